//! One table of the choices that the paper leaves open: each choice beside the printed figure.

use std::fmt::Write;

use super::cell::{Contender, ExperimentCell, Interpretation, Shape, Test};
use super::printed::printed_value;
use super::tables::{PaperEntry, Results, format_entry, measure, sample_size_note};
use super::variation::Variation;
use crate::protocol::NormalViewpoint;
use crate::{MeanStd, Motion};
use cfreg::keypoint::Sift;

/// Position of the sensor of the range scans, in their frame: in front, along z, metres.
const SENSOR: [f64; 3] = [0.0, 0.1, 1.0];

/// An open choice and its options.
struct Topic {
    title: &'static str,
    columns: Vec<ComparisonColumn>,
    rows: Vec<ComparisonRow>,
}

#[derive(Clone, Copy)]
struct ComparisonColumn {
    test: Test,
    shape: Shape,
    motion: Motion,
    noise: u32,
}

struct ComparisonRow {
    label: String,
    contender: Contender,
    reading: Interpretation,
    variation: Variation,
}

impl ComparisonRow {
    fn cell(&self, column: ComparisonColumn, trials: usize) -> ExperimentCell {
        let ComparisonRow { contender, reading, variation, .. } = *self;
        let ComparisonColumn { test, shape, motion, noise } = column;
        let variation = Some(variation);
        ExperimentCell { test, reading, shape, motion, contender, noise, trials, variation }
    }
}

/// All cells of the table: `trials` each; in `smoke` the first two
/// rows of every topic, on the bunny, moved far.
pub fn cells(trials: usize, smoke: bool) -> Vec<ExperimentCell> {
    let mut cells = Vec::new();
    for Topic { columns, rows, .. } in topics() {
        let (rows, columns) = match smoke {
            true => (&rows[..2], &columns[1..2]),
            false => (&rows[..], &columns[..]),
        };
        let of =
            |row: &ComparisonRow| columns.iter().map(|&c| row.cell(c, trials)).collect::<Vec<_>>();
        cells.extend(rows.iter().flat_map(of));
    }
    cells
}

/// Formats the table of the available results as Markdown.
pub fn markdown(results: &Results) -> String {
    let all: Vec<&ExperimentCell> =
        results.values().map(|(cell, _)| cell).filter(|cell| cell.variation.is_some()).collect();
    let trials = all.iter().map(|cell| cell.trials).max().unwrap_or(0);
    let mut text = format!("{LEGEND}\n{trials} trials a cell{}.\n", sample_size_note(trials));
    for Topic { title, columns, rows } in topics() {
        let counted = rows.iter().any(|row| row.contender == Contender::Cfk);
        let mut head: Vec<String> = columns.iter().map(|&column| column_name(column)).collect();
        head.extend(counted.then(|| "points described".to_string()));
        let _ = writeln!(text, "\n## {title}\n\n| | {} |", head.join(" | "));
        let _ = writeln!(text, "|---|{}", "---|".repeat(head.len()));
        for row in &rows {
            let mut cells: Vec<String> = columns.iter().map(|&c| entry(results, row, c)).collect();
            cells.extend(counted.then(|| describe_counts(results, row, &columns)));
            let _ = writeln!(text, "| {} | {} |", row.label, cells.join(" | "));
        }
    }
    text
}

fn column_name(ComparisonColumn { test, shape, motion, noise }: ComparisonColumn) -> String {
    match test {
        Test::Robustness => format!("I, {motion}"),
        Test::Accuracy => format!("II, {shape}, {motion}"),
        Test::Sensitivity => format!("noise {}, {motion}", 1e-4 * f64::from(noise)),
    }
}

fn entry(results: &Results, row: &ComparisonRow, column: ComparisonColumn) -> String {
    let Some((_, trials)) = results.get(&row.cell(column, 0).name()) else {
        return "not run".into();
    };
    let entry = PaperEntry {
        printed: printed_value(column.test, row.contender, column.shape, column.motion),
        ours: trials.spread(measure(column.test)),
        failures: trials.failures(),
    };
    format_entry(&entry, " ± ")
}

/// Mean number of points that were described, over all trials of a row.
fn describe_counts(results: &Results, row: &ComparisonRow, columns: &[ComparisonColumn]) -> String {
    let of = |&column: &ComparisonColumn| results.get(&row.cell(column, 0).name());
    let records = columns.iter().filter_map(of).flat_map(|(_, trials)| &trials.records);
    let counts: Vec<f64> = records.filter_map(|record| record.described).map(f64::from).collect();
    MeanStd::from_values(&counts).map_or("not run".into(), |spread| format!("{:.0}", spread.mean))
}

fn topics() -> Vec<Topic> {
    let outliers = Motion::ALL.map(robustness).to_vec();
    let mut both = outliers.clone();
    for motion in Motion::ALL {
        both.extend(Shape::ALL.map(|shape| accuracy(shape, motion)));
    }
    let armadillo = [Motion::Small, Motion::Large].map(|motion| accuracy(Shape::Armadillo, motion));
    let topic = |title, columns: &[ComparisonColumn], rows| Topic {
        title,
        columns: columns.to_vec(),
        rows,
    };
    vec![
        topic("TEASER's noise bound", &both, noise_bounds()),
        topic("CF's β, from the surface (fitting) and from the scan's points", &both, betas()),
        topic("CFK's keypoints", &both, keypoints()),
        topic("Where ICP ends", &both, icp_ends()),
        topic("Where normals look", &both, viewpoints()),
        topic("The ball of outliers", &outliers, outlier_radii()),
        topic("The side from which the Armadillo is seen", &armadillo, seen_sides()),
        topic("CPD's arithmetic", &outliers, cpd_arithmetic()),
        topic("What is sampled, under noise (section IV-B)", &noise_levels(), sampled_surfaces()),
    ]
}

fn robustness(motion: Motion) -> ComparisonColumn {
    ComparisonColumn { test: Test::Robustness, shape: Shape::Bunny, motion, noise: 0 }
}

fn accuracy(shape: Shape, motion: Motion) -> ComparisonColumn {
    ComparisonColumn { test: Test::Accuracy, shape, motion, noise: 0 }
}

fn noise_levels() -> Vec<ComparisonColumn> {
    let levels = [20, 100, 200].into_iter().flat_map(|noise| {
        Motion::ALL.map(move |motion| ComparisonColumn {
            test: Test::Sensitivity,
            shape: Shape::Bunny,
            motion,
            noise,
        })
    });
    levels.collect()
}

/// A row of the reading `fitting`.
fn fitting(label: &str, contender: Contender, variation: Variation) -> ComparisonRow {
    let (label, reading) = (label.to_string(), Interpretation::Fitting);
    ComparisonRow { label, contender, reading, variation }
}

fn noise_bounds() -> Vec<ComparisonRow> {
    let row = |bound: Option<f64>| {
        let label = bound.map_or("from the resolution".into(), |bound| format!("{bound} m"));
        fitting(&label, Contender::Teaser, Variation::NoiseBound(bound))
    };
    [None, Some(0.005), Some(0.01), Some(0.02), Some(0.05), Some(0.1)].map(row).into()
}

fn betas() -> Vec<ComparisonRow> {
    let row = |reading, beta| ComparisonRow {
        label: format!("{beta}, {reading}"),
        contender: Contender::Cf,
        reading,
        variation: Variation::Beta(beta),
    };
    [Interpretation::Fitting, Interpretation::Points]
        .into_iter()
        .flat_map(|reading| [25.0, 50.0, 100.0, 200.0, 400.0].map(|size| row(reading, size)))
        .collect()
}

fn keypoints() -> Vec<ComparisonRow> {
    let sift = |label: &str, unit, min_scale, octaves, scales, min_contrast| {
        let sift = Sift { unit, min_scale, octaves, scales, min_contrast };
        fitting(label, Contender::Cfk, Variation::Keypoints(sift))
    };
    vec![
        sift("0.5 resolutions, 4 octaves of 8 scales (ours)", None, 0.5, 4, 8, 0.0),
        sift("1 resolution, 3 octaves of 4", None, 1.0, 3, 4, 0.0),
        sift("1 resolution, 4 octaves of 16", None, 1.0, 4, 16, 0.0),
        sift("1 cm, 3 octaves of 4, contrast 0.001 (PCL's example)", Some(1.0), 0.01, 3, 4, 1e-3),
    ]
}

fn icp_ends() -> Vec<ComparisonRow> {
    let paper = "fitness epsilon 0.05 as a share (the paper's, as PCL has it)";
    vec![
        fitting(paper, Contender::Icp, Variation::Plain),
        fitting("until it rests", Contender::Icp, Variation::AtRest),
    ]
}

fn viewpoints() -> Vec<ComparisonRow> {
    let rows = [Contender::Cf, Contender::Cfk].into_iter().flat_map(|contender| {
        let look = |label: &str, viewpoint| {
            fitting(&format!("{contender}, {label}"), contender, Variation::Viewpoint(viewpoint))
        };
        [
            look("the frame's origin, which stays", NormalViewpoint::Origin),
            look("the frame's origin, which moves along", NormalViewpoint::Along),
            look("the centroid", NormalViewpoint::Centroid),
            look("the sensor, one metre in front", NormalViewpoint::At(SENSOR)),
        ]
    });
    rows.collect()
}

fn outlier_radii() -> Vec<ComparisonRow> {
    let rows = [Contender::Cf, Contender::Teaser].into_iter().flat_map(|contender| {
        [0.2, 0.1].map(|radius| {
            fitting(&format!("{contender}, radius {radius}"), contender, Variation::Radius(radius))
        })
    });
    rows.collect()
}

fn seen_sides() -> Vec<ComparisonRow> {
    let sides = [Contender::Cf, Contender::Teaser, Contender::CfMultiscale];
    let rows = sides.into_iter().flat_map(|contender| {
        [0, 45, 90, 135, 180, 225, 270, 315].map(|degrees| {
            fitting(&format!("{contender}, {degrees}°"), contender, Variation::Side(degrees))
        })
    });
    rows.collect()
}

fn cpd_arithmetic() -> Vec<ComparisonRow> {
    let tolerances = [1e-3, 1e-5, 1e-8].map(|tolerance| {
        let label = format!("tolerance {tolerance:e}");
        fitting(&label, Contender::Cpd, Variation::Tolerance(tolerance))
    });
    let decimals = [9, 8, 7, 6].map(|decimals| {
        let label = format!("coordinates of {decimals} decimals");
        fitting(&label, Contender::Cpd, Variation::Decimals(decimals))
    });
    tolerances.into_iter().chain(decimals).collect()
}

/// Without DARE, which computes no descriptors and takes longest.
fn sampled_surfaces() -> Vec<ComparisonRow> {
    let swift = Contender::ALL.into_iter().filter(|&contender| contender != Contender::Dare);
    let rows = swift.flat_map(|contender| {
        [(Interpretation::Fitting, "surface"), (Interpretation::Points, "points")].map(
            |(reading, from)| ComparisonRow {
                label: format!("{contender}, {from}"),
                contender,
                reading,
                variation: Variation::Plain,
            },
        )
    });
    rows.collect()
}

const LEGEND: &str = "# What the paper leaves open, each choice beside the printed figure\n\n\
    Columns: Table I, average shift in metres, and Table II, ‖I − R R_gtᵀ‖_F. Each cell: ours, \
    mean ± deviation, then `|` and what the paper prints, then `=` where the means differ by no \
    more than the printed deviation, `<` where ours is lower by more, `>` where it is higher. All \
    else is as in the reading `fitting`. The paper prints no figures of its noise test.\n";

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;

    #[test]
    fn every_cell_has_a_name_and_every_row_of_a_topic_is_another_choice() {
        let names: BTreeSet<String> = cells(30, false).iter().map(ExperimentCell::name).collect();
        assert_eq!(names.len(), cells(30, false).len());
        for topic in topics() {
            let choices: Vec<_> = topic
                .rows
                .iter()
                .map(|row| row.cell(topic.columns[0], 1))
                .map(|cell| {
                    // A change of the points themselves is visible in none of the other fields.
                    let points = cell.variation.filter(|v| matches!(v, Variation::Decimals(_)));
                    (cell.reading, cell.method(), cell.protocol(), cell.viewpoint(), points)
                })
                .collect();
            for (at, choice) in choices.iter().enumerate() {
                assert!(!choices[..at].contains(choice), "{}: {choice:?}", topic.title);
            }
        }
    }
}
