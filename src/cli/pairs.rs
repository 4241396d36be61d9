//! `cfreg pairs`: lists of pairs of scans.

use std::fs;
use std::path::{Path, PathBuf};

use clap::{Args, Subcommand};

use super::{CommandOutcome, log, outputs};
use crate::batch::{self, PairList, ScanPositions};
use crate::error::{Error, Result};

#[derive(Args)]
pub(super) struct PairsCommand {
    #[command(subcommand)]
    mode: PairingMode,
}

#[derive(Subcommand)]
enum PairingMode {
    /// Each scan with earlier scans: the previous one, or ones further back
    Sequence {
        /// Scans in order; a folder stands for the clouds in it, sorted by name, 2 before 10
        #[arg(required = true)]
        scans: Vec<PathBuf>,
        /// Steps back: 1,2,5 pairs each scan with the previous one, the second and the fifth before it
        #[arg(long, value_name = "STEP,..", value_delimiter = ',', default_value = "1")]
        steps: Vec<usize>,
        /// The list, CSV
        #[arg(short, long, value_name = "PAIRS.csv")]
        output: PathBuf,
    },
    /// Each scan with one map
    Map {
        /// The map, the target of all pairs
        map: PathBuf,
        /// Scans; a folder stands for the clouds in it
        #[arg(required = true)]
        scans: Vec<PathBuf>,
        /// The list, CSV
        #[arg(short, long, value_name = "PAIRS.csv")]
        output: PathBuf,
    },
    /// All pairs of scans whose approximate positions are near each other
    Near {
        /// CSV with the columns cloud, a file relative to the folder of this one, and x, y, z, its
        /// position; other columns are ignored
        poses: PathBuf,
        /// Largest distance, in the unit of x, y, z
        #[arg(long, value_name = "R", allow_negative_numbers = true)]
        radius: f64,
        /// The list, CSV
        #[arg(short, long, value_name = "PAIRS.csv")]
        output: PathBuf,
    },
}

impl PairsCommand {
    pub(super) fn run(&self) -> Result<CommandOutcome> {
        match &self.mode {
            PairingMode::Sequence { scans, steps, output } => {
                let scans = find_clouds(scans)?;
                let pairs = batch::sequential_pairs(scans.len(), steps)?;
                write(&scans, pairs, output)
            }
            PairingMode::Map { map, scans, output } => {
                let mut scans = find_clouds(scans)?;
                let number = scans.len();
                scans.push(map.clone());
                write(&scans, (0..number).map(|scan| [scan, number]).collect(), output)
            }
            PairingMode::Near { poses, radius, output } => {
                outputs::check(&[poses], &[("output", Some(output))])?;
                let ScanPositions { names, positions: places } = ScanPositions::read(poses)?;
                let pairs = batch::radius_pairs(&places, *radius)?;
                let folder = poses.parent().unwrap_or(Path::new(""));
                let scans: Vec<PathBuf> = names.iter().map(|name| folder.join(name)).collect();
                write(&scans, pairs, output)
            }
        }
    }
}

/// Writes the list of these pairs, with paths relative to its folder.
fn write(scans: &[PathBuf], pairs: Vec<[usize; 2]>, output: &Path) -> Result<CommandOutcome> {
    let inputs: Vec<&Path> = scans.iter().map(PathBuf::as_path).collect();
    outputs::check(&inputs, &[("output", Some(output))])?;
    let folder = output.parent().filter(|folder| *folder != Path::new(""));
    let folder = canonicalize(folder.unwrap_or(Path::new(".")))?;
    let name = |file: &PathBuf| {
        let file = canonicalize(file)?;
        let name = file.strip_prefix(&folder).unwrap_or(&file);
        let name = name.to_str().map(String::from);
        let rule = "file name is not valid UTF-8";
        name.ok_or_else(|| Error::config("scans", file.display(), rule))
    };
    let names = scans.iter().map(name).collect::<Result<Vec<String>>>()?;
    if pairs.is_empty() {
        log("cfreg: no pair was found: the list is empty\n");
    }
    let list = PairList::new(folder, pairs.iter().map(|pair| pair.map(|scan| &names[scan])));
    list.write(output)?;
    log(&format!("{} pairs of {} clouds\n", list.len(), scans.len()));
    Ok(CommandOutcome::Trusted)
}

/// Resolves links.
fn canonicalize(path: &Path) -> Result<PathBuf> {
    fs::canonicalize(path).map_err(|error| Error::io(path, error))
}

/// Returns the files, and the clouds in folders, sorted by name.
fn find_clouds(given: &[PathBuf]) -> Result<Vec<PathBuf>> {
    const EXTENSIONS: [&str; 4] = ["ply", "pcd", "xyz", "xyzn"];
    let mut files = Vec::new();
    for path in given {
        if !path.is_dir() {
            files.push(path.clone());
            continue;
        }
        let failed = |error| Error::io(path, error);
        let within = fs::read_dir(path).map_err(failed)?;
        let within = within.map(|entry| entry.map(|entry| entry.path()).map_err(failed));
        let mut within = within.collect::<Result<Vec<PathBuf>>>()?;
        within.retain(|file| {
            let end = file.extension().unwrap_or_default().to_string_lossy().to_lowercase();
            EXTENSIONS.contains(&end.as_str())
        });
        if within.is_empty() {
            let rule = format!("no cloud in this folder (.{})", EXTENSIONS.join(", ."));
            return Err(Error::config("scans", path.display(), rule));
        }
        within.sort_by_cached_key(|file| natural_sort_key(&file.to_string_lossy()));
        files.extend(within);
    }
    Ok(files)
}

/// Returns the key that sorts digits by their number.
fn natural_sort_key(name: &str) -> Vec<(String, u128)> {
    let mut parts = Vec::new();
    let mut rest = name;
    while !rest.is_empty() {
        let digits = rest.find(|c: char| c.is_ascii_digit()).unwrap_or(rest.len());
        let (words, after) = rest.split_at(digits);
        let end = after.find(|c: char| !c.is_ascii_digit()).unwrap_or(after.len());
        let (number, after) = after.split_at(end);
        parts.push((words.into(), number.parse().unwrap_or(u128::MAX)));
        rest = after;
    }
    parts
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn digits_are_numbers() {
        let mut names = ["10.ply", "a2.ply", "9.ply", "a10b1.ply", "a10b.ply"];
        names.sort_by_key(|name| natural_sort_key(name));
        assert_eq!(names, ["9.ply", "10.ply", "a2.ply", "a10b1.ply", "a10b.ply"]);
    }
}
