//! The header of a PCD file, checked before pcd-rs reads it.

use std::collections::HashMap;

use crate::io::content_error::{ContentError, MAX_HEADER_BYTES, quote_start, truncate_message};

/// The header as text, with the positions of its entries for error messages.
#[derive(Default)]
pub(in crate::io) struct PcdHeader {
    pub text: String,
    pub bytes: usize,
    /// The line of each entry, by its keyword.
    lines: HashMap<String, usize>,
    pub last: usize,
    /// Comments, without the line that identifies the format.
    pub comments: usize,
}

impl PcdHeader {
    /// Finds the end of the header and checks the numbers of each entry: pcd-rs reports neither the
    /// entry that is no number nor a repeated entry.
    pub fn parse(content: &[u8]) -> Result<PcdHeader, ContentError> {
        let start = &content[..content.len().min(MAX_HEADER_BYTES)];
        let mut head = PcdHeader::default();
        for line in start.split_inclusive(|&byte| byte == b'\n') {
            head.bytes += line.len();
            head.last += 1;
            // Comments come in any encoding; all other header text is ascii.
            let line = String::from_utf8_lossy(line);
            head.text.push_str(&line);
            head.comments += usize::from(line.contains('#') && !line.starts_with("# .PCD"));
            let mut words = line.split('#').next().unwrap_or_default().split_ascii_whitespace();
            let Some(keyword) = words.next().map(str::to_uppercase) else { continue };
            check_numbers(&keyword, words).map_err(|what| ContentError::line(head.last, what))?;
            let is_data = keyword == "DATA";
            if let Some(first) = head.lines.insert(keyword, head.last) {
                let what = format!("repeats the entry of line {first}");
                return Err(ContentError::line(head.last, what));
            }
            if is_data {
                return Ok(head);
            }
        }
        Err(ContentError::new(format!("there is no DATA entry in the first {} bytes", start.len())))
    }

    /// Creates an error in the entry `keyword`.
    pub fn at(&self, keyword: &str, what: String) -> ContentError {
        match self.lines.get(keyword) {
            Some(&line) => ContentError::line(line, what),
            None => ContentError::new(what),
        }
    }

    /// Converts an error of pcd-rs, with the line of the entry that it names.
    pub fn fault(&self, error: pcd_rs::Error) -> ContentError {
        let what = match error {
            pcd_rs::Error::ParseError { desc, .. } => desc,
            other => other.to_string(),
        };
        let mut words = what.split_whitespace().map(str::to_uppercase);
        let entry = words.find(|word| self.lines.contains_key(word)).unwrap_or_default();
        self.at(&entry, format!("the header is not understood: {}", truncate_message(&what)))
    }
}

/// Checks that an entry's values are the numbers that its keyword requires.
fn check_numbers<'a>(
    keyword: &str,
    mut values: impl Iterator<Item = &'a str>,
) -> Result<(), String> {
    let is_count = |value: &str| value.parse::<u64>().is_ok();
    let is_finite = |value: &str| value.parse().is_ok_and(f64::is_finite);
    let (bad, expected) = match keyword {
        "SIZE" | "COUNT" | "WIDTH" | "HEIGHT" | "POINTS" => {
            (values.find(|value| !is_count(value)), "a whole number, 0 or more")
        }
        "VIEWPOINT" => (values.find(|value| !is_finite(value)), "a finite number"),
        _ => (None, ""),
    };
    match bad {
        Some(value) => Err(format!("{keyword} has {}, expected {expected}", quote_start(value))),
        None => Ok(()),
    }
}
