//! One side of a full connection: the input, and its layout for passes.

use super::tile::{DescriptorRows, Panels};
use crate::cloud::{Descriptors, check_weights};
use crate::error::{Error, Result};
use crate::math::{self, Vec3};

/// Input of one side of the connection: positions and descriptors of its points.
#[derive(Debug, Clone, Copy)]
pub struct FeatureView<'a> {
    /// Positions relative to `origin`, as in [`PointCloud`](crate::PointCloud).
    pub points: &'a [[f32; 3]],
    /// Offset from `points` to the cloud's own frame.
    pub origin: Vec3,
    /// One row a point.
    pub descriptors: &'a Descriptors,
}

/// A side in both layouts: as rows to be cut into blocks, as panels to be streamed.
pub(super) struct ConnectionSide {
    pub(super) origin: Vec3,
    pub(super) points: Vec<[f32; 3]>,
    pub(super) rows: DescriptorRows,
    pub(super) panels: Panels,
    pub(super) weights: Option<PointWeights>,
}

/// Weights of a side's points as `scale` times numbers up to 1, so that f32 can represent their
/// products with others. The scale is a power of two: no digit changes.
pub(super) struct PointWeights {
    pub(super) shares: Vec<f32>,
    pub(super) scale: f64,
}

impl PointWeights {
    pub(super) fn new(weights: &[f32], points: usize, side: &str) -> Result<Self> {
        let what = format!("weights of the {side}'s points");
        if weights.len() != points {
            return Err(Error::Shape { what, expected: points, found: weights.len() });
        }
        check_weights(weights, &what)?;
        let most = f64::from(weights.iter().fold(0.0f32, |most, &weight| most.max(weight)));
        let scale = if most > 0.0 { 2f64.powi(most.log2().ceil() as i32) } else { 1.0 };
        let shares = weights.iter().map(|&weight| (f64::from(weight) / scale) as f32).collect();
        Ok(PointWeights { shares, scale })
    }
}

impl ConnectionSide {
    pub(super) fn new(described: &FeatureView<'_>, mean: &[f64], name: &str) -> Result<Self> {
        let n = described.points.len();
        if n == 0 {
            let what = format!("the {name} of a full connection");
            return Err(Error::TooFewPoints { what, found: 0, needed: 1 });
        }
        if described.descriptors.len() != n {
            return Err(Error::Shape {
                what: format!("descriptors of the {name}'s points"),
                expected: n,
                found: described.descriptors.len(),
            });
        }
        // About the centroid: sums of squares about a far origin would lose digits.
        let sum = described.points.iter().fold([0.0; 3], |s, p| math::add(s, p.map(f64::from)));
        let centroid = math::scaled(sum, 1.0 / n as f64);
        let centred = |p: &[f32; 3]| math::sub(p.map(f64::from), centroid).map(|x| x as f32);
        let rows = DescriptorRows::new(described.descriptors, mean)?;
        Ok(ConnectionSide {
            origin: math::add(described.origin, centroid),
            points: described.points.iter().map(centred).collect(),
            panels: rows.panels(),
            rows,
            weights: None,
        })
    }
}
