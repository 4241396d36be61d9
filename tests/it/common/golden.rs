//! Golden cases: problems solved by the independent f64 reference (`tests/golden/README.md`).

use std::fs;
use std::path::Path;

use cfreg::math::{Mat3, Vec3};
use cfreg::moments::{FeatureView, Moments};
use cfreg::pose::{self, ScaleEstimate, Solver};
use cfreg::{Descriptors, Error, PointCloud, Transform};
use serde::Deserialize;
use serde::de::DeserializeOwned;

use super::compare::{moments_difference, pose_difference};

/// `part` (`input` or `expected`) of a case.
///
/// # Panics
/// When the file is not there or not of that shape.
pub fn read<T: DeserializeOwned>(case: &str, part: &str) -> T {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden").join(case);
    let text = fs::read_to_string(folder.join(part).with_extension("json")).unwrap();
    serde_json::from_str(&text).unwrap_or_else(|error| panic!("{case}/{part}: {error}"))
}

/// f32 distances by the product, |a|² + |b|² − 2ab, are off by some 1e-7 of |a|² ≈ 2000.
/// Relative to β that is the error of a weight; it averages out in part.
pub const MOMENTS_TIMES_BETA: f64 = 1e-3;

/// [`Moments`] as the files name them.
#[derive(Deserialize)]
#[serde(remote = "Moments")]
pub struct Sums {
    pub source_origin: Vec3,
    pub target_origin: Vec3,
    pub weight: f64,
    pub weight_squared: f64,
    pub source_sum: Vec3,
    pub target_sum: Vec3,
    pub cross: Mat3,
    pub source_squares: f64,
    pub target_squares: f64,
}

#[derive(Deserialize)]
pub struct ExpectedPose {
    pub scale: f64,
    pub rotation: Mat3,
    pub translation: Vec3,
    pub residual: f64,
    pub solvers_differ_by: f64,
}

impl ExpectedPose {
    pub fn transform(&self) -> Transform {
        Transform { rotation: self.rotation, translation: self.translation, scale: self.scale }
    }
}

/// What became of a weighted connection.
#[derive(Deserialize)]
pub struct ExpectedSolution {
    #[serde(with = "Sums")]
    pub moments: Moments,
    pub effective_connections: f64,
    pub pose: Option<ExpectedPose>,
}

impl ExpectedSolution {
    /// Compares moments and what all four solvers make of them.
    pub fn check(&self, found: &Moments, tolerance: f64, context: &str) {
        let error = moments_difference(&self.moments, found);
        assert!(error < tolerance, "{context}: moments off by {error:e}");
        let error = (found.effective_connections() / self.effective_connections - 1.0).abs();
        assert!(error < tolerance, "{context}: effective connections off by {error:e}");
        for solver in Solver::ALL {
            let exact = pose::solve(&self.moments, solver, ScaleEstimate::Fixed);
            let fused = pose::solve(found, solver, ScaleEstimate::Fixed);
            let Some(pose) = &self.pose else {
                assert!(matches!(exact, Err(Error::Degenerate { .. })), "{context}: {exact:?}");
                assert!(matches!(fused, Err(Error::Degenerate { .. })), "{context}: {fused:?}");
                continue;
            };
            let error = pose_difference(&exact.unwrap().transform, &pose.transform());
            assert!(error < 1e-14, "{context}: {solver} off by {error:e}");
            // A factor on all weights turns nothing, so little of the moments' error arrives;
            // the second singular value divides what does.
            let fused = fused.unwrap();
            let error = pose_difference(&fused.transform, &pose.transform());
            let bound = 0.1 * tolerance / fused.singular_values[1];
            assert!(error < bound, "{context}: {solver} off by {error:e}, {bound:e} allowed");
        }
    }
}

#[derive(Deserialize)]
pub struct GoldenPair<S> {
    pub source: S,
    pub target: S,
}

pub fn descriptors(rows: &[Vec<f64>]) -> Descriptors {
    let values = rows.iter().flatten().map(|&x| x as f32).collect();
    Descriptors::new(rows[0].len(), values).unwrap()
}

pub fn feature_view<'a>(cloud: &'a PointCloud, descriptors: &'a Descriptors) -> FeatureView<'a> {
    FeatureView { points: cloud.points(), origin: cloud.origin(), descriptors }
}
