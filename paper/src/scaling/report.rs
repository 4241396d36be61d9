//! Report of the runs: a table of exponents, and curves.

use std::fmt::Write;
use std::path::Path;

use super::{Growth, METHODS, Run};
use crate::files;
use cfreg::error::Result;
use cfreg::figure::{Axes, Content, Curve, Figure, Panel};

/// The runs of a method that have an answer.
fn runs_of_method<'a>(
    runs: &'a [Run],
    method: &'a str,
) -> impl DoubleEndedIterator<Item = &'a Run> {
    runs.iter().filter(move |run| run.method == method && run.error.is_empty())
}

fn seconds(run: &Run) -> Option<f64> {
    Some(run.seconds)
}

fn megabytes(run: &Run) -> Option<f64> {
    run.bytes.map(|bytes| 1e-6 * bytes as f64)
}

/// Returns N and the measured value.
fn pairs(runs: &[Run], method: &str, measure: fn(&Run) -> Option<f64>) -> Vec<[f64; 2]> {
    runs_of_method(runs, method)
        .filter_map(|run| Some([run.points as f64, measure(run)?]))
        .collect()
}

const LEGEND: &str = "# Time and memory over the number of points\n\n\
    Two samples of N points each of the bunny's surface, turned a little against each other, on one \
    thread, every method with its default settings. Exponents p of N^p ± their standard errors, by \
    least squares in logarithms over the last decade of N (three sizes at least). Memory is the most \
    that was allocated at a time beyond the clouds themselves. Times are those of one machine.\n\n\
    | method | time | memory | from N | to N | seconds | MB | rotation error | trusted |\n\
    |---|---|---|---|---|---|---|---|---|\n";

/// Formats the exponents and the largest runs as Markdown.
pub fn markdown(runs: &[Run]) -> String {
    let mut text = String::from(LEGEND);
    let growth = |pairs: &[[f64; 2]]| {
        let shown = |growth: Growth| format!("{:.2} ± {:.2}", growth.exponent, growth.error);
        Growth::fit(pairs).map_or_else(String::new, shown)
    };
    for method in METHODS {
        let Some(last) = runs_of_method(runs, method).next_back() else { continue };
        let [times, memory] = [seconds, megabytes].map(|measure| pairs(runs, method, measure));
        let from = Growth::fit(&times).map_or(last.points as f64, |growth| growth.from);
        let held = megabytes(last).map_or_else(String::new, three_digits);
        let error = last.rotation_deg.unwrap_or(f64::NAN);
        let _ = writeln!(
            text,
            "| {method} | {} | {} | {from} | {} | {} | {held} | {}° | {} |",
            growth(&times),
            growth(&memory),
            last.points,
            three_digits(last.seconds),
            three_digits(error),
            if last.trusted { "yes" } else { "no" },
        );
    }
    text
}

fn three_digits(value: f64) -> String {
    let decimals = if value > 0.0 { 2 - value.log10().floor() as i32 } else { 0 };
    format!("{value:.*}", decimals.clamp(0, 6) as usize)
}

/// Writes `scaling.md`, and `fig11-scaling` as SVG and PNG, to `folder`.
///
/// # Errors
/// [`Error::Io`](cfreg::Error::Io).
pub fn draw(runs: &[Run], folder: &Path) -> Result<()> {
    files::write_bytes(&folder.join("scaling.md"), markdown(runs).as_bytes())?;
    let panels = [panel(runs, "time", "seconds", seconds), panel(runs, "memory", "MB", megabytes)];
    let figure =
        Figure { panels: panels.into_iter().flatten().collect(), columns: 2, size: (620, 460) };
    figure.save(&folder.join("fig11-scaling"))
}

/// Draws a curve a method, between guides of N and N²; `None` if nothing was measured.
fn panel(runs: &[Run], title: &str, unit: &str, measure: fn(&Run) -> Option<f64>) -> Option<Panel> {
    let curve = |method: &str| {
        let points = pairs(runs, method, measure);
        let power = Growth::fit(&points).map(|growth| format!("  N^{:.1}", growth.exponent));
        let name = method.to_uppercase() + &power.unwrap_or_default();
        (!points.is_empty()).then(|| Curve { name, points, ..Curve::default() })
    };
    let mut curves: Vec<Curve> = METHODS.iter().filter_map(|method| curve(method)).collect();
    let all = || curves.iter().flat_map(|curve| curve.points.iter().copied());
    let extreme = |a: usize, fold: fn(f64, f64) -> f64| all().map(|p| p[a]).reduce(fold);
    let ([least, low], [most, high]) = (
        [extreme(0, f64::min)?, extreme(1, f64::min)?],
        [extreme(0, f64::max)?, extreme(1, f64::max)?],
    );
    // From the lower left corner to the upper or the right edge.
    let guide = |power: f64, name: &str| {
        let to = most.min(least * (high / low).powf(1.0 / power));
        let points = vec![[least, low], [to, low * (to / least).powf(power)]];
        Curve { name: name.into(), points, guide: true, ..Curve::default() }
    };
    let guides = [guide(1.0, "N and N²"), guide(2.0, "")];
    curves.extend(guides);
    let content = Content::Curves {
        x: "N, points of each cloud".into(),
        y: unit.into(),
        axes: Axes::Logarithmic,
        curves,
    };
    Some(Panel { title: title.into(), content })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn runs(bytes: impl Fn(usize) -> Option<u64>) -> Vec<Run> {
        let run = |points: usize, error: &str| Run {
            method: "cpd".into(),
            points,
            seconds: 1e-6 * (points * points) as f64,
            bytes: bytes(points),
            iterations: 20,
            rotation_deg: Some(0.25),
            trusted: true,
            stages: String::new(),
            error: error.into(),
        };
        vec![run(100, "none"), run(200, ""), run(500, ""), run(1000, ""), run(3000, "none")]
    }

    #[test]
    fn exponents_stand_beside_the_largest_run_with_an_answer() {
        let text = markdown(&runs(|points| Some(100 * points as u64)));
        let row =
            "| cpd | 2.00 ± 0.00 | 1.00 ± 0.00 | 200 | 1000 | 1.00 | 0.100 | 0.250° | yes |\n";
        assert!(text.ends_with(row), "{text}");
        let text = markdown(&runs(|_| None));
        assert!(
            text.ends_with("| 2.00 ± 0.00 |  | 200 | 1000 | 1.00 |  | 0.250° | yes |\n"),
            "{text}"
        );
    }

    #[test]
    fn panels_have_named_curves_between_guides() {
        let panel = |runs: &[Run]| panel(runs, "memory", "MB", megabytes);
        assert!(panel(&runs(|_| None)).is_none() && panel(&[]).is_none());
        let made = panel(&runs(|points| Some(points as u64))).unwrap();
        let Content::Curves { curves, .. } = made.content else { panic!("no curves") };
        let names: Vec<&str> = curves.iter().map(|curve| curve.name.as_str()).collect();
        assert_eq!(names, ["CPD  N^1.0", "N and N²", ""]);
        assert_eq!(curves[0].points.len(), 3);
        // N² reaches the top, where the curve ends.
        let [_, [x, y]] = curves[2].points[..] else { panic!("{:?}", curves[2]) };
        assert!((x - 200.0 * 5f64.sqrt()).abs() < 1e-9 && (y - 1e-3).abs() < 1e-12, "{x} {y}");
    }
}
