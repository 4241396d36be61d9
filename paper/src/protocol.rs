//! The paper's three tests (section IV-B to IV-D), one trial at a time.

use rand::{Rng, RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};

use super::{Model, Motion};
use cfreg::cloud::{PointCloud, Transform};
use cfreg::error::{Error, Result};
use cfreg::math::{self, Vec3};
use cfreg::verify::{PoseError, pose_error};

/// Revision of the results, incremented whenever a trial of the same settings changes: saved
/// results are then not mixed with new ones.
pub const REVISION: u32 = 1;

/// Generation of the clouds of a pair from the model.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Protocol {
    /// Sensitivity to noise (section IV-B): the same points twice, the target's with
    /// Gaussian noise on every coordinate, moved by one fixed motion.
    Sensitivity {
        /// Standard deviation of the noise, in the model's unit.
        sigma: f64,
    },
    /// Robustness to outliers (section IV-C): the same points twice, and additional points in the
    /// target, sampled uniformly from a ball about its centroid.
    Robustness {
        /// Number of additional points.
        outliers: usize,
        /// Radius of the ball, in the model's unit.
        radius: f64,
    },
    /// Accuracy (section IV-D): two independent samples.
    Accuracy,
}

/// Viewpoint that the normals of a trial are oriented towards.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum NormalViewpoint {
    /// At the origin of the frame, in both clouds: what PCL does unless told otherwise.
    #[default]
    Origin,
    /// The origin of the model's frame, which moves along with the target.
    Along,
    /// The model's centroid, as in a frame that was centred first; it moves along.
    Centroid,
    /// A position in the model's frame; it moves along.
    At(Vec3),
}

/// Selection of a trial.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Draw {
    /// Kind of motion of the target.
    pub motion: Motion,
    /// Where normals look.
    pub viewpoint: NormalViewpoint,
    /// Points that are drawn from the model, at least 3.
    pub points: usize,
    /// Seed of all trials.
    pub seed: u64,
    /// Number of the trial: its data are the same if 8 or 100 trials are run.
    pub number: u64,
}

/// A pair with a known pose.
#[derive(Debug, Clone, PartialEq)]
pub struct Trial {
    /// PC1.
    pub source: PointCloud,
    /// PC2.
    pub target: PointCloud,
    /// Source into the target's frame.
    pub truth: Transform,
}

impl Protocol {
    /// Generates the trial of that number.
    ///
    /// # Errors
    /// [`Error::Config`] for fewer than three points, for noise or a radius that is negative or not
    /// finite, and for a viewpoint that is not finite; the errors of [`Model::sample`].
    pub fn trial(&self, model: &Model, draw: Draw) -> Result<Trial> {
        self.validate()?;
        if draw.points < 3 {
            return Err(Error::config("points", draw.points, "must be at least 3"));
        }
        // One random generator a trial.
        let mut rng = ChaCha8Rng::seed_from_u64(draw.seed);
        rng.set_stream(draw.number);
        let center = model.centroid();
        let truth = match self {
            Protocol::Sensitivity { .. } => draw.motion.fixed(center),
            _ => draw.motion.draw(center, &mut rng),
        };
        let mut source = model.sample(draw.points, rng.next_u64())?;
        let mut target = match *self {
            Protocol::Accuracy => model.sample(draw.points, rng.next_u64())?,
            Protocol::Sensitivity { sigma } => {
                let noisy = |p: Vec3| math::add(p, math::scaled(sample_normal(&mut rng), sigma));
                PointCloud::new(&source.positions().map(noisy).collect::<Vec<Vec3>>())?
            }
            Protocol::Robustness { outliers, radius } => {
                let center = source.centroid();
                let outlier = |()| math::add(center, math::scaled(sample_ball(&mut rng), radius));
                let more: Vec<Vec3> = vec![(); outliers].into_iter().map(outlier).collect();
                PointCloud::new(&source.positions().chain(more).collect::<Vec<Vec3>>())?
            }
        };
        let viewpoint = match draw.viewpoint {
            NormalViewpoint::Origin => None,
            NormalViewpoint::Along => Some([0.0; 3]),
            NormalViewpoint::Centroid => Some(center),
            NormalViewpoint::At(place) => Some(place),
        };
        if let Some(viewpoint) = viewpoint {
            source = source.with_viewpoint(viewpoint)?;
            target = target.with_viewpoint(viewpoint)?;
        }
        Ok(Trial { source, target: target.transformed(&truth)?, truth })
    }

    fn validate(&self) -> Result<()> {
        let (field, value) = match *self {
            Protocol::Sensitivity { sigma } => ("sigma", sigma),
            Protocol::Robustness { radius, .. } => ("radius", radius),
            Protocol::Accuracy => return Ok(()),
        };
        if !(value >= 0.0 && value.is_finite()) {
            return Err(Error::config(field, value, "must be 0 or more, and finite"));
        }
        if let Protocol::Robustness { outliers, .. } = *self
            && outliers > MAX_OUTLIERS
        {
            let rule = format!("must be at most {MAX_OUTLIERS}");
            return Err(Error::config("outliers", outliers, rule));
        }
        Ok(())
    }
}

/// Most outliers of a trial.
const MAX_OUTLIERS: usize = 10_000_000;

impl Trial {
    /// Returns the error of `found` relative to the truth.
    pub fn error(&self, found: &Transform) -> PoseError {
        pose_error(found, &self.truth, self.source.centroid())
    }

    /// Returns the paper's average shift (section IV-B, after Tsin and Kanade): the mean distance
    /// between the source's points under `found` and under the true pose, in the model's unit.
    pub fn average_shift(&self, found: &Transform) -> f64 {
        let apart = |p| math::norm(math::sub(found.apply(p), self.truth.apply(p)));
        self.source.positions().map(apart).sum::<f64>() / self.source.len() as f64
    }
}

/// Three independent standard normal numbers (Marsaglia's polar method, one of each pair).
fn sample_normal(rng: &mut ChaCha8Rng) -> Vec3 {
    [(); 3].map(|()| {
        loop {
            let [x, y] = [(); 2].map(|()| 2.0 * rng.random::<f64>() - 1.0);
            let square = x * x + y * y;
            if square > 0.0 && square < 1.0 {
                return x * (-2.0 * square.ln() / square).sqrt();
            }
        }
    })
}

/// Evenly from the unit ball, by rejection from the cube.
fn sample_ball(rng: &mut ChaCha8Rng) -> Vec3 {
    loop {
        let p = [(); 3].map(|()| 2.0 * rng.random::<f64>() - 1.0);
        if math::dot(p, p) <= 1.0 {
            return p;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use cfreg::cloud::shape::boulder;

    fn draw(motion: Motion, number: u64) -> Draw {
        Draw { motion, viewpoint: NormalViewpoint::Origin, points: 400, seed: 3, number }
    }

    fn trial(protocol: Protocol, motion: Motion, number: u64) -> Trial {
        protocol.trial(&boulder().into(), draw(motion, number)).unwrap()
    }

    #[test]
    fn noise_has_its_deviation_and_its_fixed_motion() {
        let protocol = Protocol::Sensitivity { sigma: 0.02 };
        let [one, two] = [0, 1].map(|number| trial(protocol, Motion::Small, number));
        assert_eq!(one.truth, two.truth);
        assert_ne!(one.source, two.source);
        let rest = |(p, q): (Vec3, Vec3)| math::sub(one.truth.apply(p), q);
        let rests: Vec<Vec3> =
            one.source.positions().zip(one.target.positions()).map(rest).collect();
        let square = rests.iter().map(|r| math::dot(*r, *r)).sum::<f64>();
        let sigma = (square / (3.0 * rests.len() as f64)).sqrt();
        // From 1200 numbers: known to 2 %, three times that is allowed.
        assert!((sigma / 0.02 - 1.0).abs() < 0.06, "{sigma}");
    }

    #[test]
    fn outliers_fill_their_ball_and_the_rest_corresponds() {
        let protocol = Protocol::Robustness { outliers: 300, radius: 0.4 };
        let made = trial(protocol, Motion::Large, 5);
        assert_eq!((made.source.len(), made.target.len()), (400, 700));
        let moved = made.source.positions().map(|p| made.truth.apply(p));
        let apart = moved.zip(made.target.positions()).map(|(p, q)| math::norm(math::sub(p, q)));
        assert!(apart.fold(0.0, f64::max) < 1e-6);
        let center = made.truth.apply(made.source.centroid());
        let far = |q| math::norm(math::sub(q, center));
        let radii: Vec<f64> = made.target.positions().skip(400).map(far).collect();
        assert!(radii.iter().all(|&r| r < 0.4 + 1e-6));
        // A uniform ball has half of its points within 0.794 of its radius.
        let inner = radii.iter().filter(|&&r| r < 0.7937 * 0.4).count();
        assert!((120..180).contains(&inner), "{inner}");
    }

    #[test]
    fn the_average_shift_is_zero_at_the_truth_and_a_shift_by_itself() {
        let made = trial(Protocol::Accuracy, Motion::Large, 0);
        assert_eq!(made.average_shift(&made.truth), 0.0);
        let mut off = made.truth;
        off.translation[1] += 0.25;
        assert!((made.average_shift(&off) - 0.25).abs() < 1e-12);
        assert!(made.error(&off).rotation_deg == 0.0);
    }

    #[test]
    fn a_viewpoint_that_moves_along_is_the_same_place_of_the_model() {
        let model = Model::from(boulder());
        let viewpoints = |viewpoint| {
            let made =
                Protocol::Accuracy.trial(&model, Draw { viewpoint, ..draw(Motion::Small, 2) });
            let made = made.unwrap();
            let back = made.truth.inverse();
            (made.source.viewpoint(), made.target.viewpoint().map(|place| back.apply(place)))
        };
        assert_eq!(viewpoints(NormalViewpoint::Origin), (None, None));
        let place = [0.3, -4.0, 0.5];
        for (viewpoint, want) in [
            (NormalViewpoint::Along, [0.0; 3]),
            (NormalViewpoint::Centroid, model.centroid()),
            (NormalViewpoint::At(place), place),
        ] {
            let (source, target) = viewpoints(viewpoint);
            assert_eq!(source, Some(want));
            assert!(math::norm(math::sub(target.unwrap(), want)) < 1e-12, "{viewpoint:?}");
        }
        let nowhere =
            Draw { viewpoint: NormalViewpoint::At([f64::NAN; 3]), ..draw(Motion::Small, 0) };
        let refused = Protocol::Accuracy.trial(&model, nowhere);
        assert!(matches!(refused, Err(Error::Config { field: "viewpoint", .. })));
    }

    #[test]
    fn settings_out_of_range_are_named() {
        let model = Model::from(boulder());
        let field = |protocol: Protocol, points| match protocol
            .trial(&model, Draw { points, ..draw(Motion::Small, 0) })
        {
            Err(Error::Config { field, .. }) => field,
            other => panic!("{other:?}"),
        };
        assert_eq!(field(Protocol::Accuracy, 2), "points");
        assert_eq!(field(Protocol::Sensitivity { sigma: f64::NAN }, 9), "sigma");
        assert_eq!(field(Protocol::Robustness { outliers: 1, radius: -1.0 }, 9), "radius");
        let many = Protocol::Robustness { outliers: usize::MAX, radius: 1.0 };
        assert_eq!(field(many, 9), "outliers");
    }
}
