//! Names of columns: what channels may be called, and what formats hold.

use std::collections::HashMap;

use crate::cloud::Channels;

/// Names that are taken, without regard to case.
#[derive(Default)]
pub(super) struct UniqueNames {
    /// In lower case, with the number that is tried next behind the name.
    taken: HashMap<String, usize>,
}

impl UniqueNames {
    /// Takes a name: `wanted` itself, or with the first number behind it that is free.
    pub fn make_unique(&mut self, wanted: String) -> String {
        let key = wanted.to_lowercase();
        let Some(&first) = self.taken.get(&key) else {
            self.taken.insert(key, 2);
            return wanted;
        };
        let mut number = first;
        let free = loop {
            let next = format!("{wanted}_{number}");
            number += 1;
            if !self.taken.contains_key(&next.to_lowercase()) {
                break next;
            }
        };
        // The next one with that name need not try these again.
        self.taken.insert(key, number);
        self.taken.insert(free.to_lowercase(), 2);
        free
    }
}

/// The name of the channel that a column of this name becomes: what is no part of a name turns
/// into `_`, and what then is none into the number of the column, from 1.
pub(super) fn channel_name(name: &str, column: usize) -> String {
    if Channels::is_name(name) {
        return name.into();
    }
    let spelled = sanitize_name(name, |c| c.is_alphanumeric() || matches!(c, '_' | '-' | '.'));
    if Channels::is_name(&spelled) { spelled } else { format!("column_{}", column + 1) }
}

/// `name` with one `_` for each stretch of characters that do not fit, none at its ends.
pub(super) fn sanitize_name(name: &str, fits: impl Fn(char) -> bool) -> String {
    let mut spelled = String::new();
    for c in name.chars() {
        if fits(c) {
            spelled.push(c);
        } else if !spelled.is_empty() && !spelled.ends_with('_') {
            spelled.push('_');
        }
    }
    if !name.ends_with('_') {
        spelled.truncate(spelled.trim_end_matches('_').len());
    }
    spelled
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_become_those_of_channels() {
        for (name, expected) in [
            ("glow", "glow"),
            ("GPS Time", "GPS_Time"),
            (" Height (m) ", "Height_m"),
            ("a,,b_", "a_b_"),
            ("größe", "größe"),
            ("", "column_8"),
            ("1e5", "column_8"),
            ("???", "column_8"),
            ("(nx)", "column_8"),
        ] {
            assert_eq!(channel_name(name, 7), expected);
            assert!(Channels::is_name(expected));
        }
    }

    #[test]
    fn a_name_is_taken_once() {
        let mut names = UniqueNames::default();
        let taken = ["a", "A", "a_2", "a", "a_2", "b"].map(|name| names.make_unique(name.into()));
        assert_eq!(taken, ["a", "A_2", "a_2_2", "a_3", "a_2_3", "b"]);
    }
}
