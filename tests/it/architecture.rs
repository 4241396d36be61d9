//! The floors of the crate: which top-level module may import which.
//!
//! Every `crate::name` or `super::name` in `src/` that names a top-level module
//! must point at a floor strictly below the importing module's own, except for
//! the sideways arrows in `SIDEWAYS`. Arrows that only go down cannot form a
//! cycle; `sideways_is_acyclic` checks the rest.
use std::collections::BTreeSet;
use std::fs;
use std::path::Path;

const FLOORS: &[(u8, &[&str])] = &[
    (0, &["error", "math", "par"]),
    (1, &["cloud", "weight"]),
    (2, &["io", "search", "moments"]),
    (3, &["filter", "normals", "keypoint", "descriptor", "pose", "visibility"]),
    (4, &["surface"]),
    (5, &["verify"]),
    (6, &["method"]),
    (7, &["pose_graph"]),
    (8, &["batch"]),
    (9, &["figure"]),
    (10, &["benchmark"]),
    (11, &["report"]),
    (12, &["cli"]),
];
const SIDEWAYS: &[(&str, &str)] = &[("math", "error"), ("par", "error"), ("descriptor", "normals")];

fn floor(module: &str) -> Option<u8> {
    FLOORS.iter().find(|(_, names)| names.contains(&module)).map(|(floor, _)| *floor)
}

fn allowed(from: &str, to: &str) -> bool {
    from == to || floor(to) < floor(from) || SIDEWAYS.contains(&(from, to))
}

fn word(text: &str) -> String {
    text.trim_start().chars().take_while(|c| c.is_alphanumeric() || *c == '_').collect()
}

/// Names right after `prefix`, with `prefix{a::x, b}` opened; line comments dropped.
fn names_after(prefix: &str, text: &str) -> BTreeSet<String> {
    let code: Vec<&str> = text.lines().map(|l| l.split("//").next().unwrap_or("")).collect();
    let code = code.join(" ");
    let mut names = BTreeSet::new();
    for rest in code.split(prefix).skip(1) {
        let Some(group) = rest.strip_prefix('{') else {
            names.insert(word(rest));
            continue;
        };
        let (mut depth, mut item) = (0, String::new());
        for c in group.chars() {
            match c {
                '{' => depth += 1,
                '}' if depth == 0 => break,
                '}' => depth -= 1,
                ',' if depth == 0 => {
                    names.insert(word(&item));
                    item.clear();
                    continue;
                }
                _ => {}
            }
            item.push(c);
        }
        names.insert(word(&item));
    }
    names
}

fn walk(dir: &Path, visit: &mut impl FnMut(&Path)) {
    walk_files(dir, &["rs"], visit);
}

/// Visits the files with one of these `endings`, without what tools have left.
fn walk_files(dir: &Path, endings: &[&str], visit: &mut impl FnMut(&Path)) {
    for entry in fs::read_dir(dir).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            if !path.ends_with("target") && !path.ends_with("__pycache__") {
                walk_files(&path, endings, visit);
            }
        } else if path.extension().is_some_and(|e| endings.iter().any(|&known| e == known)) {
            visit(&path);
        }
    }
}

#[test]
fn imports_only_go_down() {
    let src = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let (mut bad, mut seen) = (Vec::new(), 0);
    walk(&src, &mut |path| {
        let rel = path.strip_prefix(&src).unwrap();
        let from = rel.iter().next().unwrap().to_str().unwrap().trim_end_matches(".rs");
        if ["lib", "main"].contains(&from) {
            return;
        }
        assert!(floor(from).is_some(), "{from} has no floor: add it to FLOORS");
        let text = fs::read_to_string(path).unwrap();
        for to in names_after("crate::", &text).union(&names_after("super::", &text)) {
            // Not a top-level module: a re-export at the root (Error), or a local submodule.
            if floor(to).is_some() {
                seen += 1;
                if !allowed(from, to) {
                    bad.push(format!("{} -> {to}", rel.display()));
                }
            }
        }
    });
    assert!(seen > 0, "no import was read: the scanner is broken");
    assert!(bad.is_empty(), "arrows that go up or sideways:\n{}", bad.join("\n"));
}

#[test]
fn sideways_is_acyclic() {
    for &(from, to) in SIDEWAYS {
        assert_eq!(floor(from), floor(to), "{from} -> {to} is not sideways");
        let mut reached = BTreeSet::from([to]);
        for _ in SIDEWAYS {
            let next: Vec<&str> =
                SIDEWAYS.iter().filter(|(a, _)| reached.contains(a)).map(|(_, b)| *b).collect();
            reached.extend(next);
        }
        assert!(!reached.contains(from), "cycle through {from}");
    }
}

#[test]
fn the_scanner_sees_what_it_should() {
    let text = "use crate::{Error, a::{b, c}, d}; // crate::no\nlet _ = crate::e::f();";
    let want = ["Error", "a", "d", "e"].map(String::from);
    assert_eq!(names_after("crate::", text), BTreeSet::from(want));
    assert!(!allowed("math", "method") && allowed("method", "math"));
}

/// Names of an earlier vocabulary, each with the word of the field that took its place.
const OLD_NAMES: &[(&str, &str)] = &[
    ("Doubt", "Warning"),
    ("Judgement", "EvaluationReport"),
    ("TruthError", "PoseError"),
    ("Chain", "Pipeline"),
    ("Describe", "FeatureConfig"),
    ("Prepared", "FeatureCloud"),
    ("Described", "FeatureView"),
    ("Connections", "WeightGraph"),
    ("Positions", "PositionProblem"),
    ("Onto", "TargetIndex"),
    ("Whole", "FilteredCloud"),
    ("Thin", "DownsampledScan"),
    ("Thinned", "DownsampledKey"),
    ("Thinning", "Downsampling"),
    ("Glance", "ViewpointSample"),
    ("Attempt", "ViewpointTrial"),
    ("Matches", "Correspondences"),
    ("Settled", "Refined"),
    ("Effort", "RefineOptions"),
    ("Contact", "SurfacePair"),
    ("Standing", "Confidence"),
    ("Judged", "ScoredPose"),
    ("OtherScale", "ScaleMismatch"),
    ("Sight", "OrientedSample"),
    ("RangeLimit", "MaxRangeReturns"),
    ("Vicinity", "OccupancyGrid"),
    ("Closest", "NearestDistances"),
    ("Gathered", "GatheredTile"),
    ("Compact", "BoundedSide"),
    ("Places", "ScanPositions"),
    ("Watch", "Deadlines"),
    ("Stand", "PoseView"),
    ("Bulk", "BatchReport"),
    ("Hall", "LectureHall"),
    ("Screened", "ScreeningResult"),
    ("panics_go_to_rows", "install_panic_hook"),
    ("may_hold", "may_contain"),
    ("without_carrier", "remove_ego_vehicle"),
    ("go_on", "refine_from"),
    ("truth_error", "pose_error"),
    ("voxel_side", "voxel_size_for"),
];

#[test]
fn old_names_do_not_come_back() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut found = Vec::new();
    for folder in ["src", "paper/src", "python/src"] {
        walk(&root.join(folder), &mut |path| {
            let text = fs::read_to_string(path).unwrap();
            let code = text.lines().map(|line| line.split("//").next().unwrap_or(""));
            let declared = ["struct", "enum", "trait", "type", "fn", "mod"];
            for line in code {
                let words: Vec<&str> =
                    line.split(|c: char| !(c.is_alphanumeric() || c == '_')).collect();
                for pair in words.windows(2).filter(|pair| declared.contains(&pair[0])) {
                    let old = OLD_NAMES.iter().find(|(old, _)| *old == pair[1]);
                    let of = (pair[0], pair[1]) == ("fn", "of");
                    if let Some((old, new)) = old {
                        found.push(format!("{}: {old} is {new}", path.display()));
                    } else if of {
                        let rule = "fn of: new, from_x, compute or another verb";
                        found.push(format!("{}: {rule}", path.display()));
                    }
                }
            }
        });
    }
    assert!(found.is_empty(), "{}", found.join("\n"));
}

/// Wordings of an earlier vocabulary, each with the one that took its place.
const OLD_PHRASES: &[(&str, &str)] = &[
    ("to be trusted", "poses to use, has warnings"),
    ("without answer", "without a pose"),
    ("without an answer", "without a pose"),
];

#[test]
fn old_names_and_phrases_do_not_come_back_in_python_and_texts() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let (mut found, mut seen) = (Vec::new(), 0);
    for folder in ["src", "python", "docs", "python-ref", "paper/src"] {
        walk_files(&root.join(folder), &["rs", "py", "pyi", "md", "html"], &mut |path| {
            seen += 1;
            let text = fs::read_to_string(path).unwrap();
            for (old, new) in OLD_PHRASES {
                if text.contains(old) {
                    found.push(format!("{}: \"{old}\" is \"{new}\"", path.display()));
                }
            }
            if path.extension().is_none_or(|ending| ending != "py") {
                return;
            }
            for line in text.lines().map(str::trim_start) {
                let declared = ["class ", "def "].iter().find_map(|kind| line.strip_prefix(kind));
                let name = declared.map(word).unwrap_or_default();
                if let Some((old, new)) = OLD_NAMES.iter().find(|(old, _)| *old == name) {
                    found.push(format!("{}: {old} is {new}", path.display()));
                }
            }
        });
    }
    assert!(seen > 100, "only {seen} files were read");
    assert!(found.is_empty(), "{}", found.join("\n"));
}
