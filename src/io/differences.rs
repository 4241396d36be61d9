//! Differences between a file and a cloud: omissions and changes.

use std::fmt;

/// The differences between a file and the cloud that is read from it or written to it.
///
/// The text form is one line with the first few of each: `left out: 69451 faces, 2 comments;
/// changed: a.b is called a_b`.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
#[non_exhaustive]
pub struct Differences {
    /// Nouns: contents of the input that the output lacks.
    pub left_out: Vec<String>,
    /// Clauses: contents that the output has in another form.
    pub changed: Vec<String>,
    /// Clauses: contradictions in the input, and how they were resolved.
    pub notes: Vec<String>,
}

impl Differences {
    /// Returns whether nothing is left out or changed.
    pub fn is_empty(&self) -> bool {
        self.left_out.is_empty() && self.changed.is_empty() && self.notes.is_empty()
    }

    /// Appends `others`.
    pub fn merge(mut self, others: Differences) -> Differences {
        self.left_out.extend(others.left_out);
        self.changed.extend(others.changed);
        self.notes.extend(others.notes);
        self
    }

    /// Appends `others`.
    pub(super) fn merge_in_place(&mut self, others: Differences) {
        *self = std::mem::take(self).merge(others);
    }

    /// Adds an omission.
    pub(super) fn leave_out(&mut self, what: impl Into<String>) {
        self.left_out.push(what.into());
    }

    /// Adds `count` omissions, if there are any; `one` is the singular.
    pub(super) fn leave_out_all(&mut self, count: usize, one: &str) {
        match count {
            0 => {}
            1 => self.leave_out(format!("1 {one}")),
            _ => self.leave_out(format!("{count} {one}s")),
        }
    }

    /// Adds a change.
    pub(super) fn change(&mut self, what: impl Into<String>) {
        self.changed.push(what.into());
    }

    /// Adds a contradiction in the input, and how it was resolved.
    pub(super) fn note(&mut self, what: impl Into<String>) {
        self.notes.push(what.into());
    }

    /// Adds a renamed column or channel.
    pub(super) fn rename(&mut self, from: &str, to: &str) {
        let from =
            if from.is_empty() { "a column without a name".into() } else { truncate_name(from) };
        self.change(format!("{from} is called {}", truncate_name(to)));
    }
}

impl fmt::Display for Differences {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        const MAX_LISTED: usize = 8;
        let listed = |all: &[String]| {
            let first = all[..all.len().min(MAX_LISTED)].join(", ");
            match all.len().saturating_sub(MAX_LISTED) {
                0 => first,
                more => format!("{first} and {more} more"),
            }
        };
        let parts = [
            ("left out: ", listed(&self.left_out)),
            ("changed: ", listed(&self.changed)),
            ("note: ", listed(&self.notes)),
        ];
        let mut gap = "";
        for (word, text) in parts.iter().filter(|(_, text)| !text.is_empty()) {
            write!(f, "{gap}{word}{text}")?;
            gap = "; ";
        }
        Ok(())
    }
}

/// Formats a name for one line: without control characters, cut if it is long.
pub(super) fn truncate_name(name: &str) -> String {
    const LONGEST: usize = 40;
    let plain = |c: char| if c.is_control() { '?' } else { c };
    let start: String = name.chars().take(LONGEST).map(plain).collect();
    if start.len() < name.len() { start + "..." } else { start }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_line_says_the_first_few() {
        let mut differences = Differences::default();
        assert!(differences.is_empty() && differences.to_string().is_empty());
        differences.leave_out_all(0, "face");
        differences.rename("a.b", "a_b");
        assert_eq!(differences.to_string(), "changed: a.b is called a_b");
        differences.leave_out_all(2, "comment");
        for k in 0..12 {
            differences.rename(&"x\n".repeat(40), &format!("c{k}"));
        }
        let text = differences.to_string();
        assert!(text.starts_with("left out: 2 comments; changed: a.b is called a_b, x?x?"));
        assert!(text.ends_with("is called c6 and 5 more") && text.lines().count() == 1, "{text}");
    }
}
