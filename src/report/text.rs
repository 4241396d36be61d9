//! Text of a report.

use serde::Serialize;

use super::pair_result::PairResult;
use crate::verify::{Decision, Verdict};

/// The headline of a page.
#[derive(Debug, Clone, Serialize)]
pub(super) struct Headline {
    /// `good`, `unsure` or `bad`: the colour, in addition to the text.
    pub(super) tone: &'static str,
    /// A symbol for the tone without colour.
    pub(super) sign: &'static str,
    pub(super) title: String,
    pub(super) line: String,
    /// Evidence for and against the pose, one sentence each.
    pub(super) reasons: Vec<String>,
    /// Warnings that no reason contains.
    pub(super) doubts: Vec<String>,
}

/// Colour and symbol of a headline.
const GOOD: (&str, &str) = ("good", "\u{2713}");
const UNSURE: (&str, &str) = ("unsure", "?");
const BAD: (&str, &str) = ("bad", "\u{2717}");

impl Headline {
    pub(super) fn new(result: &PairResult<'_>) -> Headline {
        let warnings = result.warnings.iter();
        let Some(verdict) = &result.verdict else {
            let (mark, title) = match result.trusted {
                true => (GOOD, "Nothing speaks against this pose"),
                false => (BAD, "This pose is doubted"),
            };
            let line = "This method gives no probability; --verdict asks for one.".into();
            let warnings = warnings.map(|warning| to_sentence(warning)).collect();
            return Headline::from_parts(mark, title, line, Vec::new(), warnings);
        };
        let (mark, title, line) = decision_text(verdict, result.trusted);
        let reasons = verdict.reasons.iter().map(|reason| to_sentence(reason)).collect();
        let new = |warning: &&String| !verdict.reasons.iter().any(|why| warning.contains(why));
        let warnings = warnings.filter(new).map(|warning| to_sentence(warning)).collect();
        Headline::from_parts(mark, title, line, reasons, warnings)
    }

    fn from_parts(
        (tone, sign): (&'static str, &'static str),
        title: &str,
        line: String,
        reasons: Vec<String>,
        doubts: Vec<String>,
    ) -> Headline {
        Headline { tone, sign, title: title.into(), line, reasons, doubts }
    }
}

/// Returns the mark, the title and the sentence of a verdict.
fn decision_text(
    verdict: &Verdict,
    trusted: bool,
) -> ((&'static str, &'static str), &'static str, String) {
    let told = format_percent(verdict.probability);
    let right = format!("Right with a probability of {told}");
    match verdict.decision {
        Decision::Accept if trusted => (GOOD, "Take this pose", format!("{right}.")),
        Decision::Accept => (
            UNSURE,
            "Likely right, but doubted",
            format!("{right} by its surfaces; but see the doubts."),
        ),
        Decision::Ambiguous => {
            let (title, line) = ambiguity_text(verdict, &right);
            (UNSURE, title, line)
        }
        Decision::Uncertain => {
            (UNSURE, "Uncertain", format!("{right}: check it before you use it."))
        }
        Decision::Reject => {
            (BAD, "Do not take this pose", format!("{right}; the clouds may share nothing."))
        }
    }
}

/// Returns the title and the sentence of an ambiguous pose, which begins with `right`.
fn ambiguity_text(verdict: &Verdict, right: &str) -> (&'static str, String) {
    let loose = verdict.covariance.as_ref().map_or(0, |known| known.unobservable.len());
    if loose > 0 {
        let line = format!(
            "{right}, but {loose} of 6 degrees of freedom are unconstrained: see the arrows."
        );
        return ("Not constrained in every direction", line);
    }
    if let Some(scale) = verdict.other_scale {
        let line = format!(
            "{right} if both have one unit; but scaled by {scale:.3} the source would lie on the \
             target better."
        );
        return ("Two scales", line);
    }
    if verdict.mirrored {
        let line = format!("{right}, but the mirror image of the source fits the target better.");
        return ("Mirrored", line);
    }
    let line = match &verdict.runner_up {
        Some(other) => {
            let other = format_percent(other.probability);
            format!("{right}, another pose with {other}: compare them.")
        }
        None => format!("{right}; an alternative is possible."),
    };
    ("One of several poses", line)
}

/// Formats a probability or share in percent, never rounded to certainty.
pub(super) fn format_percent(share: f64) -> String {
    let percent = 100.0 * share;
    match percent {
        p if p > 99.9 && p < 100.0 => "more than 99.9 %".into(),
        p if p > 0.0 && p < 0.1 => "less than 0.1 %".into(),
        p if (10.0..99.0).contains(&p) || p == 0.0 || p == 100.0 => format!("{p:.0} %"),
        p => format!("{p:.1} %"),
    }
}

/// Formats a number with four digits, without an exponent if that is short.
pub(super) fn format_number(value: f64) -> String {
    if value == 0.0 {
        return "0".into();
    }
    if !value.is_finite() {
        return "-".into();
    }
    let power = value.abs().log10().floor() as i32;
    match power {
        -4..4 => {
            let text = format!("{value:.*}", (3 - power).clamp(0, 7) as usize);
            if text.contains('.') {
                text.trim_end_matches('0').trim_end_matches('.').into()
            } else {
                text
            }
        }
        4..7 => format!("{value:.0}"),
        _ => format!("{value:.3e}"),
    }
}

/// Formats a count with spaces between thousands.
pub(super) fn format_count(count: usize) -> String {
    let digits = count.to_string();
    let first = digits.len() % 3;
    let mut groups: Vec<&str> = Vec::new();
    if first > 0 {
        groups.push(&digits[..first]);
    }
    groups.extend((first..digits.len()).step_by(3).map(|at| &digits[at..at + 3]));
    groups.join("\u{202f}")
}

/// Describes the probable unit of a cloud from its size, for objects of usual size.
pub(super) fn guess_unit(diagonal: f64) -> &'static str {
    match diagonal {
        d if d < 0.02 => "very small for metres",
        d if d < 0.6 => "metres, if it is a thing for the hand",
        d if d < 3.0 => "metres, if it is a piece of furniture or a person",
        d if d < 30.0 => "metres, if it is a room",
        d if d < 1000.0 => "metres, if it is a street or a building; millimetres, if a thing",
        d if d < 30_000.0 => "centimetres or millimetres, if it is a room or a building",
        _ => "none that is usual",
    }
}

/// Returns the names of files without their folders, if these names differ.
pub(super) fn distinct_names(names: &[String; 2]) -> [String; 2] {
    let last = |name: &String| name.rsplit(['/', '\\']).next().unwrap_or(name).to_string();
    let short = names.each_ref().map(last);
    if short[0] == short[1] || short.iter().any(String::is_empty) { names.clone() } else { short }
}

/// Capitalises the first letter, and adds a full stop.
pub(super) fn to_sentence(text: &str) -> String {
    let mut letters = text.chars();
    let first: String = letters.next().into_iter().flat_map(char::to_uppercase).collect();
    let stop = if text.ends_with(['.', '!', '?']) { "" } else { "." };
    format!("{first}{}{stop}", letters.as_str())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_short_and_never_more_certain_than_they_are() {
        assert_eq!(format_percent(0.99951), "more than 99.9 %");
        assert_eq!(format_percent(1.0), "100 %");
        assert_eq!(format_percent(0.0002), "less than 0.1 %");
        assert_eq!((format_percent(0.421), format_percent(0.034)), ("42 %".into(), "3.4 %".into()));
        assert_eq!(
            (format_number(0.0012346), format_number(12.0)),
            ("0.001235".into(), "12".into())
        );
        assert_eq!(
            (format_number(3.2e-9), format_number(123456.7)),
            ("3.200e-9".into(), "123457".into())
        );
        assert_eq!(format_number(f64::NAN), "-");
        assert_eq!(
            (format_count(12), format_count(1234567)),
            ("12".into(), "1\u{202f}234\u{202f}567".into())
        );
        assert_eq!(to_sentence("14 matches agree"), "14 matches agree.");
        let names = |a: &str, b: &str| distinct_names(&[a.into(), b.into()]);
        assert_eq!(names("a/b.ply", "/c/d.ply"), ["b.ply", "d.ply"]);
        assert_eq!(names("a/b.ply", "c/b.ply"), ["a/b.ply", "c/b.ply"]);
    }
}
