//! The command line writes clouds and says what the files lack.

use std::path::Path;
use std::process::{Output, Stdio};

use std::process::Command;
use tempfile::tempdir;

fn cfreg(folder: &Path, line: &str) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_cfreg"));
    command.current_dir(folder).args(line.split_whitespace()).output().unwrap()
}

fn stderr(output: &Output) -> String {
    String::from_utf8(output.stderr.clone()).unwrap()
}

/// A ball of 500 vertices with two faces, a colour and a comment.
fn mesh() -> String {
    let mut file = "ply\nformat ascii 1.0\ncomment by hand\nelement vertex 500\nproperty float x\n\
                    property float y\nproperty float z\nproperty uchar red\nelement face 2\n\
                    property list uchar int vertex_indices\nend_header\n"
        .to_string();
    for i in 0..500 {
        let (height, turn) = (f64::from(i) / 250.0 - 1.0, 2.4 * f64::from(i));
        let radius = (1.0 - height * height).sqrt() * (1.0 + 0.3 * (3.0 * turn).sin());
        file += &format!("{} {} {height} {}\n", radius * turn.cos(), radius * turn.sin(), i % 256);
    }
    file + "3 0 1 2\n3 1 2 3\n"
}

#[test]
fn convert_says_what_it_leaves_out_and_changes() {
    let folder = tempdir().unwrap();
    let write = |name: &str, text: &str| std::fs::write(folder.path().join(name), text).unwrap();
    write("mesh.ply", &mesh());
    write("dot.csv", "x,y,z,a.b\n1,2,3,4\n5,6,7,8\n0,1,0,1\n");
    write("rgb.csv", "x,y,z,rgb\n1,2,3,0.5\n5,6,7,0.25\n0,1,0,1\n");
    for (line, said) in [
        (
            "convert mesh.ply a.xyz",
            "cfreg: a.xyz: left out: 2 faces, 1 comment; changed: red is a number from 0 to 1, no colour\n",
        ),
        ("convert mesh.ply a.ply", "cfreg: a.ply: left out: 2 faces, 1 comment\n"),
        ("convert dot.csv b.ply", "cfreg: b.ply: changed: a.b is called a_b\n"),
        ("convert rgb.csv c.pcd", ""),
        ("convert dot.csv dot.xyz", ""),
    ] {
        let output = cfreg(folder.path(), line);
        assert!(output.status.success(), "{line}: {}", stderr(&output));
        let all = stderr(&output);
        let others: String = all.lines().filter(|line| !line.contains(" wrote ")).collect();
        assert_eq!(others, said.trim_end(), "{line}");
    }
    for (file, channels) in [("a.ply", "red"), ("b.ply", "a_b"), ("c.pcd", "rgb")] {
        let output = cfreg(folder.path(), &format!("info {file}"));
        let text = String::from_utf8(output.stdout).unwrap();
        assert!(text.contains(&format!("channels    {channels}\n")), "{text}");
    }
    let huge = "1e308 0 0\n";
    write("huge.xyz", huge);
    let output = cfreg(folder.path(), "info huge.xyz");
    assert_eq!(output.status.code(), Some(2));
    assert!(stderr(&output).contains("huge.xyz, line 1: text: x is 1e308"), "{}", stderr(&output));
}

#[test]
fn so_does_the_aligned_source() {
    let folder = tempdir().unwrap();
    std::fs::write(folder.path().join("mesh.ply"), mesh()).unwrap();
    let line = "register mesh.ply mesh.ply --method icp --write-aligned out.csv";
    let output = cfreg(folder.path(), line);
    let said = stderr(&output);
    assert!(output.status.code() < Some(2), "{said}");
    assert!(said.contains("cfreg: out.csv: left out: 2 faces, 1 comment; changed: red"), "{said}");
}

#[cfg(target_os = "linux")]
#[test]
fn clouds_come_by_pipes_but_not_twice() {
    let folder = tempdir().unwrap();
    std::fs::write(folder.path().join("mesh.ply"), mesh()).unwrap();
    let piped = |line: &str| {
        let mut cat = std::process::Command::new("cat");
        let cat = cat.arg("mesh.ply").current_dir(folder.path()).stdout(Stdio::piped());
        let mut cat = cat.spawn().unwrap();
        let mut command = std::process::Command::new(env!("CARGO_BIN_EXE_cfreg"));
        let command = command.current_dir(folder.path()).args(line.split_whitespace());
        let output = command.stdin(cat.stdout.take().unwrap()).output().unwrap();
        cat.wait().unwrap();
        output
    };
    let output = piped("info /dev/stdin");
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(text.contains("points      500 (0 left out"), "{text}{}", stderr(&output));
    let output = piped("register /dev/stdin mesh.ply --method icp --write-aligned out.ply");
    assert_eq!(output.status.code(), Some(2));
    assert!(stderr(&output).contains("must be a file"), "{}", stderr(&output));
}
