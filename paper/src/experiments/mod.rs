//! Reproduction of the paper's experiments (section IV): every trial as CSV, Tables I and II beside
//! the printed ones, and the effect of each choice that the paper leaves open.

pub mod cell;
pub mod interpretations;
mod lecture_hall;
pub mod models;
pub mod pairs;
mod pictures;
pub mod printed;
mod record;
pub mod tables;
pub mod variation;

use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;

pub use record::{Record, Trials};

use self::cell::{ExperimentCell, Interpretation, Shape, Test};
use self::models::Source;
use self::tables::Results;
use crate::files;
use cfreg::error::{Error, Result};

/// Selection of experiments, and the output folder.
#[derive(Debug, Clone, PartialEq)]
pub struct ExperimentOptions {
    /// Folder of the scans ([`models::load`]).
    pub data: PathBuf,
    /// Folder of the results; created if missing. Existing trials with the same settings are not
    /// run again.
    pub output: PathBuf,
    /// A few trials only, in a minute.
    pub smoke: bool,
    /// This part alone.
    pub only: Option<ExperimentPart>,
}

/// A part of the experiments.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ExperimentPart {
    /// A test of section IV, as the paper has it.
    Test(Test),
    /// The tests by each choice that the paper leaves ([`interpretations`]).
    Interpretations,
}

impl ExperimentPart {
    fn includes(self, cell: &ExperimentCell) -> bool {
        match self {
            ExperimentPart::Test(test) => cell.variation.is_none() && cell.test == test,
            ExperimentPart::Interpretations => cell.variation.is_some(),
        }
    }
}

/// Results of the experiments.
#[derive(Debug, Clone, PartialEq)]
pub struct ExperimentOutcome {
    /// All trials.
    pub results: Results,
    /// A line for each missing model, which was left out: its name, and how to get it.
    pub left_out: Vec<String>,
}

/// Returns the numbers of trials of a cell in the tables, under noise and in the table of
/// interpretations, and the number of levels of noise.
fn sizes(smoke: bool) -> (usize, usize, usize, u32) {
    if smoke { (2, 1, 1, 2) } else { (100, 30, 30, 10) }
}

/// Runs the experiments; `progress` receives the number of finished cells and of all cells. Missing
/// models are left out.
///
/// # Errors
/// [`Error::Io`] when there is no model at all or a folder cannot be written, and the errors of the
/// readers. Nothing is written before the models are read.
pub fn run(
    options: &ExperimentOptions,
    mut progress: impl FnMut(usize, usize),
) -> Result<ExperimentOutcome> {
    let (trials, noisy, varied, levels) = sizes(options.smoke);
    let mut cells = cell::cells(trials, noisy, levels);
    cells.extend(interpretations::cells(varied, options.smoke));
    let (sources, left_out) = load(options, &cells)?;
    cells.retain(|cell| sources.contains_key(&cell.model()));
    let wanted = |cell: &ExperimentCell| options.only.is_none_or(|part| part.includes(cell));

    let folder = options.output.join("trials");
    std::fs::create_dir_all(&folder).map_err(|error| Error::io(&folder, error))?;
    let mut results = Results::new();
    for (done, cell) in cells.iter().enumerate() {
        progress(done, cells.len());
        let source = &sources[&cell.model()];
        let path = folder.join(cell.name() + ".csv");
        let found = match Trials::read(cell, source, &path) {
            Some(found) => found,
            // Other parts are shown with their existing results.
            None if !wanted(cell) => continue,
            None => {
                let found = Trials::run(cell, &source.model)?;
                found.write(cell, source, &path)?;
                found
            }
        };
        results.insert(cell.name(), (*cell, found));
    }
    progress(cells.len(), cells.len());
    let write =
        |name: &str, text: String| files::write_bytes(&options.output.join(name), text.as_bytes());
    if options.only.is_none_or(|part| part == ExperimentPart::Interpretations) {
        write("readings.md", interpretations::markdown(&results))?;
    }
    if options.only != Some(ExperimentPart::Interpretations) {
        write("tables.md", tables::markdown(&results))?;
        write("tables.tex", tables::latex(&results))?;
        pictures::draw(&options.data, &options.output, &results, options.smoke)?;
    }
    Ok(ExperimentOutcome { results, left_out })
}

type Sources = BTreeMap<(Shape, Interpretation, Option<u32>), Source>;

/// The models that `cells` need, and a line for each that is not there.
fn load(options: &ExperimentOptions, cells: &[ExperimentCell]) -> Result<(Sources, Vec<String>)> {
    let needed: BTreeSet<_> = cells.iter().map(ExperimentCell::model).collect();
    let (mut sources, mut missing) = (Sources::new(), Vec::new());
    for key in needed {
        let (shape, reading, side) = key;
        let source = match side {
            None => models::load(&options.data, shape, reading),
            Some(degrees) => models::armadillo(&options.data, degrees),
        };
        match source {
            Ok(source) => {
                sources.insert(key, source);
            }
            Err(error) if models::is_missing(&error) => missing.push((shape, error)),
            Err(error) => return Err(error),
        }
    }
    if sources.is_empty() && !missing.is_empty() {
        return Err(missing.swap_remove(0).1);
    }
    // One line a shape: its interpretations miss the same files.
    missing.dedup_by_key(|(shape, _)| *shape);
    let lines = missing.iter().map(|(shape, error)| models::missing_model_note(*shape, error));
    Ok((sources, lines.collect()))
}
