//! Keypoints: the few points of a cloud that are distinctive in their surroundings.
//!
//! Detectors return indices into the cloud, ascending and without repetition. Lengths are in
//! resolutions of the cloud, so that the unit does not matter.

mod iss;
mod sift;

pub use iss::Iss;
pub use sift::Sift;

use std::cmp::Ordering;

use serde::{Deserialize, Serialize};

use crate::error::{Error, Result};
use crate::search;

/// A keypoint detector with its settings.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Keypoints {
    /// Extrema of the curvature over position and scale (the paper's): [`Sift`].
    Sift(Sift),
    /// Intrinsic shape signatures: [`Iss`].
    Iss(Iss),
}

impl Default for Keypoints {
    fn default() -> Self {
        Keypoints::Sift(Sift::default())
    }
}

impl Keypoints {
    /// Returns the detector's name.
    pub fn name(&self) -> &'static str {
        match self {
            Keypoints::Sift(_) => "sift",
            Keypoints::Iss(_) => "iss",
        }
    }

    /// Checks the ranges.
    ///
    /// # Errors
    /// [`Error::Config`] for a setting out of its range.
    pub fn validate(&self) -> Result<()> {
        match self {
            Keypoints::Sift(sift) => sift.validate(),
            Keypoints::Iss(iss) => iss.validate(),
        }
    }

    /// Finds the indices of the keypoints. `values` is one number a point, such as its curvature;
    /// only SIFT uses it.
    ///
    /// # Errors
    /// The errors of [`Sift::detect`] and [`Iss::detect`].
    pub fn detect(&self, points: &[[f32; 3]], values: &[f32]) -> Result<Vec<usize>> {
        match self {
            Keypoints::Sift(sift) => sift.detect(points, values),
            Keypoints::Iss(iss) => iss.detect(points),
        }
    }
}

/// Returns the unit of a detector's lengths.
fn unit(points: &[[f32; 3]], given: Option<f64>) -> Result<f64> {
    let unit = given.map_or_else(|| search::resolution(points), Ok)?;
    if unit > 0.0 {
        return Ok(unit);
    }
    let rule = "most points of the cloud lie in the place of another: thin it by a voxel grid, or \
                set the unit";
    Err(Error::config("unit", unit, rule))
}

/// Orders the indices of the points by their coordinates, then by `values` (one a point, or none).
/// Sums in this order, and the choice between ties, do not depend on the order of the points.
///
/// # Errors
/// [`Error::NonFinite`] for a NaN or infinite coordinate or value.
fn canonical_order(points: &[[f32; 3]], values: &[f32]) -> Result<Vec<usize>> {
    let bad_point = points.iter().position(|p| p.iter().any(|x| !x.is_finite()));
    let bad_value = values.iter().position(|x| !x.is_finite());
    for (what, bad) in [("points", bad_point), ("values of points", bad_value)] {
        if let Some(index) = bad {
            return Err(Error::NonFinite { what: format!("{what} to be detected"), index });
        }
    }
    // Adding zero turns -0 into 0.
    let key = |&i: &usize| points[i].map(|x| x + 0.0);
    let value = |i: usize| values.get(i).copied().unwrap_or_default();
    let mut order: Vec<usize> = (0..points.len()).collect();
    order.sort_by(|a, b| {
        let places = key(a).into_iter().zip(key(b)).map(|(x, y)| x.total_cmp(&y));
        places.fold(Ordering::Equal, Ordering::then).then(value(*a).total_cmp(&value(*b)))
    });
    Ok(order)
}

/// Refuses `value` outside `low..=high`.
fn check_range(field: &'static str, value: f64, low: f64, high: f64) -> Result<()> {
    match (low..=high).contains(&value) {
        true => Ok(()),
        false => Err(Error::config(field, value, format!("must be from {low:e} to {high:e}"))),
    }
}

fn check_unit(given: Option<f64>) -> Result<()> {
    given.map_or(Ok(()), |unit| check_range("unit", unit, 1e-15, 1e15))
}
