//! The paper's figures: its data, noise, sensitivity, alignments, and the lecture hall.

use std::path::{Path, PathBuf};

use super::cell::{Contender, ExperimentCell, Interpretation, Shape, Test};
use super::lecture_hall;
use super::models::{self, Source};
use super::record::{POINTS, Record, SEED};
use super::tables::Results;
use crate::Motion;
use crate::protocol::{Draw, Protocol, Trial};
use cfreg::cloud::{PointCloud, Transform};
use cfreg::error::Result;
use cfreg::figure::{Axes, Content, Curve, Dots, Figure, Panel};
use cfreg::method::Register;

/// Points of a picture of a model.
const SHOWN_POINTS: usize = 4000;

/// Writes every figure to `folder`; those of the lecture hall if its scans exist.
///
/// # Errors
/// [`Error::Io`](cfreg::Error::Io), and the errors of the readers.
pub fn draw(data: &Path, folder: &Path, results: &Results, smoke: bool) -> Result<()> {
    let save = |name: &str, panels, columns, size| {
        let stem: PathBuf = folder.join(name);
        Figure { panels, columns, size }.save(&stem)
    };
    save("fig3-data", shapes(data)?, 3, (360, 360))?;
    let curves = sensitivity(results);
    if !curves.is_empty() {
        save("fig6-sensitivity", curves, 2, (560, 400))?;
    }
    let points = if smoke { 1500 } else { lecture_hall::POINTS };
    if let Some(hall) = lecture_hall::run(data, points)? {
        save("fig10-lecture-hall", lecture_hall::panels(&hall), 2, (560, 480))?;
        lecture_hall::write(&hall, &folder.join("lecture-hall.json"))?;
    }
    let Some(bunny) = load_if_present(data, Shape::Bunny)? else { return Ok(()) };
    save("fig4-noise", noise(&bunny)?, 3, (360, 360))?;
    let angles = trials_by_angle(&bunny)?;
    let number = |at: usize| angles[at].1;
    for (name, motion, number) in [
        ("fig7-small", Motion::Small, 0),
        ("fig8-medium", Motion::Large, number(0)),
        ("fig9-large", Motion::Large, number(angles.len() - 1)),
    ] {
        save(name, alignments(&bunny, motion, number)?, 4, (300, 320))?;
    }
    Ok(())
}

/// The model of `shape`, if it is there.
fn load_if_present(data: &Path, shape: Shape) -> Result<Option<Source>> {
    match models::load(data, shape, Interpretation::Fitting) {
        Err(error) if models::is_missing(&error) => Ok(None),
        found => found.map(Some),
    }
}

/// Draws the models that exist.
fn shapes(data: &Path) -> Result<Vec<Panel>> {
    let panel = |&shape: &Shape| {
        let Some(Source { model, remark, .. }) = load_if_present(data, shape)? else {
            return Ok(None);
        };
        let stands_in = if remark.is_empty() { "" } else { " (a stand-in)" };
        let content =
            Content::Points(vec![project_along_z("", &model.sample(SHOWN_POINTS, SEED)?)]);
        Ok(Some(Panel { title: format!("{shape}{stands_in}"), content }))
    };
    Shape::ALL.iter().filter_map(|shape| panel(shape).transpose()).collect()
}

/// Draws source and target at three levels of noise, for both motions.
fn noise(bunny: &Source) -> Result<Vec<Panel>> {
    let mut panels = Vec::new();
    for motion in Motion::ALL {
        for sigma in [0.002, 0.01, 0.02] {
            let trial =
                Protocol::Sensitivity { sigma }.trial(&bunny.model, trial_draw(motion, 0))?;
            let content = pair(&trial.target, &trial.source);
            panels.push(Panel { title: format!("{motion}, noise {sigma}"), content });
        }
    }
    Ok(panels)
}

/// Plots mean and deviation of the average shift over the noise, for both motions.
fn sensitivity(results: &Results) -> Vec<Panel> {
    let mut panels = Vec::new();
    for motion in Motion::ALL {
        for deviation in [false, true] {
            let point = |(cell, trials): &(ExperimentCell, super::Trials)| {
                let spread = trials.spread(|record: &Record| record.average_shift)?;
                // One trial has no deviation.
                if deviation && trials.records.len() < 2 {
                    return None;
                }
                let value = if deviation { spread.deviation } else { spread.mean };
                Some([1e-4 * f64::from(cell.noise), value])
            };
            let curve = |contender: Contender| {
                let of = |cell: &ExperimentCell| {
                    cell.variation.is_none()
                        && (cell.test, cell.motion, cell.contender)
                            == (Test::Sensitivity, motion, contender)
                };
                let mut points: Vec<[f64; 2]> =
                    results.values().filter(|(cell, _)| of(cell)).filter_map(point).collect();
                points.sort_by(|a, b| a[0].total_cmp(&b[0]));
                Curve { name: contender.to_string(), points, ..Curve::default() }
            };
            let curves: Vec<Curve> =
                Contender::ALL.map(curve).into_iter().filter(|c| !c.points.is_empty()).collect();
            if curves.is_empty() {
                continue;
            }
            let what = if deviation { "deviation of the average shift" } else { "average shift" };
            panels.push(Panel {
                title: format!("{motion} rotation"),
                content: Content::Curves {
                    x: "standard deviation of the noise (m)".into(),
                    y: format!("{what} (m)"),
                    axes: Axes::Linear,
                    curves,
                },
            });
        }
    }
    panels
}

/// Draws one trial with outliers, before and after the paper's methods and the best of ours.
fn alignments(bunny: &Source, motion: Motion, number: u64) -> Result<Vec<Panel>> {
    let trial = robustness(bunny, motion, number)?;
    let laid = |title: String, pose: &Transform| {
        let moved = trial.source.transformed(pose)?;
        let content = pair(&trial.target, &moved);
        Ok::<_, cfreg::Error>(Panel { title, content })
    };
    let mut panels = vec![laid("initial".into(), &Transform::IDENTITY)?];
    for contender in Contender::ALL.into_iter().filter(|&c| c != Contender::CfBoth) {
        if let Ok(found) = contender.method().register(&trial.source, &trial.target) {
            let shift = trial.average_shift(&found.transform);
            panels.push(laid(format!("{contender}: {shift:.4}"), &found.transform)?);
        }
    }
    Ok(panels)
}

fn robustness(bunny: &Source, motion: Motion, number: u64) -> Result<Trial> {
    let protocol = Protocol::Robustness { outliers: 100, radius: Interpretation::Fitting.radius() };
    protocol.trial(&bunny.model, trial_draw(motion, number))
}

/// Trials among which the pictures' rotations are chosen.
const CANDIDATE_TRIALS: u64 = 20;

/// Large rotations and the numbers of their trials, the smallest first.
fn trials_by_angle(bunny: &Source) -> Result<Vec<(f64, u64)>> {
    let angle = |number| {
        let truth = robustness(bunny, Motion::Large, number)?.truth;
        Ok((truth.angle(), number))
    };
    let mut angles = (0..CANDIDATE_TRIALS).map(angle).collect::<Result<Vec<_>>>()?;
    angles.sort_by(|a, b| a.0.total_cmp(&b.0));
    Ok(angles)
}

fn trial_draw(motion: Motion, number: u64) -> Draw {
    let viewpoint = Interpretation::Fitting.viewpoint();
    Draw { motion, viewpoint, points: POINTS, seed: SEED, number }
}

/// Returns both clouds, the source on top.
pub(super) fn pair(target: &PointCloud, source: &PointCloud) -> Content {
    Content::Points(vec![project_along_z("target", target), project_along_z("source", source)])
}

/// The points as seen along z.
fn project_along_z(name: &str, cloud: &PointCloud) -> Dots {
    Dots { name: name.into(), points: cloud.positions().map(|[x, y, _]| [x, y]).collect() }
}
