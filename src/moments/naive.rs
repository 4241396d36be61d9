//! The specification of [`super::FullConnection`]: the double loop, in f64, with the normalisations
//! as they are defined. These need O(N·M) memory. Tests use it as the reference.

use super::side::FeatureView;
use super::sums::Moments;
use crate::math::{self, Vec3};
use crate::weight::Normalization;

/// Computes the moments of the full connection about the origins of `source` and `target`, weighted
/// by `weight(d²)` in f64.
///
/// # Panics
/// When a side has fewer descriptors than points.
pub fn moments(
    source: FeatureView<'_>,
    target: FeatureView<'_>,
    weight: impl Fn(f64) -> f64,
    normalization: Normalization,
) -> Moments {
    let ones = [source, target].map(|side| vec![1.0; side.points.len()]);
    point_weighted_moments(source, target, weight, normalization, [&ones[0], &ones[1]])
}

/// Computes the moments with weights of the source's and of the target's points, one each: the
/// definition of [`FullConnection::with_point_weights`](super::FullConnection::with_point_weights).
///
/// # Panics
/// When a side has fewer descriptors or weights than points.
pub fn point_weighted_moments(
    source: FeatureView<'_>,
    target: FeatureView<'_>,
    weight: impl Fn(f64) -> f64,
    normalization: Normalization,
    [a, b]: [&[f32]; 2],
) -> Moments {
    let (n, m) = (source.points.len(), target.points.len());
    let mut w: Vec<Vec<f64>> = (0..n)
        .map(|i| (0..m).map(|j| weight(squared_distance(&source, &target, i, j))).collect())
        .collect();
    normalize(&mut w, normalization);
    let mut moments = Moments::about(source.origin, target.origin);
    for (i, (p, row)) in source.points.iter().zip(&w).enumerate() {
        for (j, (q, &w)) in target.points.iter().zip(row).enumerate() {
            let w = f64::from(a[i]) * f64::from(b[j]) * w;
            let global = |x: &[f32; 3]| -> Vec3 { x.map(f64::from) };
            moments.add_pair(w, global(p), global(q));
        }
    }
    moments
}

fn squared_distance(source: &FeatureView<'_>, target: &FeatureView<'_>, i: usize, j: usize) -> f64 {
    let (a, b) = (source.descriptors.row(i), target.descriptors.row(j));
    a.iter().zip(b).map(|(&a, &b)| (f64::from(a) - f64::from(b)).powi(2)).sum()
}

fn normalize(w: &mut [Vec<f64>], normalization: Normalization) {
    let rows = |w: &[Vec<f64>]| -> Vec<f64> { w.iter().map(|row| row.iter().sum()).collect() };
    let columns = |w: &[Vec<f64>]| -> Vec<f64> {
        w.iter().fold(vec![0.0; w[0].len()], |sums, row| {
            sums.iter().zip(row).map(|(sum, x)| sum + x).collect()
        })
    };
    let scale = |w: &mut [Vec<f64>], f: &dyn Fn(usize, usize, f64) -> f64| {
        for (i, row) in w.iter_mut().enumerate() {
            for (j, x) in row.iter_mut().enumerate() {
                *x = if *x > 0.0 { f(i, j, *x) } else { 0.0 };
            }
        }
    };
    let (n, m) = (w.len() as f64, w[0].len() as f64);
    match normalization {
        Normalization::None => {}
        Normalization::Source => {
            let sums = rows(w);
            scale(w, &|i, _, x| x / sums[i]);
        }
        Normalization::Target => {
            let sums = columns(w);
            scale(w, &|_, j, x| x / sums[j]);
        }
        Normalization::Both => {
            let (row, column) = (rows(w), columns(w));
            scale(w, &|i, j, x| x / row[i] * (x / column[j]));
        }
        Normalization::Sinkhorn(rounds) => {
            for _ in 0..rounds {
                let sums = rows(w);
                scale(w, &|i, _, x| x / (sums[i] * n));
                let sums = columns(w);
                scale(w, &|_, j, x| x / (sums[j] * m));
            }
        }
    }
}

/// Moves the sums to other origins, to compare two ways of summing.
pub fn shift_origins(moments: &Moments, source_origin: Vec3, target_origin: Vec3) -> Moments {
    let dp = math::sub(moments.source_origin, source_origin);
    let dq = math::sub(moments.target_origin, target_origin);
    let w = moments.weight;
    let mut moved = Moments { source_origin, target_origin, ..*moments };
    moved.source_sum = math::add(moments.source_sum, math::scaled(dp, w));
    moved.target_sum = math::add(moments.target_sum, math::scaled(dq, w));
    moved.source_squares += 2.0 * math::dot(dp, moments.source_sum) + w * math::dot(dp, dp);
    moved.target_squares += 2.0 * math::dot(dq, moments.target_sum) + w * math::dot(dq, dq);
    for a in 0..3 {
        for b in 0..3 {
            moved.cross[a][b] +=
                dp[a] * moments.target_sum[b] + moments.source_sum[a] * dq[b] + w * dp[a] * dq[b];
        }
    }
    moved
}
