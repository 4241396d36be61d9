//! The report of a benchmark: correct and wrong poses, the worst first.

use std::path::Path;

use super::PairReport;
use super::table_page::{self, TableCell, TablePage, TableRow};
use crate::benchmark::{self, BenchmarkRow, Rerun, Settings, reliability};
use crate::error::Result;

/// Columns of the table, with the cells of [`table_row`].
const COLUMNS: [&str; 12] = [
    "set",
    "source",
    "target",
    "method",
    "is",
    "accepted",
    "probability",
    "rotation error (°)",
    "translation error",
    "overlap",
    "seconds",
    "why",
];

/// Writes a table of `rows` into `folder`, the worst first: wrong poses that were accepted, then
/// failures without a pose, other wrong poses, correct poses that were not accepted, the rest. The
/// first `pages` rows link to a page with the true pose for comparison; their registrations are run
/// again. `progress` is called with the numbers done and of all.
///
/// # Errors
/// [`Error::Io`](crate::Error::Io) for a folder that cannot be written, those of reading clouds.
pub fn write_benchmark(
    rows: &[BenchmarkRow],
    pairs: &[benchmark::Pair],
    settings: Settings,
    folder: &Path,
    pages: usize,
    mut progress: impl FnMut(usize, usize),
) -> Result<()> {
    table_page::create_folders(folder)?;
    let order = worst_first(rows);
    let mut listed = Vec::new();
    let all = order.len().min(pages);
    for (at, &(number, row)) in order.iter().enumerate() {
        let mut line = table_row(row);
        if at < pages && row.error.is_empty() {
            add_pair_page(&mut line, row, number, pairs, settings, folder)?;
        }
        listed.push(line);
        progress((at + 1).min(all), all);
    }
    let mut lines = vec![summary(rows)];
    if rows.len() > pages {
        lines.push(format!("The worst {pages} open pages of their own."));
    }
    let columns = COLUMNS.to_vec();
    let title = "A benchmark, the worst first".into();
    let mut page = TablePage { title, lines, columns, rows: listed, ..TablePage::default() };
    if rows.iter().any(|row| row.probability.is_some()) {
        page.add_figure(&reliability::figure(rows)?, "Probabilities told, and the share right.")?;
    }
    page.write(folder)
}

/// Sorts numbered rows by their badness; among equals the largest rotation error first.
fn worst_first(rows: &[BenchmarkRow]) -> Vec<(usize, &BenchmarkRow)> {
    let off = |row: &BenchmarkRow| -row.rotation_deg.unwrap_or(0.0);
    let mut order: Vec<(usize, &BenchmarkRow)> = rows.iter().enumerate().collect();
    order.sort_by(|(i, a), (j, b)| {
        badness(a).cmp(&badness(b)).then(off(a).total_cmp(&off(b))).then(i.cmp(j))
    });
    order
}

/// Ranks a row, the worst 0.
fn badness(row: &BenchmarkRow) -> usize {
    match (row.right, row.accepted) {
        (false, true) => 0,
        (false, false) if !row.error.is_empty() => 1,
        // Unrelated clouds have no correct pose.
        (false, false) if row.rotation_deg.is_some() => 2,
        (true, false) => 3,
        (false, false) | (true, true) => 4,
    }
}

/// Counts the rows, in a sentence.
fn summary(rows: &[BenchmarkRow]) -> String {
    let count = |is: &dyn Fn(&BenchmarkRow) -> bool| rows.iter().filter(|row| is(row)).count();
    format!(
        "{} registrations: {} right, {} wrong and accepted, {} without a pose.",
        rows.len(),
        count(&|row| row.right),
        count(&|row| !row.right && row.accepted),
        count(&|row| !row.error.is_empty()),
    )
}

fn add_pair_page(
    line: &mut TableRow,
    row: &BenchmarkRow,
    number: usize,
    pairs: &[benchmark::Pair],
    settings: Settings,
    folder: &Path,
) -> Result<()> {
    // Poses of other programs cannot be computed again.
    let Ok(chain) = benchmark::parse_method(&row.method) else { return Ok(()) };
    let chain = chain.with_weight_graph();
    let Some((at, pair)) = pairs.iter().enumerate().find(|(_, pair)| row.matches_pair(pair)) else {
        return Ok(());
    };
    let Rerun { source, target, found, truth } = benchmark::rerun(pair, at, &chain, settings)?;
    let mut page = PairReport::new(&found, &source, &target);
    page.names = [row.source.clone(), row.target.clone()];
    page.truth = truth;
    line.add_pair_page(page, folder, number)
}

fn table_row(row: &BenchmarkRow) -> TableRow {
    let known = row.rotation_deg.is_some() || !row.error.is_empty();
    let word = match (row.right, known) {
        (true, _) => "right",
        (false, true) => "wrong",
        (false, false) => "unrelated",
    };
    let tone = match badness(row) {
        0..3 => "bad",
        3 => "unsure",
        _ => "good",
    };
    let accepted = match (row.accepted, row.ambiguous) {
        (true, _) => "yes",
        (false, true) => "ambiguous",
        (false, false) => "no",
    };
    let cells = vec![
        TableCell::text(&row.dataset),
        TableCell::text(&row.source),
        TableCell::text(&row.target),
        TableCell::text(&row.method),
        TableCell::text(word),
        TableCell::text(accepted),
        TableCell::percent(row.probability),
        TableCell::number(row.rotation_deg),
        TableCell::number(row.translation),
        TableCell::percent(row.overlap),
        TableCell::number(Some(row.seconds)),
        TableCell::text(&row.error),
    ];
    TableRow { tone, cells, ..TableRow::default() }
}
