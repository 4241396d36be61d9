//! Lists of pairs as they arise, and the graph that their poses make.

use std::fs;
use std::path::Path;
use std::process::{Command, Output};

use cfreg::batch::{RowGraph, results};
use cfreg::cloud::shape::boulder;
use cfreg::pose_graph::Tangent;
use cfreg::{Transform, io};
use tempfile::TempDir;

/// A folder `scans` with eleven scans of a boulder, each turned a little more.
fn folder() -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    fs::create_dir(folder.path().join("scans")).unwrap();
    for number in 0..11 {
        let pose = pose(number);
        let cloud = boulder().sample(500, number).unwrap().transformed(&pose.inverse()).unwrap();
        io::write(folder.path().join(format!("scans/{number}.ply")), &cloud).unwrap();
    }
    folder
}

/// Of a scan in the frame of the boulder.
fn pose(number: u64) -> Transform {
    let turn = Transform::from_rotation_vector([0.1 * number as f64, 0.2, 0.0]);
    Transform { translation: [number as f64, 0.0, 1.0], ..turn }
}

fn cfreg(folder: &Path, line: &str) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_cfreg"));
    command.current_dir(folder).args(line.split_whitespace()).output().unwrap()
}

fn said(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

fn done(folder: &Path, line: &str) -> String {
    let output = cfreg(folder, line);
    assert!(output.status.success(), "{line}: {}", said(&output));
    said(&output)
}

fn refused(folder: &Path, line: &str, words: &str) {
    let output = cfreg(folder, line);
    let said = said(&output);
    assert!(output.status.code() == Some(2) && said.contains(words), "{line}: {said}");
}

/// The lines of a list without its columns.
fn list(folder: &Path, name: &str) -> Vec<String> {
    let text = fs::read_to_string(folder.join(name)).unwrap();
    let mut lines = text.lines().map(String::from);
    assert_eq!(lines.next().unwrap(), "source,target");
    lines.collect()
}

#[test]
fn scans_are_paired_with_those_before_a_map_and_those_near() {
    let folder = folder();
    let path = folder.path();
    done(path, "pairs sequence scans -o all.csv");
    let pairs = list(path, "all.csv");
    assert_eq!((pairs.len(), &*pairs[0]), (10, "scans/1.ply,scans/0.ply"));
    assert_eq!(pairs[9], "scans/10.ply,scans/9.ply");
    done(path, "pairs sequence scans/3.ply scans/1.ply scans/2.ply --steps 1,2 -o scans/some.csv");
    assert_eq!(list(path, "scans/some.csv"), ["1.ply,3.ply", "2.ply,1.ply", "2.ply,3.ply"]);
    done(path, "pairs map scans/0.ply scans/4.ply scans/5.ply -o map.csv");
    assert_eq!(list(path, "map.csv"), ["scans/4.ply,scans/0.ply", "scans/5.ply,scans/0.ply"]);
    let rough = "cloud,x,y,z,yaw\n4.ply,0,0,0,1\n6.ply,3,0,0,1\n8.ply,0,4,0,1\n";
    fs::write(path.join("scans/rough.csv"), rough).unwrap();
    done(path, "pairs near scans/rough.csv --radius 4.5 -o near.csv");
    assert_eq!(list(path, "near.csv"), ["scans/6.ply,scans/4.ply", "scans/8.ply,scans/4.ply"]);
    // From another folder the files are the same.
    fs::create_dir(path.join("lists")).unwrap();
    done(path, "pairs near scans/rough.csv --radius 3 -o lists/near.csv");
    let pair = &list(path, "lists/near.csv")[0];
    assert!(pair.split(',').all(|file| Path::new(file).is_file()), "{pair}");
}

#[test]
fn lists_that_cannot_be_made_are_refused() {
    let folder = folder();
    let path = folder.path();
    fs::write(path.join("rough.csv"), "cloud,x,y,z\nabsent.ply,0,0,0\n").unwrap();
    refused(path, "pairs sequence scans --steps 0 -o list.csv", "steps");
    refused(path, "pairs sequence absent.ply scans/1.ply -o list.csv", "absent.ply");
    refused(path, "pairs near rough.csv --radius 1 -o list.csv", "absent.ply");
    refused(path, "pairs near rough.csv --radius -1 -o list.csv", "radius");
    refused(path, "pairs near rough.csv --radius 1 -o rough.csv", "overwrite an input");
    refused(path, "pairs map scans/0.ply . -o list.csv", "no cloud in this folder");
    assert!(!path.join("list.csv").exists());
}

#[test]
fn accepted_poses_make_a_graph_whatever_the_results_are_kept_in() {
    let folder = folder();
    let path = folder.path();
    done(path, "pairs sequence scans --steps 1,3 -o pairs.csv");
    for end in ["csv", "jsonl", "parquet"] {
        done(path, &format!("batch pairs.csv -o rows.{end}"));
        let words = done(path, &format!("graph rows.{end} -o {end}.g2o --names names.csv"));
        assert!(words.contains("11 clouds in 1 parts, "), "{words}");
    }
    let read = |name: &str| fs::read_to_string(path.join(name)).unwrap();
    let graph = read("csv.g2o");
    assert!(graph == read("jsonl.g2o") && graph == read("parquet.g2o"));
    assert!(read("names.csv").starts_with("vertex,cloud\n0,scans/0.ply\n1,scans/1.ply\n"));
    let rows = results::read(&path.join("rows.parquet")).unwrap();
    let accepted = rows.iter().filter(|row| row.decision.as_deref() == Some("accept")).count();
    assert!(accepted > 12, "{accepted} of {}", rows.len());
    assert_eq!(graph.lines().filter(|line| line.starts_with("EDGE_SE3:QUAT")).count(), accepted);
    // Every scan stands about where it does, seen from the first.
    let first = pose(0).inverse();
    for line in graph.lines().filter(|line| line.starts_with("VERTEX")) {
        let numbers: Vec<f64> = line.split(' ').skip(1).map(|word| word.parse().unwrap()).collect();
        let names = read("names.csv");
        let name = names.lines().nth(numbers[0] as usize + 1).unwrap();
        let number = name.split(['/', '.']).nth(1).unwrap().parse().unwrap();
        let expected = first.after(&pose(number)).translation;
        let off: f64 = (0..3).map(|k| (numbers[k + 1] - expected[k]).powi(2)).sum();
        assert!(off.sqrt() < 0.3, "{line} {expected:?}");
    }
    // A cluster's folder, its parts in no order.
    fs::create_dir(path.join("parts")).unwrap();
    fs::copy(path.join("rows.parquet"), path.join("parts/b.parquet")).unwrap();
    assert_eq!(results::read(&path.join("parts")).unwrap(), rows);
    fs::copy(path.join("rows.parquet"), path.join("parts/a.parquet")).unwrap();
    refused(path, "graph parts -o twice.g2o", "two rows of pair 0");
    refused(path, "graph pairs.csv -o none.g2o", "line 2: column index");
    let vectors = RowGraph::new(&rows).unwrap().graph.g2o(Tangent::RotationVector);
    assert_ne!(vectors, graph);
    done(path, "graph rows.csv -o vectors.g2o --rotations vector");
    assert_eq!(read("vectors.g2o"), vectors);
}
