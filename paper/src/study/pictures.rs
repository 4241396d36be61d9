//! The study as a figure.

use super::condition::Condition;
use super::scheme::{DescriptorSetup, GridPoint};
use super::tables::outcomes_of;
use super::{REFERENCE_METHOD, ScreeningResult, Study, TrialOutcome};
use crate::MeanStd;
use cfreg::figure::{Axes, Content, Curve, Figure, Panel};
use cfreg::weight::{Bandwidth, Normalization, WeightScheme};

/// Draws the finalists against overlap, noise and outliers, and the screening of bandwidths and
/// neighbourhoods.
pub(super) fn figure(study: &Study) -> Figure {
    let panels = vec![
        error_panel(study, "overlap", "share of the source's view that is common"),
        error_panel(study, "noise", "standard deviation of the noise (m)"),
        error_panel(study, "outliers", "outliers a point"),
        sizes(study),
        bandwidths(study, Condition::Independent),
        bandwidths(study, Condition::Noise(0.01)),
    ];
    Figure { panels, columns: 2, size: (660, 380) }
}

/// Errors of the steps from the paper's scheme to the best, and of TEASER, over the amount of
/// one kind of condition; bands hold the mean in 95 of 100 repetitions.
fn error_panel(study: &Study, kind: &str, x: &str) -> Panel {
    let conditions: Vec<&(Condition, Vec<TrialOutcome>)> =
        study.finals.iter().filter(|(condition, _)| condition.kind().0 == kind).collect();
    let curve = |(scheme, name): (String, &str)| {
        let mut curve = Curve { name: name.into(), ..Curve::default() };
        for (condition, outcomes) in &conditions {
            let errors: Vec<f64> =
                outcomes_of(outcomes, &scheme).map(TrialOutcome::error).collect();
            let Some(spread) = MeanStd::from_values(&errors) else { continue };
            let half = 1.96 * spread.deviation / (errors.len() as f64).sqrt();
            curve.points.push([condition.kind().1, spread.mean]);
            curve.band.push([spread.mean - half, spread.mean + half]);
        }
        curve
    };
    let steps = GridPoint::STEPS.iter().map(GridPoint::name).zip(GridPoint::STEP_NAMES);
    let curves =
        steps.chain([(REFERENCE_METHOD.to_string(), REFERENCE_METHOD)]).map(curve).collect();
    let content =
        Content::Curves { x: x.into(), y: "mean |I - R Rgt^T|".into(), axes: Axes::Linear, curves };
    Panel { title: kind.into(), content }
}

/// Plots median errors over the bandwidth, in the screening; the automatic one is a line.
fn bandwidths(study: &Study, condition: Condition) -> Panel {
    let mut curves = Vec::new();
    for (points, scales) in
        [(GridPoint::PAPER.points, "one scale"), (GridPoint::BEST.points, "three")]
    {
        let paper = points.histogram.default_beta();
        for normalize in [Normalization::None, Normalization::Both] {
            for kernel in [WeightScheme::Gaussian, WeightScheme::Cauchy] {
                let at = |share: f64| {
                    let beta = Bandwidth::Fixed(share * paper);
                    let place = GridPoint { points, kernel, beta, normalize };
                    Some([share, median(study, condition, place)?])
                };
                let name = format!("{scales}, {kernel}, {normalize}");
                let points = [0.25, 1.0, 4.0].into_iter().filter_map(at).collect();
                curves.push(Curve { name, points, ..Curve::default() });
            }
        }
    }
    curves.retain(|curve| !curve.points.is_empty());
    curves.extend(median(study, condition, GridPoint::BEST).map(|error| Curve {
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
            let alike = |points: &&DescriptorSetup| {
                points.scales.len() == 1
                    && points.scales[0].1 == normals
                    && points.histogram == GridPoint::PAPER.points.histogram
            };
            let error = |points: &DescriptorSetup| {
                let place = GridPoint { points: *points, normalize, ..GridPoint::PAPER };
                Some([points.scales[0].0 as f64, median(study, Condition::Independent, place)?])
            };
            let mut points: Vec<[f64; 2]> =
                DescriptorSetup::ALL.iter().filter(alike).filter_map(error).collect();
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

fn median(study: &Study, condition: Condition, place: GridPoint) -> Option<f64> {
    let (name, (kind, amount)) = (place.name(), condition.kind());
    let is_it = |row: &&ScreeningResult| {
        row.scheme == name && row.condition == kind && row.amount == amount
    };
    study.screened.iter().find(is_it)?.median_deg
}
