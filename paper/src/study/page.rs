//! The report of the study of weight schemes: its curves, and the schemes by their rank.

use std::path::Path;

use super::Study;
use cfreg::error::Result;
use cfreg::report::table_page::{TableCell, TablePage, TableRow};

impl Study {
    /// Writes a page into `folder`, `index.html`: the curves, and all finalists, those that are
    /// worse than the paper's last.
    ///
    /// # Errors
    /// The errors of drawing and of writing.
    pub fn write_page(&self, folder: &Path) -> Result<()> {
        listing(self)?.write(folder)
    }
}

fn listing(study: &Study) -> Result<TablePage> {
    let kinds: Vec<&'static str> = study
        .rankings
        .first()
        .map_or_else(Vec::new, |best| best.kinds.iter().map(|k| k.0).collect());
    let columns = [&["scheme", "error over the paper's", "from", "to"][..], &kinds].concat();
    let rows = study.rankings.iter().map(|standing| {
        let overall = standing.overall;
        let numbers = [overall.value, overall.low, overall.high].into_iter();
        let kinds = standing.kinds.iter().map(|(_, interval)| interval.value);
        let cells = numbers.chain(kinds).map(|value| TableCell::number(Some(value)));
        let tone = match overall {
            all if all.high < 1.0 => "good",
            all if all.low > 1.0 => "bad",
            _ => "unsure",
        };
        let name = TableCell::text(&standing.scheme);
        TableRow {
            tone,
            cells: std::iter::once(name).chain(cells).collect(),
            ..TableRow::default()
        }
    });
    let [few, many] = study.trials;
    let mut listing = TablePage {
        title: "Weight schemes".into(),
        lines: vec![format!(
            "Errors of the rotation over those of the paper's scheme, below 1 where they are \
             smaller, with the interval that holds 95 of 100 repetitions: {many} trials a \
             condition, after a screening with {few}."
        )],
        columns,
        rows: rows.collect(),
        ..TablePage::default()
    };
    listing.add_figure(
        &study.figure(),
        "The finalists against overlap, noise and outliers, and what the screening says.",
    )?;
    Ok(listing)
}
