//! 3-D SIFT: extrema of a difference of Gaussians over position and scale, as in PCL.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use super::{canonical_order, check_range, check_unit, unit};
use crate::error::{Error, Result};
use crate::math::{self, Vec3};
use crate::par;
use crate::search::SearchTree;

/// Number of neighbours among which a keypoint is the extremum (PCL's 25).
const EXTREMUM_NEIGHBORS: usize = 25;
/// Cutoff of the Gaussians in σ (PCL's 3).
const GAUSSIAN_REACH: f64 = 3.0;

/// The SIFT detector on one scalar per point, such as its curvature (PCL's `SIFTKeypoint`; the
/// paper, section IV-A, names the detector but none of its settings).
///
/// Every octave starts from the cloud downsampled by a voxel grid of its first scale, with mean
/// values; smooths at scales σ·2^((i−1)/s), i = 0 to s + 2; and keeps the points where the
/// difference of successive scales is the extremum among the 25 nearest, in its own scale and the
/// two adjacent ones. The keypoint is the cloud's point nearest to each.
///
/// The grid starts at the cloud's lowest corner, so that a translation, such as a map offset,
/// changes nothing. PCL's grid starts at the origin: on a cloud whose lowest corner is at the
/// origin both find the same points, elsewhere 65 to 85 % of them, fewer in coarser octaves. A
/// rotation turns the cloud in the grid and has the same effect.
///
/// PCL has no default scales. The defaults here keep a fifth of 500 points of a mesh and a seventh
/// to a fifth of a scan. On the paper's protocols (27 pairs each,
/// `python -m peers.methods --only cfk` in `python-ref`) CFK's median error, compared with CF's on
/// all points, is
///
/// | min_scale, octaves, scales | points of 500 to 600 | accuracy bunny, dragon | shift bunny, dragon |
/// |---|---|---|---|
/// | CF | all | 0.187, 0.405 | 0.0106, 0.0221 |
/// | 1, 3, 4 | 38 | 0.251, 0.752 | 0.0131, 0.0300 |
/// | **0.5, 4, 8** | 110 | 0.199, 0.457 | 0.0106, 0.0250 |
/// | 1, 4, 16 | 118 | 0.215, 0.518 | 0.0118, 0.0256 |
/// | 0.25, 5, 8 | 143 | 0.192, 0.460 | 0.0102, 0.0237 |
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Sift {
    /// Length that the scale is a multiple of, in the unit of the coordinates. Default
    /// `None`: the cloud's resolution. Set it to 1 to give the scale in the cloud's unit.
    pub unit: Option<f64>,
    /// σ of the first octave, in units, 1e-3 to 1e3; default 0.5. Raise it for fewer points
    /// and noisy clouds.
    pub min_scale: f64,
    /// Octaves, each of twice the scale, 1 to 16; default 4.
    pub octaves: usize,
    /// Scales an octave, 1 to 16; default 8. More find more points.
    pub scales: usize,
    /// Smallest difference of Gaussians of a keypoint, in the unit of the values (curvature is in
    /// [0, 1/3]), 0 to 1e6; default 0: every extremum. Raise it to exclude the extrema of flat
    /// regions, which are noise.
    pub min_contrast: f64,
}

impl Default for Sift {
    fn default() -> Self {
        Sift { unit: None, min_scale: 0.5, octaves: 4, scales: 8, min_contrast: 0.0 }
    }
}

impl Sift {
    /// Checks the ranges.
    ///
    /// # Errors
    /// [`Error::Config`] for a setting out of its range.
    pub fn validate(&self) -> Result<()> {
        check_unit(self.unit)?;
        check_range("min_scale", self.min_scale, 1e-3, 1e3)?;
        check_range("octaves", self.octaves as f64, 1.0, 16.0)?;
        check_range("scales", self.scales as f64, 1.0, 16.0)?;
        check_range("min_contrast", self.min_contrast, 0.0, 1e6)
    }

    /// Finds the indices of the keypoints, ascending.
    ///
    /// # Errors
    /// [`Error::Shape`] unless there is a value for every point; [`Error::NonFinite`] for a NaN or
    /// infinite coordinate or value; the errors of [`validate`](Self::validate) and
    /// [`SearchTree::new`]; [`Error::Config`] for a cloud without a resolution.
    pub fn detect(&self, points: &[[f32; 3]], values: &[f32]) -> Result<Vec<usize>> {
        self.validate()?;
        if points.len() != values.len() {
            let what = "values for the points of a cloud".into();
            return Err(Error::Shape { what, expected: points.len(), found: values.len() });
        }
        let order = canonical_order(points, values)?;
        let mut scale = self.min_scale * unit(points, self.unit)?;
        let (mut points, mut values): (Vec<_>, Vec<_>) =
            order.iter().map(|&i| (points[i], values[i])).unzip();
        let whole = SearchTree::new(&points)?;
        // One corner for all octaves: the voxels of each consist of whole voxels of the previous
        // one.
        let corner = [0, 1, 2].map(|a| points.iter().fold(f32::INFINITY, |low, p| low.min(p[a])));
        let mut found = Vec::new();
        for _ in 0..self.octaves {
            (points, values) = downsample(&points, &values, corner, scale);
            if points.len() < EXTREMUM_NEIGHBORS {
                break;
            }
            let keys = self.octave(&points, &values, scale)?;
            found.extend(keys.iter().map(|&i| order[whole.nearest(&points[i]).index as usize]));
            scale *= 2.0;
        }
        found.sort_unstable();
        found.dedup();
        Ok(found)
    }

    /// Finds the extrema of one octave, as indices into its downsampled points.
    fn octave(&self, points: &[[f32; 3]], values: &[f32], scale: f64) -> Result<Vec<usize>> {
        let tree = SearchTree::new(points)?;
        let sigma = |i: usize| scale * 2f64.powf((i as f64 - 1.0) / self.scales as f64);
        let sigmas: Vec<f64> = (0..self.scales + 3).map(sigma).collect();
        let reach = GAUSSIAN_REACH * sigmas[sigmas.len() - 1];
        let differences = par::map(
            points.len(),
            || (),
            |_, i| {
                let around = tree.within(&points[i], reach);
                let smooth = |&sigma: &f64| {
                    let inside = |squared: f64| squared <= (GAUSSIAN_REACH * sigma).powi(2);
                    let (mut sum, mut weights) = (0.0, 0.0);
                    for neighbor in &around {
                        let squared = f64::from(neighbor.squared_distance);
                        if !inside(squared) {
                            break;
                        }
                        let weight = (-0.5 * squared / (sigma * sigma)).exp();
                        sum += weight * f64::from(values[neighbor.index as usize]);
                        weights += weight;
                    }
                    sum / weights
                };
                let smoothed: Vec<f64> = sigmas.iter().map(smooth).collect();
                smoothed.windows(2).map(|pair| pair[1] - pair[0]).collect::<Vec<f64>>()
            },
        );
        // Sums of a constant differ in their last bits, and these differences are no contrast.
        let largest = values.iter().fold(0.0, |largest: f32, x| largest.max(x.abs()));
        let contrast = self.min_contrast.max(1e-12 * f64::from(largest));
        let extreme = par::map(
            points.len(),
            || (),
            |_, i| {
                let rivals = tree.k_nearest(&points[i], EXTREMUM_NEIGHBORS);
                let row = |at: usize| rivals.iter().map(move |r| (r.index as usize, at));
                (1..=self.scales).any(|s| {
                    let value = differences[i][s];
                    let is_least = |sign: f64| {
                        let above =
                            |(j, at): (usize, usize)| sign * differences[j][at] > sign * value;
                        row(s).all(|(j, at)| sign * differences[j][at] >= sign * value)
                            && row(s - 1).chain(row(s + 1)).all(above)
                    };
                    value.abs() >= contrast && (is_least(1.0) || is_least(-1.0))
                })
            },
        );
        Ok((0..points.len()).filter(|&i| extreme[i]).collect())
    }
}

/// Computes mean point and mean value of every occupied voxel of side `size` in a grid that starts
/// at `corner`.
fn downsample(
    points: &[[f32; 3]],
    values: &[f32],
    corner: [f32; 3],
    size: f64,
) -> (Vec<[f32; 3]>, Vec<f32>) {
    let mut cubes: BTreeMap<[i64; 3], (Vec3, f64, f64)> = BTreeMap::new();
    for (p, &value) in points.iter().zip(values) {
        let p = p.map(f64::from);
        let cube = math::sub(p, corner.map(f64::from)).map(|x| (x / size).floor() as i64);
        let (sum, total, count) = cubes.entry(cube).or_default();
        *sum = math::add(*sum, p);
        *total += f64::from(value);
        *count += 1.0;
    }
    let mean = |(sum, total, n): &(Vec3, f64, f64)| {
        (math::scaled(*sum, 1.0 / n).map(|x| x as f32), (total / n) as f32)
    };
    cubes.values().map(mean).unzip()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A flat grid of unit spacing whose value is a blob at (14, 11).
    fn blob() -> (Vec<[f32; 3]>, Vec<f32>) {
        let value = |x: f32, y: f32| (-((x - 14.0).powi(2) + (y - 11.0).powi(2)) / 8.0).exp();
        let place = |i: i32| ((i % 30) as f32, (i / 30) as f32);
        (0..900).map(place).map(|(x, y)| ([x, y, 0.0], value(x, y))).unzip()
    }

    #[test]
    fn a_blob_is_found_where_it_is() {
        let (points, values) = blob();
        let found =
            Sift { min_contrast: 0.02, ..Sift::default() }.detect(&points, &values).unwrap();
        assert!(!found.is_empty() && found.windows(2).all(|pair| pair[0] < pair[1]));
        let near = |&i: &usize| (points[i][0] - 14.0).hypot(points[i][1] - 11.0) <= 2.0;
        assert!(found.iter().any(near), "{found:?}");
    }

    #[test]
    fn a_constant_has_no_extrema_and_the_unit_does_not_matter() {
        let (points, values) = blob();
        let sift = Sift { min_contrast: 1e-3, ..Sift::default() };
        for constant in [0.5, 0.3, -1e9] {
            assert!(Sift::default().detect(&points, &[constant; 900]).unwrap().is_empty());
        }
        let large: Vec<[f32; 3]> = points.iter().map(|p| p.map(|x| x * 1024.0)).collect();
        let found = sift.detect(&points, &values).unwrap();
        assert_eq!(found, sift.detect(&large, &values).unwrap());
    }

    #[test]
    fn settings_out_of_range_are_named() {
        let (points, values) = blob();
        let sift = Sift::default();
        for (bad, want) in [
            (Sift { unit: Some(f64::NAN), ..sift }, "unit"),
            (Sift { min_scale: 0.0, ..sift }, "min_scale"),
            (Sift { octaves: 0, ..sift }, "octaves"),
            (Sift { scales: 17, ..sift }, "scales"),
            (Sift { min_contrast: f64::NAN, ..sift }, "min_contrast"),
        ] {
            let found = bad.detect(&points, &values);
            assert!(matches!(found, Err(Error::Config { field, .. }) if field == want), "{want}");
        }
        let short = sift.detect(&points, &values[1..]);
        assert!(matches!(short, Err(Error::Shape { .. })));
        let (mut hole, mut nan) = (points.clone(), values.clone());
        (hole[7][1], nan[5]) = (f32::NAN, f32::INFINITY);
        for sift in [sift, Sift { unit: Some(1.0), ..sift }] {
            let found = sift.detect(&hole, &values);
            assert!(matches!(found, Err(Error::NonFinite { index: 7, .. })));
            let found = sift.detect(&points, &nan);
            assert!(matches!(found, Err(Error::NonFinite { index: 5, .. })));
        }
    }
}
