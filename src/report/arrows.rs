//! Unobservable motions, as arrows.

use serde::Serialize;

use super::text;
use crate::math::{self, Vec3};
use crate::verify::{PoseCovariance, Twist};

/// A motion as a rotation about an axis and a translation along it, relative to the middle of the
/// target.
#[derive(Debug, Clone, Serialize)]
pub(super) struct Arrow {
    /// A point on the axis.
    pub(super) center: Vec3,
    /// Unit vector along the axis.
    pub(super) axis: Vec3,
    /// Whether it rotates, and whether it translates; both for a screw motion.
    pub(super) turns: bool,
    pub(super) slides: bool,
    /// Description in words.
    pub(super) words: String,
}

/// Smallest part of a motion that is reported: a tenth. Chosen by hand.
const MIN_COMPONENT: f64 = 0.1;

impl Arrow {
    /// Converts every unobservable motion; `middle` is the middle of the target.
    pub(super) fn unconstrained_motions(covariance: &PoseCovariance, middle: Vec3) -> Vec<Arrow> {
        let center = covariance.center;
        covariance.unobservable.iter().map(|twist| Arrow::new(twist, center, middle)).collect()
    }

    fn new(twist: &Twist, center: Vec3, middle: Vec3) -> Arrow {
        let Twist { rotation, translation } = *twist;
        let turn = math::norm(rotation);
        let local = math::sub(center, middle);
        let named = |axis: Vec3| {
            let [x, y, z] = axis.map(|part| format!("{:.2}", part + 0.0));
            format!("({x}, {y}, {z})")
        };
        if turn < MIN_COMPONENT {
            let axis = math::normalized(translation);
            let words = format!("slides along {}", named(axis));
            return Arrow { center: local, axis, turns: false, slides: true, words };
        }
        let axis = math::scaled(rotation, 1.0 / turn);
        // The point of the motion's axis that is nearest to the center.
        let off = math::scaled(math::cross(rotation, translation), 1.0 / (turn * turn));
        let along = math::dot(axis, translation).abs();
        // From |ω|² + |τ|²/r² = 1.
        let radius = math::norm(translation) / (1.0 - turn * turn).max(1e-12).sqrt();
        let slides =
            along > MIN_COMPONENT * radius && turn < (1.0 - MIN_COMPONENT * MIN_COMPONENT).sqrt();
        let place = math::add(local, off);
        let [x, y, z] = math::add(place, middle).map(text::format_number);
        let also = if slides { ", sliding along it," } else { "" };
        let words = format!("turns about {} through ({x}, {y}, {z}){also}", named(axis));
        Arrow {
            center: place,
            axis,
            turns: true,
            slides,
            words: words.trim_end_matches(',').into(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn arrow(rotation: Vec3, translation: Vec3) -> Arrow {
        Arrow::new(&Twist { rotation, translation }, [1.0, 0.0, 0.0], [0.0; 3])
    }

    #[test]
    fn motions_are_turns_slides_and_screws() {
        let slide = arrow([0.0; 3], [0.0, 3.0, 0.0]);
        assert!(slide.slides && !slide.turns && slide.axis == [0.0, 1.0, 0.0]);
        let turn = arrow([0.0, 0.0, 1.0], [0.0; 3]);
        assert!(turn.turns && !turn.slides && turn.center == [1.0, 0.0, 0.0]);
        // A rotation about z through (1, 2, 0) moves (1, 0, 0) along x.
        let (half, radius) = (0.5f64.sqrt(), 2.0);
        let beside = arrow([0.0, 0.0, half], [half * radius, 0.0, 0.0]);
        assert!(beside.turns && !beside.slides);
        assert!((beside.center[1] - 2.0).abs() < 1e-12, "{beside:?}");
        let screw = arrow([0.0, 0.0, half], [0.0, 0.0, half * radius]);
        assert!(screw.turns && screw.slides && screw.words.contains("sliding"));
    }
}
