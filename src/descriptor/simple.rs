//! Simple point feature histograms: the angles between a point and each neighbour, counted.

use pulp::{Simd, WithSimd};

use super::fpfh::{BINS, BLOCK, FULL};
use super::pair::Features;
use crate::math::Vec3;
use crate::search::Neighbors;

/// Histograms that are counted side by side: pairs in turn fall into the same bin, and would
/// wait for each other.
const COUNTS: usize = 4;

/// Pairs that are looked at together.
const LANES: usize = 8;

/// Makes SPFH of one point after the other; keeps its scratch.
#[derive(Default)]
pub(super) struct Simple {
    others: Vec<u32>,
    /// Places and normals of the neighbours, one array an axis.
    places: [Vec<f32>; 3],
    normals: [Vec<f32>; 3],
    /// Bin of θ, α and φ of every pair, as the bits of a whole f64.
    bins: [Vec<u64>; 3],
}

impl Simple {
    /// Writes the histograms of the pairs (i, neighbour), each of which sums to [`FULL`], into
    /// the first [`BINS`] values of `row`; 0 without a neighbour.
    pub(super) fn histograms(
        &mut self,
        points: &[[f32; 3]],
        normals: &[[f32; 3]],
        neighbors: &Neighbors,
        i: usize,
        row: &mut [f32],
    ) {
        self.others.clear();
        self.others.extend(neighbors.of(i).iter().filter(|&&j| j as usize != i));
        let pairs = self.others.len();
        let padded = pairs.next_multiple_of(LANES);
        self.bins.iter_mut().for_each(|bins| bins.resize(padded, 0));
        for (from, to) in [(points, &mut self.places), (normals, &mut self.normals)] {
            to.iter_mut().for_each(|axis| axis.resize(padded, 0.0));
            let [x, y, z] = to;
            for (((&j, x), y), z) in self.others.iter().zip(x).zip(y).zip(z) {
                [*x, *y, *z] = from[j as usize];
            }
        }
        let (point, normal) = (points[i].map(f64::from), normals[i].map(f64::from));
        pulp::Arch::new().dispatch(Bin { point, normal, pairs: self });
        let mut counts = [[0u32; BINS]; COUNTS];
        let [theta, alpha, phi] = &self.bins;
        for (at, ((&theta, &alpha), &phi)) in theta[..pairs].iter().zip(alpha).zip(phi).enumerate()
        {
            let counts = &mut counts[at % COUNTS];
            counts[whole(theta)] += 1;
            counts[BLOCK + whole(alpha)] += 1;
            counts[2 * BLOCK + whole(phi)] += 1;
        }
        let increment = FULL / pairs.max(1) as f64;
        for (bin, value) in row[..BINS].iter_mut().enumerate() {
            let count: u32 = counts.iter().map(|counts| counts[bin]).sum();
            *value = (f64::from(count) * increment) as f32;
        }
    }
}

struct Bin<'a> {
    point: Vec3,
    normal: Vec3,
    pairs: &'a mut Simple,
}

impl WithSimd for Bin<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let Bin { point, normal, pairs: Simple { places, normals, bins, .. } } = self;
        let [px, py, pz] = places.each_ref().map(|axis| axis.as_chunks::<LANES>().0);
        let [nx, ny, nz] = normals.each_ref().map(|axis| axis.as_chunks::<LANES>().0);
        let [theta, alpha, phi] = bins.each_mut().map(|bins| bins.as_chunks_mut::<LANES>().0);
        for at in 0..px.len() {
            // In locals, of which the compiler sees that they do not overlap.
            let (px, py, pz, nx, ny, nz) = (px[at], py[at], pz[at], nx[at], ny[at], nz[at]);
            let (mut t, mut a, mut f) = ([0; LANES], [0; LANES], [0; LANES]);
            for k in 0..LANES {
                let place = [px[k], py[k], pz[k]].map(f64::from);
                let features =
                    Features::of(point, normal, place, [nx[k], ny[k], nz[k]].map(f64::from));
                t[k] = bits(theta_bin(features.theta));
                a[k] = bits(cosine_bin(features.alpha));
                f[k] = bits(cosine_bin(features.phi));
            }
            (theta[at], alpha[at], phi[at]) = (t, a, f);
        }
    }
}

/// Cosine and sine of the edges of θ's bins above 0, (2k + 1) π / 11.
const EDGES: [[f64; 2]; BLOCK / 2] = [
    [0.959_492_973_614_497_4, 0.281_732_556_841_429_67],
    [0.654_860_733_945_285_1, 0.755_749_574_354_258_3],
    [0.142_314_838_273_285_14, 0.989_821_441_880_932_7],
    [-0.415_415_013_001_886_44, 0.909_631_995_354_518_4],
    [-0.841_253_532_831_181_2, 0.540_640_817_455_597_6],
];

/// Bin, of 11 over [−π, π], of the angle of a vector: the edges that it lies beyond are
/// counted from the middle bin on, on either side.
#[inline(always)]
fn theta_bin([x, y]: [f64; 2]) -> f64 {
    let mut beyond = 0.0f64;
    for [cos, sin] in EDGES {
        beyond += if cos * y.abs() - sin * x > 0.0 { 1.0 } else { 0.0 };
    }
    (BLOCK / 2) as f64 + beyond.copysign(y)
}

/// Bin, of 11 over [−1, 1].
#[inline(always)]
fn cosine_bin(cosine: f64) -> f64 {
    ((cosine + 1.0) * 0.5 * BLOCK as f64).floor().max(0.0).min((BLOCK - 1) as f64)
}

/// A small whole number stands in the low bits of its sum with this.
const WHOLE: f64 = (1u64 << 52) as f64;

/// Unlike a conversion to an integer this is vector code everywhere.
#[inline(always)]
fn bits(bin: f64) -> u64 {
    (bin + WHOLE).to_bits()
}

#[inline(always)]
fn whole(bits: u64) -> usize {
    (bits & 0xf) as usize
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use super::*;
    use proptest::prelude::*;

    /// By the angle itself.
    fn by_angle([x, y]: [f64; 2]) -> f64 {
        ((y.atan2(x) + PI) / (2.0 * PI) * BLOCK as f64).floor().clamp(0.0, 10.0)
    }

    proptest! {
        #[test]
        fn angles_fall_into_their_bins(angle in -PI..PI, length in 1e-3..10.0f64) {
            let share = (angle + PI) / (2.0 * PI) * BLOCK as f64;
            prop_assume!((share - share.round()).abs() > 1e-12);
            let at = [length * angle.cos(), length * angle.sin()];
            prop_assert_eq!(theta_bin(at), by_angle(at));
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
                assert_eq!(theta_bin([x, y]), by_angle([x.abs().copysign(x + 0.0), y]), "{x} {y}");
            }
        }
        assert_eq!([-1.1, -1.0, 0.0, 1.0, 1.1].map(cosine_bin), [0.0, 0.0, 5.0, 10.0, 10.0]);
        for bin in 0..=10 {
            assert_eq!(whole(bits(f64::from(bin))), bin as usize);
        }
    }
}
