//! The numbers of every method on 40 pairs stay as they are, bit for bit.
//!
//! The file of golden digests, `tests/golden/digests.csv`, has one line for each pair and method:
//! a digest of all numbers of the row of `cfreg batch`, or of `cfreg register --json`, beside the
//! decision and the pose in six digits. Texts and the keys of JSON are not digested: sentences may
//! be improved. Times and settings are left out.
//!
//! Bits depend on the widest vector instructions and on the mathematical library of the system, which
//! the first line of the file names. Elsewhere decisions and poses are compared, within `TOLERANCE`.
//!
//! `CFREG_UPDATE_DIGESTS=1 cargo test --features cli --test it digests` writes the file anew. A change of it
//! takes a line NUMBERS in CHANGELOG.md.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use cfreg::Transform;
use serde_json::Value;

use crate::common::shared_data;

const METHODS: [&str; 13] = [
    "consensus",
    "cf",
    "cf-multiscale",
    "cf-spectral",
    "cfk",
    "teaser",
    "icp",
    "icp-paper",
    "plane-icp",
    "gicp",
    "kc",
    "cpd",
    "dare",
];

/// Real pairs, every kind of sensor: of the folder of real scans.
const REAL: [(&str, &str); 24] = [
    ("stanford_bunny/bun000.ply", "stanford_bunny/bun045.ply"),
    (
        "stanford_dragon_stand/dragonStandRight_0.ply",
        "stanford_dragon_stand/dragonStandRight_72.ply",
    ),
    (
        "stanford_dragon_stand/dragonStandRight_168.ply",
        "stanford_dragon_stand/dragonStandRight_240.ply",
    ),
    (
        "3dmatch/fragments_vox25mm/7-scenes-redkitchen/cloud_bin_5.ply",
        "3dmatch/fragments_vox25mm/7-scenes-redkitchen/cloud_bin_3.ply",
    ),
    ("kitti00/000000.ply", "kitti00/000006.ply"),
    ("kitti00/000003.ply", "kitti00/000004.ply"),
    ("kitti00/000006.ply", "kitti00/000011.ply"),
    ("kitti00/000012.ply", "kitti00/000015.ply"),
    ("rgbd_7scenes_frames/frame-000050.ply", "rgbd_7scenes_frames/frame-000650.ply"),
    ("rgbd_7scenes_frames/frame-000250.ply", "rgbd_7scenes_frames/frame-000350.ply"),
    ("rgbd_7scenes_frames/frame-000350.ply", "rgbd_7scenes_frames/frame-000950.ply"),
    ("rgbd_7scenes_frames/frame-000600.ply", "rgbd_7scenes_frames/frame-000950.ply"),
    ("stanford_happy_stand/happyStandRight_0.ply", "stanford_happy_stand/happyStandRight_24.ply"),
    ("stanford_happy_stand/happyStandRight_24.ply", "stanford_happy_stand/happyStandRight_336.ply"),
    ("stanford_happy_stand/happyStandRight_96.ply", "stanford_happy_stand/happyStandRight_192.ply"),
    (
        "stanford_happy_stand/happyStandRight_192.ply",
        "stanford_happy_stand/happyStandRight_216.ply",
    ),
    (
        "stanford_happy_stand/happyStandRight_288.ply",
        "stanford_happy_stand/happyStandRight_312.ply",
    ),
    ("balm/full012.ply", "balm/full060.ply"),
    ("balm/full036.ply", "balm/full060.ply"),
    ("balm/full060.ply", "balm/full090.ply"),
    ("balm/full096.ply", "balm/full126.ply"),
    ("apc_realsense/frame-000000.ply", "apc_realsense/frame-000007.ply"),
    ("apc_realsense/frame-000002.ply", "apc_realsense/frame-000014.ply"),
    ("apc_realsense/frame-000006.ply", "apc_realsense/frame-000009.ply"),
];
const GENERATED: usize = 16;
/// Largest difference of a rotation vector, in radians, and of a translation, as a share of its
/// length or of the unit, on a machine with other instructions.
const TOLERANCE: f64 = 1e-3;

/// A number in 0..1 that depends on `seed` alone: SplitMix64 (Steele, Lea, Flood 2014).
fn random(seed: &mut u64) -> f64 {
    *seed = seed.wrapping_add(0x9e37_79b9_7f4a_7c15);
    let mut z = *seed;
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64
}

/// A height field of ten bumps over 2 × 2, by sums and quotients alone, which have the same bits on
/// every machine.
fn height(bumps: &[[f64; 4]], x: f64, y: f64) -> f64 {
    bumps
        .iter()
        .map(|[cx, cy, height, width]| {
            height / (1.0 + ((x - cx) * (x - cx) + (y - cy) * (y - cy)) / width)
        })
        .sum()
}

/// Two clouds of the bumps with the given number: they share seven tenths, and the second is moved.
fn write_generated(folder: &Path, number: usize) -> (String, String) {
    let mut seed = number as u64;
    let bumps: Vec<[f64; 4]> = (0..10)
        .map(|_| {
            let [x, y, h, w] = [0; 4].map(|_| random(&mut seed));
            [2.0 * x, 2.0 * y, h - 0.4, 0.01 + 0.05 * w]
        })
        .collect();
    // A rotation by a quaternion of simple numbers.
    let [w, x, y, z] = [0; 4].map(|_| (random(&mut seed) * 9.0).floor() - 4.0);
    let w = w + 5.0;
    let n = w * w + x * x + y * y + z * z;
    let r = [
        [w * w + x * x - y * y - z * z, 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
        [2.0 * (x * y + w * z), w * w - x * x + y * y - z * z, 2.0 * (y * z - w * x)],
        [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), w * w - x * x - y * y + z * z],
    ];
    let [source, target] = ["source", "target"].map(|side| {
        let moved = side == "target";
        let mut text = String::new();
        for _ in 0..900 {
            let x = 1.4 * random(&mut seed) + if moved { 0.6 } else { 0.0 };
            let y = 2.0 * random(&mut seed);
            let mut p = [x, y, height(&bumps, x, y)];
            if moved {
                p = r.map(|row| (row[0] * p[0] + row[1] * p[1] + row[2] * p[2]) / n);
            }
            writeln!(text, "{:.6} {:.6} {:.6}", p[0], p[1], p[2]).unwrap();
        }
        let name = format!("generated/{number:02}-{side}.xyz");
        fs::write(folder.join(&name), text).unwrap();
        name
    });
    (source, target)
}

/// FNV-1a (Fowler, Noll, Vo) over 64 bits.
fn digest(words: impl IntoIterator<Item = String>) -> u64 {
    words
        .into_iter()
        .flat_map(|word| (word + "\n").into_bytes())
        .fold(0xcbf2_9ce4_8422_2325, |hash, byte| {
            (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3)
        })
}

/// The columns of a row whose text is for people, and the number of the row.
const TEXTS: [&str; 5] = ["index", "doubts", "reasons", "error", "undetermined"];
/// The fields of a result that hold no number of the registration.
const LEFT_OUT: [&str; 2] = ["time_s", "config"];

fn numbers(value: &Value, found: &mut Vec<String>) {
    match value {
        Value::Number(_) | Value::Bool(_) | Value::Null => found.push(value.to_string()),
        Value::String(_) => {}
        Value::Array(values) => values.iter().for_each(|value| numbers(value, found)),
        Value::Object(fields) => fields
            .iter()
            .filter(|(name, _)| !LEFT_OUT.contains(&name.as_str()))
            .for_each(|(_, value)| numbers(value, found)),
    }
}

/// One line of the golden file.
#[derive(Debug, PartialEq, Clone)]
struct Line {
    digest: String,
    decision: String,
    /// Rotation vector and translation; empty where there is no pose.
    pose: Vec<f64>,
}

impl Line {
    fn new(digest: u64, decision: &str, rows: Option<[[f64; 4]; 4]>) -> Self {
        let pose = rows.map_or(Vec::new(), |rows| {
            let pose = Transform::from_matrix(rows).unwrap();
            let six = |x: f64| format!("{x:.6}").parse().unwrap();
            pose.rotation_vector().into_iter().chain(pose.translation).map(six).collect()
        });
        Line { digest: format!("{digest:016x}"), decision: decision.into(), pose }
    }

    fn is_near(&self, other: &Line) -> bool {
        let unit = 1.0 + self.pose.iter().skip(3).fold(0.0, |m: f64, x| m.max(x.abs()));
        self.decision == other.decision
            && self.pose.len() == other.pose.len()
            && self.pose.iter().zip(&other.pose).enumerate().all(|(axis, (a, b))| {
                (a - b).abs() <= TOLERANCE * if axis < 3 { 1.0 } else { unit }
            })
    }
}

type Lines = BTreeMap<(String, String), Line>;

fn run(folder: &Path, line: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_cfreg")).current_dir(folder).args(line).output().unwrap()
}

/// The lines of `cfreg batch` by one method.
fn batch(folder: &Path, method: &str, lines: &mut Lines) {
    let sample = if method == "consensus" { "1500" } else { "400" };
    let output = run(
        folder,
        &[
            "batch",
            "pairs.csv",
            "-o",
            "rows.csv",
            "--overwrite",
            "--method",
            method,
            "--sample",
            sample,
        ],
    );
    // A list without any pose to be used ends with 1.
    assert!(
        [Some(0), Some(1)].contains(&output.status.code()),
        "{method}: {}",
        String::from_utf8_lossy(&output.stderr)
    );
    let mut reader = csv::Reader::from_path(folder.join("rows.csv")).unwrap();
    let names = reader.headers().unwrap().clone();
    for row in reader.records() {
        let row = row.unwrap();
        let cell = |name: &str| &row[names.iter().position(|other| other == name).unwrap()];
        let cells = names
            .iter()
            .zip(row.iter())
            .filter(|(name, _)| !TEXTS.contains(name))
            .map(|(_, cell)| cell.to_owned());
        let pose = (!cell("t00").is_empty()).then(|| {
            [0, 1, 2, 3].map(|i| [0, 1, 2, 3].map(|j| cell(&format!("t{i}{j}")).parse().unwrap()))
        });
        let line = Line::new(digest(cells), cell("decision"), pose);
        lines.insert((cell("source").into(), format!("{method} row")), line);
    }
}

/// The line of `cfreg register --json`.
fn register(folder: &Path, pair: &(String, String), method: &str, lines: &mut Lines) {
    let out = run(
        folder,
        &["register", &pair.0, &pair.1, "--method", method, "--sample", "500", "--json"],
    );
    let line = match serde_json::from_slice::<Value>(&out.stdout) {
        Ok(answer) => {
            let mut words = Vec::new();
            numbers(&answer, &mut words);
            let decision = answer["verdict"]["decision"].as_str().unwrap_or("");
            let pose = serde_json::from_value(answer["transform"].clone()).unwrap();
            Line::new(digest(words), decision, Some(pose))
        }
        // The method has no answer, and says so.
        Err(_) => Line::new(out.status.code().unwrap() as u64, "error", None),
    };
    lines.insert((pair.0.clone(), format!("{method} json")), line);
}

/// The instructions and the library that decide about bits.
fn machine() -> String {
    #[cfg(target_arch = "x86_64")]
    let vectors = if std::is_x86_feature_detected!("avx512f") {
        "avx512"
    } else if std::is_x86_feature_detected!("avx2") {
        "avx2"
    } else {
        "sse"
    };
    #[cfg(not(target_arch = "x86_64"))]
    let vectors = std::env::consts::ARCH;
    let library = Command::new("ldd").arg("--version").output().ok();
    let library = library.and_then(|out| String::from_utf8(out.stdout).ok());
    let library = library.and_then(|text| text.lines().next().map(str::to_owned));
    format!("{vectors}, {}", library.unwrap_or_default())
}

fn golden_file() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden/digests.csv")
}

fn read(text: &str) -> Lines {
    let mut reader =
        csv::ReaderBuilder::new().comment(Some(b'#')).flexible(true).from_reader(text.as_bytes());
    reader
        .records()
        .map(|row| {
            let row = row.unwrap();
            let pose = row.iter().skip(4).map(|cell| cell.parse().unwrap()).collect();
            let line = Line { digest: row[2].into(), decision: row[3].into(), pose };
            ((row[0].into(), row[1].into()), line)
        })
        .collect()
}

fn written(lines: &Lines) -> String {
    let mut text =
        format!("# {}\nsource,method,digest,decision,rotation and translation\n", machine());
    for ((source, method), line) in lines {
        write!(text, "{source},{method},{},{}", line.digest, line.decision).unwrap();
        line.pose.iter().for_each(|x| write!(text, ",{x}").unwrap());
        text.push('\n');
    }
    text
}

#[test]
fn numbers_of_every_method_stay() {
    let temporary = tempfile::tempdir().unwrap();
    let folder = temporary.path();
    fs::create_dir(folder.join("generated")).unwrap();
    let mut pairs: Vec<(String, String)> =
        (0..GENERATED).map(|number| write_generated(folder, number)).collect();
    if let Some(scans) = shared_data() {
        let scans = fs::canonicalize(scans).unwrap();
        for entry in fs::read_dir(&scans).unwrap() {
            let entry = entry.unwrap();
            std::os::unix::fs::symlink(entry.path(), folder.join(entry.file_name())).unwrap();
        }
        pairs.extend(REAL.map(|(source, target)| (source.to_owned(), target.to_owned())));
    }
    let list: String =
        pairs.iter().map(|(source, target)| format!("{source},{target}\n")).collect();
    fs::remove_file(folder.join("pairs.csv")).ok();
    fs::write(folder.join("pairs.csv"), format!("source,target\n{list}")).unwrap();

    let mut found = Lines::new();
    for method in METHODS {
        batch(folder, method, &mut found);
    }
    for (number, pair) in pairs.iter().enumerate() {
        register(folder, pair, METHODS[number % METHODS.len()], &mut found);
    }

    if std::env::var_os("CFREG_UPDATE_DIGESTS").is_some() {
        assert!(pairs.len() > GENERATED, "the real scans are needed for all lines");
        fs::write(golden_file(), written(&found)).unwrap();
        return;
    }
    let text = fs::read_to_string(golden_file()).unwrap();
    let same_machine = text.lines().next() == Some(&format!("# {}", machine()));
    let golden = read(&text);
    if pairs.len() > GENERATED {
        assert_eq!(found.len(), golden.len(), "pairs or methods were added: write the file anew");
    }
    let changed: Vec<String> = found
        .iter()
        .filter_map(|(key, line)| {
            let Some(old) = golden.get(key) else { return Some(format!("{key:?} is new")) };
            let same = if same_machine { line == old } else { line.is_near(old) };
            (!same).then(|| format!("{key:?}\n  was {old:?}\n  is  {line:?}"))
        })
        .collect();
    assert!(
        changed.is_empty(),
        "{} of {} results changed (on {}the machine of the file):\n{}",
        changed.len(),
        found.len(),
        if same_machine { "" } else { "another than " },
        changed.join("\n")
    );
}
