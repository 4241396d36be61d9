//! Faults around the program: kills, full disks, folders that may not be written, other
//! processes, files that go away, signals, pipes that are closed. Nothing that was done is lost,
//! nothing half done is taken for done, and what went wrong is said.
//!
//! `cargo test --features cli --test faults -- --nocapture` prints what was survived.
#![cfg(target_os = "linux")]

use std::fs;
use std::path::Path;
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};

use cfreg::cloud::shape::boulder;
use cfreg::{Transform, io};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use tempfile::TempDir;

const BINARY: &str = env!("CARGO_BIN_EXE_cfreg");
const CLOUDS: usize = 6;
const PAIRS: usize = CLOUDS * CLOUDS;
const RUN: &str = "batch pairs.csv --method cf+icp --set neighbors=20 --verdict";
/// Some seconds of work, one thread of it.
const SLOW: &str =
    "batch pairs.csv --method cf --set neighbors=30 --refine cpd,dare,kc --threads 1";

/// A folder with clouds and the list of all pairs of them.
fn folder() -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    let mut list = String::from("source,target\n");
    for i in 0..CLOUDS {
        let turn = Transform::from_rotation_vector([0.1 * i as f64, 0.2, 0.0]);
        let cloud = boulder().sample(200, i as u64).unwrap().transformed(&turn).unwrap();
        io::write(folder.path().join(format!("{i}.ply")), &cloud).unwrap();
        (0..CLOUDS).for_each(|j| list += &format!("{i}.ply,{j}.ply\n"));
    }
    fs::write(folder.path().join("pairs.csv"), list).unwrap();
    folder
}

fn command(folder: &Path, line: &str) -> Command {
    let mut command = Command::new(BINARY);
    command.current_dir(folder).args(line.split_whitespace()).stdin(Stdio::null());
    command
}

fn begun(folder: &Path, line: &str) -> Child {
    command(folder, line).stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap()
}

/// By bash, with `$cfreg` for the program.
fn shell(folder: &Path, script: &str) -> Output {
    let mut bash = Command::new("bash");
    bash.current_dir(folder).env("cfreg", BINARY).args(["-c", script]).stdin(Stdio::null());
    bash.output().unwrap()
}

/// The same where file systems may be mounted that nobody else sees; `None`, and a line that says
/// so, where they may not.
fn mounting(folder: &Path, script: &str) -> Option<Output> {
    let inside = |script: &str| {
        let mut unshare = Command::new("unshare");
        unshare.current_dir(folder).env("cfreg", BINARY).stdin(Stdio::null());
        unshare.args(["--mount", "--map-root-user", "bash", "-c", script]).output()
    };
    let may = inside("mkdir -p probe && mount -t tmpfs -o size=64k tmpfs probe");
    if !may.is_ok_and(|output| output.status.success()) {
        eprintln!("skipped: no file system can be mounted here (unshare --map-root-user)");
        return None;
    }
    Some(inside(script).unwrap())
}

fn said(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

fn told(output: &Output) -> String {
    String::from_utf8_lossy(&output.stdout).into_owned()
}

fn done(folder: &Path, line: &str) {
    let output = command(folder, line).output().unwrap();
    assert!(output.status.success(), "{line}: {}", said(&output));
}

fn signal(child: &Child, name: &str) {
    let id = child.id().to_string();
    assert!(Command::new("kill").args([name, &id]).status().unwrap().success());
}

/// Waits until something is true of a process that goes on meanwhile.
fn until(child: &mut Child, what: impl Fn() -> bool) {
    while !what() {
        assert!(child.try_wait().unwrap().is_none(), "it was too fast for this test");
        std::thread::sleep(Duration::from_millis(2));
    }
}

/// Files in a folder that are none of its inputs, in order.
fn others(folder: &Path) -> Vec<String> {
    let names = fs::read_dir(folder).unwrap().map(|file| file.unwrap().file_name());
    let mut names: Vec<String> = names.map(|name| name.into_string().unwrap()).collect();
    names.retain(|name| !name.ends_with(".ply") && name != "pairs.csv" && name != "probe");
    names.sort();
    names
}

#[test]
fn killed_again_and_again_it_ends_with_the_same_bytes() {
    let folder = folder();
    let path = folder.path();
    let started = Instant::now();
    let ends = ["jsonl", "csv", "parquet"];
    ends.iter().for_each(|end| done(path, &format!("{RUN} -o undisturbed.{end}")));
    let longest = started.elapsed().as_secs_f64() / 3.0;
    let mut random = ChaCha8Rng::seed_from_u64(7);
    let (mut kills, mut torn, mut ended) = (0, 0, 0);
    let started = Instant::now();
    for end in ends.into_iter().cycle() {
        if started.elapsed() > Duration::from_secs(8) {
            break;
        }
        let [rows, part] =
            [format!("rows.{end}"), format!("rows.{end}.part")].map(|f| path.join(f));
        for attempt in 0.. {
            let mut child = begun(path, &format!("{RUN} -o rows.{end} --resume"));
            let wait = if attempt < 8 { random.random::<f64>() * longest / 2.0 } else { 600.0 };
            let began = Instant::now();
            while began.elapsed().as_secs_f64() < wait && child.try_wait().unwrap().is_none() {
                std::thread::sleep(Duration::from_millis(1));
            }
            if let Some(status) = child.try_wait().unwrap() {
                assert!(status.success(), "{status}");
                break;
            }
            child.kill().unwrap();
            child.wait().unwrap();
            kills += 1;
            // As a power cut may leave the last blocks: cut short, or zero.
            if let Ok(mut bytes) = fs::read(&part).map_err(drop)
                && bytes.len() > 64
                && random.random()
            {
                let from = bytes.len() - random.random_range(1..64);
                match random.random() {
                    true => bytes.truncate(from),
                    false => bytes[from..].fill(0),
                }
                fs::write(&part, bytes).unwrap();
                torn += 1;
            }
        }
        assert!(
            fs::read(&rows).unwrap() == fs::read(path.join(format!("undisturbed.{end}"))).unwrap()
        );
        ended += 1;
        fs::remove_file(rows).unwrap();
        let _ = fs::remove_file(path.join(format!("rows.{end}.run.json")));
        assert!(others(path).iter().all(|name| !name.starts_with("rows.")), "{:?}", others(path));
    }
    println!("{kills} kills survived, {torn} torn journals; {} rows compared", ended * PAIRS);
    assert!(kills > 5, "{kills} kills: too fast for this test");
}

#[test]
fn a_journal_that_was_changed_is_not_believed() {
    let folder = folder();
    let path = folder.path();
    done(path, &format!("{RUN} -o undisturbed.csv"));
    let mut child = begun(path, &format!("{SLOW} -o slow.csv"));
    until(&mut child, || fs::metadata(path.join("slow.csv.part")).is_ok_and(|p| p.len() > 9000));
    child.kill().unwrap();
    child.wait().unwrap();
    let journal = fs::read(path.join("slow.csv.part")).unwrap();
    let header = journal.iter().position(|&byte| byte == b'\n').unwrap() + 1;
    done(path, &format!("{SLOW} -o slow.csv --resume"));
    let rows = fs::read(path.join("slow.csv")).unwrap();
    let mut random = ChaCha8Rng::seed_from_u64(8);
    let tries = 4;
    for attempt in 0..tries {
        let mut changed = journal.clone();
        // A digit of a row, or names that are swapped, with everything else as it was.
        if attempt % 2 == 0 {
            let digits = (header..journal.len()).filter(|&at| journal[at].is_ascii_digit());
            let digits: Vec<usize> = digits.collect();
            let at = digits[random.random_range(0..digits.len())];
            changed[at] = b'0' + (changed[at] - b'0' + 1) % 10;
        } else {
            let text = String::from_utf8(journal.clone()).unwrap();
            let text = text.replacen("\"source\":\"0.ply\"", "\"source\":\"5.ply\"", 1);
            changed = text.into_bytes();
        }
        assert!(changed != journal);
        fs::remove_file(path.join("slow.csv")).unwrap();
        fs::write(path.join("slow.csv.part"), &changed).unwrap();
        // Done again, or refused with words.
        let output = command(path, &format!("{SLOW} -o slow.csv --resume")).output().unwrap();
        if !output.status.success() {
            assert!(output.status.code() == Some(2) && said(&output).contains("slow.csv.part"));
            done(path, &format!("{SLOW} -o slow.csv --overwrite"));
        }
        assert!(fs::read(path.join("slow.csv")).unwrap() == rows, "attempt {attempt}");
    }
    println!("{tries} changed journals not believed; {} rows compared", tries * PAIRS);
}

#[test]
fn a_full_disk_is_said_and_the_rest_done_later() {
    let folder = folder();
    let script = format!(
        "mkdir disk && mount -t tmpfs -o size=28k tmpfs disk && ln -s $PWD/*.ply disk/
        cp pairs.csv disk/ && cd disk
        fails() {{ \"$@\" > ../answer 2> ../words; echo \"$? $(tail -1 ../words)\"; }}
        fails $cfreg {RUN} -o rows.csv
        ls rows.csv 2>/dev/null
        mount -o remount,size=4m . && $cfreg {RUN} -o rows.csv --resume 2>/dev/null
        cmp rows.csv ../undisturbed.csv && echo same rows
        echo old > cloud.ply; echo old > page.html
        head -c 8m /dev/zero > rest 2>/dev/null
        fails $cfreg convert 0.ply cloud.ply
        fails $cfreg convert 0.ply new.xyz
        fails $cfreg register 0.ply 1.ply --method cf --report page.html
        fails $cfreg register 0.ply 1.ply --method cf --write-aligned moved.ply --output pose.txt
        cat cloud.ply page.html
        ls -A | grep -v -e '^[0-5].ply$' -e pairs.csv -e '^rows.csv' -e rest"
    );
    done(folder.path(), &format!("{RUN} -o undisturbed.csv"));
    let Some(output) = mounting(folder.path(), &script) else { return };
    let lines = told(&output);
    let failed: Vec<&str> = lines.lines().filter(|line| line.starts_with("2 ")).collect();
    assert_eq!(failed.len(), 5, "{lines}{}", said(&output));
    assert!(failed.iter().all(|line| line.contains("No space left on device")), "{lines}");
    assert!(failed[0].contains("rows.csv.part"), "{lines}");
    let rest: Vec<&str> = lines.lines().filter(|line| !line.starts_with("2 ")).collect();
    assert_eq!(rest, ["same rows", "old", "old", "cloud.ply", "page.html"], "{lines}");
    println!("full disk: {} commands said so, {PAIRS} rows compared", failed.len());
}

#[test]
fn a_folder_that_may_not_be_written_is_named() {
    let folder = folder();
    let script = format!(
        "mkdir fixed && echo old > fixed/old.ply && mount --bind fixed fixed
        mount -o remount,bind,ro fixed
        fails() {{ \"$@\" > answer 2> words; echo \"$? $(tail -1 words)\"; }}
        fails $cfreg {RUN} -o fixed/rows.csv
        fails $cfreg convert 0.ply fixed/new.ply
        fails $cfreg convert 0.ply fixed/old.ply
        fails $cfreg register 0.ply 1.ply --method cf --output fixed/pose.txt
        fails $cfreg register 0.ply 1.ply --method cf --report fixed/page.html
        fails $cfreg demo --write fixed/pair
        ls -A fixed"
    );
    let Some(output) = mounting(folder.path(), &script) else { return };
    let lines = told(&output);
    let failed: Vec<&str> = lines.lines().filter(|line| line.starts_with("2 ")).collect();
    assert_eq!(failed.len(), 6, "{lines}{}", said(&output));
    let named = |line: &&str| line.contains("fixed/") && line.contains("Read-only file system");
    assert!(failed.iter().all(named), "{lines}");
    assert!(lines.ends_with("old.ply\n"), "{lines}");
    println!("read-only folder: {} commands said so", failed.len());
}

#[test]
fn two_writers_of_one_output_do_not_mix() {
    let folder = folder();
    let path = folder.path();
    done(path, &format!("{SLOW} -o undisturbed.csv"));
    let mut first = begun(path, &format!("{SLOW} -o rows.csv"));
    let part = path.join("rows.csv.part");
    until(&mut first, || fs::metadata(&part).is_ok_and(|part| part.len() > 2000));
    for second in ["--resume", "--overwrite"] {
        let output = command(path, &format!("{SLOW} -o rows.csv {second}")).output().unwrap();
        let words = said(&output);
        assert_eq!(output.status.code(), Some(2), "{second}: {words}");
        assert!(words.contains("another process is at work"), "{second}: {words}");
    }
    assert!(first.wait().unwrap().success());
    let read = |name: &str| fs::read(path.join(name)).unwrap();
    assert!(read("rows.csv") == read("undisturbed.csv"));
    // One file by many at once: that of one of them.
    let mut many = Vec::new();
    for k in 0..8 {
        many.push(begun(path, &format!("convert {}.ply one.xyz", k % 2)));
    }
    many.iter_mut().for_each(|child| assert!(child.wait().unwrap().success()));
    done(path, "convert 0.ply zero.xyz");
    done(path, "convert 1.ply first.xyz");
    let one = read("one.xyz");
    assert!(one == read("zero.xyz") || one == read("first.xyz"));
    println!("two writers: 2 refused, 8 at once, {PAIRS} rows compared");
}

#[test]
fn inputs_that_go_away_are_rows_with_words() {
    let folder = folder();
    let path = folder.path();
    done(path, &format!("{SLOW} -o undisturbed.csv"));
    let mut child = begun(path, &format!("{SLOW} --memory 0 -o rows.csv"));
    until(&mut child, || fs::metadata(path.join("rows.csv.part")).is_ok_and(|p| p.len() > 4000));
    for name in ["pairs.csv", "3.ply", "4.ply"] {
        fs::remove_file(path.join(name)).unwrap();
    }
    fs::write(path.join("5.ply"), "ply\nformat ascii 1.0\n").unwrap();
    let output = child.wait_with_output().unwrap();
    assert!(output.status.success(), "{}", said(&output));
    let read = |name: &str| fs::read_to_string(path.join(name)).unwrap();
    let (rows, all) = (read("rows.csv"), read("undisturbed.csv"));
    let mut gone = 0;
    for (row, undisturbed) in rows.lines().zip(all.lines()) {
        let named = ["3.ply: No such file", "4.ply: No such file", "5.ply: "];
        if row != undisturbed {
            assert!(named.iter().any(|words| row.contains(words)), "{row}");
            gone += 1;
        }
    }
    assert_eq!(rows.lines().count(), PAIRS + 1);
    assert!(gone > 0, "it was too fast for this test");
    println!("{gone} of {PAIRS} rows say which file is gone, the others are as ever");
}

#[test]
fn signals_end_it_and_lose_nothing() {
    let folder = folder();
    let path = folder.path();
    done(path, &format!("{SLOW} -o undisturbed.csv"));
    let mut ended = 0;
    for name in ["-INT", "-TERM", "-HUP"] {
        let mut child = begun(path, &format!("{SLOW} -o rows.csv --resume"));
        let part = path.join("rows.csv.part");
        let before = fs::metadata(&part).map_or(0, |part| part.len());
        until(&mut child, || fs::metadata(&part).is_ok_and(|part| part.len() > before + 1500));
        signal(&child, name);
        let began = Instant::now();
        let output = child.wait_with_output().unwrap();
        assert!(began.elapsed() < Duration::from_secs(5), "{name}: {:?}", began.elapsed());
        assert_eq!(output.status.code(), Some(130), "{name}: {}", said(&output));
        assert!(said(&output).contains("--resume"), "{name}: {}", said(&output));
        assert!(fs::metadata(&part).unwrap().len() > before && !path.join("rows.csv").exists());
        ended += 1;
    }
    done(path, &format!("{SLOW} -o rows.csv --resume"));
    let read = |name: &str| fs::read(path.join(name)).unwrap();
    assert!(read("rows.csv") == read("undisturbed.csv"));
    println!("{ended} signals survived, {PAIRS} rows compared");
}

#[test]
fn pipes_that_are_closed_or_full_are_told_by_the_exit_status() {
    let folder = folder();
    let path = folder.path();
    let line = "register 0.ply 1.ply --method cf --set neighbors=20";
    let status = |redirected: &str| {
        let output = shell(path, &format!("$cfreg {line} {redirected}"));
        assert!(!said(&output).contains("panicked"), "{redirected}: {}", said(&output));
        output
    };
    let plain = status("");
    let answered = plain.status.code();
    assert!(matches!(answered, Some(0 | 1)), "{}", said(&plain));
    // An answer that nobody can have got is none.
    for redirected in [">&-", "> /dev/full", "--json >&-", "--json > /dev/full"] {
        let output = status(redirected);
        assert_eq!(output.status.code(), Some(2), "{redirected}: {}", said(&output));
        assert!(said(&output).contains("standard output"), "{redirected}: {}", said(&output));
    }
    // Words that nobody hears do not cost the answer.
    for redirected in ["2>&-", "2> /dev/full", "2> /dev/null"] {
        let output = status(redirected);
        assert_eq!(output.status.code(), answered, "{redirected}");
        assert_eq!(output.stdout, plain.stdout, "{redirected}");
    }
    // Whoever reads may have seen enough.
    let output = shell(path, &format!("set -o pipefail; $cfreg {line} --json | head -c 1 | wc -c"));
    assert!(told(&output).trim() == "1" && matches!(output.status.code(), Some(0 | 1)));
    for command in ["info 0.ply", "evaluate 0.ply 1.ply --transform pose.txt"] {
        fs::write(path.join("pose.txt"), "1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n").unwrap();
        let output = shell(path, &format!("$cfreg {command} >&-"));
        assert_eq!(output.status.code(), Some(2), "{command}: {}", said(&output));
    }
    println!("6 closed or full outputs told, 3 ways of not listening survived");
}
