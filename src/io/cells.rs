//! The cells of a line of text: how they are separated, and how numbers in them are written.

use std::cell::Cell;

use super::content_error::ContentError;
use super::lines::number;

/// The separator of the cells of a row.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Separator {
    Semicolon,
    Comma,
    /// White space.
    Space,
}

impl Separator {
    /// Detects the separator of a row: semicolons if there are any, else commas unless these are
    /// decimal commas in words that white space separates, else white space.
    pub fn detect(line: &str) -> Separator {
        if line.contains(';') {
            return Separator::Semicolon;
        }
        let mut words = line.split_whitespace();
        let is_number = |word: &str| number(word).is_some() || decimal_comma(word).is_some();
        match line.contains(',') {
            true if words.clone().count() >= 3 && words.all(is_number) => Separator::Space,
            true => Separator::Comma,
            false => Separator::Space,
        }
    }

    /// Reads the line `sep=;` that spreadsheets write first.
    pub fn from_declaration(line: &str) -> Option<Separator> {
        let (word, declared) = line.trim_matches('"').split_once('=')?;
        match declared.trim_matches(' ') {
            _ if !word.eq_ignore_ascii_case("sep") => None,
            ";" => Some(Separator::Semicolon),
            "," => Some(Separator::Comma),
            "" | "\t" => Some(Separator::Space),
            _ => None,
        }
    }

    /// Splits a row into its cells.
    pub fn words(self, line: &str) -> Words<'_> {
        match self {
            Separator::Semicolon => Words::Separated(line.split(';')),
            Separator::Comma => Words::Separated(line.split(',')),
            Separator::Space => Words::Spaced(line.split_whitespace()),
        }
    }
}

/// Splits a line of names into words, at its own separator if none is declared. Units in brackets
/// between white space are no words.
pub(super) fn bare_words(
    line: &str,
    declared: Option<Separator>,
) -> impl Iterator<Item = &str> + Clone {
    let by_letters = [(';', Separator::Semicolon), (',', Separator::Comma)]
        .into_iter()
        .find(|(letter, _)| line.contains(*letter))
        .map_or(Separator::Space, |(_, separator)| separator);
    let separator = declared.unwrap_or(by_letters);
    let is_unit = move |word: &str| {
        separator == Separator::Space
            && [('[', ']'), ('(', ')')]
                .iter()
                .any(|&(open, close)| word.starts_with(open) && word.ends_with(close))
    };
    separator.words(line).filter(move |word| !is_unit(word))
}

/// The cells of a line.
#[derive(Clone)]
pub(super) enum Words<'a> {
    Separated(std::str::Split<'a, char>),
    Spaced(std::str::SplitWhitespace<'a>),
}

impl<'a> Iterator for Words<'a> {
    type Item = &'a str;

    fn next(&mut self) -> Option<&'a str> {
        match self {
            Words::Separated(words) => words.next().map(|word| word.trim().trim_matches('"')),
            Words::Spaced(words) => words.next().map(|word| word.trim_matches('"')),
        }
    }
}

/// Splits a line into data and comment. A mark within a word starts no comment: some libraries
/// write a NaN as `1.#QNAN`.
pub(super) fn split_comment(line: &str) -> (&str, Option<&str>) {
    let starts = |&(at, _): &(usize, &str)| at == 0 || line[..at].ends_with([' ', '\t', ',', ';']);
    let marks = ["#", "//", "%"];
    let marks = marks.into_iter().filter_map(|mark| line.match_indices(mark).find(starts));
    match marks.min() {
        Some((at, mark)) => (line[..at].trim_end(), Some(&line[at + mark.len()..])),
        None => (line, None),
    }
}

/// Returns whether a line has names, and no word like a number: a line with both is a broken point.
pub(super) fn is_header<'a>(mut words: impl Iterator<Item = &'a str>) -> bool {
    let mut some = false;
    let mut is_name = |word: &str| {
        some |= !word.is_empty();
        cell(word, false).is_none() && !word.starts_with(|c: char| c.is_ascii_digit())
    };
    words.all(&mut is_name) && some
}

/// Returns the number in a cell; NaN for the words that stand for a missing one, and for nothing
/// where cells may be empty.
fn cell(word: &str, may_be_empty: bool) -> Option<f64> {
    let missing = || {
        (word.is_empty() && may_be_empty)
            || ["na", "n/a", "null"].iter().any(|missing| missing.eq_ignore_ascii_case(word))
    };
    number(word).or_else(|| missing().then_some(f64::NAN))
}

/// Returns the number in a word with a decimal comma: digits around one comma.
fn decimal_comma(word: &str) -> Option<f64> {
    let (whole, fraction) = word.split_once(',')?;
    let digits = whole.trim_start_matches(['+', '-']);
    let is_whole = !digits.is_empty() && digits.bytes().all(|byte| byte.is_ascii_digit());
    let starts = fraction.starts_with(|c: char| c.is_ascii_digit());
    let plain = !fraction.contains(',') && !fraction.contains('.');
    (is_whole && starts && plain).then(|| number(&format!("{whole}.{fraction}"))).flatten()
}

/// How the numbers of a file are written, as far as it is read.
#[derive(Debug, Default)]
pub(super) struct NumberStyle {
    has_commas: Cell<bool>,
    has_points: Cell<bool>,
}

impl NumberStyle {
    /// Returns the number in a cell. Where commas do not separate cells, they may be decimal.
    pub fn number(&self, word: &str, separator: Separator) -> Option<f64> {
        let found = cell(word, separator != Separator::Space);
        match found {
            Some(_) => {
                if !self.has_points.get() && word.contains('.') {
                    self.has_points.set(true);
                }
                found
            }
            None if separator != Separator::Comma => {
                let found = decimal_comma(word);
                if found.is_some() {
                    self.has_commas.set(true);
                }
                found
            }
            None => None,
        }
    }

    /// Returns whether any number had a decimal comma.
    pub fn has_decimal_commas(&self) -> bool {
        self.has_commas.get()
    }

    /// Refuses a file that has decimal points and decimal commas: one of them may separate
    /// thousands.
    pub fn check_decimals(&self, line: usize) -> Result<(), ContentError> {
        if !(self.has_commas.get() && self.has_points.get()) {
            return Ok(());
        }
        let what = "numbers have decimal points in some places and commas in others, which may \
                    separate thousands: write decimal points alone";
        Err(ContentError::line(line, what))
    }

    /// Refuses a row of cells separated by commas, of which every other comma may be decimal: an
    /// even number of whole numbers, without names for them.
    pub fn check_row(
        &self,
        line: &str,
        separator: Separator,
        has_names: bool,
        number: usize,
    ) -> Result<(), ContentError> {
        let may_be = separator == Separator::Comma && !has_names && !self.has_points.get();
        if !may_be || !has_decimal_pairs(line) {
            return Ok(());
        }
        let what = "commas may be decimal points and separators (0,9375, 2,2289, ... are 3 numbers \
                    or 6): write decimal points, separate by semicolons, or add a first line with \
                    the names of the columns, as x,y,z,red,green,blue";
        Err(ContentError::line(number, what))
    }
}

/// Returns whether the cells of a row look like numbers with decimal commas: six whole numbers or
/// more, an even number, of which each second one looks like a fraction by a leading zero, by the
/// same three digits or more in each, or by the lack of a space before it.
fn has_decimal_pairs(line: &str) -> bool {
    let cells: Vec<&str> = line.split(',').collect();
    let is_digits = |word: &str| !word.is_empty() && word.bytes().all(|byte| byte.is_ascii_digit());
    if cells.len() < 6 || cells.len() % 2 == 1 {
        return false;
    }
    let pairs = cells.as_chunks::<2>().0;
    let is_pair = |[whole, fraction]: &[&str; 2]| {
        is_digits(whole.trim().trim_start_matches(['+', '-'])) && is_digits(fraction.trim())
    };
    if !pairs.iter().all(is_pair) {
        return false;
    }
    let has_zero = |[_, fraction]: &[&str; 2]| {
        let fraction = fraction.trim();
        fraction.len() > 1 && fraction.starts_with('0')
    };
    let length = pairs[0][1].trim().len();
    let is_even = length >= 3 && pairs.iter().all(|[_, fraction]| fraction.trim().len() == length);
    let is_tight = |[_, fraction]: &[&str; 2]| !fraction.starts_with([' ', '\t']);
    let is_wide = |[whole, _]: &[&str; 2]| whole.starts_with([' ', '\t']);
    let by_space = pairs.iter().all(is_tight) && pairs[1..].iter().all(is_wide);
    pairs.iter().any(has_zero) || is_even || by_space
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn separators_are_told_from_decimal_commas() {
        let cases = [
            ("1;2;3", Separator::Semicolon),
            ("1,5;2,5;3", Separator::Semicolon),
            ("1,2,3", Separator::Comma),
            ("1, 2, 3", Separator::Comma),
            ("1,5 2,5 3", Separator::Space),
            ("1,5\t2,5\t-3,25", Separator::Space),
            ("1.0,2.0 3.0", Separator::Comma),
        ];
        assert!(cases.iter().all(|(line, separator)| Separator::detect(line) == *separator));
        assert_eq!(Separator::from_declaration("sep=;"), Some(Separator::Semicolon));
        assert_eq!(Separator::from_declaration("set=;"), None);
    }

    #[test]
    fn commas_that_may_be_decimal_are_refused() {
        let refused =
            ["0,9375, 2,2289, 0,8964", "1,05,2,5,3,1", "1,125,2,250,3,375", "-1,5, 2,5, 3,5"];
        assert!(refused.iter().all(|line| has_decimal_pairs(line)));
        let read = ["1,2,3", "1,2,3,255,0,0", "1,2,3,4.5,0,0", "1, 2, 3, 25, 0, 0", "1,2,3,4,5"];
        assert!(read.iter().all(|line| !has_decimal_pairs(line)));
        let style = NumberStyle::default();
        assert_eq!(style.number("-1,25", Separator::Semicolon), Some(-1.25));
        assert!(style.has_decimal_commas() && style.check_decimals(1).is_ok());
        assert_eq!(style.number("1,234.5", Separator::Semicolon), None);
        assert_eq!(style.number("1.5", Separator::Semicolon), Some(1.5));
        assert!(style.check_decimals(1).is_err());
        assert!(style.number("", Separator::Comma).unwrap().is_nan());
        assert_eq!(
            style.number("1,5", Separator::Comma).or(style.number("", Separator::Space)),
            None
        );
    }
}
