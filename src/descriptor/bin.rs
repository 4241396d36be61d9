//! Bins of the angles of pairs: f32 where it is certain, the rest in f64.
//!
//! Eleven bins need few digits, unless an angle is near an edge. So the angles of a pair are first
//! computed in f32, with a bound of their rounding; pairs with an angle so near to an edge that
//! rounding may decide are computed again in f64. The bins are always those of f64: an exact result
//! behind a filter, as in geometric predicates (Shewchuk 1997, "Adaptive Precision Floating-Point
//! Arithmetic and Fast Robust Geometric Predicates").
//!
//! # The bound
//! With u = 2⁻²⁴ and unit normals: the error of d = p₂ − p₁ is u‖d‖, of n·d 4 u‖d‖ and hence of its
//! share of ‖d‖ 10 u; of d × u 4.3 u‖d‖, hence of v and w some 13 u ‖d‖/‖d × u‖, of v·n₂ and w·n₂
//! at most 22 u ‖d‖/‖d × u‖; finding the bin adds 4 u. Normals of length l multiply the errors by
//! l², and the amplification by 1/l: [`EDGE_TOLERANCE`] of 64 u is enough up to l² = 1.5. Longer
//! normals are computed in f64.

use num_traits::Float;

use super::layout::BLOCK;
use super::pair_features::PairFeatures;
use crate::math;

/// Number of pairs computed together.
pub(super) const LANES: usize = 16;
/// Pairs in f64 at a time: as many as f32 in a vector would not stay in registers.
const HALF: usize = LANES / 2;

/// A sine or cosine whose distance from an edge of bins is below this, times
/// [`PairFeatures::rounding_gain`], is computed in f64.
const EDGE_TOLERANCE: f32 = 64.0 * (f32::EPSILON / 2.0);
/// Largest squared length of normals for which the bound is valid.
const MAX_SQUARED_NORMAL: f32 = 1.5;
/// Squared distances for which no intermediate f32 value loses digits.
const SQUARED_DISTANCE_RANGE: std::ops::Range<f32> = 1e-24..1e36;

/// An oriented point.
#[derive(Debug, Clone, Copy)]
pub(super) struct OrientedPoint {
    pub(super) place: [f32; 3],
    pub(super) normal: [f32; 3],
}

/// Oriented points, one array an axis.
#[derive(Clone, Copy, Default)]
pub(super) struct OrientedPointLanes {
    pub(super) place: [[f32; LANES]; 3],
    pub(super) normal: [[f32; LANES]; 3],
}

impl OrientedPointLanes {
    /// Gathers the points of a cloud at the indices `others`.
    #[inline(always)]
    pub(super) fn fill(
        &mut self,
        points: &[[f32; 3]],
        normals: &[[f32; 3]],
        others: &[u32; LANES],
    ) {
        for (k, &j) in others.iter().enumerate() {
            let (place, normal) = (points[j as usize], normals[j as usize]);
            for axis in 0..3 {
                self.place[axis][k] = place[axis];
                self.normal[axis][k] = normal[axis];
            }
        }
    }

    /// Without closures, which need not be inlined: with them descriptors took four times as long.
    #[inline(always)]
    fn get(&self, k: usize) -> OrientedPoint {
        let ([x, y, z], [u, v, w]) = (&self.place, &self.normal);
        OrientedPoint { place: [x[k], y[k], z[k]], normal: [u[k], v[k], w[k]] }
    }
}

/// Computes the bins of θ, α and φ of `point` with each of `others`.
///
/// The call is inside a SIMD dispatch.
#[inline(always)]
pub(super) fn bins(point: OrientedPoint, others: &OrientedPointLanes) -> [[u32; LANES]; 3] {
    let (found, doubted) = bins_f32(point, others);
    if doubted == 0 { found } else { bins_f64(point, others) }
}

/// Computes the bins in f32, and counts those that may be wrong.
#[inline(always)]
fn bins_f32(point: OrientedPoint, others: &OrientedPointLanes) -> ([[u32; LANES]; 3], u32) {
    let (mut theta, mut alpha, mut phi) = ([0; LANES], [0; LANES], [0; LANES]);
    let mut doubted = [0u32; LANES];
    let own = math::dot(point.normal, point.normal);
    for k in 0..LANES {
        let other = others.get(k);
        let features = PairFeatures::compute(point.place, point.normal, other.place, other.normal);
        let line = math::sub(other.place, point.place);
        let squared = math::dot(line, line);
        let (t, at) = theta_bin(features.theta);
        let (a, aa) = cosine_bin(features.alpha);
        let (f, af) = cosine_bin(features.phi);
        let nearest = min_unchecked(at, min_unchecked(aa, af));
        let longest = |own: f32, other: f32| if own > other { own } else { other };
        let length = longest(own, math::dot(other.normal, other.normal));
        // Written so that NaN is not certain.
        let sure = (nearest > EDGE_TOLERANCE * features.rounding_gain)
            & (features.cosine_gap > EDGE_TOLERANCE)
            & (length < MAX_SQUARED_NORMAL)
            & (squared > SQUARED_DISTANCE_RANGE.start)
            & (squared < SQUARED_DISTANCE_RANGE.end);
        (theta[k], alpha[k], phi[k]) = (bits(t), bits(a), bits(f));
        doubted[k] = u32::from(!sure);
    }
    ([theta, alpha, phi], doubted.iter().sum())
}

/// Computes the bins in f64.
#[inline(always)]
fn bins_f64(point: OrientedPoint, others: &OrientedPointLanes) -> [[u32; LANES]; 3] {
    let mut found = [[0; LANES]; 3];
    let (place, normal) = (point.place.map(f64::from), point.normal.map(f64::from));
    for half in 0..LANES / HALF {
        let (mut theta, mut alpha, mut phi) = ([0.0; HALF], [0.0; HALF], [0.0; HALF]);
        for k in 0..HALF {
            let other = others.get(half * HALF + k);
            let (to, n) = (other.place.map(f64::from), other.normal.map(f64::from));
            let features = PairFeatures::compute(place, normal, to, n);
            theta[k] = theta_bin(features.theta).0;
            alpha[k] = cosine_bin(features.alpha).0;
            phi[k] = cosine_bin(features.phi).0;
        }
        for (found, bins) in found.iter_mut().zip([theta, alpha, phi]) {
            let part = &mut found[half * HALF..][..HALF];
            part.iter_mut().zip(bins).for_each(|(to, bin)| *to = bin as u32);
        }
    }
    found
}

/// Cosine and sine of the edges of θ's bins above 0, (2k + 1) π / 11.
const EDGES: [[f64; 2]; BLOCK / 2] = [
    [0.959_492_973_614_497_4, 0.281_732_556_841_429_67],
    [0.654_860_733_945_285_1, 0.755_749_574_354_258_3],
    [0.142_314_838_273_285_14, 0.989_821_441_880_932_7],
    [-0.415_415_013_001_886_44, 0.909_631_995_354_518_4],
    [-0.841_253_532_831_181_2, 0.540_640_817_455_597_6],
];

/// Finds the bin, of 11 over [−π, π], of the angle of a vector: it counts the edges between the
/// middle bin and the vector, on either side. Returns the distance of the vector from the nearest
/// edge, too.
#[inline(always)]
fn theta_bin<T: Float>([x, y]: [T; 2]) -> (T, T) {
    let (zero, one) = (T::zero(), T::one());
    let mut beyond = zero;
    // On the left the sign of y separates the first bin from the last.
    let mut nearest = if x < zero { y.abs() } else { T::infinity() };
    for [cos, sin] in EDGES {
        let side = constant::<T>(cos) * y.abs() - constant::<T>(sin) * x;
        beyond = beyond + if side > zero { one } else { zero };
        nearest = min_unchecked(nearest, side.abs());
    }
    (constant::<T>((BLOCK / 2) as f64) + beyond.copysign(y), nearest)
}

/// Finds the bin, of 11 over [−1, 1], and the distance of the cosine from the nearest edge.
#[inline(always)]
fn cosine_bin<T: Float>(cosine: T) -> (T, T) {
    let at = (cosine + T::one()) * constant(0.5) * constant(BLOCK as f64);
    let bin = at.floor();
    let nearest = min_unchecked(at - bin, bin + T::one() - at);
    (clamp_bin(bin, (BLOCK - 1) as f64), nearest * constant(2.0 / BLOCK as f64))
}

/// Clamps to at least 0 and at most `last`; 0 for NaN.
#[inline(always)]
fn clamp_bin<T: Float>(bin: T, last: f64) -> T {
    let some = if bin > T::zero() { bin } else { T::zero() };
    min_unchecked(some, constant(last))
}

#[inline(always)]
fn constant<T: Float>(value: f64) -> T {
    T::from(value).expect("both are floats")
}

/// Returns the smaller of two, by one instruction: `min` checks for NaN as well.
#[inline(always)]
fn min_unchecked<T: Float>(a: T, b: T) -> T {
    if a < b { a } else { b }
}

/// Converts a small integer, which is in the low bits of its sum with 2²³: unlike a conversion this
/// is vector code everywhere.
#[inline(always)]
fn bits(bin: f32) -> u32 {
    (bin + 8_388_608.0).to_bits() & 0xf
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use super::*;
    use proptest::prelude::*;

    fn of_all(point: OrientedPoint, others: &[OrientedPoint]) -> OrientedPointLanes {
        let other = |k: usize| others[k % others.len()];
        let axis = |of: &dyn Fn(OrientedPoint) -> f32| std::array::from_fn(|k| of(other(k)));
        OrientedPointLanes {
            place: [0, 1, 2].map(|a| axis(&|other| other.place[a] + point.place[a])),
            normal: [0, 1, 2].map(|a| axis(&|other| other.normal[a])),
        }
    }

    fn unit(x: [f64; 3]) -> [f32; 3] {
        math::normalized(x).map(|x| x as f32)
    }

    /// Some points in general position; some where rounding decides: in one plane, on one line,
    /// with opposite normals, along the line, nearly so, of no length, near or far.
    fn oriented() -> impl Strategy<Value = OrientedPoint> {
        let place = proptest::array::uniform3(prop_oneof![
            -1.0..1.0f32,
            -1e-6..1e-6f32,
            Just(0.0f32),
            Just(0.5f32),
            Just(1e-13f32),
            Just(1e-22f32),
            Just(1e19f32),
        ]);
        let normal = prop_oneof![
            proptest::array::uniform3(-1.0..1.0f64).prop_map(unit),
            proptest::array::uniform3(-1e-6..1e-6f64).prop_map(|[x, y, z]| unit([x, y, 1.0 + z])),
            proptest::array::uniform3(-1e-6..1e-6f64).prop_map(|[x, y, z]| unit([x, y, -1.0 + z])),
            Just([0.0, 0.0, 1.0]),
            Just([0.0, 0.0, -1.0]),
            Just([1.0, 0.0, 0.0]),
            Just([0.0; 3]),
        ];
        (place, normal).prop_map(|(place, normal)| OrientedPoint { place, normal })
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(4000))]

        #[test]
        fn what_is_sure_in_f32_is_so_in_f64(
            point in oriented(),
            others in proptest::collection::vec(oriented(), 1..=LANES),
        ) {
            for other in others {
                let lanes = of_all(point, &[other]);
                let (found, doubted) = bins_f32(point, &lanes);
                if doubted == 0 {
                    prop_assert_eq!(found, bins_f64(point, &lanes));
                }
                prop_assert_eq!(bins(point, &lanes), bins_f64(point, &lanes));
            }
        }
    }

    /// A point at the origin and another, with one angle at an edge of its bins except for
    /// rounding.
    fn at_an_edge() -> impl Strategy<Value = (OrientedPoint, OrientedPoint)> {
        let turn = proptest::array::uniform3(-1.0..1.0f64);
        let edge = (0..3usize, 1..BLOCK, -1.0..1.0f64, -PI..PI);
        let lengths = prop_oneof![Just(1.0), 0.1..10.0f64];
        let all = (turn.clone(), turn, edge, 0..6i32, lengths);
        all.prop_map(|(x, y, (angle, k, alpha, theta), steep, length)| {
            let (x, z) = (math::normalized(x), math::normalized(math::cross(x, y)));
            let y = math::cross(z, x);
            let cosine = (2 * k) as f64 / BLOCK as f64 - 1.0;
            let (mut theta, mut alpha, mut phi) = (theta, alpha, (-1.0 - f64::from(steep)).exp2());
            match angle {
                0 => theta = (2 * k + 1) as f64 * PI / BLOCK as f64,
                1 => alpha = cosine,
                _ => phi = cosine,
            }
            let of = |[a, b, c]: [f64; 3]| {
                let sum = math::add(
                    math::add(math::scaled(x, a), math::scaled(y, b)),
                    math::scaled(z, c),
                );
                sum.map(|x| x as f32)
            };
            // u = z, d in the plane of x and z, so that v = −y and w = x.
            let round = (1.0 - alpha * alpha).sqrt();
            let normal = of([round * theta.sin(), -alpha, round * theta.cos()].map(|x| length * x));
            let place = of([(1.0 - phi * phi).sqrt(), 0.0, phi]);
            let first = OrientedPoint { place: [0.0; 3], normal: of([0.0, 0.0, length]) };
            (first, OrientedPoint { place, normal })
        })
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(20_000))]

        #[test]
        fn rounding_at_an_edge_is_left_to_f64((point, other) in at_an_edge()) {
            let lanes = of_all(point, &[other]);
            prop_assert_eq!(bins(point, &lanes), bins_f64(point, &lanes));
        }
    }

    #[test]
    fn few_pairs_of_a_surface_are_left_to_f64() {
        // An ellipsoid, evenly covered.
        let oriented: Vec<OrientedPoint> = (0..2000)
            .map(|i| {
                let z = (2 * i + 1) as f64 / 2000.0 - 1.0;
                let (sin, cos) = (2.399_963 * f64::from(i)).sin_cos();
                let (x, y) = ((1.0 - z * z).sqrt() * cos, (1.0 - z * z).sqrt() * sin);
                let place = [x, 0.7 * y, 0.4 * z].map(|x| x as f32);
                OrientedPoint { place, normal: unit([x, y / 0.7, z / 0.4]) }
            })
            .collect();
        let doubted = |i: usize, j: usize| {
            let there = OrientedPointLanes {
                place: oriented[j].place.map(|x| [x; LANES]),
                normal: oriented[j].normal.map(|x| [x; LANES]),
            };
            bins_f32(oriented[i], &there).1 > 0
        };
        let pairs = (0..2000).flat_map(|i| (1..20).map(move |j| (i, (i + 7 * j) % 2000)));
        let (all, left) =
            pairs.fold((0, 0), |(all, left), (i, j)| (all + 1, left + u32::from(doubted(i, j))));
        assert!(left > 0 && left * 200 < all, "{left} of {all}");
    }

    /// Finds the bin from the angle itself.
    fn by_angle([x, y]: [f64; 2]) -> f64 {
        ((y.atan2(x) + PI) / (2.0 * PI) * BLOCK as f64).floor().clamp(0.0, 10.0)
    }

    proptest! {
        #[test]
        fn angles_fall_into_their_bins(angle in -PI..PI, length in 1e-3..10.0f64) {
            let share = (angle + PI) / (2.0 * PI) * BLOCK as f64;
            prop_assume!((share - share.round()).abs() > 1e-12);
            let at = [length * angle.cos(), length * angle.sin()];
            prop_assert_eq!(theta_bin(at).0, by_angle(at));
        }
    }

    #[test]
    fn edges_are_those_of_eleven_bins() {
        for (k, [cos, sin]) in EDGES.into_iter().enumerate() {
            let angle = (2 * k + 1) as f64 * PI / BLOCK as f64;
            assert!((cos - angle.cos()).abs() < 1e-15 && (sin - angle.sin()).abs() < 1e-15);
        }
    }

    #[test]
    fn every_angle_has_a_bin() {
        for x in [-1.0, -0.0, 0.0, 1.0] {
            for y in [-1.0, -0.0, 0.0, 1.0] {
                assert_eq!(
                    theta_bin([x, y]).0,
                    by_angle([x.abs().copysign(x + 0.0), y]),
                    "{x} {y}"
                );
            }
        }
        assert_eq!(
            [-1.1, -1.0, 0.0, 1.0, 1.1, f64::NAN].map(|c| cosine_bin(c).0),
            [0.0, 0.0, 5.0, 10.0, 10.0, 0.0]
        );
        for bin in 0..=10u8 {
            assert_eq!(bits(f32::from(bin)), u32::from(bin));
        }
    }
}
