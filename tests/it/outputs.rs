//! Nothing is lost and nothing is overwritten: answers that cannot be written are errors, inputs are
//! never outputs, and files beside an output are those of an earlier run or nobody's.

use std::fs;
use std::path::Path;
use std::process::{Command, Output, Stdio};

use cfreg::cloud::shape::boulder;
use cfreg::{Transform, io};
use tempfile::TempDir;

const BINARY: &str = env!("CARGO_BIN_EXE_cfreg");
const RUN: &str = "--method cf+icp --set neighbors=30 --verdict";

/// Three clouds, a list of four pairs, a pose.
fn folder() -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    for seed in 0..3u64 {
        let turn = Transform::from_rotation_vector([0.1 * seed as f64, 0.2, 0.0]);
        let cloud = boulder().sample(250, seed).unwrap().transformed(&turn).unwrap();
        io::write(folder.path().join(format!("{seed}.ply")), &cloud).unwrap();
    }
    let pairs = "source,target\n0.ply,1.ply\n1.ply,2.ply\n2.ply,0.ply\n0.ply,2.ply\n";
    fs::write(folder.path().join("pairs.csv"), pairs).unwrap();
    io::write_transform(folder.path().join("pose.txt"), &Transform::IDENTITY).unwrap();
    folder
}

/// Runs a line of a shell, with `CFREG` for the program.
fn shell(folder: &Path, line: &str) -> Output {
    let line = line.replace("CFREG", BINARY);
    let mut command = Command::new("bash");
    command.current_dir(folder).args(["-c", &line]).stdin(Stdio::null());
    command.output().unwrap()
}

fn said(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

fn refused(folder: &Path, line: &str, words: &str) {
    let output = shell(folder, line);
    let said = said(&output);
    assert!(output.status.code() == Some(2) && said.contains(words), "{line}: {said}");
}

fn done(folder: &Path, line: &str) -> String {
    let output = shell(folder, line);
    assert!(output.status.success(), "{line}: {}", said(&output));
    said(&output)
}

/// All files, by name, with what is in them.
fn files(folder: &Path) -> Vec<(String, Vec<u8>)> {
    let mut files: Vec<_> = fs::read_dir(folder)
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .filter(|path| path.is_file())
        .map(|path| {
            (path.file_name().unwrap().to_string_lossy().into_owned(), fs::read(&path).unwrap())
        })
        .collect();
    files.sort();
    files
}

#[cfg(target_os = "linux")]
#[test]
fn an_answer_that_cannot_be_printed_is_none() {
    let folder = folder();
    let commands = [
        "register 0.ply 1.ply",
        "register 0.ply 1.ply --json",
        "evaluate 0.ply 1.ply --transform pose.txt",
        "evaluate 0.ply 1.ply --transform pose.txt --json",
        "info 0.ply",
        "info 0.ply --json",
        "demo --points 300",
        "--help",
        "register --help",
        "--version",
    ];
    for command in commands {
        for (ending, words) in [
            (" > /dev/full", "standard output: No space left"),
            (" >&-", "standard output: closed before"),
            // The reader is gone before anything is written.
            (" >&5", "standard output: closed before"),
        ] {
            let first = if ending == " >&5" { "exec 5> >(true); sleep 0.3; " } else { "" };
            let line = format!("{first}CFREG {command}{ending}");
            let output = shell(folder.path(), &line);
            let said = said(&output);
            assert_eq!(output.status.code(), Some(2), "{line}: {said}");
            assert!(said.contains(words), "{line}: {said}");
        }
    }
    // A command that prints nothing needs no output.
    for command in [
        "batch pairs.csv -o closed.csv --method cf+icp --set neighbors=30 --verdict >&-",
        "graph closed.csv -o closed.g2o >&-",
        "pairs sequence 0.ply 1.ply -o closed-pairs.csv >&-",
        "convert 0.ply closed.ply >&-",
        "info 0.ply >/dev/null",
    ] {
        done(folder.path(), &format!("CFREG {command}"));
    }
}

#[cfg(unix)]
#[test]
fn an_input_is_never_an_output() {
    let folder = folder();
    let path = folder.path();
    for file in ["0.ply", "1.ply", "pairs.csv", "pose.txt"] {
        fs::hard_link(path.join(file), path.join(format!("hard-{file}"))).unwrap();
        std::os::unix::fs::symlink(file, path.join(format!("soft-{file}"))).unwrap();
    }
    fs::write(path.join("known.csv"), {
        let titles: Vec<String> = (0..16).map(|k| format!("t{}{}", k / 4, k % 4)).collect();
        format!("source,target,{}\n0.ply,1.ply,1,0,0,0,0,1,0,0,0,0,1,0,0,0,0,1\n", titles.join(","))
    })
    .unwrap();
    done(path, &format!("CFREG batch pairs.csv -o rows.csv {RUN}"));
    fs::hard_link(path.join("rows.csv"), path.join("hard-rows.csv")).unwrap();
    done(path, "CFREG register 0.ply 1.ply --json > found.json");
    fs::hard_link(path.join("found.json"), path.join("hard-found.html")).unwrap();
    fs::copy(path.join("0.ply"), path.join("cloud.csv")).unwrap();
    fs::write(path.join("odd.csv"), "source,target\n0.ply,cloud.csv\n").unwrap();
    fs::copy(path.join("pairs.csv"), path.join("y.csv.part")).unwrap();
    fs::copy(path.join("pairs.csv"), path.join("z.csv.run.json")).unwrap();
    let before = files(path);
    for line in [
        "register 0.ply 1.ply --output hard-0.ply",
        "register 0.ply 1.ply --write-aligned hard-1.ply",
        "register 0.ply 1.ply --write-aligned soft-1.ply",
        "register 0.ply 1.ply --report hard-0.ply",
        "register 0.ply 1.ply --near pose.txt --output hard-pose.txt",
        "register 0.ply 1.ply --output a.txt --report ./a.txt",
        "convert 0.ply hard-0.ply",
        "convert 0.ply soft-0.ply",
        "convert 0.ply pose.txt --transform pose.txt",
        "convert 0.ply hard-pose.txt --transform pose.txt",
        "graph rows.csv -o hard-rows.csv",
        "graph rows.csv -o a.g2o --names rows.csv",
        "report found.json -o hard-found.html",
        "report found.json -o 0.ply",
        "pairs sequence 0.ply 1.ply -o hard-1.ply",
        "pairs map 0.ply 1.ply -o soft-0.ply",
        "batch pairs.csv -o hard-pairs.csv --overwrite",
        "batch odd.csv -o cloud.csv --overwrite",
        "batch y.csv.part -o y.csv",
        "batch y.csv.part -o y.csv --overwrite",
        "batch y.csv.part -o y.csv --resume",
        "batch z.csv.run.json -o z.csv --overwrite",
        "benchmark known.csv --output known.csv",
        "benchmark known.csv --output hard-0.ply",
        "benchmark known.csv --poses known.csv --output known.csv",
    ] {
        let output = shell(path, &format!("CFREG {line}"));
        assert_eq!(output.status.code(), Some(2), "{line}: {}", said(&output));
        assert!(files(path) == before, "{line}");
        println!("{line}: {}", said(&output).trim());
    }
}

#[test]
fn files_of_others_beside_an_output_stay() {
    let folder = folder();
    let path = folder.path();
    // A list of a name that a temporary file might have.
    fs::copy(path.join("pairs.csv"), path.join("y.csv.tmp")).unwrap();
    done(path, &format!("CFREG batch y.csv.tmp -o y.csv {RUN}"));
    assert!(fs::read(path.join("y.csv.tmp")).unwrap() == fs::read(path.join("pairs.csv")).unwrap());
    for (end, mine) in [(".run.json", "{\"mine\": 1}\n"), (".part", "mine\n"), (".part", "mine")] {
        let file = path.join(format!("rows.csv{end}"));
        fs::write(&file, mine).unwrap();
        for how in ["", " --resume", " --overwrite"] {
            refused(path, &format!("CFREG batch pairs.csv -o rows.csv {RUN}{how}"), "rows.csv");
            assert_eq!(fs::read_to_string(&file).unwrap(), mine, "{how}");
        }
        assert!(!path.join("rows.csv").exists());
        fs::remove_file(file).unwrap();
    }
    // Those of an earlier run are replaced.
    done(path, &format!("CFREG batch pairs.csv -o rows.csv {RUN}"));
    done(path, &format!("CFREG batch pairs.csv -o rows.csv {RUN} --overwrite"));
    // Parquet has no file beside it.
    fs::write(path.join("rows.parquet.run.json"), "mine").unwrap();
    done(path, &format!("CFREG batch pairs.csv -o rows.parquet {RUN}"));
    assert_eq!(fs::read_to_string(path.join("rows.parquet.run.json")).unwrap(), "mine");
    // Pages.
    fs::create_dir(path.join("site")).unwrap();
    fs::write(path.join("site/index.html"), "<h1>mine</h1>").unwrap();
    refused(path, "CFREG report rows.csv -o site", "was not written by this program");
    assert_eq!(fs::read_to_string(path.join("site/index.html")).unwrap(), "<h1>mine</h1>");
    fs::create_dir_all(path.join("half/pairs")).unwrap();
    fs::write(path.join("half/pairs/00000.html"), "mine").unwrap();
    refused(path, "CFREG report rows.csv -o half", "was not written by this program");
    done(path, "CFREG report rows.csv -o pages");
    done(path, "CFREG report rows.csv -o pages");
    shell(path, "CFREG register 0.ply 1.ply --json > found.json");
    fs::write(path.join("found.html"), "mine").unwrap();
    refused(path, "CFREG report found.json", "was not written by this program");
    done(path, "CFREG report found.json -o named.html");
    fs::remove_file(path.join("found.html")).unwrap();
    done(path, "CFREG report found.json");
    done(path, "CFREG report found.json");
    // The pair of the demo.
    fs::create_dir(path.join("pair")).unwrap();
    fs::write(path.join("pair/truth.txt"), "mine").unwrap();
    refused(path, "CFREG demo --points 300 --write pair", "was not written by this program");
    assert_eq!(fs::read_to_string(path.join("pair/truth.txt")).unwrap(), "mine");
    assert!(!path.join("pair/source.pcd").exists());
    done(path, "CFREG demo --points 300 --write demo");
    done(path, "CFREG demo --points 301 --write demo");
    // Rows of a benchmark.
    fs::write(path.join("mine.csv"), "a,b\n1,2\n").unwrap();
    fs::write(path.join("known.csv"), {
        let titles: Vec<String> = (0..16).map(|k| format!("t{}{}", k / 4, k % 4)).collect();
        format!("source,target,{}\n0.ply,1.ply,1,0,0,0,0,1,0,0,0,0,1,0,0,0,0,1\n", titles.join(","))
    })
    .unwrap();
    refused(path, "CFREG benchmark known.csv --output mine.csv", "has no rows of this benchmark");
    assert_eq!(fs::read_to_string(path.join("mine.csv")).unwrap(), "a,b\n1,2\n");
    // Nothing of our own is left.
    let left: Vec<_> = files(path).into_iter().filter(|(name, _)| name.starts_with('.')).collect();
    assert!(left.is_empty(), "{left:?}");
}

#[test]
fn rows_that_were_changed_are_registered_again() {
    let folder = folder();
    let path = folder.path();
    done(path, &format!("CFREG batch pairs.csv -o whole.csv {RUN}"));
    let whole = fs::read(path.join("whole.csv")).unwrap();
    // A journal that is complete, but for the output: the folder of that is there in its place.
    let journal = {
        let start = format!("CFREG batch pairs.csv -o rows.csv {RUN} --threads 1");
        let line = format!(
            "({start}) & while [ \"$(wc -l < rows.csv.part 2>/dev/null || echo 0)\" -lt 3 ]; do \
             kill -0 $! 2>/dev/null || break; done; kill -9 $(pgrep -P $!) $! 2>/dev/null; wait"
        );
        let mut journal = None;
        for _ in 0..20 {
            shell(path, &line);
            if let Ok(text) = fs::read_to_string(path.join("rows.csv.part"))
                && text.lines().count() >= 3
            {
                journal = Some(text);
                break;
            }
            for end in ["", ".part", ".run.json"] {
                let _ = fs::remove_file(path.join(format!("rows.csv{end}")));
            }
        }
        journal
    };
    let Some(journal) = journal else {
        println!("skipped: the run was too fast to be killed");
        return;
    };
    let lines: Vec<&str> = journal.split_inclusive('\n').collect();
    let swapped = lines[1].replace("0.ply", "X").replace("1.ply", "0.ply").replace('X', "1.ply");
    let at = lines[1].find("\"fitness\":").unwrap() + 12;
    let mut digit = lines[1].to_string();
    let other = if &digit[at..=at] == "1" { "2" } else { "1" };
    digit.replace_range(at..=at, other);
    for changed in [swapped, digit, "\n".into(), "{}\n".into()] {
        let text = [lines[0], &changed].into_iter().chain(lines[2..].iter().copied());
        fs::write(path.join("rows.csv.part"), text.collect::<String>()).unwrap();
        let _ = fs::remove_file(path.join("rows.csv"));
        let said = done(path, &format!("CFREG batch pairs.csv -o rows.csv {RUN} --resume"));
        assert!(said.contains("1 lines of rows.csv.part were modified"), "{said}");
        assert!(fs::read(path.join("rows.csv")).unwrap() == whole);
        assert!(!path.join("rows.csv.part").exists());
    }
}

#[test]
fn a_run_without_a_pose_that_may_be_used_is_doubted() {
    let folder = folder();
    fs::write(folder.path().join("none.csv"), "source,target\n7.ply,8.ply\n").unwrap();
    let output = shell(folder.path(), "CFREG batch none.csv -o rows.csv");
    assert_eq!(output.status.code(), Some(1), "{}", said(&output));
}

#[test]
fn an_accepted_pose_that_is_doubted_makes_no_edge() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    // Flat but for what no sensor sees, and a copy of itself, moved.
    for (name, shift) in [("s", 0.0), ("t", 5.0)] {
        let point = |k: u32| {
            let [x, y, z] = [0.754_877_666, 0.569_840_291, 0.438_579_021]
                .map(|step| (f64::from(k) * step).fract() * 2.0 - 1.0);
            format!("{} {} {}\n", x + shift, y, 1e-4 * z)
        };
        fs::write(path.join(format!("{name}.xyz")), (1..101).map(point).collect::<String>())
            .unwrap();
    }
    fs::write(path.join("pairs.csv"), "source,target\ns.xyz,t.xyz\n").unwrap();
    let output = shell(path, "CFREG batch pairs.csv -o rows.csv");
    assert_eq!(output.status.code(), Some(1), "{}", said(&output));
    let rows = cfreg::batch::results::read(&path.join("rows.csv")).unwrap();
    assert!(!rows[0].is_usable(), "{:?}", rows[0]);
    // Two shifts and a turn in the plane.
    assert_eq!(rows[0].undetermined, Some(3), "{:?}", rows[0]);
    io::write_transform(path.join("pose.txt"), &rows[0].transform().unwrap()).unwrap();
    let judged = shell(path, "CFREG evaluate s.xyz t.xyz --transform pose.txt --verdict --json");
    assert_eq!(judged.status.code(), Some(1), "{}", said(&judged));
    let judged: serde_json::Value = serde_json::from_slice(&judged.stdout).unwrap();
    let loose = &judged["verdict"]["covariance"]["undetermined"];
    assert_eq!(loose.as_array().map(Vec::len), Some(3), "{judged}");
    done(path, "CFREG graph rows.csv -o graph.g2o");
    assert!(!fs::read_to_string(path.join("graph.g2o")).unwrap().contains("EDGE"));
    done(path, "CFREG report rows.csv -o pages");
    let page = fs::read_to_string(path.join("pages/index.html")).unwrap();
    assert!(page.contains("1 pairs: 0 poses to use") && !page.contains(">accept<"), "{page}");
}
