//! `--descriptors` and `--matches`: what other programs computed of the two clouds.

use std::path::{Path, PathBuf};

use clap::Args;
use serde::Serialize;

use crate::error::{Error, Result};
use crate::filter::Downsampling;
use crate::io::{self, ScoredPairs};
use crate::method::GivenDescriptors;

#[derive(Args, Clone, Default, Serialize)]
pub(super) struct GivenOptions {
    /// Compare points by these descriptors, such as learned ones: two NPY files, for source and
    /// target, each with one row of at most 512 numbers for every point of its cloud; for
    /// consensus, cf, cf-multiscale, cf-spectral, cfk and teaser
    #[arg(long, value_name = "A.npy,B.npy", value_delimiter = ',')]
    #[serde(skip_serializing_if = "Vec::is_empty")]
    descriptors: Vec<PathBuf>,
    /// Whether --descriptors replace FPFH or stand beside it, and the distance of two rows: replace,
    /// replace:cosine, beside, beside:cosine [default: replace, Euclidean distance]
    #[arg(long, value_name = "ROLE[:DISTANCE]", requires = "descriptors")]
    #[serde(skip)]
    given_descriptors: Option<GivenDescriptors>,
    /// Register by these correspondences: an NPY file with rows of two numbers, a row of the source
    /// and a row of the target, from 0; a third number is a score, for consensus. For consensus and
    /// teaser
    #[arg(long, value_name = "M.npy")]
    #[serde(skip_serializing_if = "Option::is_none")]
    matches: Option<PathBuf>,
    /// Scores of --matches, 0 or more, one a correspondence: an NPY file; for consensus
    #[arg(long, value_name = "S.npy", requires = "matches")]
    #[serde(skip_serializing_if = "Option::is_none")]
    scores: Option<PathBuf>,
}

impl GivenOptions {
    /// Refuses options that contradict each other.
    pub(super) fn check(&self, thinning: &Downsampling) -> Result<()> {
        if !matches!(self.descriptors.len(), 0 | 2) {
            let rule = "files: two are needed, of the source and of the target";
            return Err(Error::config("descriptors", self.descriptors.len(), rule));
        }
        let Some(matches) = &self.matches else { return Ok(()) };
        if thinning.voxel.is_some() || thinning.sample.is_some() {
            let rule = "numbers the points of the files: leave out --sample, and --voxel unless \
                        --method consensus";
            return Err(Error::config("matches", matches.display(), rule));
        }
        Ok(())
    }

    /// Files that are read.
    pub(super) fn inputs(&self) -> impl Iterator<Item = &Path> {
        let arrays = self.descriptors.iter().chain(&self.matches).chain(&self.scores);
        arrays.map(PathBuf::as_path)
    }

    /// The files of descriptors of source and target.
    pub(super) fn descriptors(&self) -> [Option<&Path>; 2] {
        [0, 1].map(|k| self.descriptors.get(k).map(PathBuf::as_path))
    }

    /// The use of descriptors, if there are any.
    pub(super) fn setting(&self) -> Option<GivenDescriptors> {
        let any = !self.descriptors.is_empty();
        any.then(|| self.given_descriptors.unwrap_or_default())
    }

    /// Whether rows of the files are named, which reading must not renumber.
    pub(super) fn names_rows(&self) -> bool {
        self.matches.is_some()
    }

    /// Reads the correspondences and their scores, if there are any.
    pub(super) fn read_matches(&self) -> Result<Option<ScoredPairs>> {
        let Some(path) = &self.matches else { return Ok(None) };
        let (pairs, scores) = io::read_correspondences(path)?;
        let Some(file) = &self.scores else { return Ok(Some((pairs, scores))) };
        if scores.is_some() {
            let rule = "would replace the third column of --matches: leave one of them out";
            return Err(Error::config("scores", file.display(), rule));
        }
        let table = io::read_array(file)?;
        if table.shape()[1] != 1 {
            let what = format!("columns of {}", file.display());
            return Err(Error::Shape { what, expected: 1, found: table.shape()[1] });
        }
        let scores = table.values().iter().map(|&score| score as f32).collect();
        Ok(Some((pairs, Some(scores))))
    }
}
