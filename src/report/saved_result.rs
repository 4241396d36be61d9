//! A result that was kept in a file.

use std::path::{Path, PathBuf};

use super::PairReport;
use super::facts::Facts;
use crate::cloud::{PointCloud, ViewpointSource};
use crate::error::{Error, Result};
use crate::filter::Downsampling;
use crate::io;

/// What `cfreg register --json` printed, read again.
pub struct SavedResult {
    facts: Facts,
    path: PathBuf,
}

impl SavedResult {
    /// Reads a result.
    ///
    /// # Errors
    /// [`Error::Io`]; [`Error::Parse`] for what is no such result.
    pub fn read(path: &Path) -> Result<SavedResult> {
        let text = io::limited_file::read_text(
            path,
            io::limited_file::MAX_DOCUMENT_BYTES,
            "what `cfreg register --json` prints",
        )?;
        Ok(SavedResult { facts: Facts::read(&text, path)?, path: path.to_path_buf() })
    }

    /// Files of source and target, as the command was given them.
    ///
    /// # Errors
    /// [`Error::Parse`] for a result that names none.
    pub fn files(&self) -> Result<[&Path; 2]> {
        match (&self.facts.source, &self.facts.target) {
            (Some(source), Some(target)) => Ok([Path::new(source), Path::new(target)]),
            _ => Err(self.parse_error("does not name its clouds (source and target)".into())),
        }
    }

    /// How they were thinned before they were registered.
    pub fn thinning(&self) -> Downsampling {
        self.facts.thinning()
    }

    /// Whether rows that mark measurements without a return were kept, or there were none.
    pub fn keeps_no_returns(&self) -> bool {
        let ends = self.facts.first().points.as_ref();
        ends.is_none_or(|ends| ends.source.no_returns + ends.target.no_returns == 0)
    }

    /// Where their sensors stood.
    pub fn viewpoints(&self) -> ViewpointSource {
        self.facts.viewpoints.unwrap_or_default()
    }

    /// The report on the clouds, read and thinned again.
    ///
    /// # Errors
    /// [`Error::Parse`] where they have other numbers of points than then.
    pub fn pair<'a>(
        &self,
        source: &'a PointCloud,
        target: &'a PointCloud,
    ) -> Result<PairReport<'a>> {
        let ends = self.facts.first().points.as_ref();
        let counted = ends.map(|ends| [(&ends.source, source), (&ends.target, target)]);
        // Of consensus `used` leaves out what lies at a sensor's limit.
        for (then, cloud) in counted.into_iter().flatten() {
            if then.used > cloud.len() || then.dropped != cloud.dropped() {
                let what = format!(
                    "was made of a cloud of {} points, {} left out; now it has {} and {}: has the \
                     file changed?",
                    then.used,
                    then.dropped,
                    cloud.len(),
                    cloud.dropped()
                );
                return Err(self.parse_error(what));
            }
        }
        Ok(PairReport::from_facts(self.facts.clone(), source, target))
    }

    fn parse_error(&self, what: String) -> Error {
        Error::parse(&self.path, None, what)
    }
}
