//! Sparse connections: moments of listed pairs.

use super::sums::Moments;
use crate::cloud::PointCloud;
use crate::error::{Error, Result};
use crate::math::{self, Vec3};
use crate::par;

/// A connection between source point `source` and target point `target`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WeightedPair {
    /// Index into the source's points.
    pub source: u32,
    /// Index into the target's points.
    pub target: u32,
    /// Weight, finite and not negative.
    pub weight: f64,
}

/// Pairs a partial sum: fixed, so that the bits do not depend on the number of threads.
const BLOCK: usize = 1024;

/// Computes the moments of the listed pairs, in f64 throughout, about the clouds' centroids.
///
/// # Errors
/// [`Error::Shape`] for an index beyond its cloud, [`Error::NoWeight`] without pairs or
/// weight, [`Error::NonFinite`] for a weight that is not finite.
///
/// ```
/// use cfreg::{PointCloud, moments::{self, WeightedPair}};
/// let cloud = PointCloud::new(&[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 2.0, 0.0]])?;
/// let pairs = [0, 1, 2].map(|i| WeightedPair { source: i, target: i, weight: 0.5 });
/// assert_eq!(moments::moments_of_pairs(&cloud, &cloud, &pairs)?.weight, 1.5);
/// # Ok::<(), cfreg::Error>(())
/// ```
pub fn moments_of_pairs(
    source: &PointCloud,
    target: &PointCloud,
    pairs: &[WeightedPair],
) -> Result<Moments> {
    check_indices(source, "source", pairs.iter().map(|pair| pair.source))?;
    check_indices(target, "target", pairs.iter().map(|pair| pair.target))?;
    let start = Moments::about(source.centroid(), target.centroid());
    // Local coordinates: the origins of cloud and sums differ by a part of the cloud's size.
    let shift_p = math::sub(source.origin(), start.source_origin);
    let shift_q = math::sub(target.origin(), start.target_origin);
    let local = |point: [f32; 3], shift: Vec3| math::add(point.map(f64::from), shift);
    let blocks = par::map_blocks(
        pairs.len(),
        BLOCK,
        || (),
        |_, block| {
            let mut sum = start;
            for pair in &pairs[block] {
                let p = local(source.points()[pair.source as usize], shift_p);
                let q = local(target.points()[pair.target as usize], shift_q);
                sum.add_pair(pair.weight, p, q);
            }
            sum
        },
    );
    let moments = blocks.iter().fold(start, |mut sum, block| {
        sum.merge(block);
        sum
    });
    moments.centered()?;
    Ok(moments)
}

/// Refuses an index of a pair beyond its cloud; `side` is the side of the pairs.
pub(crate) fn check_indices(
    cloud: &PointCloud,
    side: &str,
    mut indices: impl Iterator<Item = u32>,
) -> Result<()> {
    match indices.find(|&index| index as usize >= cloud.len()) {
        Some(index) => {
            let what = format!("points of the {side}, for a pair with its point {index}");
            Err(Error::Shape { what, expected: index as usize + 1, found: cloud.len() })
        }
        None => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn listed_pairs_are_the_double_loop() {
        let offset = [5e5, 5.6e6, 0.0];
        let at = |i: usize| {
            let t = i as f64;
            math::add(offset, [(0.1 * t).sin(), (0.07 * t).cos(), 0.01 * t])
        };
        let points: Vec<Vec3> = (0..3000).map(at).collect();
        let source = PointCloud::new(&points).unwrap();
        let target = PointCloud::new(&points[..500]).unwrap();
        let pairs: Vec<WeightedPair> = (0..2500u32)
            .map(|i| WeightedPair {
                source: i,
                target: (i * 7) % 500,
                weight: 1.0 / (1.0 + f64::from(i)),
            })
            .collect();
        let found = moments_of_pairs(&source, &target, &pairs).unwrap();
        let mut want = Moments::about(found.source_origin, found.target_origin);
        for pair in &pairs {
            let p = math::sub(source.position(pair.source as usize), found.source_origin);
            let q = math::sub(target.position(pair.target as usize), found.target_origin);
            want.add_pair(pair.weight, p, q);
        }
        assert!((found.weight / want.weight - 1.0).abs() < 1e-14);
        assert!(math::frobenius(&math::mat_sub(&found.cross, &want.cross)) < 1e-6);
    }

    #[test]
    fn odd_lists_are_refused() {
        let cloud = PointCloud::new(&[[0.0; 3], [1.0; 3]]).unwrap();
        let pair = |source, target, weight| WeightedPair { source, target, weight };
        let of = |pairs: &[WeightedPair]| moments_of_pairs(&cloud, &cloud, pairs);
        assert!(matches!(of(&[]), Err(Error::NoWeight { .. })));
        assert!(matches!(of(&[pair(0, 0, 0.0)]), Err(Error::NoWeight { .. })));
        assert!(matches!(of(&[pair(2, 0, 1.0)]), Err(Error::Shape { .. })));
        assert!(matches!(of(&[pair(0, 7, 1.0)]), Err(Error::Shape { .. })));
        assert!(matches!(of(&[pair(0, 0, f64::NAN)]), Err(Error::NonFinite { .. })));
    }
}
