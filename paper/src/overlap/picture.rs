//! The picture: the share of right poses over the overlap.

use super::{OverlapRun, clopper_pearson};
use cfreg::figure::{Axes, Content, Curve, Figure, Panel};

/// Bounds of overlap between which pairs are counted together.
const BOUNDS: [f64; 7] = [0.1, 0.2, 0.3, 0.4, 0.5, 0.75, 1.001];
/// Fewest pairs of a point of a curve.
const FEWEST: usize = 3;

/// Draws the share of right poses of each method against overlap, with the 95 % intervals of
/// `cf-spectral`. Sweeps of streets are left out: they overlap by more than two thirds.
pub(super) fn figure(runs: &[OverlapRun], methods: &[String]) -> Figure {
    let curves = methods.iter().map(|name| curve(runs, name)).collect();
    let content = Content::Curves {
        x: "overlap (%)".into(),
        y: "right within 10 degrees (%)".into(),
        axes: Axes::Linear,
        curves,
    };
    let title = "One step against overlap".into();
    Figure { panels: vec![Panel { title, content }], columns: 1, size: (720, 420) }
}

fn curve(runs: &[OverlapRun], method: &str) -> Curve {
    let mut curve = Curve { name: method.into(), ..Curve::default() };
    for bounds in BOUNDS.windows(2) {
        let own: Vec<&OverlapRun> = runs
            .iter()
            .filter(|run| run.method == method && !run.dataset.starts_with("kitti"))
            .filter(|run| (bounds[0]..bounds[1]).contains(&run.overlap))
            .collect();
        if own.len() < FEWEST {
            continue;
        }
        let mean = own.iter().map(|run| run.overlap).sum::<f64>() / own.len() as f64;
        let right = own.iter().filter(|run| run.is_right()).count();
        curve.points.push([100.0 * mean, 100.0 * right as f64 / own.len() as f64]);
        if method == "cf-spectral" {
            let (low, high) = clopper_pearson(right, own.len());
            curve.band.push([100.0 * low, 100.0 * high]);
        }
    }
    curve
}
