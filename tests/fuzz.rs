//! The fuzz targets without a fuzzer: seeds, and what becomes of them by changes drawn at random,
//! the same in every run. Long runs with a fuzzer are those of `fuzz/run.sh`.
//!
//! `cargo test --features cli --test fuzz -- --nocapture` prints how many inputs each target has got, and
//! `FUZZ_TIMES=20` before it makes that twenty times as many.
#![cfg(unix)]

#[path = "../fuzz/src/lib.rs"]
mod fuzz;

use std::fs;
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::path::{Path, PathBuf};
use std::time::Instant;

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Longest input.
const LONGEST: usize = 16 << 10;

fn seeds(target: &str) -> Vec<(PathBuf, Vec<u8>)> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("fuzz/seeds").join(target);
    let files = fs::read_dir(&folder).unwrap_or_else(|error| panic!("{folder:?}: {error}"));
    let mut files: Vec<PathBuf> = files.map(|file| file.unwrap().path()).collect();
    files.sort();
    files.into_iter().map(|file| (file.clone(), fs::read(file).unwrap())).collect()
}

/// Hands all seeds of a target to it, then so many inputs that are made of them.
fn drive(target: &str, executions: usize) {
    let (_, run) = fuzz::TARGETS.into_iter().find(|(name, _)| *name == target).unwrap();
    let seeds: Vec<Vec<u8>> = seeds(target).into_iter().map(|(_, seed)| seed).collect();
    let guarded = |input: &[u8], number: usize| {
        catch_unwind(AssertUnwindSafe(|| run(input))).unwrap_or_else(|panic| {
            let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("{target}-{number}"));
            fs::write(&path, input).unwrap();
            eprintln!("the input is in {}", path.display());
            resume_unwind(panic)
        });
    };
    let mut random = ChaCha8Rng::seed_from_u64(target.bytes().map(u64::from).sum());
    let times = std::env::var("FUZZ_TIMES").ok().and_then(|times| times.parse().ok());
    let executions = executions * times.unwrap_or(1);
    let (start, mut slowest) = (Instant::now(), 0.0f64);
    seeds.iter().enumerate().for_each(|(number, seed)| guarded(seed, number));
    for number in 0..executions {
        let mut input = seeds[random.random_range(0..seeds.len())].clone();
        for _ in 0..random.random_range(1..=5) {
            change(&mut input, &seeds, &mut random);
        }
        input.truncate(LONGEST);
        let began = Instant::now();
        guarded(&input, number);
        slowest = slowest.max(began.elapsed().as_secs_f64());
    }
    let (seconds, count) = (start.elapsed().as_secs_f64(), seeds.len() + executions);
    println!(
        "{target}: {count} inputs in {seconds:.1} s, {:.0} a second, the slowest took {:.0} ms",
        count as f64 / seconds,
        1000.0 * slowest
    );
}

/// Words that numbers are replaced by.
const NUMBERS: [&str; 22] = [
    "0",
    "-1",
    "1",
    "1e308",
    "-1e308",
    "1e309",
    "nan",
    "inf",
    "-inf",
    "1e-320",
    "1e-45",
    "3.4e38",
    "1e39",
    "4294967295",
    "4294967296",
    "18446744073709551615",
    "9223372036854775807",
    "1,5",
    "",
    "0x10",
    "1000000",
    "99999999999999999999999",
];
/// Numbers that lengths and values in binary are replaced by.
const VALUES: [u64; 10] =
    [0, 1, 0x7f, 0xff, 0xffff, 0x7fff_ffff, 0xffff_ffff, 0x7f80_0000, 0x7ff0_0000_0000_0000, !0];

/// One change: a bit, a byte, a number in words or in binary, a piece left out, repeated, moved or
/// taken from another seed.
fn change(input: &mut Vec<u8>, seeds: &[Vec<u8>], random: &mut ChaCha8Rng) {
    if input.is_empty() {
        input.push(random.random());
    }
    let at = random.random_range(0..input.len());
    let end = (at + random.random_range(1..=64)).min(input.len());
    match random.random_range(0..11) {
        0 => input[at] ^= 1 << random.random_range(0..8),
        1 => input[at] = random.random(),
        2 => input.truncate(at),
        3 => drop(input.drain(at..end)),
        4 => {
            let piece: Vec<u8> = input[at..end].repeat(random.random_range(1..=40));
            input.splice(at..at, piece);
        }
        5 => {
            let other = &seeds[random.random_range(0..seeds.len())];
            if !other.is_empty() {
                let from = random.random_range(0..other.len());
                let to = random.random_range(from..=other.len());
                input.splice(at..end, other[from..to].iter().copied());
            }
        }
        6 => {
            let other = &seeds[random.random_range(0..seeds.len())];
            input.truncate(at);
            input.extend(&other[at.min(other.len())..]);
        }
        7 | 8 => {
            let part = |byte: &u8| byte.is_ascii_digit() || b".+-eE".contains(byte);
            let before = input[..at].iter().rev().take_while(|byte| part(byte)).count();
            let after = input[at..].iter().take_while(|byte| part(byte)).count();
            let word = NUMBERS[random.random_range(0..NUMBERS.len())];
            input.splice(at - before..at + after, word.bytes());
        }
        9 => {
            let value = VALUES[random.random_range(0..VALUES.len())];
            let size = [1, 2, 4, 8][random.random_range(0..4)].min(input.len() - at);
            let bytes = value.to_le_bytes();
            input[at..at + size].copy_from_slice(&bytes[..size]);
            if random.random() {
                input[at..at + size].reverse();
            }
        }
        _ => {
            let mut lines: Vec<&[u8]> = input.split_inclusive(|&byte| byte == b'\n').collect();
            let (from, to) =
                (random.random_range(0..lines.len()), random.random_range(0..lines.len()));
            match random.random() {
                true => lines.swap(from, to),
                false => lines.insert(to, lines[from]),
            }
            *input = lines.concat();
        }
    }
}

macro_rules! targets {
    ($($name:ident $executions:literal,)*) => {$(
        #[test]
        fn $name() {
            drive(stringify!($name), $executions);
        }
    )*

        #[test]
        fn every_target_is_driven_and_has_small_seeds() {
            let driven = [$(stringify!($name)),*];
            assert_eq!(driven.map(String::from), fuzz::TARGETS.map(|(name, _)| name.to_string()));
            let mut bytes = 0;
            for (path, seed) in driven.into_iter().flat_map(seeds) {
                assert!(seed.len() < 2000, "{path:?}: {} bytes", seed.len());
                bytes += seed.len();
            }
            assert!(bytes < 200_000, "{bytes} bytes of seeds");
            // The binaries of cargo-fuzz are of the same names.
            let manifest = include_str!("../fuzz/Cargo.toml");
            for name in driven {
                assert!(manifest.contains(&format!("\"fuzz_targets/{name}.rs\"")), "{name}");
            }
        }
    };
}

targets! {
    ply 20_000,
    pcd 20_000,
    text 20_000,
    array 20_000,
    pose 20_000,
    list 20_000,
    parquet 10_000,
    rows 20_000,
    journal 2_000,
    report 20_000,
    benchmark 20_000,
    settings 20_000,
    round_trip 5_000,
    registration 100,
}
