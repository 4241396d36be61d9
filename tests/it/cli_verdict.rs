//! Verdicts of the command line: what they go by, and what is advised against doubts.

use std::path::Path;
use std::process::Output;

use cfreg::cloud::shape::boulder;
use cfreg::{Channels, PointCloud, Transform, io};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde_json::Value;
use std::process::Command;
use tempfile::TempDir;

fn cfreg(folder: &Path, line: &str) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_cfreg"));
    command.current_dir(folder).args(line.split_whitespace()).output().unwrap()
}

fn said(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// Points of a box, painted so that no two places look alike; half turns fit its shape.
fn painted_box(seed: u64) -> PointCloud {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let sides = [3.0, 2.0, 1.0];
    let mut point = || {
        let mut at = sides.map(|side| side * (random.random::<f64>() - 0.5));
        let axis = random.random_range(0..3);
        at[axis] = 0.5 * sides[axis] * f64::from(2 * random.random_range(0..2) - 1);
        at
    };
    let points: Vec<_> = (0..4000).map(|_| point()).collect();
    let paint = |p: &[f64; 3]| (2.0 * p[0] + 0.7).sin() + (1.3 * p[1] - 0.4 * p[2]).cos() * p[2];
    let paint = |p: &[f64; 3]| paint(p) as f32;
    let paint = Channels::default().with("paint", points.iter().map(paint).collect()).unwrap();
    PointCloud::new(&points).unwrap().with_channels(paint).unwrap()
}

fn boxes() -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    let truth = Transform::from_rotation_vector([0.0, 0.0, 0.4]);
    io::write(folder.path().join("a.ply"), &painted_box(1)).unwrap();
    let target = painted_box(2).transformed(&truth).unwrap();
    io::write(folder.path().join("b.ply"), &target).unwrap();
    let half = Transform::from_rotation_vector([0.0, 0.0, std::f64::consts::PI]);
    for (name, pose) in [("truth.txt", truth), ("half.txt", truth.after(&half))] {
        io::write_transform(folder.path().join(name), &pose).unwrap();
    }
    folder
}

#[test]
fn a_verdict_goes_by_channels_and_by_what_is_known() {
    let folder = boxes();
    let judged = |pose: &str, more: &str| {
        let line = format!("evaluate a.ply b.ply --transform {pose} --verdict --json {more}");
        let output = cfreg(folder.path(), &line);
        let answer: Value = serde_json::from_slice(&output.stdout).unwrap();
        let verdict = &answer["verdict"];
        let accepted = verdict["decision"] == "accept";
        assert_eq!(output.status.success(), accepted, "{line}");
        (accepted, verdict["probability"].as_f64().unwrap())
    };
    let (accepted, probability) = judged("half.txt", "");
    assert!(!accepted && probability > 0.05, "{probability}");
    assert!(!judged("truth.txt", "").0);
    assert!(judged("truth.txt", "--channels paint:10").0);
    let (accepted, probability) = judged("half.txt", "--channels paint:10");
    assert!(!accepted && probability < 0.01, "{probability}");
    assert!(judged("truth.txt", "--near truth.txt --within 20").0);
    let refused = |more: &str, words: &str| {
        let output =
            cfreg(folder.path(), &format!("evaluate a.ply b.ply --transform truth.txt {more}"));
        assert_eq!(output.status.code(), Some(2), "{more}");
        assert!(said(&output).contains(words), "{more}: {}", said(&output));
    };
    for option in ["--channels paint", "--near half.txt", "--direction 0,0,1"] {
        refused(option, "requires --verdict");
    }
    refused("--verdict --channels glow", "channels = glow: the source has no such channel");
    refused("--verdict --channels paint:nan", "a share must be a finite number");
    refused("--verdict --direction 0,0", "direction = 0,0: must be");
    refused("--verdict --within 3", "--near");
    let help = cfreg(folder.path(), "register a.ply b.ply --channels paint:nan");
    assert!(said(&help).contains("a share must be a finite number"), "{}", said(&help));
}

#[test]
fn the_voxel_is_the_length_of_a_verdict() {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, seed| {
        io::write(folder.path().join(name), &boulder().sample(6000, seed).unwrap()).unwrap();
    };
    write("a.ply", 1);
    write("b.ply", 2);
    io::write_transform(folder.path().join("t.txt"), &Transform::IDENTITY).unwrap();
    let read = |line: &str| -> Value {
        let output = cfreg(folder.path(), line);
        serde_json::from_slice(&output.stdout)
            .unwrap_or_else(|_| panic!("{line}: {}", said(&output)))
    };
    let judged = read("evaluate a.ply b.ply --transform t.txt --verdict --json --voxel 0.1");
    // As the library has it, of clouds as they are.
    let [source, target] =
        ["a.ply", "b.ply"].map(|name| io::read(folder.path().join(name)).unwrap());
    let judge = cfreg::method::Consensus { voxel: Some(0.1), ..Default::default() };
    let verdict = judge.verify(&source, &target, &Transform::IDENTITY).unwrap();
    assert_eq!(judged["verdict"]["probability"].as_f64().unwrap(), verdict.probability);
    let other = cfreg::method::Consensus::default().verify(&source, &target, &Transform::IDENTITY);
    assert_ne!(other.unwrap().probability, verdict.probability);
    // Fitness is that of thinned clouds, with a verdict and without.
    let plain = read("evaluate a.ply b.ply --transform t.txt --json --voxel 0.1");
    assert_eq!(plain["fitness"], judged["fitness"]);
}

#[test]
fn advice_is_of_use_against_the_doubt() {
    let folder = boxes();
    let output = cfreg(folder.path(), "register a.ply b.ply");
    assert_eq!(output.status.code(), Some(1));
    // More seeds do not break a symmetry.
    assert!(
        said(&output).contains("cfreg: try something that distinguishes the poses: --channels"),
        "{}",
        said(&output)
    );
    assert!(!said(&output).contains("seeds"), "{}", said(&output));
    // Of methods by position: nothing is near.
    let far = painted_box(1)
        .transformed(&Transform { translation: [1e3, 0.0, 0.0], ..Transform::IDENTITY });
    io::write(folder.path().join("far.ply"), &far.unwrap()).unwrap();
    for (line, advice) in [
        ("--method icp --set max_distance=0.1", "or raise max_distance, or start nearer"),
        ("--method kc --set sigma=0.1", "or raise sigma, or start nearer"),
    ] {
        let output = cfreg(folder.path(), &format!("register a.ply far.ply {line}"));
        assert_eq!(output.status.code(), Some(2), "{line}");
        assert!(said(&output).trim_end().ends_with(advice), "{line}: {}", said(&output));
    }
}
