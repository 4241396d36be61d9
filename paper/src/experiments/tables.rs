//! Tables I and II, ours beside the paper's, as Markdown and LaTeX.

use std::collections::BTreeMap;
use std::fmt::Write;

use super::cell::{Contender, ExperimentCell, Interpretation, Shape, Test};
use super::printed::printed_value;
use super::record::{Record, Trials};
use crate::{MeanStd, Motion};

/// All trials, by the name of their cell.
pub type Results = BTreeMap<String, (ExperimentCell, Trials)>;

/// Comparison of a figure of ours with the paper's.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PrintedComparison {
    /// The means differ by no more than the printed deviation.
    Within,
    /// Ours is lower by more.
    Lower,
    /// Ours is higher by more.
    Higher,
    /// The paper prints nothing.
    Unprinted,
}

impl PrintedComparison {
    /// Of a mean of ours, beside what is printed.
    pub fn compare(mean: f64, printed: Option<MeanStd>) -> Self {
        match printed {
            None => PrintedComparison::Unprinted,
            Some(theirs) if (mean - theirs.mean).abs() <= theirs.deviation => {
                PrintedComparison::Within
            }
            Some(theirs) if mean < theirs.mean => PrintedComparison::Lower,
            Some(_) => PrintedComparison::Higher,
        }
    }

    fn mark(self) -> &'static str {
        match self {
            PrintedComparison::Within => "=",
            PrintedComparison::Lower => "<",
            PrintedComparison::Higher => ">",
            PrintedComparison::Unprinted => "",
        }
    }
}

/// Returns the error measure of a test.
pub(super) fn measure(test: Test) -> fn(&Record) -> Option<f64> {
    match test {
        Test::Accuracy => |record| record.frobenius,
        Test::Robustness | Test::Sensitivity => |record| record.average_shift,
    }
}

/// Returns the columns of a table: shape and motion.
fn columns(test: Test) -> Vec<(Shape, Motion)> {
    let shapes = if test == Test::Robustness { &Shape::ALL[..1] } else { &Shape::ALL[..] };
    let of = |motion| shapes.iter().map(move |&shape| (shape, motion));
    of(Motion::Small).chain(of(Motion::Large)).collect()
}

/// One table: rows are contenders, columns shapes and motions.
struct PaperTable {
    title: String,
    head: Vec<String>,
    rows: Vec<(Contender, Vec<PaperEntry>)>,
}

pub(super) struct PaperEntry {
    pub(super) printed: Option<MeanStd>,
    pub(super) ours: Option<MeanStd>,
    pub(super) failures: usize,
}

fn table(results: &Results, test: Test, reading: Interpretation) -> PaperTable {
    let columns = columns(test);
    let title = match test {
        Test::Robustness => "Table I: average shift (m)",
        Test::Accuracy => "Table II: norm of I - R R_gt^T",
        Test::Sensitivity => "Sensitivity: average shift (m)",
    };
    let entry = |contender, &(shape, motion): &(Shape, Motion)| {
        let is_it = |cell: &ExperimentCell| {
            belongs_to(cell, test, reading)
                && cell.contender == contender
                && (cell.shape, cell.motion) == (shape, motion)
        };
        let trials = results.values().find(|(cell, _)| is_it(cell)).map(|(_, trials)| trials);
        PaperEntry {
            printed: printed_value(test, contender, shape, motion),
            ours: trials.and_then(|trials| trials.spread(measure(test))),
            failures: trials.map_or(0, Trials::failures),
        }
    };
    let row = |&contender: &Contender| {
        (contender, columns.iter().map(|column| entry(contender, column)).collect())
    };
    PaperTable {
        title: format!("{title}, reading: {reading}"),
        head: columns.iter().map(|(shape, motion)| format!("{shape}, {motion}")).collect(),
        rows: Contender::ALL.iter().map(row).collect(),
    }
}

/// Formats both tables under every interpretation with results, as Markdown.
pub fn markdown(results: &Results) -> String {
    let mut text = String::from(LEGEND);
    let own = results.values().map(|(cell, _)| cell).filter(|cell| cell.variation.is_none());
    let trials = own.map(|cell| cell.trials).max().unwrap_or(0);
    let _ = writeln!(text, "\n{trials} trials a cell{}.", sample_size_note(trials));
    for table in tables(results) {
        let _ = writeln!(text, "\n## {}\n", table.title);
        let _ = writeln!(text, "| | {} |", table.head.join(" | "));
        let _ = writeln!(text, "|---|{}", "---|".repeat(table.head.len()));
        for (contender, entries) in &table.rows {
            let cells: Vec<String> =
                entries.iter().map(|entry| format_entry(entry, " ± ")).collect();
            let _ = writeln!(text, "| {contender} | {} |", cells.join(" | "));
        }
    }
    text
}

/// A warning where trials are too few for a mean.
pub(super) fn sample_size_note(trials: usize) -> &'static str {
    if trials < 30 { ": a check that all runs, not a measurement" } else { "" }
}

/// Formats both tables as LaTeX.
pub fn latex(results: &Results) -> String {
    let mut text = String::from("% Ours | printed, and how they stand: see tables.md.\n");
    for table in tables(results) {
        let _ = writeln!(
            text,
            "\\begin{{table}}\\caption{{{}}}\n\\begin{{tabular}}{{l{}}}\n & {} \\\\ \\hline",
            table.title.replace('_', "\\_").replace('^', "\\^{}"),
            "l".repeat(table.head.len()),
            table.head.join(" & ")
        );
        for (contender, entries) in &table.rows {
            let cells: Vec<String> = entries
                .iter()
                .map(|entry| format!("${}$", format_entry(entry, " \\pm ").replace('|', "\\mid")))
                .collect();
            let _ = writeln!(text, "{contender} & {} \\\\", cells.join(" & "));
        }
        text.push_str("\\end{tabular}\\end{table}\n");
    }
    text
}

const LEGEND: &str = "# The paper's tables, ours beside the printed\n\n\
    Each cell: ours, mean ± deviation, then `|` and what the paper prints, then `=` where the \
    means differ by no more than the printed deviation, `<` where ours is lower by more, `>` where \
    it is higher by more. `(n none)`: n trials had no answer.\n\n\
    Readings of the paper: `written`, to the letter; `fitting`, as its figures suggest (outliers \
    from a ball of diameter 0.2, a viewpoint that moves along); `points`, as `fitting` from the \
    scan's points instead of its surface. For the Armadillo's the side of its \
    mesh that faces the sensor stands in, in `points` a scan simulated from it.\n";

/// Whether a cell is of the paper's tables, and of this one.
fn belongs_to(cell: &ExperimentCell, test: Test, reading: Interpretation) -> bool {
    cell.variation.is_none() && (cell.test, cell.reading) == (test, reading)
}

fn tables(results: &Results) -> Vec<PaperTable> {
    let there = |test, reading| results.values().any(|(cell, _)| belongs_to(cell, test, reading));
    let all = [Test::Robustness, Test::Accuracy]
        .into_iter()
        .flat_map(|test| Interpretation::ALL.map(|reading| (test, reading)));
    all.filter(|&(test, reading)| there(test, reading))
        .map(|(test, reading)| table(results, test, reading))
        .collect()
}

pub(super) fn format_entry(entry: &PaperEntry, between: &str) -> String {
    let spread =
        |spread: MeanStd| format!("{}{between}{}", number(spread.mean), number(spread.deviation));
    let without = if entry.failures > 0 { "none" } else { "not run" };
    let mut text = entry.ours.map_or(without.to_string(), spread);
    if let Some(printed) = entry.printed {
        let mark = entry
            .ours
            .map_or("", |ours| PrintedComparison::compare(ours.mean, Some(printed)).mark());
        let _ = write!(text, " \\| {} {mark}", spread(printed));
    }
    if entry.failures > 0 {
        let _ = write!(text, " ({} none)", entry.failures);
    }
    // The bar is the table's own sign only in Markdown.
    if between.contains("pm") { text.replace("\\|", "|") } else { text }
}

/// Formats two significant digits, as the paper prints.
fn number(value: f64) -> String {
    if value == 0.0 {
        return "0".into();
    }
    let magnitude = value.abs().log10().floor();
    if magnitude < -4.0 {
        return format!("{value:.1e}");
    }
    format!("{value:.*}", (1.0 - magnitude).max(0.0) as usize)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn verdicts_follow_the_printed_deviation() {
        let printed = Some(MeanStd { mean: 0.18, deviation: 0.14 });
        assert_eq!(PrintedComparison::compare(0.30, printed), PrintedComparison::Within);
        assert_eq!(PrintedComparison::compare(0.33, printed), PrintedComparison::Higher);
        assert_eq!(PrintedComparison::compare(0.03, printed), PrintedComparison::Lower);
        assert_eq!(PrintedComparison::compare(0.03, None), PrintedComparison::Unprinted);
    }

    #[test]
    fn numbers_have_two_digits() {
        let shown = [0.0, 0.00712, 0.1849, 1.149, 2.4e-9, 12.3].map(number);
        assert_eq!(shown, ["0", "0.0071", "0.18", "1.1", "2.4e-9", "12"]);
    }
}
