//! Files of several scans, and the choice of one.

use std::path::{Path, PathBuf};

use super::content_error::ContentError;
use super::differences::{Differences, truncate_name};

/// The scans of a file that are read.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub(super) enum ScanChoice {
    /// All, as one cloud.
    #[default]
    All,
    /// One, by its number from 1 or by its name.
    One(String),
}

/// Splits `FILE#SCAN` into the file and the choice, where no file has the whole name.
pub(super) fn split_path(path: &Path) -> (PathBuf, ScanChoice) {
    let whole = || (path.to_path_buf(), ScanChoice::All);
    let Some(name) = path.file_name().and_then(|name| name.to_str()) else { return whole() };
    match name.rsplit_once('#') {
        Some((file, scan)) if !file.is_empty() && !scan.is_empty() && !path.exists() => {
            (path.with_file_name(file), ScanChoice::One(scan.into()))
        }
        _ => whole(),
    }
}

/// The scans of a file, in order, of which some are chosen.
pub(super) struct ScanList<'a> {
    choice: &'a ScanChoice,
    names: Vec<String>,
    chosen: usize,
}

/// Most names of scans that a message lists.
const MAX_LISTED: usize = 12;

impl<'a> ScanList<'a> {
    /// Creates the list of a file whose scans are not known yet.
    pub fn new(choice: &'a ScanChoice) -> Self {
        ScanList { choice, names: Vec::new(), chosen: 0 }
    }

    /// Adds the next scan, and returns whether it is chosen.
    pub fn next(&mut self, name: Option<&str>) -> bool {
        let number = self.names.len() + 1;
        let is_chosen = match self.choice {
            ScanChoice::All => true,
            ScanChoice::One(own) => name == Some(own) || *own == number.to_string(),
        };
        self.names.push(match name {
            Some(name) => format!("{number} ({})", truncate_name(name)),
            None => number.to_string(),
        });
        self.chosen += usize::from(is_chosen);
        is_chosen
    }

    /// Refuses a choice that no scan, or more than one, fits.
    pub fn check(&self) -> Result<(), ContentError> {
        let ScanChoice::One(own) = self.choice else { return Ok(()) };
        if self.chosen == 1 {
            return Ok(());
        }
        let found = if self.chosen == 0 { "no scan is" } else { "more than one scan is" };
        let names = &self.names[..self.names.len().min(MAX_LISTED)];
        let what = format!(
            "{found} {}; the file has {}: {}",
            truncate_name(own),
            self.names.len(),
            names.join(", ")
        );
        Err(ContentError::new(what))
    }

    /// Notes that a cloud of several scans has no single place of a sensor.
    pub fn note_places(&self, places: usize, differences: &mut Differences) {
        if self.chosen > 1 {
            let scans = self.chosen;
            differences.note(format!(
                "{scans} scans are one cloud, without the {places} places of their sensors: \
                 FILE#1 reads the first alone, with its place"
            ));
        }
    }
}

/// Refuses a choice in a format that has one cloud.
pub(super) fn refuse_choice(choice: &ScanChoice) -> Result<(), ContentError> {
    match choice {
        ScanChoice::All => Ok(()),
        ScanChoice::One(name) => Err(ContentError::new(format!(
            "has one cloud, of which #{} picks none: it picks scans of E57 and PTX and arrays of NPZ",
            truncate_name(name)
        ))),
    }
}
