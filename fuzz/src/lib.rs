//! Fuzz targets: one function each, which panics where an input breaks a promise.
//!
//! The binaries of cargo-fuzz hand bytes to these functions (`fuzz/run.sh`), and so does
//! `tests/fuzz.rs`, with the stable compiler and without a fuzzer. They go through the public doors
//! of `cfreg` alone.

mod batches;
mod bytes;
mod clouds;
mod door;
mod memory;
mod readers;
mod registrations;
mod settings;

pub use batches::journal;
pub use clouds::round_trip;
pub use readers::{array, benchmark, list, parquet, pcd, ply, pose, report, rows, text};
pub use registrations::registration;
pub use settings::settings;

/// A function that takes whatever bytes there are.
pub type Target = fn(&[u8]);

/// All targets with their names, which are those of the folders in `fuzz/seeds`.
///
/// The verdict's model has no file that is read at run time. Once it has, a target `model` belongs
/// here: a model that is read has finite coefficients, and a verdict by it a probability in [0, 1].
pub const TARGETS: [(&str, Target); 14] = [
    ("ply", ply),
    ("pcd", pcd),
    ("text", text),
    ("array", array),
    ("pose", pose),
    ("list", list),
    ("parquet", parquet),
    ("rows", rows),
    ("journal", journal),
    ("report", report),
    ("benchmark", benchmark),
    ("settings", settings),
    ("round_trip", round_trip),
    ("registration", registration),
];
