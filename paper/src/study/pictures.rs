//! The study as a figure.

use super::condition::Condition;
use super::scheme::{Place, Points};
use super::tables::of;
use super::{BESIDE, Outcome, ScreeningResult, Study};
use crate::Spread;
use cfreg::figure::{Axes, Content, Curve, Figure, Panel};
use cfreg::weight::{Bandwidth, Normalization, WeightScheme};

/// Draws the finalists against overlap, noise and outliers, and the screening of bandwidths and
/// neighbourhoods.
pub(super) fn figure(study: &Study) -> Figure {
    let panels = vec![
        against(study, "overlap", "share of the source's view that is common"),
        against(study, "noise", "standard deviation of the noise (m)"),
        against(study, "outliers", "outliers a point"),
        sizes(study),
        bandwidths(study, Condition::Independent),
        bandwidths(study, Condition::Noise(0.01)),
    ];
    Figure { panels, columns: 2, size: (660, 380) }
}

/// Plots the errors of the steps from the paper's scheme to the best, and of TEASER, over the
/// amount of one kind of condition; bands contain the mean in 95 of 100 repetitions.
fn against(study: &Study, kind: &str, x: &str) -> Panel {
    let conditions: Vec<&(Condition, Vec<Outcome>)> =
        study.finals.iter().filter(|(condition, _)| condition.kind().0 == kind).collect();
    let curve = |(scheme, name): (String, &str)| {
        let mut curve = Curve { name: name.into(), ..Curve::default() };
        for (condition, outcomes) in &conditions {
            let errors: Vec<f64> = of(outcomes, &scheme).map(Outcome::error).collect();
            let Some(spread) = Spread::of(&errors) else { continue };
            let half = 1.96 * spread.deviation / (errors.len() as f64).sqrt();
            curve.points.push([condition.kind().1, spread.mean]);
            curve.band.push([spread.mean - half, spread.mean + half]);
        }
        curve
    };
    let steps = Place::STEPS.iter().map(Place::name).zip(Place::STEP_NAMES);
    let curves = steps.chain([(BESIDE.to_string(), BESIDE)]).map(curve).collect();
    let content =
        Content::Curves { x: x.into(), y: "mean |I - R Rgt^T|".into(), axes: Axes::Linear, curves };
    Panel { title: kind.into(), content }
}

/// Plots median errors over the bandwidth, in the screening; the automatic one is a line.
fn bandwidths(study: &Study, condition: Condition) -> Panel {
    let mut curves = Vec::new();
    for (points, scales) in [(Place::PAPER.points, "one scale"), (Place::BEST.points, "three")] {
        let paper = points.histogram.default_beta();
        for normalize in [Normalization::None, Normalization::Both] {
            for kernel in [WeightScheme::Gaussian, WeightScheme::Cauchy] {
                let at = |share: f64| {
                    let beta = Bandwidth::Fixed(share * paper);
                    let place = Place { points, kernel, beta, normalize };
                    Some([share, median(study, condition, place)?])
                };
                let name = format!("{scales}, {kernel}, {normalize}");
                let points = [0.25, 1.0, 4.0].into_iter().filter_map(at).collect();
                curves.push(Curve { name, points, ..Curve::default() });
            }
        }
    }
    curves.retain(|curve| !curve.points.is_empty());
    curves.extend(median(study, condition, Place::BEST).map(|error| Curve {
        name: "multiscale, automatic".into(),
        points: vec![[0.25, error], [4.0, error]],
        guide: true,
        ..Curve::default()
    }));
    screening(
        format!("bandwidth, {condition}"),
        "bandwidth over the paper's (400 on Open3D's scale)",
        Axes::Logarithmic,
        curves,
    )
}

/// Plots median errors over the size of the neighbourhood, in the screening.
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
                Some([points.scales[0].0 as f64, median(study, Condition::Independent, place)?])
            };
            let mut points: Vec<[f64; 2]> =
                Points::ALL.iter().filter(alike).filter_map(error).collect();
            points.sort_by(|a, b| a[0].total_cmp(&b[0]));
            curves.push(Curve {
                name: format!("{words}, {normalize}"),
                points,
                ..Curve::default()
            });
        }
    }
    curves.retain(|curve| !curve.points.is_empty());
    screening("neighbourhood, independent samples".into(), "nearest points", Axes::Linear, curves)
}

fn screening(title: String, x: &str, axes: Axes, curves: Vec<Curve>) -> Panel {
    let y = "median rotation error (deg)".into();
    Panel { title, content: Content::Curves { x: x.into(), y, axes, curves } }
}

fn median(study: &Study, condition: Condition, place: Place) -> Option<f64> {
    let (name, (kind, amount)) = (place.name(), condition.kind());
    let is_it = |row: &&ScreeningResult| {
        row.scheme == name && row.condition == kind && row.amount == amount
    };
    study.screened.iter().find(is_it)?.median_deg
}
