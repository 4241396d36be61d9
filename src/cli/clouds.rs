//! `cfreg info` and `cfreg convert`.

use std::path::PathBuf;

use clap::Args;
use serde::Serialize;

use super::{CommandOutcome, input, log, outputs, print, print_json};
use crate::cloud::Transform;
use crate::error::Result;
use crate::filter::{self, Downsampling, NoReturns};
use crate::{io, search};

#[derive(Args)]
pub(super) struct InfoCommand {
    /// Files of clouds
    #[arg(required = true)]
    files: Vec<PathBuf>,
    /// Print a JSON array instead of text
    #[arg(long)]
    json: bool,
}

/// The content of a file.
#[derive(Serialize)]
struct CloudInfo {
    file: String,
    points: usize,
    dropped: usize,
    /// Rows that mark measurements without a return, of those points.
    no_returns: Vec<NoReturns>,
    normals: bool,
    weights: bool,
    channels: Vec<String>,
    viewpoint: Option<[f64; 3]>,
    low: Option<[f64; 3]>,
    high: Option<[f64; 3]>,
    diagonal: f64,
    resolution: f64,
}

impl InfoCommand {
    pub(super) fn run(&self) -> Result<CommandOutcome> {
        let mut all = Vec::new();
        for path in &self.files {
            let cloud = io::read(path)?;
            let bounds = cloud.bounds();
            let facts = CloudInfo {
                file: path.display().to_string(),
                points: cloud.len(),
                dropped: cloud.dropped(),
                no_returns: filter::find_no_returns(&cloud),
                normals: cloud.normals().is_some(),
                weights: cloud.weights().is_some(),
                channels: cloud.channels().names().map(String::from).collect(),
                viewpoint: cloud.viewpoint(),
                low: bounds.map(|(low, _)| low),
                high: bounds.map(|(_, high)| high),
                diagonal: cloud.diagonal(),
                resolution: search::resolution(cloud.points())?,
            };
            if !self.json {
                print(&facts.text())?;
            }
            all.push(facts);
        }
        if self.json {
            print_json(&all)?;
        }
        Ok(CommandOutcome::Trusted)
    }
}

impl CloudInfo {
    fn no_returns_text(&self) -> String {
        let text = |mark: &NoReturns| {
            let [x, y, z] = mark.place;
            format!("{} points at exactly ({x}, {y}, {z})", mark.rows)
        };
        match self.no_returns.iter().map(text).collect::<Vec<_>>().join(", ") {
            none if none.is_empty() => "no".into(),
            some => some,
        }
    }

    fn text(&self) -> String {
        let mut lines = vec![
            self.file.clone(),
            format!("  points      {} ({} left out: NaN or infinite)", self.points, self.dropped),
            format!("  no returns  {}", self.no_returns_text()),
            format!("  normals     {}", if self.normals { "yes" } else { "no" }),
        ];
        if self.weights {
            lines.push("  weights     yes".into());
        }
        if !self.channels.is_empty() {
            lines.push(format!("  channels    {}", self.channels.join(", ")));
        }
        if let Some(at) = self.viewpoint {
            lines.push(format!("  viewpoint   {at:?}"));
        }
        if let (Some(low), Some(high)) = (self.low, self.high) {
            lines.push(format!("  from        {low:?}"));
            lines.push(format!("  to          {high:?}"));
        }
        lines.push(format!("  diagonal    {:.6}", self.diagonal));
        lines.push(format!(
            "  resolution  {:.6} (median distance to the next point)",
            self.resolution
        ));
        lines.join("\n") + "\n"
    }
}

#[derive(Args)]
pub(super) struct ConvertCommand {
    /// Cloud to read; FILE.e57#2 is the second scan
    input: PathBuf,
    /// File to write, in the format of its extension: .ply .pcd .las .laz .e57 .xyz .txt .csv
    /// .pts .npy
    output: PathBuf,
    #[command(flatten)]
    thinning: Downsampling,
    /// Move the cloud by the 4×4 matrix in this file
    #[arg(long, value_name = "T.txt")]
    transform: Option<PathBuf>,
}

impl ConvertCommand {
    pub(super) fn run(&self) -> Result<CommandOutcome> {
        io::check_writable(&self.output)?;
        let mut inputs = vec![self.input.as_path()];
        inputs.extend(self.transform.as_deref());
        outputs::check(&inputs, &[("output", Some(&self.output))])?;
        let pose = self.transform.as_ref().map(io::read_transform).transpose()?;
        if self.thinning.voxel.is_none() && self.thinning.sample.is_none() && self.keeps_format() {
            let pose = pose.unwrap_or(Transform::IDENTITY);
            let moved = io::apply(&self.input, &pose, &self.output)?;
            let path = self.output.display();
            if !moved.differences.is_empty() {
                log(&format!("cfreg: {path}: {}\n", moved.differences));
            }
            log(&format!("cfreg: wrote {} points to {path}\n", moved.points));
            return Ok(CommandOutcome::Trusted);
        }
        let (mut cloud, differences) = input::read_with_differences(&self.input, &self.thinning)?;
        if let Some(pose) = &pose {
            cloud = cloud.transformed(pose)?;
        }
        input::write(&self.output, &cloud, differences)?;
        log(&format!("cfreg: wrote {} points to {}\n", cloud.len(), self.output.display()));
        Ok(CommandOutcome::Trusted)
    }

    /// Whether both files are LAS or LAZ, or both E57, which have more than a cloud has: records of
    /// their headers, several scans, images.
    fn keeps_format(&self) -> bool {
        let format = |path| io::Format::from_extension(path);
        let own = format(&self.input);
        matches!(own, Some(io::Format::Las | io::Format::E57)) && own == format(&self.output)
    }
}
