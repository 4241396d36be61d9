//! When the iterations of ICP end.

use std::collections::VecDeque;

use super::Icp;
use crate::cloud::Transform;
use crate::math::{self, Vec3};
use crate::method::StopReason;

/// Number of last steps: a pose that returns to one of them has converged, as a few sets of pairs
/// then alternate without end. Five of 38 refinements of scans by the surface metrics did.
const CYCLE_LENGTH: usize = 8;

/// The last poses, which a pose that rests is near, and the error before the step.
pub(super) struct Convergence<'a> {
    config: &'a Icp,
    poses: VecDeque<Transform>,
    /// Centre of the source, whose motion is the translation of a step.
    center: Vec3,
    /// Largest rotation, radians, and translation of a step at rest.
    tolerances: (f64, f64),
    /// Mean squared distance of the pairs.
    error: f64,
}

impl<'a> Convergence<'a> {
    /// `center` is that of the source, `unit` the length that the tolerance of the translation is
    /// relative to.
    pub(super) fn new(config: &'a Icp, center: Vec3, unit: f64, initial: Transform) -> Self {
        Convergence {
            config,
            poses: VecDeque::from([initial]),
            center,
            tolerances: (config.rotation_tolerance, config.translation_tolerance * unit),
            error: f64::INFINITY,
        }
    }

    /// Returns the reason to stop, if there is one, after an iteration that ended at `pose`;
    /// `error` is the mean squared distance of its pairs.
    pub(super) fn check(
        &mut self,
        pose: Transform,
        error: f64,
        iteration: u32,
    ) -> Option<StopReason> {
        let Icp { error_tolerance, relative_error_tolerance, max_iterations, .. } = *self.config;
        let before = std::mem::replace(&mut self.error, error);
        let change = (before - error).abs();
        let least_change = error_tolerance.max(relative_error_tolerance * before);
        match () {
            () if self.contains_near(pose) => Some(StopReason::PoseSettled),
            () if change < least_change => Some(StopReason::ObjectiveSettled),
            () if iteration == max_iterations => Some(StopReason::IterationLimit),
            () => None,
        }
    }

    /// Returns whether one of the poses is near `pose`, and adds it.
    fn contains_near(&mut self, pose: Transform) -> bool {
        let near = |other: &Transform| {
            let turned = math::mat_mul(&pose.rotation, &math::transpose(&other.rotation));
            let shift = math::norm(math::sub(pose.apply(self.center), other.apply(self.center)));
            Transform::rigid(turned, [0.0; 3]).angle() <= self.tolerances.0
                && shift <= self.tolerances.1
        };
        let rests = self.poses.iter().any(near);
        self.poses.push_back(pose);
        if self.poses.len() > CYCLE_LENGTH {
            self.poses.pop_front();
        }
        rests
    }
}
