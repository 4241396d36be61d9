//! The three angles between two oriented points (Rusu, Blodow and Beetz 2009, section III).

use crate::math::{self, Vec3};

/// Angles (f1, f2, f3) of the pair: f1 = θ = atan2(w·n₂, u·n₂) in [−π, π], f2 = α = v·n₂
/// and f3 = φ = u·d/‖d‖ in [−1, 1], in the Darboux frame u, v = d × u, w = u × v of the
/// point whose normal is nearer to the connecting line. The two points may be exchanged.
///
/// `None` for points in one place, an undefined normal, or a normal along the line.
pub(super) fn features(p1: Vec3, n1: Vec3, p2: Vec3, n2: Vec3) -> Option<[f64; 3]> {
    let line = math::sub(p2, p1);
    let distance = math::norm(line);
    if distance == 0.0 {
        return None;
    }
    let (along1, along2) = (math::dot(n1, line) / distance, math::dot(n2, line) / distance);
    let (u, other, line, f3) = if along1.abs() < along2.abs() {
        (n2, n1, math::scaled(line, -1.0), -along2)
    } else {
        (n1, n2, line, along1)
    };
    let v = math::cross(line, u);
    let length = math::norm(v);
    if length == 0.0 {
        return None;
    }
    let v = math::scaled(v, 1.0 / length);
    let w = math::cross(u, v);
    let f1 = math::dot(w, other).atan2(math::dot(u, other));
    Some([f1, math::dot(v, other), f3])
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
            let there = features([0.0; 3], n1, x, n2);
            let back = features(x, n2, [0.0; 3], n1);
            let (Some(there), Some(back)) = (there, back) else { return Ok(()) };
            // When both normals are equally near the line, either frame may be taken.
            prop_assume!((math::dot(n1, unit(x)).abs() - math::dot(n2, unit(x)).abs()).abs() > 1e-9);
            for k in 0..3 {
                prop_assert!((there[k] - back[k]).abs() < 1e-9, "{there:?} {back:?}");
            }
        }
    }

    #[test]
    fn undefined_pairs_have_no_features() {
        let (o, x, z) = ([0.0; 3], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]);
        assert_eq!(features(o, z, o, z), None);
        assert_eq!(features(o, x, x, x), None);
        assert_eq!(features(o, o, x, o), None);
        assert_eq!(features(o, z, x, z), Some([0.0, 0.0, 0.0]));
    }
}
