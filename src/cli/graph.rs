//! `cfreg graph`: results of a list as a graph of poses.

use std::path::PathBuf;

use clap::{Args, ValueEnum};

use super::{Outcome, log, outputs};
use crate::batch::{self, RowGraph};
use crate::error::Result;
use crate::pose_graph::Tangent;

#[derive(Args)]
pub(super) struct ToGraph {
    /// Results of `cfreg batch`: .csv, .jsonl or .parquet, or a folder with .parquet in it
    results: PathBuf,
    /// The graph: a vertex a cloud, an edge with its information for each accepted pose
    #[arg(short, long, value_name = "GRAPH.g2o")]
    output: PathBuf,
    /// Names of the clouds by the numbers of their vertices, CSV
    #[arg(long, value_name = "NAMES.csv")]
    names: Option<PathBuf>,
    /// By what the reader of the graph measures rotations
    #[arg(long, value_enum, default_value_t)]
    rotations: Rotations,
}

#[derive(Clone, Copy, Default, ValueEnum)]
enum Rotations {
    /// The vector part of quaternions: g2o
    #[default]
    Quaternion,
    /// Rotation vectors: GTSAM
    Vector,
}

impl ToGraph {
    pub(super) fn run(&self) -> Result<Outcome> {
        let outputs = [("output", Some(&*self.output)), ("names", self.names.as_deref())];
        outputs::check(&[&self.results], &outputs)?;
        let found = RowGraph::new(&batch::results::read(&self.results)?)?;
        let tangent = match self.rotations {
            Rotations::Quaternion => Tangent::Quaternion,
            Rotations::Vector => Tangent::RotationVector,
        };
        found.graph.write(&self.output, tangent)?;
        if let Some(names) = &self.names {
            found.write_names(names)?;
        }
        log(&format!(
            "{} clouds in {} parts, {} edges; {} poses not accepted, {} left out\n",
            found.graph.names().len(),
            found.graph.parts(),
            found.graph.edges(),
            found.not_accepted,
            found.left_out
        ));
        Ok(Outcome::Trusted)
    }
}
