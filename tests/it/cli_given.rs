//! Descriptors and correspondences from other programs, on the command line.

use std::path::Path;
use std::process::{Command, Output};

use cfreg::cloud::shape::boulder;
use cfreg::descriptor::Fpfh;
use cfreg::method::FeatureConfig;
use cfreg::normals::Orientation;
use cfreg::{Transform, io};
use serde_json::Value;
use tempfile::TempDir;

use crate::common::files::npy;

fn cfreg(folder: &Path, line: &str) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_cfreg"));
    command.current_dir(folder).args(line.split_whitespace()).output().unwrap()
}

/// The object that is printed, and the rotation error in degrees.
fn registered(folder: &Path, line: &str) -> (Value, f64) {
    let output = cfreg(folder, &format!("register source.ply target.ply --json {line}"));
    let said = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(0), "{said}");
    let answer: Value = serde_json::from_slice(&output.stdout).unwrap();
    let pose: Transform = serde_json::from_value(answer["transform"].clone()).unwrap();
    (answer, pose.after(&truth().inverse()).angle().to_degrees())
}

/// Asserts that this command line is refused, in these words.
fn assert_refused(folder: &Path, line: &str, words: &str) {
    let output = cfreg(folder, &format!("register source.ply target.ply {line}"));
    assert_eq!(output.status.code(), Some(2), "{line}");
    let said = String::from_utf8(output.stderr).unwrap();
    assert!(said.contains(words), "{line}: {said}");
}

fn truth() -> Transform {
    let turn = Transform::from_rotation_vector([0.4, -1.0, 0.8]);
    Transform { translation: [2.0, -1.0, 0.5], ..turn }
}

/// Two clouds of one surface, `source.ply` and `target.ply`, each point of which has the number of
/// its counterpart, with FPFH as `a.npy` and `b.npy`.
fn pair() -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    let source = boulder().sample(1500, 1).unwrap();
    let target = source.transformed(&truth()).unwrap();
    let features = FeatureConfig { orientation: Orientation::Outward, ..FeatureConfig::default() };
    for (cloud, name, array) in [(source, "source.ply", "a.npy"), (target, "target.ply", "b.npy")] {
        io::write(folder.path().join(name), &cloud).unwrap();
        let cloud = features.attach(&cloud, &Fpfh::default()).unwrap();
        let values = cloud.descriptors().unwrap().as_slice();
        let bytes: Vec<u8> = values.iter().flat_map(|x| x.to_le_bytes()).collect();
        npy(folder.path(), array, "<f4", "(1500, 33)", &bytes);
    }
    folder
}

#[test]
fn descriptors_are_read_used_and_recorded() {
    let folder = pair();
    for (line, role) in [
        ("", "replace:euclidean"),
        ("--given-descriptors beside:cosine", "beside:cosine"),
        (
            "--method teaser --given-descriptors replace:cosine --orientation outward",
            "replace:cosine",
        ),
    ] {
        let (answer, off) = registered(folder.path(), &format!("--descriptors a.npy,b.npy {line}"));
        assert!(off < 1.0, "{line}: {off} degrees");
        assert_eq!(answer["config"]["given_descriptors"], role);
        assert_eq!(answer["descriptors"], serde_json::json!(["a.npy", "b.npy"]));
    }
    npy(folder.path(), "short.npy", "<f4", "(2, 33)", &[0; 264]);
    npy(folder.path(), "wide.npy", "<f4", "(1500, 600)", &[1; 3_600_000]);
    for (line, words) in [
        ("--descriptors a.npy", "two are needed"),
        ("--descriptors a.npy,absent.npy", "absent.npy"),
        ("--descriptors a.npy,short.npy", "expected 1500, found 2"),
        ("--descriptors a.npy,wide.npy", "at most 512"),
        ("--descriptors a.npy,source.ply", "NPY: the header"),
        ("--descriptors a.npy,b.npy --given-descriptors both", "must be one of"),
        ("--descriptors a.npy,b.npy --method icp", "no such setting"),
        ("--given-descriptors beside", "--descriptors"),
    ] {
        assert_refused(folder.path(), line, words);
    }
}

#[test]
fn correspondences_are_read_used_and_recorded() {
    let folder = pair();
    let right = (0..60).map(|i: i32| [i, i]);
    let wrong = (0..200).map(|i: i32| [i * 7 % 1500, i * 13 % 1500]);
    let pairs: Vec<[i32; 2]> = wrong.chain(right).collect();
    let bytes: Vec<u8> = pairs.as_flattened().iter().flat_map(|x| x.to_le_bytes()).collect();
    npy(folder.path(), "matches.npy", "<i4", "(260, 2)", &bytes);
    let scored = pairs.iter().flat_map(|&[i, j]| [i as f32, j as f32, 0.5]);
    let bytes: Vec<u8> = scored.flat_map(f32::to_le_bytes).collect();
    npy(folder.path(), "scored.npy", "<f4", "(260, 3)", &bytes);
    npy(folder.path(), "scores.npy", "|u1", "(260,)", &[1; 260]);
    let mut found = Vec::new();
    for line in [
        "--matches matches.npy",
        "--matches matches.npy --scores scores.npy",
        "--matches scored.npy --refine gicp",
        "--matches matches.npy --method teaser --report page.html",
    ] {
        let (answer, off) = registered(folder.path(), line);
        assert!(off < 1.0, "{line}: {off} degrees");
        assert_eq!(answer["verdict"]["decision"], "accept", "{line}");
        let first = match answer["refined_from"].is_object() {
            true => &answer["refined_from"]["config"],
            false => &answer["config"],
        };
        assert_eq!(first["given_correspondences"], 260, "{line}");
        found.push(answer["transform"].clone());
    }
    assert_eq!(found[0], found[1]);
    for (line, words) in [
        ("--matches scored.npy --scores scores.npy", "third column"),
        ("--matches scored.npy --method teaser", "takes no scores"),
        ("--matches a.npy", "rows of 33 numbers"),
        ("--matches matches.npy --method cf", "takes no correspondences"),
        ("--matches matches.npy --sample 100", "numbers the points of the files"),
        ("--matches matches.npy --method teaser --voxel 0.1", "numbers the points"),
        ("--scores scores.npy", "--matches"),
    ] {
        assert_refused(folder.path(), line, words);
    }
}
