//! The paper's experiments (section IV), run again: every trial as CSV, Tables I and II
//! beside the printed ones.

pub mod cell;
mod lecture;
pub mod models;
pub mod pairs;
mod pictures;
pub mod printed;
mod record;
pub mod tables;

use std::collections::BTreeMap;
use std::collections::btree_map::Entry;
use std::path::PathBuf;

pub use record::{Record, Trials};

use self::cell::{Cell, Reading, Shape, Test};
use self::models::Source;
use self::tables::Results;
use crate::error::{Error, Result};
use crate::io;

/// What is run, and where it goes.
#[derive(Debug, Clone, PartialEq)]
pub struct Options {
    /// Folder of the scans ([`models::load`]).
    pub data: PathBuf,
    /// Folder of the results; made if it is not there. Trials that are in it already, made by
    /// the same settings, are not run again.
    pub output: PathBuf,
    /// A few trials only, in a minute.
    pub smoke: bool,
    /// This test alone.
    pub only: Option<Test>,
}

/// Runs the experiments; `progress` is told how many cells of how many are done.
///
/// # Errors
/// [`Error::Io`] for missing scans or a folder that cannot be written, those of the readers.
pub fn run(options: &Options, mut progress: impl FnMut(usize, usize)) -> Result<Results> {
    let (trials, noisy, levels) = if options.smoke { (2, 1, 2) } else { (100, 30, 10) };
    let wanted = |cell: &Cell| options.only.is_none_or(|test| test == cell.test);
    let cells: Vec<Cell> = cell::cells(trials, noisy, levels).into_iter().filter(wanted).collect();
    let folder = options.output.join("trials");
    std::fs::create_dir_all(&folder).map_err(|error| Error::io(&folder, error))?;
    let mut sources: BTreeMap<(Shape, Reading), Source> = BTreeMap::new();
    let mut results = Results::new();
    for (done, cell) in cells.iter().enumerate() {
        progress(done, cells.len());
        let path = folder.join(cell.name()).with_extension("csv");
        let found = match Trials::read(cell, &path) {
            Some(found) => found,
            None => {
                let key = (cell.shape, cell.reading);
                if let Entry::Vacant(place) = sources.entry(key) {
                    place.insert(models::load(&options.data, cell.shape, cell.reading)?);
                }
                let found = Trials::run(cell, &sources[&key].model)?;
                found.write(cell, &path)?;
                found
            }
        };
        results.insert(cell.name(), (*cell, found));
    }
    progress(cells.len(), cells.len());
    let write =
        |name: &str, text: String| io::write_bytes(&options.output.join(name), text.as_bytes());
    write("tables.md", tables::markdown(&results))?;
    write("tables.tex", tables::latex(&results))?;
    pictures::draw(&options.data, &options.output, &results, options.smoke)?;
    Ok(results)
}
