//! Tables I and II, ours beside the paper's, as Markdown and LaTeX.

use std::collections::BTreeMap;
use std::fmt::Write;

use super::cell::{Cell, Contender, Interpretation, Shape, Test};
use super::printed::printed;
use super::record::{Record, Trials};
use crate::{Motion, Spread};

/// All trials, by the name of their cell.
pub type Results = BTreeMap<String, (Cell, Trials)>;

/// Comparison of a figure of ours with the paper's.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Verdict {
    /// The means differ by no more than the printed deviation.
    Within,
    /// Ours is lower by more.
    Lower,
    /// Ours is higher by more.
    Higher,
    /// The paper prints nothing.
    Unprinted,
}

impl Verdict {
    /// Compares a mean of ours with the printed value.
    pub fn of(mean: f64, printed: Option<Spread>) -> Self {
        match printed {
            None => Verdict::Unprinted,
            Some(theirs) if (mean - theirs.mean).abs() <= theirs.deviation => Verdict::Within,
            Some(theirs) if mean < theirs.mean => Verdict::Lower,
            Some(_) => Verdict::Higher,
        }
    }

    fn mark(self) -> &'static str {
        match self {
            Verdict::Within => "=",
            Verdict::Lower => "<",
            Verdict::Higher => ">",
            Verdict::Unprinted => "",
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
struct Table {
    title: String,
    head: Vec<String>,
    rows: Vec<(Contender, Vec<Entry>)>,
}

pub(super) struct Entry {
    pub(super) printed: Option<Spread>,
    pub(super) ours: Option<Spread>,
    pub(super) failures: usize,
}

fn table(results: &Results, test: Test, reading: Interpretation) -> Table {
    let columns = columns(test);
    let title = match test {
        Test::Robustness => "Table I: average shift (m)",
        Test::Accuracy => "Table II: norm of I - R R_gt^T",
        Test::Sensitivity => "Sensitivity: average shift (m)",
    };
    let entry = |contender, &(shape, motion): &(Shape, Motion)| {
        let is_it = |cell: &Cell| {
            is_of(cell, test, reading)
                && cell.contender == contender
                && (cell.shape, cell.motion) == (shape, motion)
        };
        let trials = results.values().find(|(cell, _)| is_it(cell)).map(|(_, trials)| trials);
        Entry {
            printed: printed(test, contender, shape, motion),
            ours: trials.and_then(|trials| trials.spread(measure(test))),
            failures: trials.map_or(0, Trials::failures),
        }
    };
    let row = |&contender: &Contender| {
        (contender, columns.iter().map(|column| entry(contender, column)).collect())
    };
    Table {
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
    let _ = writeln!(text, "\n{trials} trials a cell{}.", few(trials));
    for table in tables(results) {
        let _ = writeln!(text, "\n## {}\n", table.title);
        let _ = writeln!(text, "| | {} |", table.head.join(" | "));
        let _ = writeln!(text, "|---|{}", "---|".repeat(table.head.len()));
        for (contender, entries) in &table.rows {
            let cells: Vec<String> = entries.iter().map(|entry| shown(entry, " ± ")).collect();
            let _ = writeln!(text, "| {contender} | {} |", cells.join(" | "));
        }
    }
    text
}

/// Returns a warning if trials are too few for a mean.
pub(super) fn few(trials: usize) -> &'static str {
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
                .map(|entry| format!("${}$", shown(entry, " \\pm ").replace('|', "\\mid")))
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

/// Returns whether a cell belongs to the paper's tables, and to this one.
fn is_of(cell: &Cell, test: Test, reading: Interpretation) -> bool {
    cell.variation.is_none() && (cell.test, cell.reading) == (test, reading)
}

fn tables(results: &Results) -> Vec<Table> {
    let there = |test, reading| results.values().any(|(cell, _)| is_of(cell, test, reading));
    let all = [Test::Robustness, Test::Accuracy]
        .into_iter()
        .flat_map(|test| Interpretation::ALL.map(|reading| (test, reading)));
    all.filter(|&(test, reading)| there(test, reading))
        .map(|(test, reading)| table(results, test, reading))
        .collect()
}

pub(super) fn shown(entry: &Entry, between: &str) -> String {
    let spread =
        |spread: Spread| format!("{}{between}{}", number(spread.mean), number(spread.deviation));
    let without = if entry.failures > 0 { "none" } else { "not run" };
    let mut text = entry.ours.map_or(without.to_string(), spread);
    if let Some(printed) = entry.printed {
        let mark = entry.ours.map_or("", |ours| Verdict::of(ours.mean, Some(printed)).mark());
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
        let printed = Some(Spread { mean: 0.18, deviation: 0.14 });
        assert_eq!(Verdict::of(0.30, printed), Verdict::Within);
        assert_eq!(Verdict::of(0.33, printed), Verdict::Higher);
        assert_eq!(Verdict::of(0.03, printed), Verdict::Lower);
        assert_eq!(Verdict::of(0.03, None), Verdict::Unprinted);
    }

    #[test]
    fn numbers_have_two_digits() {
        let shown = [0.0, 0.00712, 0.1849, 1.149, 2.4e-9, 12.3].map(number);
        assert_eq!(shown, ["0", "0.0071", "0.18", "1.1", "2.4e-9", "12"]);
    }
}
