//! The three angles between two oriented points (Rusu, Blodow and Beetz 2009, section III).

use crate::math::{self, Vec3};

/// What the angles of a pair are told by, in the Darboux frame u, v = d × u, w = u × v of the
/// point whose normal is nearer to the connecting line d. The two points may be exchanged.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Features {
    /// (u·n₂, w·n₂): θ = atan2(w·n₂, u·n₂) is the angle of this vector.
    pub(super) theta: [f64; 2],
    /// v·n₂ in [−1, 1].
    pub(super) alpha: f64,
    /// u·d/‖d‖ in [−1, 1].
    pub(super) phi: f64,
}

impl Features {
    /// Of the pair of points `p1` and `p2` with normals `n1` and `n2`. Without a branch, so
    /// that a loop over it becomes vector code.
    ///
    /// All zero, as PCL and Open3D have it, for points in one place, an undefined normal, or a
    /// normal along the line.
    #[inline(always)]
    pub(super) fn of(p1: Vec3, n1: Vec3, p2: Vec3, n2: Vec3) -> Self {
        let line = math::sub(p2, p1);
        let share = 1.0 / math::norm(line);
        let (cosine1, cosine2) = (math::dot(n1, line) * share, math::dot(n2, line) * share);
        let exchanged = cosine1.abs() < cosine2.abs();
        let either = |a: f64, b: f64| if exchanged { b } else { a };
        let u = [0, 1, 2].map(|k| either(n1[k], n2[k]));
        let other = [0, 1, 2].map(|k| either(n2[k], n1[k]));
        // The line from the other point is the same, the other way round.
        let (line, phi) = (line.map(|x| either(x, -x)), either(cosine1, -cosine2));
        // Step by step as the libraries do: of opposite normals, rounding alone says on which
        // side of the circle θ is.
        let v = math::cross(line, u);
        let length = math::norm(v);
        let v = math::scaled(v, 1.0 / length);
        let w = math::cross(u, v);
        let (x, y) = (math::dot(u, other), math::dot(w, other));
        // `length` is 0, too, where the distance is.
        let defined = |value: f64| if length > 0.0 { value } else { 0.0 };
        Features {
            theta: [defined(x), defined(y)],
            alpha: defined(math::dot(v, other)),
            phi: defined(phi),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn unit(x: [f64; 3]) -> Vec3 {
        math::normalized(x)
    }

    proptest! {
        #[test]
        fn the_points_may_be_exchanged(
            x in proptest::array::uniform3(-1.0..1.0f64),
            n1 in proptest::array::uniform3(-1.0..1.0f64),
            n2 in proptest::array::uniform3(-1.0..1.0f64),
        ) {
            let (n1, n2) = (unit(n1), unit(n2));
            let there = Features::of([0.0; 3], n1, x, n2);
            let back = Features::of(x, n2, [0.0; 3], n1);
            // When both normals are equally near the line, either frame may be taken.
            prop_assume!((math::dot(n1, unit(x)).abs() - math::dot(n2, unit(x)).abs()).abs() > 1e-9);
            let flat = |f: Features| [f.theta[0], f.theta[1], f.alpha, f.phi];
            for (a, b) in flat(there).into_iter().zip(flat(back)) {
                prop_assert!((a - b).abs() < 1e-9, "{there:?} {back:?}");
            }
        }
    }

    #[test]
    fn undefined_pairs_are_all_zero() {
        let (o, x, z) = ([0.0; 3], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]);
        let none = Features { theta: [0.0; 2], alpha: 0.0, phi: 0.0 };
        assert_eq!(Features::of(o, z, o, z), none);
        assert_eq!(Features::of(o, x, x, x), none);
        assert_eq!(Features::of(o, o, x, o), none);
        assert_eq!(Features::of(o, z, x, z), Features { theta: [1.0, 0.0], ..none });
    }
}
