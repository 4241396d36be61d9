//! The study as a figure.

use std::path::Path;

use super::condition::Condition;
use super::scheme::{Place, Points};
use super::tables::{notable, of};
use super::{Outcome, Study};
use crate::error::Result;
use crate::experiment::Spread;
use crate::experiment::figure::{Axes, Content, Curve, Figure, Panel};
use crate::weight::{Bandwidth, Normalization, WeightScheme};

/// Writes `fig12-weights` to `folder`.
///
/// # Errors
/// [`Error::Io`](crate::Error::Io).
pub(super) fn draw(study: &Study, folder: &Path) -> Result<()> {
    let panels = vec![
        against(study, "overlap", "share of the source's view that is common"),
        against(study, "noise", "standard deviation of the noise (m)"),
        against(study, "outliers", "outliers a point"),
        bandwidths(study, Condition::Independent),
        bandwidths(study, Condition::Noise(0.01)),
        sizes(study),
    ];
    Figure { panels, columns: 2, size: (760, 400) }.save(&folder.join("fig12-weights"))
}

const ERROR: &str = "mean of |I - R Rgt^T|";

fn panel(title: String, x: &str, axes: Axes, curves: Vec<Curve>) -> Panel {
    Panel { title, content: Content::Curves { x: x.into(), y: ERROR.into(), axes, curves } }
}

/// Errors of notable finalists over the amount of one kind of condition; bands hold the mean
/// in 95 of 100 repetitions.
fn against(study: &Study, kind: &str, x: &str) -> Panel {
    let conditions: Vec<&(Condition, Vec<Outcome>)> =
        study.finals.iter().filter(|(condition, _)| condition.kind().0 == kind).collect();
    let curve = |name: String| {
        let mut curve = Curve { name: name.clone(), ..Curve::default() };
        for (condition, outcomes) in &conditions {
            let errors: Vec<f64> = of(outcomes, &name).map(Outcome::error).collect();
            let Some(spread) = Spread::of(&errors) else { continue };
            let half = 1.96 * spread.deviation / (errors.len() as f64).sqrt();
            curve.points.push([condition.kind().1, spread.mean]);
            curve.band.push([spread.mean - half, spread.mean + half]);
        }
        curve
    };
    let curves = notable(study).into_iter().map(curve).collect();
    panel(kind.into(), x, Axes::Linear, curves)
}

/// Errors over the bandwidth, in the screening; an automatic one is a line.
fn bandwidths(study: &Study, condition: Condition) -> Panel {
    let mut curves = Vec::new();
    for points in [Place::PAPER.points, Place::BEST.points] {
        for normalize in [Normalization::None, Normalization::Both] {
            for kernel in [WeightScheme::Gaussian, WeightScheme::Cauchy] {
                let error =
                    |beta| screened(study, condition, Place { points, kernel, beta, normalize });
                let at = |beta: f64| Some([beta, error(Bandwidth::Fixed(beta))?]);
                let name = format!("{}, {kernel}, {normalize}", points.name());
                let fixed: Vec<[f64; 2]> =
                    [25.0, 100.0, 400.0].into_iter().filter_map(at).collect();
                if !fixed.is_empty() {
                    curves.push(Curve { name, points: fixed, ..Curve::default() });
                }
            }
        }
    }
    let best = screened(study, condition, Place::BEST);
    curves.extend(best.map(|error| Curve {
        name: "best, automatic".into(),
        points: vec![[25.0, error], [400.0, error]],
        guide: true,
        ..Curve::default()
    }));
    panel(
        format!("bandwidth, {condition}"),
        "bandwidth (squared descriptor units)",
        Axes::Logarithmic,
        curves,
    )
}

/// Errors over the size of the neighbourhood, in the screening.
fn sizes(study: &Study) -> Panel {
    let mut curves = Vec::new();
    for (normals, words) in [(None, "normals of as many"), (Some(10), "normals of 10")] {
        for normalize in [Normalization::None, Normalization::Both] {
            let alike = |points: &&Points| {
                points.scales.len() == 1
                    && points.scales[0].1 == normals
                    && points.histogram == Place::PAPER.points.histogram
            };
            let error = |points: &Points| {
                let place = Place { points: *points, normalize, ..Place::PAPER };
                Some([points.scales[0].0 as f64, screened(study, Condition::Independent, place)?])
            };
            let mut found: Vec<[f64; 2]> =
                Points::ALL.iter().filter(alike).filter_map(error).collect();
            found.sort_by(|a, b| a[0].total_cmp(&b[0]));
            if !found.is_empty() {
                let name = format!("{words}, {normalize}");
                curves.push(Curve { name, points: found, ..Curve::default() });
            }
        }
    }
    panel(
        "size of the neighbourhood, independent samples".into(),
        "nearest points",
        Axes::Linear,
        curves,
    )
}

fn screened(study: &Study, condition: Condition, place: Place) -> Option<f64> {
    let (name, (kind, amount)) = (place.name(), condition.kind());
    let is_it = |row: &&super::Screened| {
        row.scheme == name && row.condition == kind && row.amount == amount
    };
    study.screened.iter().find(is_it).map(|row| row.mean_frobenius)
}
