//! The three angles between two oriented points (Rusu, Blodow and Beetz 2009, section III).

use num_traits::Float;

use crate::math;

/// Sines and cosines of the angles of a pair, in the Darboux frame u, v = d × u, w = u × v of the
/// point whose normal is nearer to the connecting line d. The two points may be exchanged.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct PairFeatures<T> {
    /// (u·n₂, w·n₂): θ = atan2(w·n₂, u·n₂) is the angle of this vector.
    pub(super) theta: [T; 2],
    /// v·n₂ in [−1, 1].
    pub(super) alpha: T,
    /// u·d/‖d‖ in [−1, 1].
    pub(super) phi: T,
    /// ‖d‖/‖d × u‖: the factor by which v and w amplify the rounding of d × u. Infinite or NaN if
    /// there is no frame.
    pub(super) rounding_gain: T,
    /// Difference of the cosines of both normals with the line; infinite if the normals are equal,
    /// because their rounding is then equal, too.
    pub(super) cosine_gap: T,
}

impl<T: Float> PairFeatures<T> {
    /// Computes the features of the points `p1` and `p2` with normals `n1` and `n2`. It has no
    /// branch, so that a loop over it becomes vector code.
    ///
    /// All zero, as in PCL and Open3D, for points at the same position, an undefined normal, or a
    /// normal along the line.
    #[inline(always)]
    pub(super) fn compute(p1: [T; 3], n1: [T; 3], p2: [T; 3], n2: [T; 3]) -> Self {
        let (zero, one) = (T::zero(), T::one());
        let line = math::sub(p2, p1);
        let distance = math::norm(line);
        let share = one / distance;
        let (cosine1, cosine2) = (math::dot(n1, line) * share, math::dot(n2, line) * share);
        let exchanged = cosine1.abs() < cosine2.abs();
        let either = |a: T, b: T| if exchanged { b } else { a };
        let u = [0, 1, 2].map(|k| either(n1[k], n2[k]));
        let other = [0, 1, 2].map(|k| either(n2[k], n1[k]));
        // The line from the other point is the same, reversed.
        let (line, phi) = (line.map(|x| either(x, -x)), either(cosine1, -cosine2));
        // Step by step as in the libraries: for opposite normals, rounding alone decides the side
        // of the circle for θ.
        let v = math::cross(line, u);
        let length = math::norm(v);
        let inverse = one / length;
        let v = math::scaled(v, inverse);
        let w = math::cross(u, v);
        let (x, y) = (math::dot(u, other), math::dot(w, other));
        // `length` is 0 if the distance is, too.
        let defined = |value: T| if length > zero { value } else { zero };
        let same = (n1[0] == n2[0]) & (n1[1] == n2[1]) & (n1[2] == n2[2]);
        PairFeatures {
            theta: [defined(x), defined(y)],
            alpha: defined(math::dot(v, other)),
            phi: defined(phi),
            rounding_gain: distance * inverse,
            cosine_gap: if same { T::infinity() } else { (cosine1.abs() - cosine2.abs()).abs() },
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::Vec3;
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
            let there = PairFeatures::compute([0.0; 3], n1, x, n2);
            let back = PairFeatures::compute(x, n2, [0.0; 3], n1);
            // When both normals are equally near the line, either frame may be taken.
            prop_assume!((math::dot(n1, unit(x)).abs() - math::dot(n2, unit(x)).abs()).abs() > 1e-9);
            let flat = |f: PairFeatures<f64>| [f.theta[0], f.theta[1], f.alpha, f.phi];
            for (a, b) in flat(there).into_iter().zip(flat(back)) {
                prop_assert!((a - b).abs() < 1e-9, "{there:?} {back:?}");
            }
        }
    }

    #[test]
    fn undefined_pairs_are_all_zero() {
        let (o, x, z) = ([0.0; 3], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]);
        let flat = |p1, n1, p2, n2| {
            let f = PairFeatures::compute(p1, n1, p2, n2);
            [f.theta[0], f.theta[1], f.alpha, f.phi]
        };
        assert_eq!(flat(o, z, o, z), [0.0; 4]);
        assert_eq!(flat(o, x, x, x), [0.0; 4]);
        assert_eq!(flat(o, o, x, o), [0.0; 4]);
        assert_eq!(flat(o, z, x, z), [1.0, 0.0, 0.0, 0.0]);
    }
}
