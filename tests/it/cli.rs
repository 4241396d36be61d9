//! The command line as a process: outputs, exit codes, messages.

use std::path::Path;
use std::process::{Command, Output};

use cfreg::descriptor::Fpfh;
use cfreg::io;
use cfreg::method::FeatureConfig;
use serde_json::Value;
use tempfile::TempDir;

use crate::common::files::npy;

fn cfreg(folder: &Path, line: &str) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_cfreg"));
    command.current_dir(folder).args(line.split_whitespace()).output().unwrap()
}

fn code(output: &Output) -> i32 {
    output.status.code().unwrap()
}

fn stderr(output: &Output) -> String {
    String::from_utf8(output.stderr.clone()).unwrap()
}

/// A folder with the demo's clouds in `pair`.
fn demo() -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    let output = cfreg(folder.path(), "demo --write pair");
    assert_eq!(code(&output), 0, "{}", stderr(&output));
    folder
}

const PAIR: &str = "register pair/source.pcd pair/target.pcd";

#[test]
fn json_is_one_object_with_the_documented_fields() {
    let folder = demo();
    let output = cfreg(
        folder.path(),
        &format!("{PAIR} --method cf --verdict=off --json --voxel 0.02 --sample 1800 --seed 4"),
    );
    assert_eq!(code(&output), 0, "{}", stderr(&output));
    let answer: Value = serde_json::from_slice(&output.stdout).unwrap();
    let rows = answer["transform"].as_array().unwrap();
    assert!(rows.len() == 4 && rows.iter().all(|row| row.as_array().unwrap().len() == 4));
    for field in [
        "method",
        "trusted",
        "doubts",
        "evaluation",
        "weighted_rms",
        "connections",
        "effective_connections",
        "singular_values",
        "moments",
        "points",
        "time_s",
        "config",
        "source",
        "target",
        "thinning",
    ] {
        assert!(answer.get(field).is_some(), "{field} is missing");
    }
    assert_eq!(answer["method"], "cf");
    assert_eq!(answer["config"]["beta"], 100.0);
    assert_eq!(answer["config"]["weights"], "gaussian");
    assert_eq!(answer["points"]["source"]["used"], 1800);
    assert!(answer["time_s"]["moments"].as_f64().unwrap() > 0.0);
    assert!(answer["time_s"]["total"].as_f64().unwrap() > 0.0);
}

#[test]
fn the_program_tells_of_itself() {
    let folder = tempfile::tempdir().unwrap();
    let output = cfreg(folder.path(), "doctor");
    let said = String::from_utf8(output.stdout).unwrap();
    assert!(said.starts_with(&format!("cfreg:               {}\n", env!("CARGO_PKG_VERSION"))));
    for name in ["verdict model:", "built for:", "vector instructions:", "processors:", "memory:"] {
        let line = said.lines().find(|line| line.starts_with(name)).unwrap();
        assert!(line.len() > 21, "{line}");
    }
    for shell in ["bash", "zsh", "fish", "powershell", "elvish"] {
        let script = cfreg(folder.path(), &format!("completions {shell}")).stdout;
        assert!(String::from_utf8(script).unwrap().contains("write-aligned"), "{shell}");
    }
    assert_eq!(code(&cfreg(folder.path(), "completions dos")), 2);
    assert_eq!(code(&cfreg(folder.path(), "man pages")), 0);
    let page = std::fs::read_to_string(folder.path().join("pages/cfreg-register.1")).unwrap();
    assert!(page.contains("refine") && page.contains(".SH OPTIONS"), "{page}");
    std::fs::write(folder.path().join("file"), "").unwrap();
    let refused = cfreg(folder.path(), "man file");
    assert!(code(&refused) == 2 && stderr(&refused).contains("file"), "{}", stderr(&refused));
}

#[test]
fn the_default_says_whether_to_take_its_answer() {
    let folder = demo();
    let output = cfreg(folder.path(), &format!("{PAIR} --json"));
    assert_eq!(code(&output), 0, "{}", stderr(&output));
    let answer: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(answer["method"], "consensus");
    let verdict = &answer["verdict"];
    assert_eq!(verdict["decision"], "accept");
    assert!(verdict["probability"].as_f64().unwrap() > 0.9 && verdict["overlap"].is_number());
    assert!(verdict["reasons"].as_array().unwrap().len() > 2);
    assert!(verdict.get("runner_up").is_some());
    let said = stderr(&cfreg(folder.path(), PAIR));
    assert!(said.contains("accept: right with probability"), "{said}");
    // The one length, and a setting of another method.
    let output = cfreg(folder.path(), &format!("{PAIR} --json --voxel 0.1"));
    let answer: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(answer["config"]["voxel"], 0.1);
    assert_eq!(answer["points"]["source"]["used"], 2000);
    let said = stderr(&cfreg(folder.path(), &format!("{PAIR} --beta 3")));
    assert!(said.contains("consensus has no such setting"), "{said}");
}

#[test]
fn a_benchmark_counts_right_poses() {
    let folder = demo();
    let truth = cfreg::io::read_transform(folder.path().join("pair/truth.txt")).unwrap().matrix();
    let numbers: Vec<String> = truth.as_flattened().iter().map(f64::to_string).collect();
    let titles: Vec<String> = (0..16).map(|k| format!("t{}{}", k / 4, k % 4)).collect();
    let list = format!(
        "dataset,source,target,{},overlap\ndemo,pair/source.pcd,pair/target.pcd,{},1\n",
        titles.join(","),
        numbers.join(",")
    );
    std::fs::write(folder.path().join("list.csv"), &list).unwrap();
    // Poses of another pair.
    let others = list.replace("pair/source.pcd,", "source.pcd,");
    std::fs::write(folder.path().join("others.csv"), others).unwrap();
    let line =
        "benchmark list.csv --method consensus --method cf+icp --rule relative --output rows.csv";
    let output = cfreg(folder.path(), line);
    assert_eq!(code(&output), 0, "{}", stderr(&output));
    let table = String::from_utf8(output.stdout).unwrap();
    for method in ["consensus", "cf+icp"] {
        assert!(table.contains(&format!("| demo | {method} | 1/1 = 100.0 % |")), "{table}");
    }
    assert_eq!(std::fs::read_to_string(folder.path().join("rows.csv")).unwrap().lines().count(), 4);
    // What the verdicts told, from the rows that are there.
    let drawn = format!("{} --figure told", line.replace(" --method cf+icp", ""));
    let output = cfreg(folder.path(), &drawn);
    assert_eq!(code(&output), 0, "{}", stderr(&output));
    let picture = std::fs::read_to_string(folder.path().join("told.svg")).unwrap();
    assert!(picture.contains("consensus") && folder.path().join("told.png").is_file());
    let line = "benchmark list.csv --rule relative --candidates judged.csv";
    let output = cfreg(folder.path(), line);
    assert_eq!(code(&output), 0, "{}", stderr(&output));
    let judged = std::fs::read_to_string(folder.path().join("judged.csv")).unwrap();
    let answers: Vec<&str> = judged.lines().filter(|row| row.ends_with(",true")).collect();
    assert!(judged.starts_with("dataset,source,target,overlap,surface_conflict,residual_std,"));
    // One answer, right and last, after the candidates that it was chosen from.
    assert!(judged.lines().count() > 2 && judged.trim_end().ends_with("true,true"), "{judged}");
    assert_eq!(answers.len(), 1, "{judged}");
    for (line, cause) in [
        ("benchmark list.csv --candidates list.csv", "overwrite"),
        ("benchmark none.csv", "none.csv"),
        ("benchmark list.csv --method icq", "icq"),
        ("benchmark list.csv --method icp --figure told", "no method told a probability"),
        ("benchmark list.csv --figure elsewhere/told", "does not exist"),
        ("benchmark list.csv --rule near", "outdoor-coarse"),
        ("benchmark list.csv --poses others.csv", "others.csv, line 2: no listed pair"),
        ("benchmark list.csv --output list.csv", "overwrite"),
        ("benchmark list.csv --folder elsewhere", "elsewhere"),
        ("benchmark list.csv --output rows.csv --seed 5", "other settings"),
    ] {
        let output = cfreg(folder.path(), line);
        assert_eq!(code(&output), 2, "{line}: {}", stderr(&output));
        assert!(stderr(&output).contains(cause), "{line}: {}", stderr(&output));
    }
}

#[test]
fn the_pose_is_written_read_and_judged() {
    let folder = demo();
    let output = cfreg(folder.path(), &format!("{PAIR} --output pose.txt --write-aligned out.ply"));
    assert_eq!(code(&output), 0);
    let printed = String::from_utf8(output.stdout).unwrap();
    assert_eq!(printed.lines().count(), 4);
    let judge = "evaluate pair/source.pcd pair/target.pcd --transform pose.txt --truth pair/truth.txt --json";
    let judged: Value = serde_json::from_slice(&cfreg(folder.path(), judge).stdout).unwrap();
    assert!(judged["truth"]["rotation_deg"].as_f64().unwrap() < 10.0);
    assert!(judged["fitness"].as_f64().unwrap() > 0.5);
    // The aligned cloud needs no further motion: the identity has the same fitness.
    std::fs::write(folder.path().join("one.txt"), "1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n").unwrap();
    let distance = judged["max_distance"].as_f64().unwrap();
    let judge = format!(
        "evaluate out.ply pair/target.pcd --transform one.txt --json --max-distance {distance}"
    );
    let again: Value = serde_json::from_slice(&cfreg(folder.path(), &judge).stdout).unwrap();
    let difference = again["fitness"].as_f64().unwrap() - judged["fitness"].as_f64().unwrap();
    assert!(difference.abs() < 0.01, "{difference}");
}

#[test]
fn a_verdict_is_told_of_any_pose_and_method() {
    let folder = demo();
    let evaluate = "evaluate pair/source.pcd pair/target.pcd --verdict --transform";
    let right = cfreg(folder.path(), &format!("{evaluate} pair/truth.txt"));
    let told = String::from_utf8(right.stdout.clone()).unwrap();
    assert!(code(&right) == 0 && told.contains("accept: right with probability"), "{told}");
    std::fs::write(folder.path().join("one.txt"), "1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n").unwrap();
    let wrong = cfreg(folder.path(), &format!("{evaluate} one.txt --json"));
    let told: Value = serde_json::from_slice(&wrong.stdout).unwrap();
    assert_eq!((code(&wrong), &told["verdict"]["decision"]), (1, &"reject".into()));
    assert!(told["verdict"]["runner_up"]["probability"].as_f64().unwrap() > 0.9);
    let plain =
        cfreg(folder.path(), &format!("{evaluate} one.txt --json").replace("--verdict", ""));
    let plain: Value = serde_json::from_slice(&plain.stdout).unwrap();
    assert!(plain.get("verdict").is_none() && plain["fitness"] == told["fitness"]);
    // Of a method that has none of its own.
    for (line, decision) in [("--verdict=off", Value::Null), ("", "accept".into())] {
        let found = cfreg(folder.path(), &format!("{PAIR} --method cf-multiscale --json {line}"));
        let found: Value = serde_json::from_slice(&found.stdout).unwrap();
        assert_eq!(found["verdict"].get("decision").unwrap_or(&Value::Null), &decision);
        assert_eq!(found["time_s"].get("verdict").is_some(), line.is_empty());
    }
}

#[test]
fn viewpoints_are_the_files_the_zero_or_unknown() {
    let folder = demo();
    // A format that keeps none, and one that does.
    assert_eq!(code(&cfreg(folder.path(), "convert pair/source.pcd source.ply")), 0);
    let oriented_by = |viewpoints: &str| {
        let line = format!("register source.ply pair/target.pcd --method cf --json {viewpoints}");
        let output = cfreg(folder.path(), &line);
        assert!(code(&output) < 2, "{viewpoints}: {}", stderr(&output));
        let answer: Value = serde_json::from_slice(&output.stdout).unwrap();
        let by = |side: &str| answer["points"][side]["oriented_by"].as_str().unwrap().to_string();
        [by("source"), by("target"), answer["viewpoints"].as_str().unwrap().to_string()]
    };
    assert_eq!(oriented_by(""), ["frame-origin", "cloud-viewpoint", "file"]);
    let origin = oriented_by("--viewpoints origin");
    assert_eq!(origin, ["cloud-viewpoint", "cloud-viewpoint", "origin"]);
    assert_eq!(oriented_by("--viewpoints none"), ["frame-origin", "frame-origin", "none"]);
    let refused = cfreg(folder.path(), &format!("{PAIR} --viewpoints sensor"));
    assert!(code(&refused) == 2 && stderr(&refused).contains("file, origin, none"));
}

#[test]
fn settings_reach_the_method() {
    let folder = demo();
    let settings = "--neighbors 80 --normal-neighbors 30 --orientation outward --histogram open3d \
        --weights student-t:3 --normalize sinkhorn:2 --solver walker --scale symmetric --threads 1";
    let output = cfreg(folder.path(), &format!("{PAIR} --method cf --json {settings}"));
    let answer: Value = serde_json::from_slice(&output.stdout).unwrap();
    let config = &answer["config"];
    assert_eq!(config["neighborhood"]["nearest"], 80);
    assert_eq!(config["normal_neighborhood"]["nearest"], 30);
    assert_eq!(config["orientation"], "outward");
    assert_eq!(config["histogram"], "open3d");
    assert_eq!(config["beta"], 400.0);
    assert_eq!(config["weights"], "student-t:3");
    assert_eq!(config["normalization"], "sinkhorn:2");
    assert_eq!(config["solver"], "walker");
    assert_eq!(config["scale"], "symmetric");
    assert_eq!(config["threads"], 1);
}

#[test]
fn help_states_the_defaults_of_the_library() {
    let output = cfreg(Path::new("."), "register --help");
    let help = String::from_utf8(output.stdout).unwrap();
    let help = help.split_whitespace().collect::<Vec<_>>().join(" ");
    let cf = cfreg::method::Cf::default();
    let cfreg::search::Neighborhood::Nearest(k) = cf.features.neighborhood else { panic!() };
    let beta = cf.features.histogram.default_beta();
    for default in [
        format!("[default: {k}]"),
        format!("[default: {} with", beta),
        format!("[default: {}]", cf.weights),
        format!("[default: {}]", cf.normalization),
        format!("[default: {}]", cf.solver),
        format!("[default: {}]", cf.scale),
        format!("[default: {}]", cf.features.histogram),
    ] {
        assert!(help.contains(&default), "{default} is not in the help:\n{help}");
    }
    for name in
        cfreg::weight::WeightScheme::NAMES.into_iter().chain(cfreg::weight::Normalization::NAMES)
    {
        assert!(help.contains(name), "{name}");
    }
}

#[test]
fn an_answer_not_to_be_trusted_is_written_and_exits_with_1() {
    let folder = demo();
    // Two halves of the shape that share nothing.
    let whole = cfreg::io::read(folder.path().join("pair/source.pcd")).unwrap();
    for (name, sign) in [("left.ply", -1.0), ("right.ply", 1.0)] {
        let side: Vec<usize> =
            (0..whole.len()).filter(|&i| sign * whole.position(i)[0] > 0.05).collect();
        cfreg::io::write(folder.path().join(name), &whole.select(&side)).unwrap();
    }
    let output = cfreg(folder.path(), "register left.ply right.ply --output pose.txt");
    assert_eq!(code(&output), 1);
    assert!(stderr(&output).contains("cfreg: warning: "));
    assert!(folder.path().join("pose.txt").exists() && !output.stdout.is_empty());
}

#[test]
fn no_answer_exits_with_2_and_names_the_cause() {
    let folder = demo();
    let file = |name: &str, text: &str| std::fs::write(folder.path().join(name), text).unwrap();
    file("empty.ply", "");
    file("two.xyz", "0 0 0\n1 1 1\n");
    file("word.xyz", "0 0 0\n1 one 1\n");
    file(
        "huge.ply",
        "ply\nformat binary_little_endian 1.0\nelement vertex 1000000000000\nproperty float x\nproperty float y\nproperty float z\nend_header\n",
    );
    for (line, cause) in [
        ("register nosuch.ply pair/target.pcd", "nosuch.ply"),
        ("register empty.ply pair/target.pcd", "empty.ply"),
        ("register pair pair/target.pcd", "directory"),
        ("register two.xyz pair/target.pcd", "2 usable points"),
        ("register word.xyz pair/target.pcd", "line 2"),
        ("register huge.ply pair/target.pcd", "1000000000000"),
        ("register pair/source.pcd pair/target.pcd --method cf --beta -1", "beta"),
        ("register pair/source.pcd pair/target.pcd --method cf --neighbors 1", "neighbors"),
        ("register pair/source.pcd pair/target.pcd --method cf --radius 1e-9", "larger"),
        ("register pair/source.pcd pair/target.pcd --method cf --weights gauss", "gaussian"),
        ("register pair/source.pcd pair/target.pcd --method cf --weights uniform", "rank"),
        ("register pair/source.pcd pair/target.pcd --threads 1000000", "at most 1024"),
        ("register pair/source.pcd pair/target.pcd --voxel 0", "voxel"),
        ("register pair/source.pcd pair/target.pcd --sample 0", "sample"),
        ("register pair/source.pcd pair/target.pcd --method icq", "icq"),
        ("register pair/source.pcd pair/target.pcd --method cf --orientation up", "up"),
        ("register pair/source.pcd pair/target.pcd --write-aligned out.stl", "out.stl"),
        ("evaluate pair/source.pcd pair/target.pcd --transform two.xyz", "two.xyz"),
        ("convert pair/source.pcd out.stl", "out.stl"),
        ("info empty.ply", "is empty"),
    ] {
        let output = cfreg(folder.path(), line);
        assert_eq!(code(&output), 2, "{line}: {}", stderr(&output));
        assert!(stderr(&output).contains(cause), "{line}: {}", stderr(&output));
        assert!(output.stdout.is_empty(), "{line} wrote to stdout");
    }
}

#[test]
fn clouds_are_converted_and_described() {
    let folder = demo();
    for target in ["a.pcd", "b.xyz", "c.csv", "d.ply"] {
        let output = cfreg(folder.path(), &format!("convert pair/source.pcd {target}"));
        assert_eq!(code(&output), 0, "{}", stderr(&output));
    }
    let output = cfreg(folder.path(), "info a.pcd b.xyz c.csv d.ply --json");
    let facts: Value = serde_json::from_slice(&output.stdout).unwrap();
    for file in facts.as_array().unwrap() {
        assert_eq!(file["points"], 2000, "{file}");
        assert_eq!(file["diagonal"], facts[0]["diagonal"]);
    }
}

/// Writes descriptors and correspondences of the demo's clouds, as other programs would.
fn write_given(folder: &Path) {
    let read = |name: &str| io::read(folder.join("pair").join(name)).unwrap();
    let clouds = [read("source.pcd"), read("target.pcd")];
    for (cloud, name) in clouds.iter().zip(["source.npy", "target.npy"]) {
        let cloud = FeatureConfig::default().attach(cloud, &Fpfh::default()).unwrap();
        let values = cloud.descriptors().unwrap().as_slice();
        let bytes: Vec<u8> = values.iter().flat_map(|x| x.to_le_bytes()).collect();
        npy(folder, name, "<f4", "(2000, 33)", &bytes);
    }
    let truth = io::read_transform(folder.join("pair/truth.txt")).unwrap();
    let nearest = |i: usize| {
        let moved = truth.apply(clouds[0].position(i));
        let square = |j: usize| -> f64 {
            let at = clouds[1].position(j);
            (0..3).map(|axis| (at[axis] - moved[axis]).powi(2)).sum()
        };
        (0..clouds[1].len()).min_by(|&a, &b| square(a).total_cmp(&square(b))).unwrap()
    };
    let rows: Vec<[i32; 2]> = (0..200).map(|k| [10 * k, nearest(10 * k as usize) as i32]).collect();
    let bytes: Vec<u8> = rows.as_flattened().iter().flat_map(|x| x.to_le_bytes()).collect();
    npy(folder, "matches.npy", "<i4", "(200, 2)", &bytes);
    npy(folder, "scores.npy", "|u1", "(200,)", &[1; 200]);
}

#[test]
fn commands_of_the_readme_and_the_manual_run() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let read = |page: &Path| std::fs::read_to_string(page).unwrap();
    let entries = std::fs::read_dir(root.join("docs")).unwrap().map(|entry| entry.unwrap().path());
    let mut pages: Vec<_> =
        entries.filter(|path| path.extension().is_some_and(|e| e == "md")).collect();
    pages.push(root.join("README.md"));
    // By a line of the page on bulk, for shells.
    let pairs = "source,target\npair/source.pcd,pair/target.pcd\npair/target.pcd,pair/source.pcd\n";
    let printed = format!("printf '{}' > pairs.csv", pairs.escape_default());
    assert!(read(&root.join("docs/bulk.md")).contains(&printed));
    let mut commands = 0;
    for page in pages {
        let folder = demo();
        std::fs::write(folder.path().join("pairs.csv"), pairs).unwrap();
        write_given(folder.path());
        for line in read(&page).lines().filter_map(|line| line.strip_prefix("cfreg ")) {
            let line = line.split(" #").next().unwrap();
            let (line, file) =
                line.split_once(" > ").map_or((line, None), |(l, file)| (l, Some(file.trim())));
            let output = cfreg(folder.path(), line);
            assert_eq!(code(&output), 0, "{}: {line}: {}", page.display(), stderr(&output));
            if let Some(file) = file {
                std::fs::write(folder.path().join(file), &output.stdout).unwrap();
            }
            commands += 1;
        }
    }
    assert!(commands > 25, "the commands of the pages were not found");
}

#[test]
fn outputs_never_cost_an_input_or_the_answer() {
    let folder = demo();
    let before = std::fs::read(folder.path().join("pair/source.pcd")).unwrap();
    for outputs in [
        "--output pair/source.pcd",
        "--output pair/../pair/target.pcd",
        "--output a.txt --write-aligned ./a.txt",
        "--output nowhere/a.txt",
        "--write-aligned nowhere/a.ply",
        "--output pair",
    ] {
        let command = format!("register pair/source.pcd pair/target.pcd {outputs}");
        let output = cfreg(folder.path(), &command);
        assert_eq!(code(&output), 2, "{outputs}: {}", stderr(&output));
        assert!(output.stdout.is_empty(), "{outputs}");
    }
    assert_eq!(std::fs::read(folder.path().join("pair/source.pcd")).unwrap(), before);
    let output = cfreg(folder.path(), "convert pair/target.pcd s.ply");
    assert!(stderr(&output).contains("--orientation"), "{}", stderr(&output));
}

#[test]
fn the_printed_matrix_keeps_every_digit() {
    let folder = demo();
    let output = cfreg(folder.path(), "register pair/source.pcd pair/target.pcd --output T.txt");
    std::fs::write(folder.path().join("printed.txt"), &output.stdout).unwrap();
    let read = |name: &str| cfreg::io::read_transform(folder.path().join(name)).unwrap();
    assert_eq!(read("printed.txt"), read("T.txt"));
}

#[test]
fn counts_beyond_reason_are_refused() {
    let folder = demo();
    for command in [
        "demo --points 10000000000000000000",
        "demo --points -3",
        "register pair/source.pcd pair/target.pcd --method cf --normalize sinkhorn:1000000000",
        "register pair/source.pcd pair/target.pcd --sample -3",
    ] {
        let output = cfreg(folder.path(), command);
        assert_eq!(code(&output), 2, "{command}: {}", stderr(&output));
        assert!(!stderr(&output).contains("panicked") && !stderr(&output).contains("tip:"));
    }
}

#[cfg(target_os = "linux")]
#[test]
fn a_full_standard_error_does_not_cost_the_answer() {
    let folder = demo();
    let full = std::fs::OpenOptions::new().write(true).open("/dev/full").unwrap();
    let output = std::process::Command::new(env!("CARGO_BIN_EXE_cfreg"))
        .args(["register", "pair/source.pcd", "pair/target.pcd"])
        .current_dir(folder.path())
        .stderr(full)
        .output()
        .unwrap();
    assert_eq!(code(&output), 0);
    assert!(!output.stdout.is_empty());
}
