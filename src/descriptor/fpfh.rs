//! Fast Point Feature Histograms (Rusu, Blodow and Beetz 2009).

use std::fmt;
use std::str::FromStr;

use pulp::{Simd, WithSimd};
use serde::{Deserialize, Serialize};

use super::layout::{BINS, BLOCK, BLOCK_SUM};
use super::spfh::SpfhBuilder;
use crate::cloud::Descriptors;
use crate::error::{Error, Result};
use crate::par;
use crate::search::{Neighbors, squared_distance};

/// Lanes that simple histograms are summed in.
const LANES: usize = 8;
/// Length of a stored simple histogram: whole lanes, of which the last ones are 0.
const STRIDE: usize = BINS.next_multiple_of(LANES);

/// Two libraries, two histograms. Squared distances differ by a factor of about four, so
/// a bandwidth β belongs to a scale.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum HistogramScale {
    /// Blocks sum to 100: the neighbours' histograms weighted by 1/d², normalised. PCL computes
    /// this scale, and the paper used it.
    #[default]
    Pcl,
    /// Blocks sum to 200: the same plus the point's own histogram, as in the formula of the FPFH
    /// paper. Open3D computes this scale.
    Open3d,
}

impl HistogramScale {
    /// Returns the bandwidth β for the scale: the paper's 100 on PCL's, and 400 on Open3D's, where
    /// every block is twice as large.
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

/// Computes FPFH of every point: N×33, f32.
///
/// A row of zeros is "undefined" and must not be compared: the point has no other points in its
/// neighbourhood.
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

/// Computes FPFH of only the points at `rows`, in that order, from all points around them: the same
/// bits as those rows of [`fpfh`]. Simple histograms are computed only where needed.
///
/// # Errors
/// As for [`fpfh`], and [`Error::Shape`] for a row that is not a point.
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
    // If all points are selected, no marks are needed.
    let some = rows.len() < points.len();
    let mut needed = vec![!some; points.len()];
    for &i in rows.iter().filter(|_| some) {
        needed[i] = true;
        neighbors.indices(i).iter().for_each(|&neighbor| needed[neighbor as usize] = true);
    }
    // In an order in which neighbours follow each other, independent of the cloud's order.
    let order = neighbors.order();
    let mut simple = vec![0.0f32; points.len() * STRIDE];
    par::for_each_row(&mut simple, STRIDE, SpfhBuilder::default, |scratch, at, row| {
        let i = order[at] as usize;
        if needed[i] {
            scratch.histograms(points, normals, neighbors, i, row);
        }
    });
    // In that order again; each row is moved to its position afterwards.
    let mut places: Vec<u32> = (0..rows.len() as u32).collect();
    places.sort_by_key(|&at| neighbors.row(rows[at as usize]));
    let simple = simple.as_chunks().0;
    let describe = |weights: &mut WeightScratch, at: usize| {
        let i = rows[places[at] as usize];
        pulp::Arch::new().dispatch(WeightSpfh {
            points,
            spfh: simple,
            neighbors,
            scale,
            i,
            weights,
        })
    };
    let described = par::map(rows.len(), WeightScratch::default, describe);
    let mut full = vec![0.0f32; rows.len() * BINS];
    for (&at, row) in places.iter().zip(&described) {
        full[at as usize * BINS..][..BINS].copy_from_slice(row);
    }
    Descriptors::new(BINS, full)
}

/// Scratch: for each neighbour in turn, the squared distance and the weight of its histogram.
#[derive(Default)]
struct WeightScratch {
    distances: Vec<f32>,
    weights: Vec<f64>,
}

/// Computes FPFH: the neighbours' SPFH weighted by 1/d², each block normalised.
struct WeightSpfh<'a> {
    points: &'a [[f32; 3]],
    /// Histograms in the order of the neighbourhoods' rows.
    spfh: &'a [[f32; STRIDE]],
    neighbors: &'a Neighbors,
    scale: HistogramScale,
    i: usize,
    weights: &'a mut WeightScratch,
}

impl WithSimd for WeightSpfh<'_> {
    type Output = [f32; BINS];

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> [f32; BINS] {
        let WeightSpfh { points, spfh: simple, neighbors, scale, i, weights } = self;
        let WeightScratch { distances, weights } = weights;
        let (others, point) = (neighbors.indices(i), points[i]);
        distances.clear();
        distances.extend(others.iter().map(|&j| squared_distance(point, points[j as usize])));
        weights.resize(others.len(), 0.0);
        for (weight, &distance) in weights.iter_mut().zip(&distances[..]) {
            // A neighbour at the same position has no distance to weight by: as in PCL, leave it
            // out.
            *weight = if distance > 0.0 { 1.0 / f64::from(distance) } else { 0.0 };
        }
        // Named sums and no variable index into them: they stay in registers.
        let (mut a, mut b, mut c) = ([0.0; LANES], [0.0; LANES], [0.0; LANES]);
        let (mut d, mut e) = ([0.0; LANES], [0.0; LANES]);
        for (&j, &weight) in others.iter().zip(&weights[..]) {
            let values = &simple[neighbors.row(j as usize)];
            for k in 0..LANES {
                let value = |block: usize| weight * f64::from(values[block * LANES + k]);
                a[k] += value(0);
                b[k] += value(1);
                c[k] += value(2);
                d[k] += value(3);
                e[k] += value(4);
            }
        }
        let sums: [f64; STRIDE] = {
            let mut sums = [0.0; STRIDE];
            let blocks = sums.as_chunks_mut::<LANES>().0;
            blocks.iter_mut().zip([a, b, c, d, e]).for_each(|(to, from)| *to = from);
            sums
        };
        let own = &simple[neighbors.row(i)];
        let mut row = [0.0; BINS];
        for block in 0..3 {
            let range = block * BLOCK..(block + 1) * BLOCK;
            let total: f64 = sums[range.clone()].iter().sum();
            let factor = if total > 0.0 { BLOCK_SUM / total } else { 0.0 };
            for bin in range {
                let own = match scale {
                    HistogramScale::Pcl => 0.0,
                    HistogramScale::Open3d => f64::from(own[bin]),
                };
                row[bin] = (sums[bin] * factor + own) as f32;
            }
        }
        row
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
    fn lengths_must_agree() {
        let (points, normals) = bumpy();
        let neighbors = Neighbors::find(&points, Neighborhood::Nearest(5)).unwrap();
        let short = fpfh(&points, &normals[1..], &neighbors, HistogramScale::Pcl);
        assert!(matches!(short, Err(Error::Shape { expected: 300, found: 299, .. })));
    }
}
