//! Reading of clouds with `--voxel`, `--sample`, `--seed` and `--viewpoints`.

use std::path::Path;

use clap::{Arg, ArgMatches, Args, Command, FromArgMatches, value_parser};

use super::given::GivenOptions;
use super::log;
use crate::cloud::{PointCloud, ViewpointSource};
use crate::error::{Error, Result};
use crate::filter::{self, Downsampling};
use crate::io::{self, Differences};

/// Reads `path`, and logs what was made of its contents.
fn read_file_with_notes(path: &Path) -> Result<PointCloud> {
    let (cloud, differences) = read_file(path)?;
    for note in &differences.notes {
        log(&format!("cfreg: {}: {note}\n", path.display()));
    }
    Ok(cloud)
}

/// Leaves marks of missing returns out unless they are to be kept, and logs them.
fn without_no_returns(cloud: PointCloud, path: &Path, keep_no_returns: bool) -> PointCloud {
    let marks = filter::find_no_returns(&cloud);
    for mark in &marks {
        let ([x, y, z], rows) = (mark.place, mark.rows);
        let path = path.display();
        let done = match keep_no_returns {
            true => "kept",
            false => "left out as missing returns; --keep-no-returns keeps them",
        };
        log(&format!("cfreg: {path}: {rows} points at exactly ({x}, {y}, {z}) are {done}\n"));
    }
    // Most clouds have none, and need no second search.
    match keep_no_returns || marks.is_empty() {
        true => cloud,
        false => filter::remove_no_returns(cloud),
    }
}

/// Reads and downsamples `path`, and returns the differences from the file; marks of missing returns
/// stay.
pub(super) fn read_with_differences(
    path: &Path,
    thinning: &Downsampling,
) -> Result<(PointCloud, Differences)> {
    let (cloud, differences) = read_file(path)?;
    Ok((thinning.apply(cloud, 0)?, differences))
}

fn read_file(path: &Path) -> Result<(PointCloud, Differences)> {
    let (cloud, differences) = io::read_with_differences(path)?;
    if cloud.dropped() > 0 {
        let (path, dropped) = (path.display(), cloud.dropped());
        let what = "points with NaN or infinite coordinates";
        log(&format!("cfreg: {path}: left out {dropped} {what}\n"));
    }
    if cloud.no_returns() > 0 {
        let (path, rows) = (path.display(), cloud.no_returns());
        let what = "points that the format marks as missing returns";
        log(&format!("cfreg: {path}: left out {rows} {what}\n"));
    }
    Ok((cloud, differences))
}

/// Writes `cloud` to `path`, and logs the differences of the file from the cloud, and the
/// `differences` of the cloud from its own file.
pub(super) fn write(path: &Path, cloud: &PointCloud, differences: Differences) -> Result<()> {
    io::write(path, cloud)?;
    let differences = differences.merge(io::differences(path, cloud)?);
    if !differences.is_empty() {
        log(&format!("cfreg: {}: {differences}\n", path.display()));
    }
    Ok(())
}

/// Reads the source and the target of a pair with what other programs computed of them.
pub(super) fn read_pair_given(
    files: [&Path; 2],
    thinning: &Downsampling,
    viewpoints: ViewpointSource,
    keep_no_returns: bool,
    given: &GivenOptions,
) -> Result<[PointCloud; 2]> {
    let [from, onto] = given.descriptors();
    let read = |path: &Path, descriptors: Option<&Path>, stream| {
        let mut cloud = read_file_with_notes(path)?;
        if given.names_rows() {
            check_rows(path, "matches", &cloud)?;
        }
        if let Some(descriptors) = descriptors {
            check_rows(path, "descriptors", &cloud)?;
            cloud = cloud.with_descriptors(io::read_descriptors(descriptors)?)?;
        }
        // Methods leave marks of missing returns out, and keep the numbers of the rows.
        let cloud = match given.names_rows() {
            true => cloud,
            false => without_no_returns(cloud, path, keep_no_returns),
        };
        viewpoints.apply(thinning.apply(cloud, stream)?)
    };
    Ok([read(files[0], from, 0)?, read(files[1], onto, 1)?])
}

/// Refuses a cloud whose points are not the rows of its file, which `option` names.
fn check_rows(path: &Path, option: &'static str, cloud: &PointCloud) -> Result<()> {
    match cloud.dropped() {
        0 => Ok(()),
        dropped => {
            let rule = format!(
                "{dropped} points with NaN or infinite coordinates were left out, so that the rows \
                 after them have moved up: write the file without these points first"
            );
            Err(Error::config(option, path.display(), rule))
        }
    }
}

/// Reads the source and the target of a pair; the samples of the two are independent.
pub(super) fn read_pair(
    files: [&Path; 2],
    thinning: &Downsampling,
    viewpoints: ViewpointSource,
    keep_no_returns: bool,
) -> Result<[PointCloud; 2]> {
    let given = GivenOptions::default();
    read_pair_given(files, thinning, viewpoints, keep_no_returns, &given)
}

/// The help of `--viewpoints`.
pub(super) const VIEWPOINTS_HELP: &str = "Viewpoints of the sensors: file (as the files say, if they do), origin (the zero of each \
     file's frame, if a file says nothing), none (unknown)";

impl Args for Downsampling {
    fn augment_args(command: Command) -> Command {
        let option = |name: &'static str, unit: &'static str, help: &'static str| {
            Arg::new(name).long(name).value_name(unit).help(help).allow_negative_numbers(true)
        };
        let voxel = "Keep one point (the mean) per voxel of this side, in the unit of the \
                     coordinates; for consensus the voxel size, from which all other distances follow";
        let sample = "Keep this many points, drawn at random, after --voxel";
        let seed = "Seed of --sample; the two clouds of a pair are drawn independently";
        command.args([
            option("voxel", "V", voxel).value_parser(value_parser!(f64)),
            option("sample", "N", sample).value_parser(value_parser!(usize)),
            option("seed", "S", seed).value_parser(value_parser!(u64)).default_value("0"),
        ])
    }

    fn augment_args_for_update(command: Command) -> Command {
        Self::augment_args(command)
    }
}

impl FromArgMatches for Downsampling {
    fn from_arg_matches(typed: &ArgMatches) -> std::result::Result<Self, clap::Error> {
        Ok(Downsampling {
            voxel: typed.get_one("voxel").copied(),
            sample: typed.get_one("sample").copied(),
            seed: typed.get_one("seed").copied().unwrap_or_default(),
        })
    }

    fn update_from_arg_matches(
        &mut self,
        typed: &ArgMatches,
    ) -> std::result::Result<(), clap::Error> {
        *self = Self::from_arg_matches(typed)?;
        Ok(())
    }
}
