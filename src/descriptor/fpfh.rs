//! Fast Point Feature Histograms (Rusu, Blodow and Beetz 2009).

use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Serialize};

use super::pair;
use crate::cloud::Descriptors;
use crate::error::{Error, Result};
use crate::math::Vec3;
use crate::par;
use crate::search::Neighbors;

/// Bins of one of the three angle histograms.
pub const BLOCK: usize = 11;
/// Bins of a descriptor: the histograms of θ, α and φ one after the other.
pub const BINS: usize = 3 * BLOCK;

/// Sum of a finished block on the scale of PCL.
const FULL: f64 = 100.0;

/// Two libraries, two histograms. Squared distances differ by a factor of about four, so
/// a bandwidth β belongs to a scale.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum HistogramScale {
    /// Blocks sum to 100: the neighbours' histograms weighted by 1/d², normalised. What
    /// PCL computes and the paper used.
    #[default]
    Pcl,
    /// Blocks sum to 200: the same, and the point's own histogram added, as in the FPFH
    /// paper's formula. What Open3D computes.
    Open3d,
}

impl HistogramScale {
    /// Bandwidth β that goes with the scale: the paper's 100 on PCL's, and 400 on
    /// Open3D's, where every block is twice as large.
    pub fn default_beta(self) -> f64 {
        match self {
            HistogramScale::Pcl => 100.0,
            HistogramScale::Open3d => 400.0,
        }
    }
}

impl fmt::Display for HistogramScale {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            HistogramScale::Pcl => "pcl",
            HistogramScale::Open3d => "open3d",
        })
    }
}

impl FromStr for HistogramScale {
    type Err = Error;
    fn from_str(text: &str) -> Result<Self> {
        match text {
            "pcl" => Ok(HistogramScale::Pcl),
            "open3d" => Ok(HistogramScale::Open3d),
            _ => Err(Error::config("histogram", text, "must be pcl or open3d")),
        }
    }
}

/// FPFH of every point: N×33, f32.
///
/// A row is all zeros where nothing can be told: a point without other points in its
/// neighbourhood. Such a row is "undefined" and must
/// not be compared.
///
/// # Errors
/// [`Error::Shape`] when points, normals and neighbourhoods differ in number.
pub fn fpfh(
    points: &[[f32; 3]],
    normals: &[[f32; 3]],
    neighbors: &Neighbors,
    scale: HistogramScale,
) -> Result<Descriptors> {
    let rows: Vec<usize> = (0..points.len()).collect();
    fpfh_at(points, normals, neighbors, &rows, scale)
}

/// FPFH of the points named by `rows` alone, in that order, from all points around them:
/// the same bits as those rows of [`fpfh`]. Simple histograms are made where needed.
///
/// # Errors
/// As [`fpfh`], and [`Error::Shape`] for a row that is not a point.
pub fn fpfh_at(
    points: &[[f32; 3]],
    normals: &[[f32; 3]],
    neighbors: &Neighbors,
    rows: &[usize],
    scale: HistogramScale,
) -> Result<Descriptors> {
    for (what, found) in [("normals", normals.len()), ("neighbourhoods", neighbors.len())] {
        if found != points.len() {
            let what = format!("{what} for the points of a cloud");
            return Err(Error::Shape { what, expected: points.len(), found });
        }
    }
    if let Some(&found) = rows.iter().find(|&&row| row >= points.len()) {
        let what = "a point to be described".into();
        return Err(Error::Shape { what, expected: points.len(), found });
    }
    let mut needed = vec![false; points.len()];
    for &i in rows {
        needed[i] = true;
        neighbors.of(i).iter().for_each(|neighbor| needed[neighbor.index as usize] = true);
    }
    let mut simple = vec![0.0f32; points.len() * BINS];
    par::for_each_row(
        &mut simple,
        BINS,
        || (),
        |_, i, row| {
            if needed[i] {
                simple_histograms(points, normals, neighbors, i, row);
            }
        },
    );
    let mut full = vec![0.0f32; rows.len() * BINS];
    par::for_each_row(
        &mut full,
        BINS,
        || (),
        |_, i, row| {
            weighted_histograms(&simple, neighbors, scale, rows[i], row);
        },
    );
    Descriptors::new(BINS, full)
}

/// The histograms of the pairs (i, neighbour): SPFH.
fn simple_histograms(
    points: &[[f32; 3]],
    normals: &[[f32; 3]],
    neighbors: &Neighbors,
    i: usize,
    row: &mut [f32],
) {
    let at = |j: usize| -> (Vec3, Vec3) { (points[j].map(f64::from), normals[j].map(f64::from)) };
    let (p, n) = at(i);
    let others = neighbors.of(i).iter().filter(|neighbor| neighbor.index as usize != i);
    let mut counts = [0u32; BINS];
    let mut pairs = 0;
    for neighbor in others {
        let (q, m) = at(neighbor.index as usize);
        pairs += 1;
        // PCL and Open3D alike count a pair without a frame as one with all angles zero.
        let features = pair::features(p, n, q, m).unwrap_or([0.0; 3]);
        for (block, bin) in bins(features).into_iter().enumerate() {
            counts[block * BLOCK + bin] += 1;
        }
    }
    let increment = FULL / f64::from(pairs.max(1));
    for (value, count) in row.iter_mut().zip(counts) {
        *value = (f64::from(count) * increment) as f32;
    }
}

/// Bin of each angle: θ over [−π, π], α and φ over [−1, 1].
fn bins([f1, f2, f3]: [f64; 3]) -> [usize; 3] {
    use std::f64::consts::PI;
    let shares = [(f1 + PI) / (2.0 * PI), (f2 + 1.0) * 0.5, (f3 + 1.0) * 0.5];
    shares.map(|share| ((share * BLOCK as f64).floor().max(0.0) as usize).min(BLOCK - 1))
}

/// The neighbours' SPFH weighted by 1/d², each block normalised: FPFH.
fn weighted_histograms(
    simple: &[f32],
    neighbors: &Neighbors,
    scale: HistogramScale,
    i: usize,
    row: &mut [f32],
) {
    let mut sums = [0.0f64; BINS];
    // A neighbour in the same place has no distance to weigh by: as PCL, leave it out.
    let apart = neighbors.of(i).iter().filter(|neighbor| neighbor.squared_distance > 0.0);
    for neighbor in apart {
        let weight = 1.0 / f64::from(neighbor.squared_distance);
        let at = neighbor.index as usize * BINS;
        for (sum, &value) in sums.iter_mut().zip(&simple[at..at + BINS]) {
            *sum += weight * f64::from(value);
        }
    }
    for block in 0..3 {
        let range = block * BLOCK..(block + 1) * BLOCK;
        let total: f64 = sums[range.clone()].iter().sum();
        let factor = if total > 0.0 { FULL / total } else { 0.0 };
        for bin in range {
            let own = match scale {
                HistogramScale::Pcl => 0.0,
                HistogramScale::Open3d => f64::from(simple[i * BINS + bin]),
            };
            row[bin] = (sums[bin] * factor + own) as f32;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::search::Neighborhood;

    fn bumpy() -> (Vec<[f32; 3]>, Vec<[f32; 3]>) {
        (0..300)
            .map(|i| {
                let (x, y) = ((i % 20) as f32 * 0.1, (i / 20) as f32 * 0.1);
                let normal = [(3.0 * x).sin() * 0.3, (2.0 * y).cos() * 0.3, 1.0f32];
                let length = normal.iter().map(|x| x * x).sum::<f32>().sqrt();
                ([x, y, 0.1 * (x * 3.0).cos() + 0.05 * (y * 2.0).sin()], normal.map(|x| x / length))
            })
            .unzip()
    }

    fn describe(neighborhood: Neighborhood, scale: HistogramScale) -> Descriptors {
        let (points, normals) = bumpy();
        let neighbors = Neighbors::find(&points, neighborhood).unwrap();
        fpfh(&points, &normals, &neighbors, scale).unwrap()
    }

    #[test]
    fn blocks_sum_to_their_scale() {
        for (scale, want) in [(HistogramScale::Pcl, 100.0), (HistogramScale::Open3d, 200.0)] {
            for row in describe(Neighborhood::Nearest(30), scale).rows() {
                for block in row.chunks(BLOCK) {
                    assert!((block.iter().sum::<f32>() - want).abs() < 1e-3);
                    assert!(block.iter().all(|bin| *bin >= 0.0));
                }
            }
        }
    }

    #[test]
    fn chosen_rows_are_those_of_all_to_the_bit() {
        let (points, normals) = bumpy();
        let rows = [0, 7, 299, 120, 7];
        for scale in [HistogramScale::Pcl, HistogramScale::Open3d] {
            let neighbors = Neighbors::find(&points, Neighborhood::Nearest(30)).unwrap();
            let some = fpfh_at(&points, &normals, &neighbors, &rows, scale).unwrap();
            let all = fpfh(&points, &normals, &neighbors, scale).unwrap();
            assert_eq!(some, all.select(&rows));
            let lost = fpfh_at(&points, &normals, &neighbors, &[300], scale);
            assert!(matches!(lost, Err(Error::Shape { found: 300, .. })));
        }
    }

    #[test]
    fn lonely_points_are_undefined() {
        for scale in [HistogramScale::Pcl, HistogramScale::Open3d] {
            let lonely = describe(Neighborhood::Radius(1e-3), scale);
            assert!(lonely.as_slice().iter().all(|value| *value == 0.0));
        }
    }

    #[test]
    fn every_angle_has_a_bin() {
        use std::f64::consts::PI;
        assert_eq!(bins([-PI, -1.0, -1.0]), [0, 0, 0]);
        assert_eq!(bins([PI, 1.0, 1.0]), [10, 10, 10]);
        assert_eq!(bins([0.0, 0.0, 0.0]), [5, 5, 5]);
        assert_eq!(bins([4.0, -1.1, 1.1]), [10, 0, 10]);
    }

    #[test]
    fn lengths_must_agree() {
        let (points, normals) = bumpy();
        let neighbors = Neighbors::find(&points, Neighborhood::Nearest(5)).unwrap();
        let short = fpfh(&points, &normals[1..], &neighbors, HistogramScale::Pcl);
        assert!(matches!(short, Err(Error::Shape { expected: 300, found: 299, .. })));
    }
}
