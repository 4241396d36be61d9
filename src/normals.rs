//! Normals and curvature by principal component analysis of neighbourhoods.

use pulp::{Simd, WithSimd};
use serde::{Deserialize, Serialize};

use crate::cloud::PointCloud;
use crate::error::{Error, Result};
use crate::math::{self, Mat3, Vec3};
use crate::par;
use crate::search::Neighbors;

/// Choice of the sign of a normal. Descriptors depend on it, so both clouds of a pair must be
/// oriented the same way.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Orientation {
    /// Towards the cloud's own viewpoint or, if its file names none, towards the origin of its
    /// frame, as in PCL. For a cloud with coordinates far from zero this is
    /// [`PointCloud::frame_origin`], so that a map offset changes nothing.
    #[default]
    Viewpoint,
    /// Towards a given position, in the cloud's frame.
    Towards(Vec3),
    /// Away from the cloud's centroid: for whole objects without a known viewpoint.
    Outward,
    /// The cloud's own normals unchanged: nothing is estimated.
    Stored,
}

/// The reference that oriented the normals.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum OrientedBy {
    /// The viewpoint named by the cloud's file.
    CloudViewpoint,
    /// The origin of the cloud's frame.
    FrameOrigin,
    /// A given viewpoint.
    GivenViewpoint,
    /// The centre of the returns at the limit of the sensor's range.
    RangeLimit,
    /// A viewpoint estimated from the shape of the cloud.
    Guess,
    /// The cloud's centroid, from which they point away.
    Centroid,
    /// The normals stored in the cloud.
    Stored,
}

/// Normals of a cloud.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct Normals {
    /// Unit vectors, one a point; zero if the neighbourhood has no plane (fewer than three points,
    /// all on one line or at one position).
    pub vectors: Vec<[f32; 3]>,
    /// λ₀/(λ₀ + λ₁ + λ₂) with the covariance's eigenvalues ascending, in [0, 1/3]: 0 on a plane.
    /// Empty when the normals were stored.
    pub curvature: Vec<f32>,
    /// The reference that oriented them.
    pub oriented_by: OrientedBy,
}

impl Normals {
    /// Returns whether point `i` has a normal.
    ///
    /// # Panics
    /// When there is no such point.
    pub fn is_defined(&self, i: usize) -> bool {
        self.vectors[i] != [0.0; 3]
    }

    /// Counts the points without a defined normal.
    pub fn undefined_count(&self) -> usize {
        self.vectors.iter().filter(|normal| **normal == [0.0; 3]).count()
    }
}

/// Below this share of the largest eigenvalue the second one is rounding: the neighbourhood is a
/// line. f32 coordinates leave 6e-8² ≈ 4e-15.
const MIN_EIGENVALUE_RATIO: f64 = 1e-12;

/// Estimates the normals of `cloud` from `neighbors`, one neighbourhood a point.
///
/// The normal is the eigenvector of the smallest eigenvalue of the neighbourhood's
/// covariance about its mean (Hoppe et al. 1992; PCL's `NormalEstimation`).
///
/// # Errors
/// [`Error::Shape`] when `neighbors` belongs to another cloud; [`Error::Config`] for
/// [`Orientation::Stored`] on a cloud without normals or a viewpoint that is not finite.
pub fn estimate(
    cloud: &PointCloud,
    neighbors: &Neighbors,
    orientation: Orientation,
) -> Result<Normals> {
    if orientation == Orientation::Stored {
        return stored_normals(cloud);
    }
    if neighbors.len() != cloud.len() {
        let what = "neighbourhoods for the points of a cloud".into();
        return Err(Error::Shape { what, expected: cloud.len(), found: neighbors.len() });
    }
    let (reference, sign, oriented_by) = match orientation {
        Orientation::Towards(at) => {
            if at.iter().any(|x| !x.is_finite()) {
                let value = format!("{at:?}");
                return Err(Error::config("viewpoint", value, "must be three finite numbers"));
            }
            (at, 1.0, OrientedBy::GivenViewpoint)
        }
        Orientation::Outward => (cloud.centroid(), -1.0, OrientedBy::Centroid),
        Orientation::Viewpoint | Orientation::Stored => match cloud.viewpoint() {
            Some(at) => (at, 1.0, OrientedBy::CloudViewpoint),
            None => (cloud.frame_origin(), 1.0, OrientedBy::FrameOrigin),
        },
    };
    let reference = math::sub(reference, cloud.origin());
    let points = cloud.points();
    let order = neighbors.order();
    let planes = par::map_blocks(points.len(), LANES, Members::default, |members, block| {
        let mut covariances = [[[0.0; 3]; 3]; LANES];
        for (covariance, &i) in covariances.iter_mut().zip(&order[block]) {
            *covariance = members.covariance(points, neighbors.indices(i as usize));
        }
        pulp::Arch::new().dispatch(Planes(&covariances))
    });
    let (mut vectors, mut curvature) = (vec![[0.0; 3]; points.len()], vec![0.0; points.len()]);
    for (&i, (normal, flatness)) in order.iter().zip(planes.into_iter().flatten()) {
        let i = i as usize;
        let towards = math::sub(reference, points[i].map(f64::from));
        let flip = if sign * math::dot(normal, towards) < 0.0 { -1.0 } else { 1.0 };
        vectors[i] = math::scaled(normal, flip).map(|x| x as f32);
        curvature[i] = flatness as f32;
    }
    Ok(Normals { vectors, curvature, oriented_by })
}

fn stored_normals(cloud: &PointCloud) -> Result<Normals> {
    let Some(normals) = cloud.normals() else {
        let rule = "the cloud has no normals: choose viewpoint or outward";
        return Err(Error::config("orientation", "stored", rule));
    };
    let oriented_by = OrientedBy::Stored;
    Ok(Normals { vectors: normals.to_vec(), curvature: Vec::new(), oriented_by })
}

/// Number of lanes of sums, the same on every machine, so that vector widths do not change the
/// result.
const LANES: usize = 8;

/// The points of a neighbourhood, one array an axis, in whole lanes.
#[derive(Default)]
struct Members([Vec<f64>; 3]);

impl Members {
    /// Returns the covariance of a neighbourhood; zero if there are too few points for a plane.
    ///
    /// Sums run in the order of the neighbours and about the mean: points that have the same
    /// neighbours then have the same normal to the last bit, so that the choice of a pair's frame
    /// in FPFH does not depend on rounding.
    fn covariance(&mut self, points: &[[f32; 3]], neighbors: &[u32]) -> Mat3 {
        let count = neighbors.len();
        if count < 3 {
            return [[0.0; 3]; 3];
        }
        let Members([x, y, z]) = self;
        for axis in [&mut *x, &mut *y, &mut *z] {
            axis.clear();
            axis.resize(count.next_multiple_of(LANES), 0.0);
        }
        for (((&j, x), y), z) in neighbors.iter().zip(x).zip(y).zip(z) {
            [*x, *y, *z] = points[j as usize].map(f64::from);
        }
        pulp::Arch::new().dispatch(Covariance { members: self, count })
    }
}

/// Computes unoriented normal and curvature from each covariance; zero if there is no plane.
struct Planes<'a>(&'a [Mat3; LANES]);

impl WithSimd for Planes<'_> {
    type Output = [(Vec3, f64); LANES];

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> Self::Output {
        math::eigen::symmetric_many(self.0).map(|(values, vectors)| {
            if values[1] <= MIN_EIGENVALUE_RATIO * values[2] {
                return ([0.0; 3], 0.0);
            }
            let least = values[0].max(0.0);
            (vectors[0], least / (least + values[1] + values[2]))
        })
    }
}

struct Covariance<'a> {
    members: &'a mut Members,
    count: usize,
}

impl WithSimd for Covariance<'_> {
    type Output = Mat3;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> Mat3 {
        let Covariance { members: Members(axes), count } = self;
        let share = 1.0 / count as f64;
        let whole = axes[0].len();
        for axis in axes.iter_mut() {
            let mut sums = [0.0; LANES];
            for part in axis.as_chunks::<LANES>().0 {
                for k in 0..LANES {
                    sums[k] += part[k];
                }
            }
            let mean = total(sums) * share;
            axis[..count].iter_mut().for_each(|x| *x -= mean);
        }
        let [x, y, z] = axes.each_ref().map(|axis| axis[..whole].as_chunks::<LANES>().0);
        let (mut xx, mut xy, mut xz) = ([0.0; LANES], [0.0; LANES], [0.0; LANES]);
        let (mut yy, mut yz, mut zz) = ([0.0; LANES], [0.0; LANES], [0.0; LANES]);
        for ((x, y), z) in x.iter().zip(y).zip(z) {
            for k in 0..LANES {
                xx[k] += x[k] * x[k];
                xy[k] += x[k] * y[k];
                xz[k] += x[k] * z[k];
                yy[k] += y[k] * y[k];
                yz[k] += y[k] * z[k];
                zz[k] += z[k] * z[k];
            }
        }
        let [xx, xy, xz, yy, yz, zz] = [xx, xy, xz, yy, yz, zz].map(|sums| total(sums) * share);
        [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]
    }
}

#[inline(always)]
fn total(sums: [f64; LANES]) -> f64 {
    let [a, b, c, d, e, f, g, h] = sums;
    ((a + e) + (b + f)) + ((c + g) + (d + h))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::search::Neighborhood;

    fn normals(points: &[Vec3], orientation: Orientation) -> Normals {
        let cloud = PointCloud::new(points).unwrap();
        let neighbors = Neighbors::find(cloud.points(), Neighborhood::Nearest(12)).unwrap();
        estimate(&cloud, &neighbors, orientation).unwrap()
    }

    fn grid(height: f64) -> Vec<Vec3> {
        (0..100).map(|i| [f64::from(i % 10), f64::from(i / 10), height]).collect()
    }

    #[test]
    fn a_plane_faces_its_viewpoint() {
        let up = normals(&grid(-5.0), Orientation::Viewpoint);
        assert_eq!(up.oriented_by, OrientedBy::FrameOrigin);
        assert!(up.vectors.iter().all(|n| n[2] > 0.999_999));
        assert!(up.curvature.iter().all(|c| *c < 1e-9));
        let down = normals(&grid(-5.0), Orientation::Towards([0.0, 0.0, -9.0]));
        assert_eq!(down.oriented_by, OrientedBy::GivenViewpoint);
        assert!(down.vectors.iter().all(|n| n[2] < -0.999_999));
    }

    #[test]
    fn a_ball_points_outward() {
        let golden = std::f64::consts::PI * (3.0 - 5f64.sqrt());
        let ball: Vec<Vec3> = (0..400)
            .map(|i| {
                let z = 1.0 - (f64::from(i) + 0.5) / 200.0;
                let (sin, cos) = (golden * f64::from(i)).sin_cos();
                let r = (1.0 - z * z).sqrt();
                [r * cos + 7.0, r * sin, z]
            })
            .collect();
        let found = normals(&ball, Orientation::Outward);
        for (normal, p) in found.vectors.iter().zip(&ball) {
            let cos = math::dot(normal.map(f64::from), math::sub(*p, [7.0, 0.0, 0.0]));
            assert!(cos > 0.98, "{cos}");
        }
    }

    #[test]
    fn lines_and_lumps_have_no_normal() {
        let line: Vec<Vec3> =
            (0..50).map(|i| [0.1 * f64::from(i), 0.3 * f64::from(i), 1.0]).collect();
        assert_eq!(normals(&line, Orientation::Viewpoint).undefined_count(), 50);
        assert_eq!(normals(&[[1.0, 2.0, 3.0]; 30], Orientation::Viewpoint).undefined_count(), 30);
        assert_eq!(normals(&line[..2], Orientation::Viewpoint).undefined_count(), 2);
    }

    #[test]
    fn stored_normals_are_taken_or_missed() {
        let cloud = PointCloud::with_normals(&grid(0.0), &[[0.0, 1.0, 0.0]; 100]).unwrap();
        let neighbors = Neighbors::find(cloud.points(), Neighborhood::Nearest(5)).unwrap();
        let found = estimate(&cloud, &neighbors, Orientation::Stored).unwrap();
        assert_eq!(found.vectors[3], [0.0, 1.0, 0.0]);
        let bare = PointCloud::new(&grid(0.0)).unwrap();
        let missing = estimate(&bare, &neighbors, Orientation::Stored);
        assert!(matches!(missing, Err(Error::Config { field: "orientation", .. })));
    }
}
