//! Section V: terrestrial scans with partial overlap, on which the full connection fails.
//!
//! The paper's lecture hall was not available; two terrestrial scans of 3DTK's sample data are
//! similar.

use std::path::Path;

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use serde::Serialize;

use super::pictures::pair;
use super::record::SEED;
use crate::Motion;
use crate::files;
use cfreg::cloud::{PointCloud, Transform};
use cfreg::error::{Error, Result};
use cfreg::figure::Panel;
use cfreg::method::{Cf, CfSpectral, Cfk, Method, Register};
use cfreg::verify::{PoseError, pose_error};
use cfreg::{filter, io};

/// Number of points drawn from each scan (section V).
pub const POINTS: usize = 30_000;
/// The pair, from the data folder, as `pairs.csv` names it.
const PAIR: (&str, &str) = ("tls_3dtk/scan001.ply", "tls_3dtk/scan000.ply");

/// The pair and its results.
pub struct LectureHall {
    source: PointCloud,
    target: PointCloud,
    outcomes: Vec<LectureHallResult>,
}

/// The result of a method.
#[derive(Debug, Clone, Serialize)]
pub struct LectureHallResult {
    /// The method's name on the command line.
    pub method: &'static str,
    /// The estimated pose.
    pub transform: Transform,
    /// Whether the method reports that the pose may be trusted.
    pub trusted: bool,
    /// The error of the pose; the translation in the scans' unit, centimetres.
    pub error: PoseError,
}

/// Registers `points` of each scan, the source rotated at random, by CF, CFK and CF at three
/// scales; `None` if the scans are missing.
///
/// # Errors
/// The errors of the readers and of the methods.
pub fn run(data: &Path, points: usize) -> Result<Option<LectureHall>> {
    let (source, target) = (data.join(PAIR.0), data.join(PAIR.1));
    let Some(truth) = truth(&data.join("pairs.csv"))? else { return Ok(None) };
    if !(source.is_file() && target.is_file()) {
        return Ok(None);
    }
    let read = |path: &Path, seed| {
        let cloud = io::read(path)?;
        Ok::<_, Error>(filter::sample(&cloud, points, seed))
    };
    // The scanner was at the origin of its file; the viewpoint moves along.
    let seen = |cloud: PointCloud| cloud.with_viewpoint([0.0; 3]);
    let (source, target) = (seen(read(&source, 1)?)?, seen(read(&target, 2)?)?);
    let mut rng = ChaCha8Rng::seed_from_u64(SEED);
    let motion = Motion::Large.draw(source.centroid(), &mut rng);
    let (source, truth) = (source.transformed(&motion)?, truth.after(&motion.inverse()));
    let outcome = |(name, method): (&'static str, Method)| {
        let found = method.register(&source, &target)?;
        let error = pose_error(&found.transform, &truth, source.centroid());
        let (transform, trusted) = (found.transform, found.trusted);
        Ok::<_, Error>(LectureHallResult { method: name, transform, trusted, error })
    };
    let methods = [
        ("cf", Method::Cf(Cf::default())),
        ("cfk", Method::Cfk(Cfk::default())),
        ("cf-multiscale", Method::Cf(Cf::multiscale())),
        ("cf-spectral", Method::CfSpectral(CfSpectral::default())),
    ];
    let outcomes = methods.into_iter().map(outcome).collect::<Result<_>>()?;
    Ok(Some(LectureHall { source, target, outcomes }))
}

/// Returns the clouds before registration, and under each pose.
pub fn panels(hall: &LectureHall) -> Vec<Panel> {
    let panel =
        |title: String, source: &PointCloud| Panel { title, content: pair(&hall.target, source) };
    let mut panels = vec![panel("initial (terrestrial scans that stand in)".into(), &hall.source)];
    for outcome in &hall.outcomes {
        if let Ok(moved) = hall.source.transformed(&outcome.transform) {
            let verdict = if outcome.trusted { "trusted" } else { "not trusted" };
            let off = outcome.error.rotation_deg;
            panels
                .push(panel(format!("{}: off by {off:.0} deg, {verdict}", outcome.method), &moved));
        }
    }
    panels
}

/// Writes the outcomes as JSON.
///
/// # Errors
/// [`Error::Io`].
pub fn write(hall: &LectureHall, path: &Path) -> Result<()> {
    let text = serde_json::to_string_pretty(&hall.outcomes).unwrap_or_default();
    files::write_bytes(path, (text + "\n").as_bytes())
}

/// Reads the pair's true pose from the table of pairs; `None` if the table is missing, or lacks the
/// pair.
fn truth(table: &Path) -> Result<Option<Transform>> {
    let Ok(mut reader) = csv::Reader::from_path(table) else { return Ok(None) };
    let parse = |what: String| Error::parse(table, None, what);
    let columns = reader.headers().map_err(|error| parse(error.to_string()))?.clone();
    let column = |name: &str| {
        columns.iter().position(|x| x == name).ok_or_else(|| parse(format!("has no {name}")))
    };
    let (source, target, first) = (column("source")?, column("target")?, column("t00")?);
    for row in reader.records() {
        let row = row.map_err(|error| parse(error.to_string()))?;
        if (row.get(source), row.get(target)) != (Some(PAIR.0), Some(PAIR.1)) {
            continue;
        }
        let mut matrix = [[0.0; 4]; 4];
        for (k, entry) in matrix.as_flattened_mut().iter_mut().enumerate() {
            let word = row.get(first + k).unwrap_or_default();
            *entry = word.parse().map_err(|_| parse(format!("{word:?} is not a number")))?;
        }
        return Transform::from_matrix(matrix).map(Some);
    }
    Ok(None)
}
