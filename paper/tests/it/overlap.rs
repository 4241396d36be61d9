//! `overlap`: pairs of a list are moved, registered once, and read again.

use std::fs;

use cfreg::cloud::shape::boulder;
use cfreg::method::Method;
use cfreg::{Error, io};
use cfreg_paper::overlap::{OverlapOptions, contender, markdown, run};

#[test]
fn pairs_are_registered_once_and_read_again() {
    let folder = tempfile::tempdir().unwrap();
    for (name, seed) in [("a.ply", 1), ("b.ply", 2)] {
        io::write(folder.path().join(name), &boulder().sample(900, seed).unwrap()).unwrap();
    }
    let entries: Vec<String> = (0..16).map(|k| format!("t{}{}", k / 4, k % 4)).collect();
    let identity = "1,0,0,0,0,1,0,0,0,0,1,0,0,0,0,1";
    // The last pair has no known overlap.
    let list = format!(
        "dataset,source,target,{},overlap,units\nboulder,a.ply,b.ply,{identity},0.9,m\n\
         boulder,b.ply,a.ply,{identity},0.4,m\nother,a.ply,a.ply,{identity},,m\n",
        entries.join(",")
    );
    let path = folder.path().join("pairs.csv");
    fs::write(&path, list).unwrap();
    let options = OverlapOptions {
        lists: vec![path],
        output: folder.path().join("results"),
        every: 1,
        methods: ["cf", "cf-spectral", "cf-spectral:connections=300"].map(String::from).into(),
    };
    let mut calls = 0;
    let runs = run(&options, |_, _| calls += 1).unwrap();
    assert_eq!(runs.len(), 6);
    let spectral: Vec<_> = runs.iter().filter(|run| run.method == "cf-spectral").collect();
    assert!(spectral.iter().all(|run| run.is_right() && run.eigenvalue_ratio.is_some()));
    assert!(runs.iter().all(|run| run.error.is_empty() && run.seconds > 0.0));
    assert!(runs.iter().all(|run| (run.method == "cf") == run.eigenvalue_ratio.is_none()));
    let text = fs::read_to_string(options.output.join("overlap.md")).unwrap();
    assert_eq!(text, markdown(&runs, &options.methods));
    assert!(text.contains("| 75-100 %, without KITTI | ") && text.contains("| 30-50 % | "));
    assert!(options.output.join("one-step-against-overlap.svg").exists());
    let again = run(&options, |_, _| ()).unwrap();
    // The same seconds to the last digit: they were read.
    assert_eq!(again, runs);
}

#[test]
fn contenders_are_methods_and_variations_of_one() {
    for name in cfreg_paper::overlap::CONTENDERS {
        contender(name).unwrap();
    }
    let Method::CfSpectral(method) = contender("cf-spectral:normal_tolerance=2").unwrap() else {
        panic!()
    };
    assert_eq!(method.compatibility.normal_tolerance, 2.0);
    assert_eq!(method.compatibility.min_length, 2.0);
    for bad in ["", "icp", "cf-spectral:", "cf-spectral:connections", "cf-spectral:beta=auto"] {
        assert!(matches!(contender(bad), Err(Error::Config { field: "methods", .. })), "{bad}");
    }
    assert!(matches!(contender("cf-spectral:sigma=1"), Err(Error::Setting { .. })));
}
