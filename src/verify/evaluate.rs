//! How well two clouds fit under a pose.

use serde::ser::SerializeStruct;
use serde::{Deserialize, Deserializer, Serialize, Serializer};

use crate::cloud::{PointCloud, Transform};
use crate::error::{Error, Result};
use crate::math::{self, Vec3};
use crate::par;
use crate::search::{self, NearestDistances};

/// Default inlier distance, in resolutions of the coarser cloud.
pub const DISTANCE_IN_RESOLUTIONS: f64 = 2.0;

/// Fit of two clouds under a pose.
///
/// Serialises with its [`chance_corrected_fitness`](Self::chance_corrected_fitness).
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct Evaluation {
    /// Share of the *source* points that have a target point within
    /// [`max_distance`](Self::max_distance) once moved, in [0, 1].
    pub fitness: f64,
    /// Share of the *target* points that have a moved source point within that distance, in [0, 1].
    pub target_fitness: f64,
    /// Root mean square distance of the source points counted in `fitness` to their nearest target
    /// points, in the target's unit; `null` (NaN) if there are none.
    pub inlier_rmse: f64,
    /// Inlier distance, in the target's unit.
    pub max_distance: f64,
    /// The fitness that a wrong rotation gets by chance: mean over quarter turns of the source
    /// about its own centre. High for dense, compact or symmetric clouds.
    pub chance_fitness: f64,
}

impl Evaluation {
    /// Returns the fitness beyond chance, (fitness − chance)/(1 − chance), at most 1: comparable
    /// between clouds of different density and shape, unlike the fitness. 0 when chance is 1.
    pub fn chance_corrected_fitness(&self) -> f64 {
        if self.chance_fitness < 1.0 {
            (self.fitness - self.chance_fitness) / (1.0 - self.chance_fitness)
        } else {
            0.0
        }
    }
}

impl Serialize for Evaluation {
    fn serialize<S: Serializer>(&self, serializer: S) -> std::result::Result<S::Ok, S::Error> {
        let mut fields = serializer.serialize_struct("Evaluation", 6)?;
        fields.serialize_field("fitness", &self.fitness)?;
        fields.serialize_field("target_fitness", &self.target_fitness)?;
        fields.serialize_field("inlier_rmse", &self.inlier_rmse)?;
        fields.serialize_field("max_distance", &self.max_distance)?;
        fields.serialize_field("chance", &self.chance_fitness)?;
        fields.serialize_field("agreement", &self.chance_corrected_fitness())?;
        fields.end()
    }
}

impl<'de> Deserialize<'de> for Evaluation {
    /// From the fields that are serialised: `null` is NaN, `agreement` follows from the others.
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> std::result::Result<Self, D::Error> {
        #[derive(Deserialize)]
        struct Fields {
            fitness: Option<f64>,
            target_fitness: Option<f64>,
            inlier_rmse: Option<f64>,
            max_distance: Option<f64>,
            chance: Option<f64>,
        }
        let fields = Fields::deserialize(deserializer)?;
        let number = |value: Option<f64>| value.unwrap_or(f64::NAN);
        Ok(Evaluation {
            fitness: number(fields.fitness),
            target_fitness: number(fields.target_fitness),
            inlier_rmse: number(fields.inlier_rmse),
            max_distance: number(fields.max_distance),
            chance_fitness: number(fields.chance),
        })
    }
}

/// [`DISTANCE_IN_RESOLUTIONS`] times the coarser cloud's resolution (median distance to
/// the nearest neighbour), the source's in the target's unit: what two independent
/// samples of one surface keep from each other.
///
/// # Errors
/// Those of [`search::resolution`].
pub fn default_distance(source: &PointCloud, target: &PointCloud, scale: f64) -> Result<f64> {
    let [source, target] =
        par::join_pair([source, target], |cloud| search::resolution(cloud.points()))?;
    Ok(default_distance_from_resolutions(source, target, scale))
}

/// Returns the [`default_distance`] of clouds whose resolutions are known.
pub(crate) fn default_distance_from_resolutions(source: f64, target: f64, scale: f64) -> f64 {
    DISTANCE_IN_RESOLUTIONS * (source * scale).max(target)
}

/// Evaluates the fit of `source`, moved by `transform`, to `target`.
///
/// # Errors
/// [`Error::TooFewPoints`] for an empty cloud, [`Error::Config`] unless `max_distance` is finite
/// and not negative, [`Error::Extent`] when the moved source exceeds the coordinate range.
pub fn evaluate(
    source: &PointCloud,
    target: &PointCloud,
    transform: &Transform,
    max_distance: f64,
) -> Result<Evaluation> {
    if !(max_distance >= 0.0 && max_distance.is_finite()) {
        let rule = "must be a finite distance, 0 or more";
        return Err(Error::config("max_distance", max_distance, rule));
    }
    for (cloud, name) in [(source, "the source"), (target, "the target")] {
        if cloud.is_empty() {
            return Err(Error::TooFewPoints { what: name.into(), found: 0, needed: 1 });
        }
    }
    // Both clouds about the target's origin, so that f32 distances are as fine as its points.
    let moved = |p| math::sub(transform.apply(p), target.origin()).map(|x| x as f32);
    let moved: Vec<[f32; 3]> = source.positions().map(moved).collect();
    if moved.as_flattened().iter().any(|x| x.is_nan() || x.abs() > 1e18) {
        return Err(Error::Extent { extent: f64::INFINITY });
    }
    let limit = (max_distance * max_distance) as f32;
    let [source_points, target_points] =
        par::join_pair([&moved[..], target.points()], NearestDistances::new)?;
    let moved: Vec<[f32; 3]> = source_points.points().collect();
    let there = target_points.squared_distances(&moved, limit);
    let back = source_points.squared_distances(&target_points.points().collect::<Vec<_>>(), limit);
    let inliers = |distances: &[f32]| distances.iter().filter(|&&d| d <= limit).count();
    let count = inliers(&there);
    let sum: f64 = there.iter().filter(|&&d| d <= limit).map(|&d| f64::from(d)).sum();
    Ok(Evaluation {
        fitness: count as f64 / source.len() as f64,
        target_fitness: inliers(&back) as f64 / target.len() as f64,
        inlier_rmse: (sum / count as f64).sqrt(),
        max_distance,
        chance_fitness: chance_fitness(&moved, &target_points, limit),
    })
}

/// Most points for the measurement of the chance fitness: they give a share to 0.01.
const MAX_CHANCE_POINTS: usize = 1000;

/// Returns the mean fitness of `moved` after quarter turns about its centroid.
fn chance_fitness(moved: &[[f32; 3]], target: &NearestDistances, limit: f32) -> f64 {
    let step = moved.len().div_ceil(MAX_CHANCE_POINTS);
    let points: Vec<Vec3> = moved.iter().step_by(step).map(|p| p.map(f64::from)).collect();
    let n = points.len() as f64;
    let center = math::scaled(points.iter().fold([0.0; 3], |sum, &p| math::add(sum, p)), 1.0 / n);
    let quarter = std::f64::consts::FRAC_PI_2;
    let mut inliers = 0;
    for (axis, turns) in (0..3).flat_map(|axis| [1.0, 2.0, 3.0].map(|turns| (axis, turns))) {
        let mut vector = [0.0; 3];
        vector[axis] = quarter * turns;
        let turn = Transform::from_rotation_vector(vector);
        let turned: Vec<[f32; 3]> = points
            .iter()
            .map(|&p| math::add(turn.rotate(math::sub(p, center)), center).map(|x| x as f32))
            .collect();
        inliers += target.squared_distances(&turned, limit).iter().filter(|&&d| d <= limit).count();
    }
    inliers as f64 / (9.0 * n)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn line(n: usize, shift: f64) -> PointCloud {
        let points: Vec<_> = (0..n).map(|i| [i as f64 + shift, 1.0, 0.0]).collect();
        PointCloud::new(&points).unwrap()
    }

    #[test]
    fn fitness_names_its_denominator() {
        let (short, long) = (line(10, 0.0), line(40, 0.0));
        let found = evaluate(&short, &long, &Transform::IDENTITY, 0.1).unwrap();
        assert_eq!((found.fitness, found.target_fitness), (1.0, 0.25));
        assert_eq!(found.inlier_rmse, 0.0);
        let shifted = Transform::rigid(math::IDENTITY, [35.25, 0.0, 0.0]);
        let found = evaluate(&short, &long, &shifted, 0.5).unwrap();
        assert_eq!((found.fitness, found.inlier_rmse), (0.5, 0.25));
        assert_eq!(default_distance(&short, &long, 1.0).unwrap(), 2.0);
    }

    #[test]
    fn nothing_near_is_no_fitness_and_no_rmse() {
        let far = Transform::rigid(math::IDENTITY, [1e6, 0.0, 0.0]);
        let found = evaluate(&line(5, 0.0), &line(5, 0.0), &far, 1.0).unwrap();
        assert!(found.fitness == 0.0 && found.inlier_rmse.is_nan());
    }

    #[test]
    fn odd_input_is_refused() {
        let (empty, some) = (PointCloud::default(), line(3, 0.0));
        let identity = Transform::IDENTITY;
        assert!(matches!(evaluate(&empty, &some, &identity, 1.0), Err(Error::TooFewPoints { .. })));
        for distance in [-1.0, f64::NAN, f64::INFINITY] {
            let found = evaluate(&some, &some, &identity, distance);
            assert!(matches!(found, Err(Error::Config { .. })));
        }
        let huge = Transform { scale: 1e300, ..identity };
        assert!(matches!(evaluate(&some, &some, &huge, 1.0), Err(Error::Extent { .. })));
    }
}
