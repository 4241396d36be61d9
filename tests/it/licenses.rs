//! The notice of what binaries carry, `THIRD-PARTY.txt`, is that of `Cargo.lock`.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::Path;

use std::process::Command;

/// Crates that `Cargo.lock` lists for features of other crates that nothing here turns on:
/// `cargo tree --all-features --target all --invert NAME` finds none of them.
const NEVER_BUILT: [(&str, &str); 5] = [
    ("bytemuck_derive", "1"),
    ("gemm-f16", "0.19"),
    ("getrandom", "0.4"),
    ("r-efi", "6"),
    ("zlib-rs", "0.6"),
];
const ADVICE: &str = "make THIRD-PARTY.txt again with the command in CONTRIBUTING.md";

type Crates = BTreeSet<(String, String)>;

fn read(file: &str) -> String {
    fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join(file)).unwrap()
}

/// Name and version of each crate of the notice.
fn listed() -> Crates {
    let notice = read("THIRD-PARTY.txt");
    let (_, rest) = notice.split_once("\nCrates\n\n").unwrap();
    let (list, _) = rest.split_once("\nLicence texts\n").unwrap();
    let line = |line: &str| {
        let (name, license) = line.split_once(": ").unwrap();
        let (name, version) = name.split_once(' ').unwrap();
        assert!(!license.is_empty(), "{line}");
        (name.to_string(), version.to_string())
    };
    list.lines().filter(|line| !line.is_empty()).map(line).collect()
}

/// Dependencies of each package of `Cargo.lock`, by its name and version.
fn locked() -> BTreeMap<(String, String), Vec<String>> {
    let lock = read("Cargo.lock");
    let packages = lock.split("[[package]]").skip(1).map(|package| {
        let text = |key: &str| {
            let (_, rest) = package.split_once(&format!("\n{key} = \"")).unwrap();
            rest.split('"').next().unwrap().to_string()
        };
        let list = package.split_once("\ndependencies = [").map_or("", |(_, rest)| rest);
        let list = list.split(']').next().unwrap_or("");
        let needs = list.split('"').skip(1).step_by(2).map(str::to_string).collect();
        ((text("name"), text("version")), needs)
    });
    packages.collect()
}

/// Crates that the program and the Python extension need by `[dependencies]` of their manifests, on whatever platform, with those that
/// these need in turn.
fn needed() -> Crates {
    let locked = locked();
    let mut todo: Vec<&String> = Vec::new();
    for (package, manifest) in [("cfreg", "Cargo.toml"), ("cfreg-python", "python/Cargo.toml")] {
        let manifest = read(manifest);
        let (_, table) = manifest.split_once("\n[dependencies]\n").unwrap();
        let own: BTreeSet<&str> = table
            .split("\n[")
            .next()
            .unwrap()
            .lines()
            .filter(|line| !line.starts_with('#'))
            .filter_map(|line| line.split_once(" = ").map(|(name, _)| name))
            .filter(|name| *name != "cfreg")
            .collect();
        let needs = locked.iter().find(|((name, _), _)| name == package).unwrap().1;
        todo.extend(needs.iter().filter(|need| own.contains(need.split(' ').next().unwrap())));
    }
    let mut found = Crates::new();
    while let Some(need) = todo.pop() {
        let mut words = need.split(' ');
        let (name, version) = (words.next().unwrap(), words.next());
        let package = locked
            .iter()
            .find(|((other, at), _)| other == name && version.is_none_or(|version| version == at));
        let (key, needs) = package.unwrap();
        if found.insert(key.clone()) {
            todo.extend(needs);
        }
    }
    found
}

#[test]
fn the_notice_lists_the_crates_that_are_locked() {
    let (listed, needed) = (listed(), needed());
    assert!(needed.len() > 100, "{} crates: the reader of Cargo.lock is broken", needed.len());
    let gone: Vec<_> = listed.difference(&needed).collect();
    assert!(gone.is_empty(), "not in Cargo.lock: {gone:?}; {ADVICE}");
    let built = |(name, version): &&(String, String)| {
        !NEVER_BUILT.iter().any(|(other, of)| name == other && version.starts_with(of))
    };
    let missing: Vec<_> = needed.difference(&listed).filter(built).collect();
    assert!(missing.is_empty(), "not in THIRD-PARTY.txt: {missing:?}; {ADVICE}");
}

#[test]
fn the_notice_has_the_texts_and_nothing_of_the_machine_that_made_it() {
    let notice = read("THIRD-PARTY.txt");
    let texts = [
        "SIL OPEN FONT LICENSE Version 1.1",
        "UBUNTU FONT LICENCE Version 1.0",
        "Redistribution and use in source and binary forms",
        "Apache Arrow\nCopyright 2016",
        "Permission is hereby granted, free of charge",
    ];
    for text in texts {
        assert!(notice.contains(text), "{text} is missing; {ADVICE}");
    }
    for word in ["/home/", "/root/", "/Users/", ".cargo/", "crates.io"] {
        assert!(!notice.contains(word), "{word}");
    }
    // Each crate has a text.
    let (_, texts) = notice.split_once("\nLicence texts\n").unwrap();
    for (name, version) in listed() {
        assert!(texts.contains(&format!(" {name} {version}")), "{name} {version}; {ADVICE}");
    }
}

#[test]
fn wheels_have_the_notice() {
    let project = read("pyproject.toml");
    let files = project.lines().find(|line| line.starts_with("license-files = ")).unwrap();
    assert!(files.contains("\"THIRD-PARTY.txt\"") && files.contains("\"LICENSE-*\""), "{files}");
}

#[test]
fn the_command_line_prints_the_notice() {
    let output = Command::new(env!("CARGO_BIN_EXE_cfreg")).arg("licenses").output().unwrap();
    assert!(output.status.success());
    assert_eq!(String::from_utf8(output.stdout).unwrap(), read("THIRD-PARTY.txt"));
}
