//! The report of a batch of pairs.

use std::path::Path;

use super::PairReport;
use super::pair_result::PairResult;
use super::table_page::{self, TableCell, TablePage, TableRow};
use crate::batch::Row;
use crate::cloud::{PointCloud, ViewpointSource};
use crate::error::Result;
use crate::io;

/// The folders and settings of a batch report.
#[derive(Debug, Clone)]
pub struct BatchReport<'a> {
    /// Folder that the files of the rows are relative to.
    pub clouds: &'a Path,
    /// Folder of the pages, created if missing: `index.html` is the table.
    pub output: &'a Path,
    /// Number of rows, the worst first, with a page of their own.
    pub pages: usize,
    /// Source of the sensor viewpoints.
    pub viewpoints: ViewpointSource,
}

/// Columns of the table, with the cells of [`table_row`].
const COLUMNS: [&str; 9] = [
    "pair",
    "source",
    "target",
    "verdict",
    "probability",
    "overlap",
    "fitness",
    "agreement",
    "why",
];

impl BatchReport<'_> {
    /// Writes a table of `rows`, the worst first, and the pages of pairs that it links; a pair
    /// whose clouds cannot be read has none. `progress` is called with the numbers of pages done
    /// and of all pages. Returns the number of pages.
    ///
    /// # Errors
    /// [`Error::Io`](crate::Error::Io) for a folder that cannot be written,
    /// [`Error::Config`](crate::Error::Config) for a row with an invalid pose.
    pub fn write(&self, rows: &[Row], mut progress: impl FnMut(usize, usize)) -> Result<usize> {
        table_page::create_folders(self.output)?;
        let order = worst_first(rows);
        let mut lines = vec![summary(rows)];
        let all = order.len().min(self.pages);
        let (mut made, mut missing) = (0, 0);
        let mut listed = Vec::new();
        for (at, row) in order.iter().enumerate() {
            let mut line = table_row(row);
            if let Some(result) = PairResult::from_row(row)?.filter(|_| at < self.pages) {
                match self.read_clouds(row) {
                    Ok([source, target]) => {
                        let mut pair = PairReport::from_result(result, &source, &target);
                        pair.names = [row.source.clone(), row.target.clone()];
                        line.add_pair_page(pair, self.output, row.index)?;
                        made += 1;
                    }
                    // The table is useful without its pages.
                    Err(_) => missing += 1,
                }
            }
            listed.push(line);
            progress((at + 1).min(all), all);
        }
        if rows.len() > self.pages {
            lines.push(format!("The worst {made} have a page of their own."));
        }
        if missing > 0 {
            lines.push(format!("Of {missing} the clouds could not be read from here again."));
        }
        let columns = COLUMNS.to_vec();
        let title = "Registrations, the worst first".into();
        TablePage { title, lines, columns, rows: listed, ..TablePage::default() }
            .write(self.output)?;
        Ok(made)
    }

    /// Reads the clouds of a row again.
    fn read_clouds(&self, row: &Row) -> Result<[PointCloud; 2]> {
        let read = |name: &String| self.viewpoints.apply(io::read(self.clouds.join(name))?);
        Ok([read(&row.source)?, read(&row.target)?])
    }
}

/// Sorts rows: those without a pose, rejected, ambiguous or uncertain, with warnings, usable; among
/// equals the least probable first.
fn worst_first(rows: &[Row]) -> Vec<&Row> {
    let badness = |row: &Row| match (&row.error, row.decision.as_deref()) {
        (Some(_), _) => 0,
        (None, Some("reject")) => 1,
        (None, Some("ambiguous" | "uncertain")) => 2,
        _ if row.is_usable() => 4,
        _ => 3,
    };
    let sure = |row: &Row| row.probability.or(row.agreement).unwrap_or(0.0);
    let mut order: Vec<&Row> = rows.iter().collect();
    order.sort_by(|a, b| {
        let key = badness(a).cmp(&badness(b)).then(sure(a).total_cmp(&sure(b)));
        key.then(a.index.cmp(&b.index))
    });
    order
}

/// Counts the rows, in a sentence.
fn summary(rows: &[Row]) -> String {
    let count = |is: &dyn Fn(&Row) -> bool| rows.iter().filter(|row| is(row)).count();
    format!(
        "{} pairs: {} poses to use, {} with warnings, {} without a pose.",
        rows.len(),
        count(&Row::is_usable),
        count(&|row| row.error.is_none() && !row.is_usable()),
        count(&|row| row.error.is_some()),
    )
}

fn table_row(row: &Row) -> TableRow {
    let usable = row.is_usable();
    let verdict = match (&row.error, usable, row.decision.as_deref()) {
        (Some(_), ..) => "no answer",
        (None, true, decision) => decision.unwrap_or("trusted"),
        // Accepted by a verdict, with a warning of another kind.
        (None, false, None | Some("accept")) => "doubted",
        (None, false, Some(decision)) => decision,
    };
    let tone = match (&row.error, row.decision.as_deref()) {
        _ if usable => "good",
        (Some(_), _) | (None, Some("reject") | None) => "bad",
        _ => "unsure",
    };
    let why = [&row.error, &row.doubts].into_iter().find_map(Clone::clone).unwrap_or_default();
    let cells = vec![
        TableCell::number(Some(row.index as f64)),
        TableCell::text(&row.source),
        TableCell::text(&row.target),
        TableCell::text(verdict),
        TableCell::percent(row.probability),
        TableCell::percent(row.overlap),
        TableCell::percent(row.fitness),
        TableCell::percent(row.agreement),
        TableCell::text(why),
    ];
    TableRow { tone, cells, ..TableRow::default() }
}
