//! Tables of benchmark results.

use std::collections::BTreeMap;
use std::fmt::Write as _;

use super::BenchmarkRow;
use super::reliability::{ReliabilityBin, calibration_error, reliability_bins};

/// 95 % quantile of χ² with six degrees of freedom, whose median is 5.348.
const CHI_SQUARE_95: f64 = 12.592;
/// Bounds of overlap between which pairs are counted together. Chosen by hand.
const BANDS: [f64; 4] = [0.1, 0.3, 0.5, 0.75];

/// Formats tables in Markdown: for every set and method the share of correct poses, by overlap, the
/// errors of the correct ones, and the seconds; then the reliability of the methods' own verdicts.
pub fn markdown(rows: &[BenchmarkRow]) -> String {
    let mut sets: Vec<&str> = Vec::new();
    let mut methods: Vec<&str> = Vec::new();
    for row in rows {
        for (list, name) in [(&mut sets, &row.dataset), (&mut methods, &row.method)] {
            if !list.contains(&name.as_str()) {
                list.push(name);
            }
        }
    }
    let of = |set: &str, method: &str| -> Vec<&BenchmarkRow> {
        rows.iter().filter(|row| row.dataset == set && row.method == method).collect()
    };
    let mut text = String::from(
        "| set | method | right | 75-100 % | 50-75 % | 30-50 % | 10-30 % | below | \
         rotation (deg) | translation | seconds (median) | no answer |\n\
         |---|---|---|---|---|---|---|---|---|---|---|---|\n",
    );
    for set in &sets {
        for method in &methods {
            let rows = of(set, method);
            if rows.iter().any(|row| row.overlap != Some(0.0)) {
                recall(&mut text, set, method, &rows);
            }
        }
    }
    text += "\n| set | method | accepted, wrong | right, not accepted | of these ambiguous |\n\
             |---|---|---|---|---|\n";
    for set in &sets {
        for method in &methods {
            let rows = of(set, method);
            if !rows.is_empty() {
                verdicts(&mut text, set, method, &rows);
            }
        }
    }
    if rows.iter().any(|row| row.right && row.nees.is_some()) {
        text += "\n| set | method | right poses | NEES (median; 5.3 expected) | within the 95 % region |\n\
                 |---|---|---|---|---|\n";
    }
    for set in &sets {
        for method in &methods {
            let right = of(set, method).into_iter().filter(|row| row.right);
            let mut nees: Vec<f64> = right.filter_map(|row| row.nees).collect();
            if !nees.is_empty() {
                covariances(&mut text, set, method, &mut nees);
            }
        }
    }
    for method in &methods {
        let told: Vec<&BenchmarkRow> =
            rows.iter().filter(|row| row.method == *method && row.probability.is_some()).collect();
        if !told.is_empty() {
            reliability(&mut text, method, &told);
        }
    }
    text
}

fn recall(text: &mut String, set: &str, method: &str, rows: &[&BenchmarkRow]) {
    let share = |rows: &[&BenchmarkRow]| match rows.len() {
        0 => "-".to_string(),
        all => format!("{}/{all}", rows.iter().filter(|row| row.right).count()),
    };
    let mut bands: BTreeMap<usize, Vec<&BenchmarkRow>> = BTreeMap::new();
    for row in rows {
        if let Some(overlap) = row.overlap {
            let band = BANDS.iter().filter(|&&bound| overlap >= bound).count();
            bands.entry(band).or_default().push(row);
        }
    }
    let band = |at: usize| share(bands.get(&at).map_or(&[], Vec::as_slice));
    let right = rows.iter().filter(|row| row.right);
    let mean = |of: fn(&BenchmarkRow) -> Option<f64>| {
        let values: Vec<f64> = right.clone().filter_map(|row| of(row)).collect();
        values.iter().sum::<f64>() / values.len() as f64
    };
    // The seconds are unknown for a pair without a row of the program.
    let mut seconds: Vec<f64> = rows.iter().map(|row| row.seconds).collect();
    if seconds.iter().any(|seconds| seconds.is_finite()) {
        seconds.retain(|seconds| seconds.is_finite());
    }
    seconds.sort_by(f64::total_cmp);
    let failed = rows.iter().filter(|row| !row.error.is_empty()).count();
    let _ = writeln!(
        text,
        "| {set} | {method} | {} = {:.1} % | {} | {} | {} | {} | {} | {:.2} | {:.4} | {:.3} | {failed} |",
        share(rows),
        100.0 * right.clone().count() as f64 / rows.len() as f64,
        band(4),
        band(3),
        band(2),
        band(1),
        band(0),
        mean(|row| row.rotation_deg),
        mean(|row| row.translation),
        seconds[seconds.len() / 2],
    );
}

fn verdicts(text: &mut String, set: &str, method: &str, rows: &[&BenchmarkRow]) {
    let part = |part: usize, all: usize| match all {
        0 => "-".to_string(),
        _ => format!("{part}/{all} = {:.1} %", 100.0 * part as f64 / all as f64),
    };
    let wrong: Vec<_> = rows.iter().filter(|row| !row.right).collect();
    let right: Vec<_> = rows.iter().filter(|row| row.right).collect();
    let missed = right.iter().filter(|row| !row.accepted).count();
    let _ = writeln!(
        text,
        "| {set} | {method} | {} | {} | {} |",
        part(wrong.iter().filter(|row| row.accepted).count(), wrong.len()),
        part(missed, right.len()),
        right.iter().filter(|row| row.ambiguous).count(),
    );
}

/// Reports the consistency of covariances: squared errors of correct poses, normalised by them.
fn covariances(text: &mut String, set: &str, method: &str, nees: &mut [f64]) {
    nees.sort_by(f64::total_cmp);
    let within = nees.iter().filter(|&&error| error < CHI_SQUARE_95).count();
    let _ = writeln!(
        text,
        "| {set} | {method} | {} | {:.1} | {:.0} % |",
        nees.len(),
        nees[nees.len() / 2],
        100.0 * within as f64 / nees.len() as f64,
    );
}

/// Tabulates ten classes of the reported probability, and the share of correct poses.
fn reliability(text: &mut String, method: &str, rows: &[&BenchmarkRow]) {
    let _ = write!(
        text,
        "\n{method}: told and true\n\n| told | poses | mean told | right |\n|---|---|---|---|\n"
    );
    let classes = reliability_bins(rows.iter().copied());
    for ReliabilityBin { from, poses, predicted: told, observed: right } in &classes {
        let to = from + 0.1;
        let _ = writeln!(text, "| {from:.1}-{to:.1} | {poses} | {told:.3} | {right:.3} |");
    }
    let error = calibration_error(&classes);
    let _ = writeln!(text, "\nexpected calibration error {error:.3}");
}

#[cfg(test)]
mod tests {
    use super::super::SuccessCriterion;
    use super::*;

    fn row(set: &str, overlap: f64, right: bool, accepted: bool, probability: f64) -> BenchmarkRow {
        BenchmarkRow {
            dataset: set.into(),
            source: "a".into(),
            target: "b".into(),
            overlap: Some(overlap),
            method: "consensus".into(),
            right,
            rule: SuccessCriterion::Indoor,
            rotation_deg: Some(if right { 1.0 } else { 90.0 }),
            translation: Some(0.1),
            accepted,
            ambiguous: false,
            probability: Some(probability),
            nees: Some(if right { 5.0 } else { 900.0 }),
            seconds: 0.25,
            error: String::new(),
        }
    }

    #[test]
    fn tables_count_what_is_there() {
        let rows = [
            row("rooms", 0.8, true, true, 0.99),
            row("rooms", 0.2, true, false, 0.35),
            row("rooms", 0.2, false, false, 0.31),
            row("unrelated", 0.0, false, true, 0.95),
        ];
        let text = markdown(&rows);
        let line = "| rooms | consensus | 2/3 = 66.7 % | 1/1 | - | - | 1/2 | - | 1.00 | 0.1000 | 0.250 | 0 |";
        assert!(text.contains(line), "{text}");
        assert!(text.contains("| rooms | consensus | 0/1 = 0.0 % | 1/2 = 50.0 % | 0 |"), "{text}");
        // Unrelated pairs have no recall, but a false accept.
        assert!(text.contains("| unrelated | consensus | 1/1 = 100.0 % | - | 0 |"), "{text}");
        assert!(text.contains("| rooms | consensus | 2 | 5.0 | 100 % |"), "{text}");
        assert!(text.contains("| 0.3-0.4 | 2 | 0.330 | 0.500 |"), "{text}");
        assert!(text.contains("| 0.9-1.0 | 2 | 0.970 | 0.500 |"), "{text}");
    }
}
