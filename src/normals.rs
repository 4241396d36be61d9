//! Normals and curvature by principal component analysis of neighbourhoods.

use serde::{Deserialize, Serialize};

use crate::cloud::PointCloud;
use crate::error::{Error, Result};
use crate::math::{self, Vec3};
use crate::par;
use crate::search::Neighbors;

/// Which of its two directions a normal takes. Descriptors depend on it, so both clouds
/// of a pair must be oriented alike.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Orientation {
    /// Towards the cloud's own viewpoint or, where its file names none, towards the
    /// origin of its frame, as PCL does. For a cloud whose coordinates lie far from zero
    /// that is [`PointCloud::frame_origin`], so that a map offset changes nothing.
    #[default]
    Viewpoint,
    /// Towards a given place, in the cloud's frame.
    Towards(Vec3),
    /// Away from the cloud's centroid: for whole objects, where no viewpoint is known.
    Outward,
    /// The cloud's own normals as they are: nothing is estimated.
    Stored,
}

/// What oriented the normals in the end.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum OrientedBy {
    /// The viewpoint that the cloud's file names.
    CloudViewpoint,
    /// The origin of the cloud's frame.
    FrameOrigin,
    /// A viewpoint that was given.
    GivenViewpoint,
    /// The cloud's centroid, from which they point away.
    Centroid,
    /// They were in the cloud.
    Stored,
}

/// Normals of a cloud.
#[derive(Debug, Clone, PartialEq)]
pub struct Normals {
    /// Unit vectors, one a point; zero where the neighbourhood has no plane (fewer than
    /// three points, all on one line or in one place).
    pub vectors: Vec<[f32; 3]>,
    /// λ₀/(λ₀ + λ₁ + λ₂) with the covariance's eigenvalues ascending, in [0, 1/3]: 0 on a
    /// plane. Empty when the normals were stored.
    pub curvature: Vec<f32>,
    /// What oriented them.
    pub oriented_by: OrientedBy,
}

impl Normals {
    /// Whether point `i` has a normal.
    ///
    /// # Panics
    /// When there is no such point.
    pub fn defined(&self, i: usize) -> bool {
        self.vectors[i] != [0.0; 3]
    }

    /// Points without a defined normal.
    pub fn undefined(&self) -> usize {
        self.vectors.iter().filter(|normal| **normal == [0.0; 3]).count()
    }
}

/// Below this share of the largest eigenvalue the second one is rounding: the
/// neighbourhood is a line. f32 coordinates leave 6e-8² ≈ 4e-15.
const LINE: f64 = 1e-12;

/// Estimates the normals of `cloud` from `neighbors`, one neighbourhood a point.
///
/// The normal is the eigenvector of the smallest eigenvalue of the neighbourhood's
/// covariance about its mean (Hoppe et al. 1992; PCL's `NormalEstimation`).
///
/// # Errors
/// [`Error::Shape`] when `neighbors` is of another cloud; [`Error::Config`] for
/// [`Orientation::Stored`] on a cloud without normals or a viewpoint that is not finite.
pub fn estimate(
    cloud: &PointCloud,
    neighbors: &Neighbors,
    orientation: Orientation,
) -> Result<Normals> {
    if orientation == Orientation::Stored {
        return stored(cloud);
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
    let (vectors, curvature) = par::map(points.len(), Vec::new, |members, i| {
        let (normal, curvature) = plane(points, neighbors, i, members);
        let towards = math::sub(reference, points[i].map(f64::from));
        let flip = if sign * math::dot(normal, towards) < 0.0 { -1.0 } else { 1.0 };
        (math::scaled(normal, flip).map(|x| x as f32), curvature as f32)
    })
    .into_iter()
    .unzip();
    Ok(Normals { vectors, curvature, oriented_by })
}

fn stored(cloud: &PointCloud) -> Result<Normals> {
    let Some(normals) = cloud.normals() else {
        let rule = "the cloud has no normals: choose viewpoint or outward";
        return Err(Error::config("orientation", "stored", rule));
    };
    let oriented_by = OrientedBy::Stored;
    Ok(Normals { vectors: normals.to_vec(), curvature: Vec::new(), oriented_by })
}

/// Unoriented normal and curvature of the neighbourhood of point `i`; `members` is scratch.
///
/// Sums run in the order of the indices and about the mean: points that have the same
/// neighbours then have the same normal to the last bit, which keeps the choice of a
/// pair's frame in FPFH from hanging on rounding.
fn plane(
    points: &[[f32; 3]],
    neighbors: &Neighbors,
    i: usize,
    members: &mut Vec<u32>,
) -> (Vec3, f64) {
    members.clear();
    members.extend(neighbors.of(i).iter().map(|neighbor| neighbor.index));
    members.sort_unstable();
    if members.len() < 3 {
        return ([0.0; 3], 0.0);
    }
    let member = |&j: &u32| points[j as usize].map(f64::from);
    let n = members.len() as f64;
    let sum = members.iter().map(member).fold([0.0; 3], math::add);
    let mean = math::scaled(sum, 1.0 / n);
    let mut squares = [0.0; 6];
    for point in members.iter().map(member) {
        let [x, y, z] = math::sub(point, mean);
        for (total, product) in squares.iter_mut().zip([x * x, x * y, x * z, y * y, y * z, z * z]) {
            *total += product;
        }
    }
    let [xx, xy, xz, yy, yz, zz] = squares.map(|total| total / n);
    let (values, vectors) = math::eigen::symmetric(&[[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]);
    if values[1] <= LINE * values[2] {
        return ([0.0; 3], 0.0);
    }
    let curvature = values[0].max(0.0) / (values[0].max(0.0) + values[1] + values[2]);
    (vectors[0], curvature)
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
        assert_eq!(normals(&line, Orientation::Viewpoint).undefined(), 50);
        assert_eq!(normals(&[[1.0, 2.0, 3.0]; 30], Orientation::Viewpoint).undefined(), 30);
        assert_eq!(normals(&line[..2], Orientation::Viewpoint).undefined(), 2);
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
