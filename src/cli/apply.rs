//! `cfreg apply`.

use std::path::{Path, PathBuf};

use clap::Args;

use super::{CommandOutcome, log, outputs};
use crate::batch::{Row, results};
use crate::cloud::Transform;
use crate::error::{Error, Result};
use crate::io;

#[derive(Args)]
pub(super) struct ApplyCommand {
    /// Pose to move by: 4×4 numbers, what register --json printed, or the results of batch, of which
    /// each file takes the row that has it as its source
    pose: PathBuf,
    /// Clouds to move
    #[arg(required = true)]
    files: Vec<PathBuf>,
    /// File to write, or a folder for files of the same names. In the same format everything but
    /// coordinates and normals stays; another extension gives another format
    #[arg(short, long, value_name = "OUT")]
    output: PathBuf,
    /// Move by the inverse of the pose
    #[arg(long)]
    inverse: bool,
}

impl ApplyCommand {
    pub(super) fn run(&self) -> Result<CommandOutcome> {
        let poses = Poses::read(&self.pose)?;
        let mut jobs = Vec::new();
        for file in &self.files {
            let output = self.output_of(file)?;
            io::check_applicable(file, &output)?;
            let pose = poses.find(file)?;
            jobs.push((file, if self.inverse { pose.inverse() } else { pose }, output));
        }
        let mut inputs = vec![self.pose.as_path()];
        inputs.extend(self.files.iter().map(PathBuf::as_path));
        let named: Vec<(&'static str, Option<&Path>)> =
            jobs.iter().map(|(_, _, output)| ("output", Some(output.as_path()))).collect();
        outputs::check(&inputs, &named)?;
        for (file, pose, output) in &jobs {
            let moved = io::apply(file, pose, output)?;
            let (from, to) = (file.display(), output.display());
            log(&format!("cfreg: moved {} points of {from} to {to}\n", moved.points));
            if !moved.differences.is_empty() {
                log(&format!("cfreg: {to}: {}\n", moved.differences));
            }
        }
        Ok(CommandOutcome::Trusted)
    }

    /// Returns the file that a moved file is written to.
    fn output_of(&self, file: &Path) -> Result<PathBuf> {
        if self.output.is_dir() {
            return Ok(self.output.join(file.file_name().unwrap_or_default()));
        }
        if self.files.len() > 1 {
            let rule = "must be a folder that exists, for more than one file";
            return Err(Error::config("output", self.output.display(), rule));
        }
        Ok(self.output.clone())
    }
}

/// The poses of a file: one for all clouds, or rows of pairs.
enum Poses {
    One(Transform),
    Rows(PathBuf, Vec<Row>),
}

impl Poses {
    fn read(path: &Path) -> Result<Poses> {
        let extension = path.extension().unwrap_or_default().to_string_lossy().to_lowercase();
        match extension.as_str() {
            "csv" | "parquet" | "jsonl" => {
                Ok(Poses::Rows(path.to_path_buf(), results::read(path)?))
            }
            _ => io::read_transform(path).map(Poses::One),
        }
    }

    /// Returns the pose of a cloud: of rows the only one that has its name as the source.
    fn find(&self, file: &Path) -> Result<Transform> {
        let (path, rows) = match self {
            Poses::One(pose) => return Ok(*pose),
            Poses::Rows(path, rows) => (path, rows),
        };
        let name = file.file_name();
        let is_own =
            |row: &&Row| Path::new(&row.source).file_name() == name && row.transform().is_some();
        let own: Vec<&Row> = rows.iter().filter(is_own).collect();
        match own[..] {
            [row] => {
                if !row.is_usable() {
                    let (from, path) = (file.display(), path.display());
                    log(&format!("cfreg: {from}: the pose in {path} has warnings\n"));
                }
                row.transform().ok_or_else(|| self.missing(file, 0))
            }
            _ => Err(self.missing(file, own.len())),
        }
    }

    fn missing(&self, file: &Path, found: usize) -> Error {
        let name = file.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let rule = format!(
            "{found} rows with a pose have this file as their source, expected 1: write the pose of \
             one pair to a file of 4 by 4 numbers"
        );
        Error::config("pose", name, rule)
    }
}
