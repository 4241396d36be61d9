//! How many points of a file are used: `--voxel`, `--sample` and `--seed`.

use std::path::Path;

use clap::{Arg, ArgMatches, Args, Command, FromArgMatches, value_parser};

use super::say;
use crate::cloud::PointCloud;
use crate::error::Result;
use crate::filter::Thinning;
use crate::io;

/// Reads `path` and thins it; `stream` keeps the samples of a pair independent.
pub(super) fn read(path: &Path, thinning: &Thinning, stream: u64) -> Result<PointCloud> {
    let cloud = io::read(path)?;
    if cloud.dropped() > 0 {
        let (path, dropped) = (path.display(), cloud.dropped());
        let what = "points with NaN or infinite coordinates";
        say(&format!("cfreg: {path}: left out {dropped} {what}\n"));
    }
    thinning.apply(cloud, stream)
}

impl Args for Thinning {
    fn augment_args(command: Command) -> Command {
        let option = |name: &'static str, unit: &'static str, help: &'static str| {
            Arg::new(name).long(name).value_name(unit).help(help).allow_negative_numbers(true)
        };
        let voxel = "Keep one point (the mean) per cube of this side, in the unit of the \
                     coordinates; for consensus the length that all others follow from";
        let sample = "Keep this many points, drawn at random (after --voxel)";
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

impl FromArgMatches for Thinning {
    fn from_arg_matches(typed: &ArgMatches) -> std::result::Result<Self, clap::Error> {
        Ok(Thinning {
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
