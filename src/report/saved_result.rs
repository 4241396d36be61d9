//! A result that was saved to a file.

use std::path::{Path, PathBuf};

use serde::Deserialize;
use serde::de::DeserializeOwned;

use super::PairReport;
use crate::cloud::{PointCloud, ViewpointSource};
use crate::error::{Error, Result};
use crate::filter::Downsampling;
use crate::io;
use crate::method::Registration;

/// The output of `cfreg register --json`, read from a file.
pub struct SavedResult {
    found: Registration,
    command: SavedCommand,
    path: PathBuf,
}

/// The inputs of the command, which its output has beside the registration.
#[derive(Default, Deserialize)]
#[serde(default)]
struct SavedCommand {
    source: Option<String>,
    target: Option<String>,
    thinning: Downsampling,
    viewpoints: ViewpointSource,
    command: Option<String>,
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
        Ok(SavedResult {
            found: parse(&text, path)?,
            command: parse(&text, path)?,
            path: path.to_path_buf(),
        })
    }

    /// Returns the files of source and target, as in the command.
    ///
    /// # Errors
    /// [`Error::Parse`] for a result without them.
    pub fn files(&self) -> Result<[&Path; 2]> {
        match (&self.command.source, &self.command.target) {
            (Some(source), Some(target)) => Ok([Path::new(source), Path::new(target)]),
            _ => Err(self.parse_error("does not name its clouds (source and target)".into())),
        }
    }

    /// Returns the downsampling before registration; a voxel size that is a setting of the method
    /// itself does not count.
    pub fn thinning(&self) -> Downsampling {
        let thinning = self.command.thinning;
        let own = self.found.first().method.name == "consensus";
        Downsampling { voxel: thinning.voxel.filter(|_| !own), ..thinning }
    }

    /// Returns whether rows that mark measurements without a return were kept, or none were
    /// present.
    pub fn keeps_no_returns(&self) -> bool {
        let points = self.found.first().points;
        points.source.no_returns + points.target.no_returns == 0
    }

    /// Returns the source of the sensor viewpoints.
    pub fn viewpoints(&self) -> ViewpointSource {
        self.command.viewpoints
    }

    /// Creates the report on the clouds, which were read and downsampled again.
    ///
    /// # Errors
    /// [`Error::Parse`] if their numbers of points differ from those in the result.
    pub fn pair<'a>(
        &'a self,
        source: &'a PointCloud,
        target: &'a PointCloud,
    ) -> Result<PairReport<'a>> {
        let points = self.found.first().points;
        // For consensus, `used` excludes points at the maximum range of a sensor.
        for (then, cloud) in [(points.source, source), (points.target, target)] {
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
        let mut pair = PairReport::new(&self.found, source, target);
        if let (Some(source), Some(target)) = (&self.command.source, &self.command.target) {
            pair.names = [source.clone(), target.clone()];
        }
        pair.command = self.command.command.clone();
        Ok(pair)
    }

    fn parse_error(&self, what: String) -> Error {
        Error::parse(&self.path, None, what)
    }
}

/// Parses one JSON object.
fn parse<T: DeserializeOwned>(text: &str, path: &Path) -> Result<T> {
    serde_json::from_str(text).map_err(|error| {
        let what = format!("is not what `cfreg register --json` prints: {error}");
        let what = io::truncate_message(&what);
        Error::parse(path, Some(error.line()), what)
    })
}
