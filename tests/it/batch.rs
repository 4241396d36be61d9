//! Pairs in bulk: every pair has one row, whatever happens on the way.

use std::fs;
use std::path::Path;
use std::process::{Command, Output, Stdio};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Duration;

use cfreg::batch::{Batch, PairList, Row, StartMode, install_panic_hook};
use cfreg::cloud::ViewpointSource;
use cfreg::cloud::shape::boulder;
use cfreg::method::{Consensus, Method, Pipeline, Register, Registration};
use cfreg::{Error, PointCloud, Transform, io, par};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde_json::Value;
use tempfile::TempDir;

const CLOUDS: usize = 5;

/// A folder with a few clouds, one with NaN alone, and a list of pairs of them.
fn folder() -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    for seed in 0..CLOUDS as u64 {
        let turn = Transform::from_rotation_vector([0.1 * seed as f64, 0.2, 0.0]);
        let cloud = boulder().sample(250, seed).unwrap().transformed(&turn).unwrap();
        io::write(folder.path().join(format!("{seed}.ply")), &cloud).unwrap();
    }
    fs::write(folder.path().join("nan.xyz"), "nan nan nan\nnan 0 0\n").unwrap();
    fs::write(folder.path().join("cut.ply"), "ply\nformat ascii 1.0\nelement ver").unwrap();
    let mut list = String::from("id,source,target\n");
    for i in 0..CLOUDS {
        for j in 0..CLOUDS {
            list += &format!("{},{i}.ply,{j}.ply\n", i * j);
        }
    }
    list += "x,0.ply,absent.ply\ny,nan.xyz,1.ply\nz,cut.ply,1.ply\n";
    fs::write(folder.path().join("pairs.csv"), list).unwrap();
    folder
}

/// Pairs in that list.
const PAIRS: usize = CLOUDS * CLOUDS + 3;
const BINARY: &str = env!("CARGO_BIN_EXE_cfreg");
const RUN: &str = "batch pairs.csv --method cf+icp --set neighbors=30 --verdict";

fn command(folder: &Path, line: &str) -> Command {
    let mut command = Command::new(BINARY);
    command.current_dir(folder).args(line.split_whitespace()).stdin(Stdio::null());
    command
}

fn cfreg(folder: &Path, line: &str) -> Output {
    command(folder, line).output().unwrap()
}

fn said(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

fn done(folder: &Path, line: &str) {
    let output = cfreg(folder, line);
    assert!(output.status.success(), "{line}: {}", said(&output));
}

/// That it ends with exit status 2 and says this, without a panic.
fn refused(folder: &Path, line: &str, words: &str) {
    let output = cfreg(folder, line);
    let said = said(&output);
    assert!(output.status.code() == Some(2) && said.contains(words), "{line}: {said}");
    assert!(!said.contains("panicked"), "{said}");
}

#[test]
fn rows_are_in_the_order_of_the_list_and_errors_are_rows() {
    let folder = folder();
    done(folder.path(), &format!("{RUN} -o rows.jsonl --times"));
    assert!(!folder.path().join("rows.jsonl.part").exists());
    let text = fs::read_to_string(folder.path().join("rows.jsonl")).unwrap();
    let rows: Vec<Value> = text.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    assert_eq!(rows.len(), PAIRS);
    for (row, index) in rows.iter().zip(0..) {
        assert_eq!(row["index"], index);
    }
    let [same, absent, nan, cut] = [0, PAIRS - 3, PAIRS - 2, PAIRS - 1].map(|at| &rows[at]);
    assert!(same["error"].is_null() && same["trusted"] == true && same["fitness"] == 1.0, "{same}");
    assert!((same["t00"].as_f64().unwrap() - 1.0).abs() < 1e-6 && same["t33"] == 1.0);
    assert!(same["seconds"].as_f64().unwrap() > 0.0 && same["source_points"] == 250);
    let error = |row: &Value| row["error"].as_str().unwrap().to_string();
    assert!(error(absent).contains("absent.ply") && absent["t00"].is_null());
    assert!(error(cut).contains("cut.ply") && !error(nan).is_empty(), "{nan}");
}

#[test]
fn threads_and_memory_change_nothing() {
    let folder = folder();
    for end in ["csv", "jsonl", "parquet"] {
        let mut all = Vec::new();
        for (threads, memory) in [(1, "1GiB"), (2, "0"), (4, "8kB")] {
            let name = format!("{threads}.{end}");
            done(folder.path(), &format!("{RUN} -o {name} --threads {threads} --memory {memory}"));
            all.push(fs::read(folder.path().join(name)).unwrap());
        }
        assert!(all.iter().all(|bytes| *bytes == all[0]), "{end}");
    }
    // What is written as Parquet is a list, too, with the same pairs.
    done(
        folder.path(),
        "batch 1.parquet --method cf+icp --set neighbors=30 --verdict -o again.csv",
    );
    let read = |name: &str| fs::read_to_string(folder.path().join(name)).unwrap();
    assert!(read("again.csv") == read("1.csv") && read("1.csv").lines().count() == PAIRS + 1);
}

#[test]
fn killed_at_any_moment_it_ends_with_the_same_bytes() {
    let folder = folder();
    let mut random = ChaCha8Rng::seed_from_u64(1);
    let started = std::time::Instant::now();
    done(folder.path(), &format!("{RUN} -o whole.parquet"));
    let longest = started.elapsed().as_secs_f64();
    done(folder.path(), &format!("{RUN} -o whole.csv"));
    let mut kills = 0;
    for end in ["parquet", "csv"].into_iter().cycle().take(6) {
        let file = |name: &str| folder.path().join(name);
        let [part, output] =
            ["rows.END.part", "rows.END"].map(|name| file(&name.replace("END", end)));
        let whole = fs::read(file(&format!("whole.{end}"))).unwrap();
        // Until it is through before it is killed.
        for attempt in 0.. {
            let mut child = command(folder.path(), &format!("{RUN} -o rows.{end} --resume"))
                .stderr(Stdio::null())
                .spawn()
                .unwrap();
            let wait = if attempt < 6 { random.random::<f64>() * longest / 3.0 } else { 600.0 };
            let until = std::time::Instant::now() + Duration::from_secs_f64(wait);
            let ended = loop {
                match child.try_wait().unwrap() {
                    Some(status) => break Some(status),
                    None if std::time::Instant::now() > until => break None,
                    None => std::thread::sleep(Duration::from_millis(1)),
                }
            };
            if let Some(status) = ended {
                assert!(status.success());
                break;
            }
            child.kill().unwrap();
            child.wait().unwrap();
            kills += 1;
            // What a power cut may leave of it.
            if let Ok(bytes) = fs::read(&part)
                && random.random::<bool>()
            {
                let cut = random.random_range(bytes.len() / 2..=bytes.len());
                fs::write(&part, &bytes[..cut]).unwrap();
            }
        }
        assert!(fs::read(&output).unwrap() == whole);
        fs::remove_file(&output).unwrap();
        if end == "csv" {
            let [run, whole] = ["rows.csv.run.json", "whole.csv.run.json"].map(file);
            assert!(fs::read(&run).unwrap() == fs::read(whole).unwrap());
            fs::remove_file(run).unwrap();
        }
        // Nothing else is left.
        let mut left = fs::read_dir(folder.path()).unwrap().map(|file| file.unwrap().file_name());
        assert!(!left.any(|name| name.to_string_lossy().starts_with("rows.")), "{end}");
    }
    assert!(kills > 5, "{kills} kills: too fast for this test");
}

#[test]
fn what_an_earlier_run_left_is_not_lost_by_mistake() {
    let folder = folder();
    let path = folder.path();
    done(path, &format!("{RUN} -o rows.csv"));
    refused(path, &format!("{RUN} -o rows.csv"), "--overwrite");
    let output = cfreg(path, &format!("{RUN} -o rows.csv --resume"));
    assert!(output.status.success() && said(&output).contains("complete"));
    assert!(said(&output).contains("28 pairs: ") && said(&output).contains("3 without a pose"));
    // An output of other settings, of other pairs, or that is cut short.
    for end in ["parquet", "jsonl", "csv"] {
        let again = format!("{RUN} -o rows.{end} --resume");
        done(path, &again);
        done(path, &again);
        refused(path, &format!("{again} --sample 9"), "thinning.sample null");
        refused(path, &format!("{again} --set icp.keep=0.5"), "begun with method.refinements");
    }
    let rows = fs::read_to_string(path.join("rows.csv")).unwrap();
    let head = rows.split_inclusive('\n').take(PAIRS).collect::<String>();
    for other in [rows.replacen("1.ply", "7.ply", 1), head] {
        fs::write(path.join("other.csv"), other).unwrap();
        fs::copy(path.join("rows.csv.run.json"), path.join("other.csv.run.json")).unwrap();
        refused(path, &format!("{RUN} -o other.csv --resume"), "than the list");
    }
    // One of which nothing tells how it was made.
    fs::remove_file(path.join("other.csv.run.json")).unwrap();
    refused(path, &format!("{RUN} -o other.csv --resume"), "which other.csv.run.json should");
    done(path, &format!("{RUN} -o rows.csv --overwrite"));
    // A journal of another method.
    fs::remove_file(path.join("rows.csv")).unwrap();
    let chain: Pipeline = Pipeline::new("cf".parse().unwrap(), Vec::new()).unwrap();
    let list = PairList::read(&path.join("pairs.csv"), Path::new("")).unwrap();
    let mut batch = Batch::new(&chain, &chain);
    batch.interrupt.request();
    let ended = batch.run(&list, &path.join("rows.csv"));
    assert!(matches!(ended, Err(Error::Interrupted)));
    assert!(path.join("rows.csv.part").exists());
    refused(path, &format!("{RUN} -o rows.csv"), "--resume");
    refused(path, &format!("{RUN} -o rows.csv --resume"), "was begun with method");
    batch.start = StartMode::Resume;
    assert!(matches!(batch.run(&list, &path.join("rows.csv")), Err(Error::Interrupted)));
    done(path, &format!("{RUN} -o rows.csv --overwrite"));
}

#[test]
fn lists_and_outputs_that_will_not_do_are_named() {
    let folder = folder();
    let path = folder.path();
    let write = |name: &str, text: &str| fs::write(path.join(name), text).unwrap();
    write("columns.csv", "source,goal\na,b\n");
    write("empty.csv", "source,target\n");
    write("cut.csv", "source,target\n0.ply,1.ply\n0.pl");
    write("cut.parquet", "PAR1abc");
    done(path, &format!("{RUN} -o whole.parquet"));
    let whole = fs::read(path.join("whole.parquet")).unwrap();
    fs::write(path.join("half.parquet"), &whole[..whole.len() / 2]).unwrap();
    let wrong = [
        ("none.csv -o rows.csv", "none.csv"),
        (". -o rows.csv", "directory"),
        ("columns.csv -o rows.csv", "no column target"),
        ("empty.csv -o rows.csv", "no pair"),
        ("cut.csv -o rows.csv", "line 3"),
        ("cut.parquet -o rows.csv", "is not Parquet"),
        ("half.parquet -o rows.csv", "is not Parquet"),
        ("pairs.csv -o rows.txt", ".parquet"),
        ("pairs.csv -o none/rows.csv", "folder does not exist"),
        ("pairs.csv -o pairs.csv", "overwrite an input"),
        ("pairs.csv -o rows.csv --method nonsense", "nonsense"),
        ("pairs.csv -o rows.csv --memory lots", "number of bytes"),
        // What would make an error of every row.
        ("pairs.csv -o rows.csv --sample 0", "sample"),
        ("pairs.csv -o rows.csv --voxel -1 --method cf", "voxel"),
        ("pairs.csv -o rows.csv --viewpoints sensor", "must be one of"),
    ];
    for (line, words) in wrong {
        refused(path, &format!("batch {line}"), words);
    }
    assert!(!path.join("rows.csv.part").exists());
}

#[cfg(target_os = "linux")]
#[test]
fn a_full_disk_is_said_and_nothing_lost() {
    let folder = folder();
    let path = folder.path();
    std::os::unix::fs::symlink("/dev/full", path.join("full.csv")).unwrap();
    refused(path, &format!("{RUN} -o full.csv --overwrite"), "not a regular file");
    // No file may be longer than 8 KiB: writes are refused as on a full disk.
    let line = format!("trap '' XFSZ; ulimit -f 8; exec {BINARY} {RUN} -o rows.csv");
    let output = Command::new("bash").current_dir(path).args(["-c", &line]).output().unwrap();
    assert_eq!(output.status.code(), Some(2));
    assert!(said(&output).contains("rows.csv.part: File too large"), "{}", said(&output));
    assert!(!path.join("rows.csv").exists());
    done(path, &format!("{RUN} -o rows.csv --resume"));
    done(path, &format!("{RUN} -o whole.csv"));
    let read = |name: &str| fs::read(path.join(name)).unwrap();
    assert!(read("rows.csv") == read("whole.csv"));
}

#[cfg(unix)]
#[test]
fn ctrl_c_keeps_what_is_done() {
    let folder = folder();
    let path = folder.path();
    let slow = "batch pairs.csv --method cf --set neighbors=30 --refine cpd,dare,kc -o rows.csv";
    let mut child = command(path, slow).stderr(Stdio::piped()).spawn().unwrap();
    while !fs::metadata(path.join("rows.csv.part")).is_ok_and(|part| part.len() > 6000) {
        assert!(child.try_wait().unwrap().is_none(), "it was too fast for this test");
        std::thread::sleep(Duration::from_millis(5));
    }
    let id = child.id().to_string();
    assert!(Command::new("kill").args(["-INT", &id]).status().unwrap().success());
    let output = child.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(130), "{}", said(&output));
    assert!(said(&output).contains("--resume") && path.join("rows.csv.part").exists());
}

/// Fails in every way, by the number of points of the source.
struct Moody<'a>(&'a AtomicUsize);

impl Register for Moody<'_> {
    fn register(&self, source: &PointCloud, target: &PointCloud) -> cfreg::Result<Registration> {
        self.0.fetch_add(1, Ordering::Relaxed);
        match source.len() {
            4 => panic!("four points"),
            5 => loop {
                par::checkpoint();
                std::thread::sleep(Duration::from_millis(1));
            },
            _ => Pipeline::new("icp".parse()?, Vec::new())?.register(source, target),
        }
    }
}

#[test]
fn panics_and_time_limits_are_rows() {
    let folder = folder();
    let path = folder.path();
    for points in 4..6 {
        let text = "0 0 0\n1 0 0\n0 1 0\n0 0 1\n1 1 1\n";
        let text: String = text.split_inclusive('\n').take(points).collect();
        fs::write(path.join(format!("{points}.xyz")), text).unwrap();
    }
    let list = PairList::new(
        path,
        [["4.xyz", "0.ply"], ["0.ply", "1.ply"], ["5.xyz", "0.ply"], ["4.xyz", "4.xyz"]],
    );
    let calls = AtomicUsize::new(0);
    let method = Moody(&calls);
    install_panic_hook();
    let mut batch = Batch::new(&method, &"moody");
    batch.time_limit = Some(Duration::from_secs(2));
    batch.threads = 2;
    let summary = batch.run(&list, &path.join("rows.csv")).unwrap();
    assert_eq!((summary.pairs, summary.errors, calls.into_inner()), (4, 3, 4));
    let text = fs::read_to_string(path.join("rows.csv")).unwrap();
    let lines: Vec<&str> = text.lines().collect();
    assert!(lines[1].contains("four points (tests/it/batch.rs:"), "{text}");
    assert!(lines[4].contains("four points"), "{text}");
    assert!(lines[2].starts_with("1,0.ply,1.ply,,"), "{text}");
    assert!(lines[3].contains("time limit of 2 s"), "{text}");
}

#[test]
fn the_time_limit_covers_reading() {
    let folder = folder();
    let line = |i: usize| format!("{} {} 0.5\n", i % 1000, i / 1000);
    fs::write(folder.path().join("large.xyz"), (0..500_000).map(line).collect::<String>()).unwrap();
    let list = PairList::new(folder.path(), [["large.xyz", "0.ply"]]);
    let calls = AtomicUsize::new(0);
    let method = Moody(&calls);
    let mut batch = Batch::new(&method, &"moody");
    batch.time_limit = Some(Duration::from_millis(1));
    let rows = batch.rows(&list, |_, _| ()).unwrap();
    assert!(rows[0].error.as_deref().unwrap().contains("time limit"), "{rows:?}");
    assert_eq!(calls.into_inner(), 0);
}

#[test]
fn clouds_at_hand_are_as_files_and_rows_may_be_kept() {
    let folder = folder();
    // Messages name files as they are seen from here.
    let here = folder.path().display();
    let line = format!("{RUN} -o rows.csv --viewpoints none --sample 200 --folder {here}");
    done(folder.path(), &line);
    let chain = Pipeline::new(
        "cf".parse::<Method>().unwrap().with([("neighbors", 30.into())]).unwrap(),
        vec!["icp".parse().unwrap()],
    );
    let chain = chain.unwrap().with_verification(Consensus::default());
    let list = PairList::read(&folder.path().join("pairs.csv"), folder.path()).unwrap();
    let mut batch = Batch::new(&chain, &chain);
    batch.viewpoints = ViewpointSource::None;
    batch.thinning.sample = Some(200);
    let rows = batch.rows(&list, |_, _| ()).unwrap();
    for seed in 0..CLOUDS {
        let name = format!("{seed}.ply");
        let path = folder.path().join(&name);
        batch.in_memory.insert(name, io::read(&path).unwrap().into());
        fs::remove_file(path).unwrap();
    }
    assert_eq!(batch.rows(&list, |_, _| ()).unwrap().len(), rows.len());
    batch.run(&list, &folder.path().join("given.csv")).unwrap();
    let read = |name: &str| fs::read_to_string(folder.path().join(name)).unwrap();
    assert!(read("given.csv") == read("rows.csv"));
    let seconds = |row: &Row| row.seconds.is_some();
    assert!(rows[..PAIRS - 3].iter().all(seconds) && !rows[PAIRS - 1..].iter().any(seconds));
}
