//! Small inputs after faults that users of this field's programs reported: each stands for its
//! kind. The files are beside the real scans; where they are not, the tests skip with a line.

use crate::common;

use std::path::{Path, PathBuf};
use std::process::Output;

use cfreg::{io, verify};
use serde_json::Value;
use std::process::Command;

/// The folder of one kind, or `None` after a line that says why.
fn case(name: &str) -> Option<PathBuf> {
    let folder = common::shared_data()?.join("../cases").join(name);
    if folder.is_dir() {
        return Some(folder);
    }
    eprintln!("skipped: no case at {}", folder.display());
    None
}

fn cfreg(folder: &Path, line: &str) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_cfreg"));
    command.current_dir(folder).args(line.split_whitespace()).output().unwrap()
}

fn said(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// The result of `register LINE --json`, how far its pose is from `truth` (degrees, and units at
/// the source's centroid), and what was said.
fn registered(folder: &Path, line: &str, truth: &str) -> (Value, [f64; 2], String) {
    let output = cfreg(folder, &format!("register {line} --json"));
    let answer: Value = serde_json::from_slice(&output.stdout)
        .unwrap_or_else(|error| panic!("{line}: {error}: {}", said(&output)));
    let source = io::read(folder.join(line.split_whitespace().next().unwrap())).unwrap();
    let pose = serde_json::to_vec(&answer["transform"]).unwrap();
    let pose: [[f64; 4]; 4] = serde_json::from_slice(&pose).unwrap();
    let pose = cfreg::Transform::from_matrix(pose).unwrap();
    let truth = io::read_transform(folder.join(truth)).unwrap();
    let off = verify::pose_error(&pose, &truth, source.centroid());
    (answer, [off.rotation_deg, off.translation], said(&output))
}

/// Accepted, trusted, and right to within this many degrees.
fn right(folder: &Path, line: &str, degrees: f64) -> (Value, String) {
    let (answer, off, said) = registered(folder, line, "truth.txt");
    assert!(off[0] < degrees, "{line}: off by {off:?}: {said}");
    assert_eq!(answer["verdict"]["decision"], "accept", "{line}: {said}");
    assert_eq!(answer["trusted"], true, "{line}: {said}");
    (answer, said)
}

#[test]
fn vertices_that_faces_do_not_share_are_places_that_repeat() {
    let Some(folder) = case("mesh-unshared-vertices") else { return };
    right(&folder, "stl_a.ply stl_b.ply", 0.5);
    right(&folder, "shared_a.ply shared_b.ply", 0.5);
}

#[test]
fn zeros_of_a_masked_depth_image_are_left_out_and_told() {
    let Some(folder) = case("masked-organised-zeros") else { return };
    let (answer, said) = right(&folder, "a.ply b.ply", 0.2);
    assert!(said.contains("6000 points at exactly (0, 0, 0) are left out"), "{said}");
    let points = &answer["points"]["source"];
    assert_eq!(points["no_returns"], 6000, "{points}");
}

#[test]
fn coordinates_of_few_decimals_are_places_that_repeat() {
    let Some(folder) = case("few-decimals") else { return };
    right(&folder, "a.xyz b.xyz", 0.6);
}

#[test]
fn zeros_are_no_range_limit() {
    let Some(folder) = case("zeros-called-range-limit") else { return };
    for line in ["register a.ply b.ply --json", "register a.ply b.ply --json --keep-no-returns"] {
        let output = cfreg(&folder, line);
        let text = String::from_utf8_lossy(&output.stdout).into_owned() + &said(&output);
        assert!(!text.contains("sensor's range"), "{line}: {text}");
    }
}

#[test]
fn a_refinement_leaves_out_what_the_search_left_out() {
    let Some(folder) = case("refine-icp-no-returns") else { return };
    // Point to point is drawn along by the rings of the scanner.
    for (refine, most) in [("icp", 0.05), ("plane-icp", 0.02), ("gicp", 0.02)] {
        let line = format!("a.ply b.ply --refine {refine}");
        let (answer, off, said) = registered(&folder, &line, "truth.txt");
        assert!(off[1] < most, "{refine}: off by {off:?}: {said}");
        assert_eq!(answer["verdict"]["decision"], "accept", "{refine}: {said}");
    }
}
