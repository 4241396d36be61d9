//! The ranking as Markdown.

use std::fmt::Write;

use super::condition::Condition;
use super::ranking::{self, Interval};
use super::scheme::GridPoint;
use super::{REFERENCE_METHOD, Study, TrialOutcome, screening, without_duplicates};
use crate::MeanStd;
use crate::experiments::cell::Shape;

const LEGEND: &str = "# Weight schemes\n\n\
    Every scheme is one step: weights on the full connection from descriptors, one closed form. \
    Named `nearest points of each scale (nN: N for its normals) and whose histogram (PCL's if none \
    is named) | kernel | bandwidth | normalisation`; `150 | gaussian | 100 | none` is the paper's. \
    No answer counts as a half turn.\n";

/// Formats the study as tables.
pub(super) fn markdown(study: &Study) -> String {
    let mut text = String::from(LEGEND);
    let [few, many] = study.trials;
    let conditions: Vec<Condition> = study.finals.iter().map(|(condition, _)| *condition).collect();
    let places = study.screened.len() / conditions.len().max(1);
    let small = if many < 30 { " A check that all runs, not a measurement." } else { "" };
    let _ = writeln!(
        text,
        "\n{places} schemes were screened in {} conditions on {few} trials each; the finalists ran \
         {many} others each.{small}",
        conditions.len()
    );
    ranking(&mut text, study);
    errors(&mut text, study);
    shapes(&mut text, study);
    choices(&mut text, study, &conditions);
    text
}

fn ranking(text: &mut String, study: &Study) {
    let kinds = study.rankings.first().map_or(Vec::new(), |s| s.kinds.clone());
    let kinds: Vec<&str> = kinds.iter().map(|(kind, _)| *kind).collect();
    let _ = writeln!(
        text,
        "\n## Ranking\n\nMean error over that of the paper's scheme, below 1 where it is better: per \
         kind the geometric mean over its conditions, overall over the kinds; in brackets the \
         interval that holds it in 95 of 100 repetitions (bootstrap over trials).\n"
    );
    let _ = writeln!(text, "| scheme | overall | {} |", kinds.join(" | "));
    let _ = writeln!(text, "|---|---|{}", "---|".repeat(kinds.len()));
    for standing in &study.rankings {
        let by_kind: Vec<String> =
            standing.kinds.iter().map(|(_, i)| format_interval(*i)).collect();
        let (name, overall) =
            (escape_markdown(&standing.scheme), format_interval(standing.overall));
        let _ = writeln!(text, "| {name} | {overall} | {} |", by_kind.join(" | "));
    }
}

/// What a reader asks for first: the paper's scheme, the steps away from it, the winner, and
/// the method that stands beside.
pub(super) fn highlighted_schemes(study: &Study) -> Vec<String> {
    let mut names: Vec<String> = GridPoint::STEPS.iter().map(GridPoint::name).collect();
    let best = study.rankings.iter().find(|standing| standing.scheme != REFERENCE_METHOD);
    let winner = best.map(|standing| standing.scheme.clone());
    names.extend(winner);
    names.push(REFERENCE_METHOD.into());
    without_duplicates(names)
}

/// Errors of one scheme in one condition.
pub(super) fn outcomes_of<'a>(
    outcomes: &'a [TrialOutcome],
    name: &'a str,
) -> impl Iterator<Item = &'a TrialOutcome> {
    outcomes.iter().filter(move |outcome| outcome.scheme == name)
}

fn errors(text: &mut String, study: &Study) {
    let names = highlighted_schemes(study);
    let _ = writeln!(text, "\n## Errors\n\nMean ± deviation of ‖I − R R_gtᵀ‖_F over the trials.\n");
    let heads: Vec<String> = names.iter().map(|name| escape_markdown(name)).collect();
    let _ = writeln!(text, "| | {} |", heads.join(" | "));
    let _ = writeln!(text, "|---|{}", "---|".repeat(names.len()));
    for (condition, outcomes) in &study.finals {
        let cells: Vec<String> = names
            .iter()
            .map(|name| mean(outcomes_of(outcomes, name).map(TrialOutcome::error).collect()))
            .collect();
        let _ = writeln!(text, "| {condition} | {} |", cells.join(" | "));
    }
}

fn shapes(text: &mut String, study: &Study) {
    let Some((_, outcomes)) =
        study.finals.iter().find(|(condition, _)| *condition == Condition::Independent)
    else {
        return;
    };
    let _ = writeln!(text, "\n## Independent samples, by shape\n");
    let _ = writeln!(text, "| | {} |", Shape::ALL.map(|shape| shape.to_string()).join(" | "));
    let _ = writeln!(text, "|---|{}", "---|".repeat(Shape::ALL.len()));
    for name in highlighted_schemes(study) {
        let cell = |shape: Shape| {
            let of = outcomes_of(outcomes, &name).filter(|outcome| outcome.shape == shape);
            mean(of.map(TrialOutcome::error).collect())
        };
        let _ =
            writeln!(text, "| {} | {} |", escape_markdown(&name), Shape::ALL.map(cell).join(" | "));
    }
}

/// Formats the best scheme with one choice changed, from the screening.
fn choices(text: &mut String, study: &Study, conditions: &[Condition]) {
    let places = study.screened.len() / conditions.len().max(1);
    let rows = &study.screened[..places];
    let at = |place: GridPoint| rows.iter().position(|row| row.scheme == place.name());
    let (Some(base), Some(unchanged)) = (at(GridPoint::PAPER), at(GridPoint::BEST)) else { return };
    let best = &rows[unchanged];
    let scores = screening::scores(&study.screened, conditions, base);
    let kinds = ranking::kinds(conditions);
    let _ = writeln!(
        text,
        "\n## One choice at a time\n\n`{}` with one choice changed, in the screening; as in the \
         ranking.\n",
        best.scheme
    );
    let _ = writeln!(text, "| changed | to | overall | {} |", kinds.join(" | "));
    let _ = writeln!(text, "|---|---|---|{}", "---|".repeat(kinds.len()));
    let others = (0..rows.len()).filter(|&at| at != unchanged);
    for at in [unchanged].into_iter().chain(others) {
        let row = &rows[at];
        let differences = [
            ("nothing", "", at == unchanged),
            ("description", row.points.as_str(), row.points != best.points),
            ("kernel", row.kernel.as_str(), row.kernel != best.kernel),
            ("bandwidth", row.beta.as_str(), row.beta != best.beta),
            ("normalisation", row.normalize.as_str(), row.normalize != best.normalize),
        ];
        let changed: Vec<_> = differences.iter().filter(|(_, _, is)| *is).collect();
        let &[&(what, to, _)] = changed.as_slice() else { continue };
        let cells: Vec<String> = scores[at].iter().map(|s| format!("{:.2}", s.exp())).collect();
        let _ = writeln!(text, "| {what} | {to} | {} |", cells.join(" | "));
    }
}

fn mean(errors: Vec<f64>) -> String {
    MeanStd::from_values(&errors)
        .map_or("none".into(), |s| format!("{:.3} ± {:.3}", s.mean, s.deviation))
}

fn format_interval(Interval { value, low, high }: Interval) -> String {
    format!("{value:.2} [{low:.2}, {high:.2}]")
}

/// The bar is the table's own sign.
fn escape_markdown(name: &str) -> String {
    name.replace('|', "\\|")
}
