//! Column names: valid channel names, and names that formats can hold.

use std::collections::HashMap;

use crate::cloud::Channels;

/// Names in use, case-insensitive.
#[derive(Default)]
pub(super) struct UniqueNames {
    /// In lower case, with the next number to try as a suffix.
    taken: HashMap<String, usize>,
}

impl UniqueNames {
    /// Returns `wanted`, or `wanted` with the first free number as a suffix, and marks it as used.
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
        // The next name of this kind need not try these numbers again.
        self.taken.insert(key, number);
        self.taken.insert(free.to_lowercase(), 2);
        free
    }
}

/// Returns the channel name of a column: invalid characters become `_`; if no valid name results,
/// the number of the column, from 1.
pub(super) fn channel_name(name: &str, column: usize) -> String {
    if Channels::is_name(name) {
        return name.into();
    }
    let spelled = sanitize_name(name, |c| c.is_alphanumeric() || matches!(c, '_' | '-' | '.'));
    if Channels::is_name(&spelled) { spelled } else { format!("column_{}", column + 1) }
}

/// Replaces each run of characters that do not fit by one `_` and removes it at the ends.
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
