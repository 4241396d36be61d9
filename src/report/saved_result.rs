//! A result that was saved to a file.

use std::path::{Path, PathBuf};

use super::PairReport;
use super::facts::Facts;
use crate::cloud::{PointCloud, ViewpointSource};
use crate::error::{Error, Result};
use crate::filter::Downsampling;
use crate::io;

/// The output of `cfreg register --json`, read from a file.
pub struct SavedResult {
    facts: Facts,
    path: PathBuf,
}

impl SavedResult {
    /// Reads a result.
    ///
    /// # Errors
    /// [`Error::Io`]; [`Error::Parse`] for an invalid result.
    pub fn read(path: &Path) -> Result<SavedResult> {
        let text = io::limited_file::read_text(
            path,
            io::limited_file::MAX_DOCUMENT_BYTES,
            "what `cfreg register --json` prints",
        )?;
        Ok(SavedResult { facts: Facts::read(&text, path)?, path: path.to_path_buf() })
    }

    /// Returns the files of source and target, as in the command.
    ///
    /// # Errors
    /// [`Error::Parse`] for a result without them.
    pub fn files(&self) -> Result<[&Path; 2]> {
        match (&self.facts.source, &self.facts.target) {
            (Some(source), Some(target)) => Ok([Path::new(source), Path::new(target)]),
            _ => Err(self.parse_error("does not name its clouds (source and target)".into())),
        }
    }

    /// Returns the downsampling before registration.
    pub fn thinning(&self) -> Downsampling {
        self.facts.thinning()
    }

    /// Returns whether rows that mark measurements without a return were kept, or none were
    /// present.
    pub fn keeps_no_returns(&self) -> bool {
        let ends = self.facts.first().points.as_ref();
        ends.is_none_or(|ends| ends.source.no_returns + ends.target.no_returns == 0)
    }

    /// Returns the source of the sensor viewpoints.
    pub fn viewpoints(&self) -> ViewpointSource {
        self.facts.viewpoints.unwrap_or_default()
    }

    /// Creates the report on the clouds, which were read and downsampled again.
    ///
    /// # Errors
    /// [`Error::Parse`] if their numbers of points differ from those in the result.
    pub fn pair<'a>(
        &self,
        source: &'a PointCloud,
        target: &'a PointCloud,
    ) -> Result<PairReport<'a>> {
        let ends = self.facts.first().points.as_ref();
        let counted = ends.map(|ends| [(&ends.source, source), (&ends.target, target)]);
        // For consensus, `used` excludes points at the maximum range of a sensor.
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
