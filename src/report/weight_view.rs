//! The weights as a page shows them: correspondences as lines, W as an image.

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use serde::Serialize;

use super::text;
use crate::cloud::Transform;
use crate::math::{self, Vec3};
use crate::method::{WeightBlock, WeightGraph, WeightedLink};

/// Weighted links and W. Numbers are base64 of little-endian arrays.
#[derive(Debug, Clone, Serialize)]
pub(super) struct WeightView {
    /// Whether all points were connected with all; otherwise there were correspondences.
    pub(super) full: bool,
    /// Numbers of links, and of drawn links.
    pub(super) links: usize,
    pub(super) drawn: usize,
    /// Drawn links whose ends coincide at the pose.
    pub(super) right: usize,
    /// Ends relative to the middles of their clouds, three f32 each.
    pub(super) from: String,
    pub(super) onto: String,
    /// Whether the ends coincide at the pose, a u8 each.
    pub(super) agree: String,
    pub(super) matrix: WeightMatrixView,
}

/// W between points that coincide at the pose, with as many rows as columns.
#[derive(Debug, Clone, Serialize)]
pub(super) struct WeightMatrixView {
    pub(super) side: usize,
    /// Rows at the end, of points without a counterpart at the pose.
    pub(super) alone: usize,
    /// Weights as shares of the largest, by their square root, a u8 each, row by row; rows and
    /// columns along the cloud's longest axis.
    pub(super) weights: String,
    /// Weights of the first order in the same way; `None` for other weights.
    pub(super) first_order: Option<String>,
    /// Row indices in the order of descriptors, a u16 each.
    pub(super) by_looks: String,
    /// Mean weight on the diagonal relative to the overall mean, for rows with a counterpart.
    pub(super) diagonal: Option<String>,
}

/// Most lines. Chosen by hand.
const MAX_LINES: usize = 400;
/// Distance, in inlier distances, up to which the ends of a link of the full connection coincide.
/// Chosen by hand.
const CLOSE_PAIR_FACTOR: f64 = 3.0;
/// Share of the weights above the darkest tone. Chosen by hand.
const CLIPPED_SHARE: f64 = 0.002;

impl WeightView {
    /// Builds the view. Positions are relative to `middles`; `near` is the inlier distance.
    pub(super) fn new(
        connections: &WeightGraph,
        pose: &Transform,
        middles: [Vec3; 2],
        near: f64,
    ) -> WeightView {
        let near = connections.inlier_distance.unwrap_or(CLOSE_PAIR_FACTOR * near);
        let WeightGraph { points, links, .. } = connections;
        let ends = |link: &WeightedLink| {
            [points[0][link.source as usize], points[1][link.target as usize]]
        };
        // Weights of the second order do not depend on the pose either.
        let by_weight = connections.full || !connections.block.first_order.is_empty();
        let drawn = sample_links(links, by_weight);
        let agrees: Vec<u8> = drawn
            .iter()
            .map(|link| {
                let [p, q] = ends(link);
                u8::from(math::norm(math::sub(pose.apply(p), q)) <= near)
            })
            .collect();
        let side = |k: usize| {
            let local = drawn.iter().flat_map(|link| math::sub(ends(link)[k], middles[k]));
            STANDARD.encode(local.flat_map(|x| (x as f32).to_le_bytes()).collect::<Vec<u8>>())
        };
        WeightView {
            full: connections.full,
            links: links.len(),
            drawn: drawn.len(),
            right: agrees.iter().filter(|&&agrees| agrees == 1).count(),
            from: side(0),
            onto: side(1),
            agree: STANDARD.encode(&agrees),
            matrix: WeightMatrixView::new(&connections.block, &points[0], near),
        }
    }
}

/// Selects the links with the largest weights; of correspondences, whose weights depend on the
/// pose, an even selection.
fn sample_links(links: &[WeightedLink], by_weight: bool) -> Vec<WeightedLink> {
    let step = if by_weight { 1 } else { links.len().div_ceil(MAX_LINES).max(1) };
    links.iter().step_by(step).take(MAX_LINES).copied().collect()
}

impl WeightMatrixView {
    fn new(matrix: &WeightBlock, source: &[Vec3], near: f64) -> WeightMatrixView {
        let n = matrix.rows.len();
        let place = |k: usize| source[matrix.rows[k] as usize];
        let extent = |axis: usize| {
            let along = (0..n).map(|k| place(k)[axis]);
            let ends = along.fold((f64::MAX, f64::MIN), |(l, h), x| (l.min(x), h.max(x)));
            ends.1 - ends.0
        };
        let longest = (0..3).max_by(|&a, &b| extent(a).total_cmp(&extent(b))).unwrap_or(0);
        let alone = |k: usize| matrix.distances[k] > near;
        let ordered = |key: &dyn Fn(usize) -> f64| {
            let mut order: Vec<usize> = (0..n).collect();
            order.sort_by(|&a, &b| alone(a).cmp(&alone(b)).then(key(a).total_cmp(&key(b))));
            order
        };
        let by_place = ordered(&|k| place(k)[longest]);
        let by_looks = ordered(&|k| matrix.principal_feature[k]);
        let mut rank = vec![0u16; n];
        by_place.iter().zip(0..).for_each(|(&k, at)| rank[k] = at);
        let in_order = |weights: &[f32]| -> Vec<f64> {
            (0..n * n)
                .map(|at| f64::from(weights[by_place[at / n] * n + by_place[at % n]]))
                .collect()
        };
        let all = in_order(&matrix.weights);
        let first_order = (!matrix.first_order.is_empty())
            .then(|| STANDARD.encode(tones(&in_order(&matrix.first_order))));
        let weight = |a: usize, b: usize| all[a * n + b];
        let touching = (0..n).filter(|&k| !alone(k)).count();
        let mean = all.iter().sum::<f64>() / all.len() as f64;
        let own = (0..touching).map(|k| weight(k, k)).sum::<f64>() / touching.max(1) as f64;
        let told = touching > 0 && mean > 0.0 && mean.is_finite();
        WeightMatrixView {
            side: n,
            alone: n - touching,
            weights: STANDARD.encode(tones(&all)),
            first_order,
            by_looks: STANDARD
                .encode(by_looks.iter().flat_map(|&k| rank[k].to_le_bytes()).collect::<Vec<u8>>()),
            diagonal: told.then(|| text::format_number(own / mean)),
        }
    }
}

/// Returns weights as shares of the largest but a few, by their square root.
fn tones(weights: &[f64]) -> Vec<u8> {
    let mut sorted = weights.to_vec();
    sorted.sort_by(f64::total_cmp);
    let top = (((1.0 - CLIPPED_SHARE) * sorted.len() as f64) as usize).min(sorted.len() - 1);
    let most = if sorted[top] > 0.0 { sorted[top] } else { sorted[sorted.len() - 1] };
    let tone = |w: &f64| match most > 0.0 && w.is_finite() {
        true => ((w / most).clamp(0.0, 1.0).sqrt() * 255.0).round() as u8,
        false => 0,
    };
    weights.iter().map(tone).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_square_is_ordered_by_place_and_by_looks() {
        let source: Vec<Vec3> = [3.0, 1.0, 2.0].map(|x| [x, 0.0, 0.0]).into();
        let matrix = WeightBlock {
            rows: vec![0, 1, 2],
            columns: vec![0, 1, 2],
            distances: vec![0.0, 0.0, 9.0],
            principal_feature: vec![0.1, 0.2, 0.0],
            weights: vec![4.0, 0.0, 0.0, 0.0, 4.0, 0.0, 1.0, 0.0, 0.0],
            first_order: vec![0.0, 0.0, 0.0, 0.0, 2.0, 0.0, 0.0, 0.0, 0.0],
        };
        let square = WeightMatrixView::new(&matrix, &source, 1.0);
        // By position: the second, the first; the third has no counterpart.
        assert_eq!(STANDARD.decode(&square.weights).unwrap(), [255, 0, 0, 0, 255, 0, 0, 128, 0]);
        let first = STANDARD.decode(square.first_order.as_ref().unwrap()).unwrap();
        assert_eq!(first, [255, 0, 0, 0, 0, 0, 0, 0, 0]);
        // By descriptor: the first, the second.
        assert_eq!(STANDARD.decode(&square.by_looks).unwrap(), [1, 0, 0, 0, 2, 0]);
        assert_eq!((square.alone, square.diagonal.as_deref()), (1, Some("4")));
    }
}
