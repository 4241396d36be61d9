//! Generation of pairs: from consecutive scans, and from scans at nearby positions.
//!
//! Pairs are of source and target, by the numbers of scans. The later scan is the source: its pose
//! is relative to the frame of the earlier one.

use crate::error::{Error, Result};
use crate::math::{self, Vec3};

/// Pairs each of `count` scans with earlier ones: a step of 1 is the previous scan, 2 skips one.
///
/// # Errors
/// [`Error::Config`] for a step of 0.
///
/// ```
/// let pairs = cfreg::batch::sequential_pairs(4, &[1, 3])?;
/// assert_eq!(pairs, [[1, 0], [2, 1], [3, 2], [3, 0]]);
/// # Ok::<(), cfreg::Error>(())
/// ```
pub fn sequential_pairs(count: usize, steps: &[usize]) -> Result<Vec<[usize; 2]>> {
    if steps.contains(&0) {
        return Err(Error::config("steps", 0, "must be at least 1: a scan is not its own pair"));
    }
    let before = |scan: usize| {
        let before = steps.iter().filter_map(move |step| scan.checked_sub(*step));
        before.map(move |target| [scan, target])
    };
    Ok((0..count).flat_map(before).collect())
}

/// Most pairs in a list. Chosen by hand: at a hundred a second they take a week.
const MAX_PAIRS: usize = 60_000_000;

/// Returns all pairs of scans at most `radius` apart, in the unit of `places`.
///
/// # Errors
/// [`Error::Config`] when the radius is negative or not a number, or so large that it makes more
/// than 60 million pairs, [`Error::NonFinite`] for a position that is not finite.
///
/// ```
/// let places = [[0.0, 0.0, 0.0], [9.0, 0.0, 0.0], [3.0, 4.0, 0.0]];
/// assert_eq!(cfreg::batch::radius_pairs(&places, 5.0)?, [[2, 0]]);
/// # Ok::<(), cfreg::Error>(())
/// ```
pub fn radius_pairs(places: &[Vec3], radius: f64) -> Result<Vec<[usize; 2]>> {
    if radius.is_nan() || radius < 0.0 {
        return Err(Error::config("radius", radius, "must be at least 0"));
    }
    if let Some(index) = places.iter().position(|place| place.iter().any(|x| !x.is_finite())) {
        return Err(Error::NonFinite { what: "the places of scans".into(), index });
    }
    // Positions near each other are also near along x.
    let mut order: Vec<usize> = (0..places.len()).collect();
    order.sort_by(|&a, &b| places[a][0].total_cmp(&places[b][0]));
    let mut pairs = Vec::new();
    for (rank, &one) in order.iter().enumerate() {
        for &other in &order[rank + 1..] {
            if places[other][0] - places[one][0] > radius {
                break;
            }
            if math::norm(math::sub(places[one], places[other])) <= radius {
                if pairs.len() == MAX_PAIRS {
                    let rule = format!("makes more than {MAX_PAIRS} pairs: take a smaller one");
                    return Err(Error::config("radius", radius, rule));
                }
                pairs.push([one.max(other), one.min(other)]);
            }
        }
    }
    pairs.sort();
    Ok(pairs)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn near_ones_are_all_found() {
        let places: Vec<Vec3> =
            (0..60).map(|i| [i * 37 % 11, i * 17 % 7, i % 3].map(f64::from)).collect();
        for radius in [0.0, 1.0, 2.5, 100.0] {
            let far = |[a, b]: &[usize; 2]| math::norm(math::sub(places[*a], places[*b])) > radius;
            let mut all: Vec<[usize; 2]> =
                (0..60).flat_map(|a| (0..a).map(move |b| [a, b])).collect();
            all.retain(|pair| !far(pair));
            assert_eq!(radius_pairs(&places, radius).unwrap(), all, "{radius}");
        }
    }

    #[test]
    fn what_makes_no_sense_is_refused() {
        assert!(sequential_pairs(3, &[0]).is_err() && radius_pairs(&[], -1.0).is_err());
        assert!(
            radius_pairs(&[[f64::NAN; 3]], 1.0).is_err() && radius_pairs(&[], f64::NAN).is_err()
        );
        assert!(sequential_pairs(0, &[1]).unwrap().is_empty());
        assert_eq!(sequential_pairs(2, &[5]).unwrap(), [[0; 2]; 0]);
    }
}
