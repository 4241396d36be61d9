//! The results as tables: shares of right poses by overlap, with intervals.

use std::fmt::Write as _;

use super::{OverlapRun, clopper_pearson};

/// Name of a group of pairs, and whether a run is one of them.
type Group = (&'static str, fn(&OverlapRun) -> bool);

fn is_street(run: &OverlapRun) -> bool {
    run.dataset.starts_with("kitti")
}

/// Groups of the table. Sweeps of streets overlap by more than two thirds and would hide the others.
const GROUPS: [Group; 6] = [
    ("75-100 %, without KITTI", |run| !is_street(run) && run.overlap >= 0.75),
    ("50-75 %, without KITTI", |run| !is_street(run) && (0.5..0.75).contains(&run.overlap)),
    ("30-50 %", |run| !is_street(run) && (0.3..0.5).contains(&run.overlap)),
    ("10-30 %", |run| !is_street(run) && (0.1..0.3).contains(&run.overlap)),
    ("KITTI", is_street),
    ("terrestrial scans", |run| run.dataset.starts_with("tls")),
];

/// Formats the shares of right poses in Markdown, by overlap and by set of pairs, and the seconds.
pub fn markdown(runs: &[OverlapRun], methods: &[String]) -> String {
    let by_overlap = |text: &mut String, is_right: fn(&OverlapRun) -> bool| {
        for (name, is_in) in GROUPS {
            row(text, name, methods, runs, is_in, is_right);
        }
    };
    let mut text = String::new();
    head(&mut text, "Right within 10 degrees, by overlap (95 % intervals)", methods);
    by_overlap(&mut text, OverlapRun::is_right);
    head(&mut text, "Right by the criterion of its size, by overlap", methods);
    by_overlap(&mut text, |run| run.meets_criterion);
    head(&mut text, "Right within 10 degrees, overlap above one half, by set", methods);
    let mut sets: Vec<&str> = runs.iter().map(|run| run.dataset.as_str()).collect();
    sets.sort_unstable();
    sets.dedup();
    for set in sets {
        let is_in = |run: &OverlapRun| run.dataset == set && run.overlap >= 0.5;
        row(&mut text, set, methods, runs, is_in, OverlapRun::is_right);
    }
    head(&mut text, "Seconds (median)", methods);
    text += "| registration";
    for name in methods {
        let mut seconds: Vec<f64> =
            runs.iter().filter(|run| run.method == *name).map(|run| run.seconds).collect();
        seconds.sort_by(f64::total_cmp);
        match seconds.get(seconds.len() / 2) {
            Some(seconds) => drop(write!(text, " | {seconds:.3}")),
            None => text += " | -",
        }
    }
    text += " |\n";
    trust(&mut text, runs);
    text
}

/// Begins a table with a heading.
fn head(text: &mut String, title: &str, methods: &[String]) {
    let lead = if text.is_empty() { "" } else { "\n" };
    let _ = write!(text, "{lead}## {title}\n\n| | {} |\n", methods.join(" | "));
    *text += &format!("|---|{}\n", "---|".repeat(methods.len()));
}

/// Bounds of the ratio of eigenvalues between which poses are counted together.
const RATIOS: [f64; 6] = [0.0, 0.1, 0.2, 0.4, 0.7, 1.001];

/// Appends the share of right poses by the ratio of the two largest eigenvalues, if there is one.
fn trust(text: &mut String, runs: &[OverlapRun]) {
    if runs.iter().all(|run| run.eigenvalue_ratio.is_none()) {
        return;
    }
    *text += "\n## Right within 10 degrees, by the ratio of eigenvalues\n\n\
              | second over first eigenvalue | poses | right |\n|---|---|---|\n";
    for bounds in RATIOS.windows(2) {
        let is_in = |run: &&OverlapRun| {
            run.eigenvalue_ratio.is_some_and(|ratio| (bounds[0]..bounds[1]).contains(&ratio))
        };
        let all = runs.iter().filter(is_in).count();
        let right = runs.iter().filter(is_in).filter(|run| run.is_right()).count();
        let (low, high) = clopper_pearson(right, all);
        let _ = writeln!(
            text,
            "| {:.1}-{:.1} | {all} | {:.0} % ({:.0}-{:.0}) |",
            bounds[0],
            bounds[1].min(1.0),
            100.0 * right as f64 / all.max(1) as f64,
            100.0 * low,
            100.0 * high,
        );
    }
}

/// Appends a row, unless no pair is in the group.
fn row(
    text: &mut String,
    name: &str,
    methods: &[String],
    runs: &[OverlapRun],
    is_in: impl Fn(&OverlapRun) -> bool,
    is_right: impl Fn(&OverlapRun) -> bool,
) {
    let cell = |method: &String| {
        let own: Vec<&OverlapRun> =
            runs.iter().filter(|run| run.method == *method && is_in(run)).collect();
        let right = own.iter().filter(|run| is_right(run)).count();
        (right, own.len())
    };
    let cells: Vec<(usize, usize)> = methods.iter().map(cell).collect();
    if cells.iter().all(|&(_, all)| all == 0) {
        return;
    }
    let _ = write!(text, "| {name}");
    for (right, all) in cells {
        let (low, high) = clopper_pearson(right, all);
        let percent = 100.0 * right as f64 / all.max(1) as f64;
        let _ = write!(
            text,
            " | {right}/{all} = {percent:.0} % ({:.0}-{:.0})",
            100.0 * low,
            100.0 * high
        );
    }
    *text += " |\n";
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn groups_count_their_pairs() {
        let run = |dataset: &str, overlap, rotation_deg| OverlapRun {
            dataset: dataset.into(),
            source: "a".into(),
            target: "b".into(),
            overlap,
            method: "cf".into(),
            rotation_deg,
            shift: Some(0.0),
            meets_criterion: false,
            eigenvalue_ratio: None,
            seconds: 0.5,
            error: String::new(),
        };
        let runs = [
            run("bunny", 0.8, Some(2.0)),
            run("bunny", 0.6, Some(12.0)),
            run("bunny", 0.6, Some(10.0)),
            run("kitti00", 0.9, None),
            run("tls", 0.55, Some(1.0)),
        ];
        let text = markdown(&runs, &["cf".to_string()]);
        for line in [
            "| 75-100 %, without KITTI | 1/1 = 100 % (2-100) |",
            "| 50-75 %, without KITTI | 2/3 = 67 % (9-99) |",
            "| KITTI | 0/1 = 0 % (0-98) |",
            "| terrestrial scans | 1/1 = 100 % (2-100) |",
            "| bunny | 2/3 = 67 % (9-99) |",
        ] {
            assert!(text.contains(line), "{line}\n{text}");
        }
        assert!(
            !text.contains("30-50 %") && text.ends_with("| registration | 0.500 |\n"),
            "{text}"
        );
    }
}
