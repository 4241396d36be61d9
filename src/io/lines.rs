//! Text: its lines, and the numbers in them.

use super::content_error::ContentError;

/// Iterates over the trimmed lines that are not blank, with their number from 1.
///
/// Lines end at `\n`, `\r\n` or `\r`: if `\r` were not an ending, a file with `\r` endings would be
/// one long line.
#[derive(Debug)]
pub(super) struct Lines<'a> {
    content: &'a [u8],
    at: usize,
    number: usize,
}

impl<'a> Lines<'a> {
    /// Iterates over the lines of `content` from byte `at` on, after `before` lines of the file.
    pub fn new(content: &'a [u8], at: usize, before: usize) -> Self {
        Lines { content, at, number: before }
    }

    /// Returns the bytes not read yet.
    pub fn rest(&self) -> &'a [u8] {
        self.content.get(self.at..).unwrap_or_default()
    }

    /// Returns the number of the last line read.
    pub fn number(&self) -> usize {
        self.number
    }
}

impl<'a> Iterator for Lines<'a> {
    type Item = Result<(usize, &'a str), ContentError>;

    fn next(&mut self) -> Option<Self::Item> {
        loop {
            let rest = self.rest();
            if rest.is_empty() {
                return None;
            }
            let start = self.at;
            let end = rest.iter().position(|&byte| byte == b'\n' || byte == b'\r');
            let (line, after) = rest.split_at(end.unwrap_or(rest.len()));
            let ending = if after.starts_with(b"\r\n") { 2 } else { after.len().min(1) };
            self.at += line.len() + ending;
            self.number += 1;
            match std::str::from_utf8(line) {
                Ok(line) if line.trim().is_empty() => continue,
                Ok(line) => return Some(Ok((self.number, line.trim()))),
                Err(error) => {
                    let byte = start + error.valid_up_to();
                    return Some(Err(ContentError::byte(byte, "is not UTF-8 text")));
                }
            }
        }
    }
}

/// Parses the number in `word`: anything Rust reads, including `nan` and `inf`, and the NaNs of
/// other C libraries, `-nan(ind)` and `1.#QNAN`.
pub(super) fn number(word: &str) -> Option<f64> {
    word.parse().ok().or_else(|| {
        let bare = word.trim_start_matches(['+', '-']);
        let nan = bare.starts_with("1.#")
            || bare.get(..4).is_some_and(|start| start.eq_ignore_ascii_case("nan("));
        nan.then_some(f64::NAN)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_end_in_every_way_and_keep_their_numbers() {
        let lines: Vec<_> =
            Lines::new(b"a\r\n\r\nb\rc\n\n d ", 0, 10).map(Result::unwrap).collect();
        assert_eq!(lines, [(11, "a"), (13, "b"), (14, "c"), (16, "d")]);
    }

    #[test]
    fn numbers_of_all_libraries_are_read() {
        assert_eq!(number(".5").or(number("x")), Some(0.5));
        for word in ["nan", "-NaN", "-nan(ind)", "1.#QNAN", "-1.#IND"] {
            assert!(number(word).unwrap().is_nan(), "{word}");
        }
        assert_eq!(number("-inf"), Some(f64::NEG_INFINITY));
        assert_eq!(number("1,5").or(number("0x10")).or(number("")), None);
    }
}
