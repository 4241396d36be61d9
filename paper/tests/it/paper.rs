//! The paper's experiments in small: files that are whole, the same again, and gone on with.

use crate::common;

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use cfreg::Error;
use cfreg_paper::experiments::{
    ExperimentOptions, ExperimentPart,
    cell::{Shape, Test},
    pairs, run,
};

fn files(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let name = |path: &Path| path.file_name().unwrap().to_string_lossy().into_owned();
    let read = |entry: fs::DirEntry| (name(&entry.path()), fs::read(entry.path()).unwrap());
    let entries = fs::read_dir(folder).unwrap().map(Result::unwrap);
    entries.filter(|entry| entry.path().is_file()).map(read).collect()
}

#[test]
fn a_smoke_run_is_whole_and_goes_on_where_it_was_cut() {
    let Some(data) = common::shared_data() else { return };
    let folder = tempfile::tempdir().unwrap();
    let output = folder.path().to_path_buf();
    let options = ExperimentOptions {
        data,
        output,
        smoke: true,
        only: Some(ExperimentPart::Test(Test::Robustness)),
    };
    let results = run(&options, |_, _| {}).unwrap().results;
    // Three readings, two motions, nine contenders.
    assert_eq!(results.len(), 54);
    let answered = results.values().filter(|(_, trials)| trials.failures() == 0).count();
    assert!(answered >= 45, "{answered}");
    let (first, trials) = (files(&options.output), files(&options.output.join("trials")));
    assert!(first.contains_key("tables.md") && first.contains_key("fig9-large.png"));
    let tables = String::from_utf8_lossy(&first["tables.md"]).into_owned();
    assert!(tables.contains("| CF |") && tables.contains("0.0075"), "{tables}");

    let one = options.output.join("trials/robustness_fitting_bunny_large_cf.csv");
    fs::remove_file(&one).unwrap();
    let half = options.output.join("trials/robustness_points_bunny_small_teaser.csv");
    let text = fs::read(&half).unwrap();
    fs::write(&half, &text[..text.len() - 9]).unwrap();
    run(&options, |_, _| {}).unwrap();
    assert_eq!(files(&options.output.join("trials")), trials);
    assert!(files(&options.output) == first, "a second run differs");
}

#[test]
fn pairs_are_written_once_for_all_contenders() {
    let Some(data) = common::shared_data() else { return };
    let folder = tempfile::tempdir().unwrap();
    let output = folder.path().join("results");
    let options = ExperimentOptions { data, output, smoke: true, only: None };
    let written = folder.path().join("pairs");
    pairs::write(&options, &written).unwrap();
    // One shape and three, two motions; nothing is registered.
    let cells: Vec<_> = fs::read_dir(&written).unwrap().map(|cell| cell.unwrap().path()).collect();
    assert_eq!(cells.len(), 8);
    assert!(!options.output.exists());
    for cell in cells {
        let names: Vec<String> = files(&cell).into_keys().collect();
        assert_eq!(names, ["source.npy", "target.npy", "truth.npy", "viewpoints.npy"]);
        // Two trials of 500 points, three f64 each, after a header of two times 64 bytes.
        assert_eq!(files(&cell)["source.npy"].len(), 128 + 2 * 500 * 24, "{}", cell.display());
    }
}

#[test]
fn missing_scans_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let (data, output) = (folder.path().join("nowhere"), folder.path().join("results"));
    let options = ExperimentOptions { data, output: output.clone(), smoke: true, only: None };
    match run(&options, |_, _| {}) {
        Err(error @ Error::Io { .. }) => assert!(error.to_string().contains("bun000.ply")),
        other => panic!("{other:?}"),
    }
    assert!(!output.exists());
}

#[test]
fn what_is_there_is_run_and_the_rest_is_named() {
    let Some(data) = common::shared_data() else { return };
    let folder = tempfile::tempdir().unwrap();
    let (bunny, output) = (folder.path().join("scans"), folder.path().join("results"));
    fs::create_dir(&bunny).unwrap();
    fs::copy(data.join("stanford_bunny/bun000.ply"), bunny.join("bun000.ply")).unwrap();
    let only = Some(ExperimentPart::Test(Test::Accuracy));
    let options = ExperimentOptions { data: bunny, output, smoke: true, only };
    let done = run(&options, |_, _| {}).unwrap();
    assert!(!done.results.is_empty());
    assert!(done.results.values().all(|(cell, _)| cell.shape == Shape::Bunny));
    assert!(done.left_out.iter().any(|line| line.contains("Armadillo left out")));
    assert!(done.left_out.iter().any(|line| line.contains("Armadillo.ply.gz")), "{done:?}");
}

#[test]
fn the_table_of_readings_goes_on_from_what_is_there() {
    let Some(data) = common::shared_data() else { return };
    let folder = tempfile::tempdir().unwrap();
    let output = folder.path().to_path_buf();
    let options = ExperimentOptions {
        data,
        output: output.clone(),
        smoke: true,
        only: Some(ExperimentPart::Interpretations),
    };
    let done = run(&options, |_, _| {}).unwrap();
    assert!(done.left_out.is_empty() && !done.results.is_empty());
    let table = fs::read_to_string(output.join("readings.md")).unwrap();
    assert!(table.contains("## TEASER's noise bound") && table.contains("not run"), "{table}");
    assert!(!output.join("tables.md").exists());
    let before = files(&output.join("trials"));
    assert_eq!(run(&options, |_, _| {}).unwrap(), done);
    assert_eq!(files(&output.join("trials")), before);
}
