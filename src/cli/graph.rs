//! `cfreg graph`: results of a list as a pose graph.

use std::path::PathBuf;

use clap::{Args, ValueEnum};

use super::{CommandOutcome, log, outputs};
use crate::batch::{self, RowGraph};
use crate::error::Result;
use crate::pose_graph::Tangent;

#[derive(Args)]
pub(super) struct GraphCommand {
    /// Results of `cfreg batch`: .csv, .jsonl or .parquet, or a folder with .parquet in it
    results: PathBuf,
    /// The graph: a vertex for each cloud, an edge with its information matrix for each accepted pose
    #[arg(short, long, value_name = "GRAPH.g2o")]
    output: PathBuf,
    /// Names of the clouds by vertex number, CSV
    #[arg(long, value_name = "NAMES.csv")]
    names: Option<PathBuf>,
    /// Rotation convention of the program that reads the graph
    #[arg(long, value_enum, default_value_t)]
    rotations: RotationConvention,
}

#[derive(Clone, Copy, Default, ValueEnum)]
enum RotationConvention {
    /// The vector part of quaternions: g2o
    #[default]
    Quaternion,
    /// Rotation vectors: GTSAM
    Vector,
}

impl GraphCommand {
    pub(super) fn run(&self) -> Result<CommandOutcome> {
        let outputs = [("output", Some(&*self.output)), ("names", self.names.as_deref())];
        outputs::check(&[&self.results], &outputs)?;
        let found = RowGraph::new(&batch::results::read(&self.results)?)?;
        let tangent = match self.rotations {
            RotationConvention::Quaternion => Tangent::Quaternion,
            RotationConvention::Vector => Tangent::RotationVector,
        };
        found.graph.write(&self.output, tangent)?;
        if let Some(names) = &self.names {
            found.write_names(names)?;
        }
        log(&format!(
            "{} clouds in {} parts, {} edges; {} poses not accepted, {} left out\n",
            found.graph.names().len(),
            found.graph.component_count(),
            found.graph.edge_count(),
            found.not_accepted,
            found.skipped
        ));
        Ok(CommandOutcome::Trusted)
    }
}
