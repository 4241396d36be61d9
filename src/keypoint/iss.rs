//! Intrinsic shape signatures (Zhong 2009): points spread unequally in all three directions.

use serde::{Deserialize, Serialize};

use super::{canonical_order, check_range, check_unit, unit};
use crate::error::{Error, Result};
use crate::math::{self, Vec3};
use crate::par;
use crate::search::{self, Neighbor, SearchTree};

/// The ISS detector, as in Open3D.
///
/// A point is salient if the eigenvalues λ₁ ≥ λ₂ ≥ λ₃ of its neighbourhood's covariance are well
/// separated. Among the salient points, those with the largest λ₃ in their surroundings are kept.
/// The covariance is about the neighbourhood's mean. (PCL sums about the point itself without
/// dividing by the number of neighbours, so that density matters too: on scans at most a third of
/// its points are the same.)
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Iss {
    /// Length that the radii are multiples of, in the unit of the coordinates. Default
    /// `None`: the cloud's resolution. Set it to 1 to give radii in the cloud's unit.
    pub unit: Option<f64>,
    /// Radius of the covariance, in units, 1e-3 to 1e3; default 6 (PCL, Open3D). Raise it
    /// on noisy clouds.
    pub salient_radius: f64,
    /// Radius within which only the most salient point is kept, in units, 1e-3 to 1e3;
    /// default 4 (PCL, Open3D). Smaller keeps more points.
    pub non_max_radius: f64,
    /// Largest λ₂/λ₁ of a salient point, in (0, 1]; default 0.975 (Open3D, PCL).
    pub gamma21: f64,
    /// Largest λ₃/λ₂ of a salient point, in (0, 1]; default 0.975 (Open3D, PCL).
    pub gamma32: f64,
    /// Fewest points, itself included, within either radius; at least 3, default 5
    /// (Open3D, PCL).
    pub min_neighbors: usize,
}

impl Default for Iss {
    fn default() -> Self {
        Iss {
            unit: None,
            salient_radius: 6.0,
            non_max_radius: 4.0,
            gamma21: 0.975,
            gamma32: 0.975,
            min_neighbors: 5,
        }
    }
}

impl Iss {
    /// Checks the ranges.
    ///
    /// # Errors
    /// [`Error::Config`] for a setting out of its range.
    pub fn validate(&self) -> Result<()> {
        check_unit(self.unit)?;
        check_range("salient_radius", self.salient_radius, 1e-3, 1e3)?;
        check_range("non_max_radius", self.non_max_radius, 1e-3, 1e3)?;
        check_range("gamma21", self.gamma21, 1e-9, 1.0)?;
        check_range("gamma32", self.gamma32, 1e-9, 1.0)?;
        if self.min_neighbors < 3 {
            return Err(Error::config("min_neighbors", self.min_neighbors, "must be at least 3"));
        }
        Ok(())
    }

    /// Finds the indices of the keypoints, ascending.
    ///
    /// # Errors
    /// The errors of [`validate`](Self::validate) and [`SearchTree::new`]; [`Error::NonFinite`] for
    /// a NaN or infinite coordinate; [`Error::Config`] for a cloud without a resolution and for
    /// radii with too many neighbours to process.
    pub fn detect(&self, points: &[[f32; 3]]) -> Result<Vec<usize>> {
        self.validate()?;
        let order = canonical_order(points, &[])?;
        let unit = unit(points, self.unit)?;
        let points: Vec<[f32; 3]> = order.iter().map(|&i| points[i]).collect();
        let tree = SearchTree::new(&points)?;
        let largest = self.salient_radius.max(self.non_max_radius);
        search::check_neighbor_memory(&tree, &points, largest * unit)?;
        let around = |i: usize, radius: f64| tree.within(&points[i], radius * unit);
        let saliency = par::map(
            points.len(),
            || (),
            |_, i| self.saliency(&points, &around(i, self.salient_radius)),
        );
        let keep = par::map(
            points.len(),
            || (),
            |_, i| {
                if saliency[i] <= 0.0 {
                    return false;
                }
                let rivals = around(i, self.non_max_radius);
                rivals.len() >= self.min_neighbors
                    && rivals.iter().all(|rival| saliency[rival.index as usize] <= saliency[i])
            },
        );
        let mut found: Vec<usize> =
            (0..points.len()).filter(|&i| keep[i]).map(|i| order[i]).collect();
        found.sort_unstable();
        Ok(found)
    }

    /// Returns λ₃ of the neighbourhood's covariance, 0 if the eigenvalues are not well separated.
    fn saliency(&self, points: &[[f32; 3]], members: &[Neighbor]) -> f64 {
        if members.len() < self.min_neighbors {
            return 0.0;
        }
        // In the order of indices, not of distances: points with the same neighbourhood tie
        // exactly, and rounding does not choose between them.
        let mut members: Vec<u32> = members.iter().map(|neighbor| neighbor.index).collect();
        members.sort_unstable();
        let member = |&index: &u32| points[index as usize].map(f64::from);
        let n = members.len() as f64;
        let sum = members.iter().map(member).fold([0.0; 3], math::add);
        let mean = math::scaled(sum, 1.0 / n);
        let mut covariance = [[0.0; 3]; 3];
        for point in members.iter().map(member) {
            let d: Vec3 = math::sub(point, mean);
            for (row, product) in covariance.iter_mut().zip(math::outer(d, d)) {
                *row = math::add(*row, math::scaled(product, 1.0 / n));
            }
        }
        let ([third, second, first], _) = math::eigen::symmetric(&covariance);
        // As products, to avoid dividing by the zeros of lines and of single positions.
        let salient = second < self.gamma21 * first && third < self.gamma32 * second;
        if salient { third } else { 0.0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A plane of unit spacing with a pyramid around (12, 9).
    fn tent() -> Vec<[f32; 3]> {
        let height = |x: f32, y: f32| (4.0 - (x - 12.0).abs() - 0.7 * (y - 9.0).abs()).max(0.0);
        let place = |i: i32| ((i % 30) as f32, (i / 30) as f32);
        (0..900).map(place).map(|(x, y)| [x, y, height(x, y)]).collect()
    }

    #[test]
    fn a_peak_is_salient_and_a_plane_is_not() {
        let points = tent();
        let found = Iss { salient_radius: 4.0, ..Iss::default() }.detect(&points).unwrap();
        assert!(!found.is_empty() && found.windows(2).all(|pair| pair[0] < pair[1]));
        for i in found {
            let [x, y, _] = points[i];
            assert!((x - 12.0).abs() <= 9.0 && (y - 9.0).abs() <= 10.0, "{x} {y}");
        }
        let flat: Vec<[f32; 3]> = points.iter().map(|p| [p[0], p[1], 0.0]).collect();
        assert!(Iss::default().detect(&flat).unwrap().is_empty());
    }

    #[test]
    fn the_unit_does_not_matter() {
        let points = tent();
        let large: Vec<[f32; 3]> = points.iter().map(|p| p.map(|x| x * 1024.0)).collect();
        let found = Iss::default().detect(&points).unwrap();
        assert_eq!(found, Iss::default().detect(&large).unwrap());
        let absolute = Iss { unit: Some(1024.0), ..Iss::default() };
        assert_eq!(found, absolute.detect(&large).unwrap());
    }

    #[test]
    fn settings_out_of_range_are_named() {
        let iss = Iss::default();
        for (bad, want) in [
            (Iss { unit: Some(0.0), ..iss }, "unit"),
            (Iss { salient_radius: f64::NAN, ..iss }, "salient_radius"),
            (Iss { non_max_radius: -1.0, ..iss }, "non_max_radius"),
            (Iss { gamma21: 0.0, ..iss }, "gamma21"),
            (Iss { gamma32: 1.1, ..iss }, "gamma32"),
            (Iss { min_neighbors: 2, ..iss }, "min_neighbors"),
        ] {
            let found = bad.detect(&tent());
            assert!(matches!(found, Err(Error::Config { field, .. }) if field == want), "{want}");
        }
        assert!(matches!(iss.detect(&[[1.0; 3]; 9]), Err(Error::Config { field: "unit", .. })));
    }
}
