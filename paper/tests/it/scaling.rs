//! `cfreg-paper reproduce --only scaling`: measured once, memory told apart, then read again.

use crate::common;

use std::cell::Cell;
use std::fs;

use cfreg::Error;
use cfreg_paper::scaling::{METHODS, Meter, Run, RunLimit, ScalingOptions, run};
use std::process::Command;

#[test]
fn the_smoke_run_measures_every_method_and_is_not_made_again() {
    let Some(data) = common::shared_data() else { return };
    let folder = tempfile::tempdir().unwrap();
    let output = folder.path();
    let command = || {
        let mut command = Command::new(env!("CARGO_BIN_EXE_cfreg-paper"));
        command.args(["reproduce", "--only", "scaling", "--smoke"]);
        command.arg("--data").arg(&data).arg("--output").arg(output).output().unwrap()
    };
    let done = command();
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    let printed = done.stdout;
    let names: Vec<_> =
        fs::read_dir(output).unwrap().map(|entry| entry.unwrap().file_name()).collect();
    assert_eq!(names.len(), 4, "{names:?}");
    assert_eq!(fs::read(output.join("scaling.md")).unwrap(), printed);
    let written = fs::read(output.join("scaling.csv")).unwrap();
    command();
    assert_eq!(fs::read(output.join("scaling.csv")).unwrap(), written, "times again");

    // The library reads what the program measured; what the meter tells is not asked for.
    let options = ScalingOptions::new(data, output.to_path_buf(), true);
    let meter = Meter { start: || panic!("measured again"), peak: || 0 };
    let runs = run(&options, Some(meter), |_, _| {}).unwrap();
    let at = |method: &str, points: usize| -> &Run {
        runs.iter().find(|run| run.method == method && run.points == points).unwrap()
    };
    for method in METHODS {
        let [first, last] = [options.sizes[0], options.sizes[1]].map(|size| at(method, size));
        assert!(first.error.is_empty() && last.error.is_empty(), "{last:?}");
        assert!(last.rotation_deg.unwrap() < 15.0 && last.seconds > 0.0, "{last:?}");
        assert!(last.bytes.unwrap() > 24 * last.points as u64, "{last:?}");
    }
    // What CF freed is not counted for ICP, which needs a few dozen bytes a point.
    let icp = at("icp", 600).bytes.unwrap();
    assert!(icp < 600 * 400 && at("icp", 300).bytes.unwrap() < icp, "{icp}");
}

#[test]
fn sizes_end_at_the_limit_and_other_settings_are_measured_anew() {
    let Some(data) = common::shared_data() else { return };
    let folder = tempfile::tempdir().unwrap();
    let output = folder.path().to_path_buf();
    let limit = RunLimit { seconds: 60.0, bytes: 1 << 30 };
    let whole = ScalingOptions { data, output, sizes: vec![60, 120], limit };
    let calls = Cell::new(0);
    let count = |_, _| calls.set(calls.get() + 1);
    let runs = run(&whole, None, count).unwrap();
    assert_eq!(runs.len(), 2 * METHODS.len());
    assert_eq!(calls.into_inner(), runs.len() + 1);
    assert!(runs.iter().all(|run| run.bytes.is_none()));
    assert_eq!(run(&whole, None, |_, _| panic!("measured again")).unwrap(), runs);
    // No time at all: the first size alone, which nothing foretells.
    let short = ScalingOptions { limit: RunLimit { seconds: 0.0, ..limit }, ..whole.clone() };
    let runs = run(&short, None, |_, _| {}).unwrap();
    assert!(runs.len() == METHODS.len() && runs.iter().all(|run| run.points == 60));
    let shrinking = ScalingOptions { sizes: vec![120, 60], ..whole };
    match run(&shrinking, None, |_, _| {}) {
        Err(Error::Config { field: "sizes", .. }) => {}
        other => panic!("{other:?}"),
    }
}
