//! Options that several commands share, as they are typed.

use std::path::Path;

use clap::Args;

use super::say;
use crate::cloud::PointCloud;
use crate::descriptor::HistogramScale;
use crate::error::{Error, Result};
use crate::method::{Cf, Describe, Method};
use crate::normals::Orientation;
use crate::pose::{ScaleEstimate, Solver};
use crate::search::Neighborhood;
use crate::weight::{Normalization, WeightScheme};
use crate::{filter, io};

/// How many points of a file are used.
#[derive(Args, Clone, serde::Serialize)]
pub(super) struct Thinning {
    /// Keep one point (the mean) per cube of this side, in the unit of the coordinates
    #[arg(long, value_name = "V", allow_negative_numbers = true)]
    voxel: Option<f64>,
    /// Keep this many points, drawn at random (after --voxel)
    #[arg(long, value_name = "N", allow_negative_numbers = true)]
    sample: Option<usize>,
    /// Seed of --sample; the two clouds of a pair are drawn independently
    #[arg(long, value_name = "S", default_value_t = 0, allow_negative_numbers = true)]
    seed: u64,
}

impl Thinning {
    /// Reads `path` and thins it; `stream` keeps the samples of a pair independent.
    pub(super) fn read(&self, path: &Path, stream: u64) -> Result<PointCloud> {
        let cloud = io::read(path)?;
        if cloud.dropped() > 0 {
            let (path, dropped) = (path.display(), cloud.dropped());
            let what = "points with NaN or infinite coordinates";
            say(&format!("cfreg: {path}: left out {dropped} {what}\n"));
        }
        self.apply(cloud, stream)
    }

    pub(super) fn apply(&self, mut cloud: PointCloud, stream: u64) -> Result<PointCloud> {
        if let Some(size) = self.voxel {
            cloud = filter::voxel_grid(&cloud, size)?;
        }
        if let Some(count) = self.sample {
            if count == 0 {
                return Err(Error::config("sample", 0, "must be at least 1"));
            }
            cloud = filter::sample(&cloud, count, self.seed.wrapping_mul(2).wrapping_add(stream));
        }
        Ok(cloud)
    }
}

/// The method and its settings. What is not typed keeps the default of the library.
#[derive(Args, Clone)]
pub(super) struct MethodOptions {
    /// Registration method: cf (the paper's full connection)
    #[arg(long, default_value = "cf")]
    method: String,
    /// Nearest points that describe a point, itself included; clouds with fewer use all
    /// [default: 150]
    #[arg(long, value_name = "K", conflicts_with = "radius", allow_negative_numbers = true)]
    neighbors: Option<usize>,
    /// Describe by all points within this radius instead, in the unit of the coordinates
    #[arg(long, value_name = "R", allow_negative_numbers = true)]
    radius: Option<f64>,
    /// Nearest points for normals [default: as for descriptors]
    #[arg(long, value_name = "K", allow_negative_numbers = true)]
    normal_neighbors: Option<usize>,
    /// Where normals point: viewpoint, outward, stored, or x,y,z to look towards
    /// [default: viewpoint]
    #[arg(long, value_name = "WHERE", allow_hyphen_values = true)]
    orientation: Option<String>,
    /// Whose FPFH scale: pcl or open3d [default: pcl]
    #[arg(long)]
    histogram: Option<HistogramScale>,
    /// Kernel: gaussian, laplacian, cauchy, geman-mcclure, truncated, student-t:NU, tukey,
    /// uniform [default: gaussian]
    #[arg(long)]
    weights: Option<WeightScheme>,
    /// Squared bandwidth of the kernel, in squared descriptor units [default: 100 with
    /// --histogram pcl, 400 with open3d]
    #[arg(long, allow_negative_numbers = true)]
    beta: Option<f64>,
    /// Normalisation of the full connection: none, source, target, both, sinkhorn:N
    /// [default: none]
    #[arg(long)]
    normalize: Option<Normalization>,
    /// Closed form: arun, horn-quaternion, horn-matrix, walker [default: arun]
    #[arg(long)]
    solver: Option<Solver>,
    /// Estimate a scale: fixed, umeyama, symmetric [default: fixed]
    #[arg(long)]
    scale: Option<ScaleEstimate>,
    /// Threads, 0 for all cores; never changes the result [default: 0]
    #[arg(long, value_name = "T", allow_negative_numbers = true)]
    pub(super) threads: Option<usize>,
}

impl MethodOptions {
    /// What was typed, laid over the method's defaults.
    pub(super) fn method(&self) -> Result<Method> {
        match self.method.parse()? {
            Method::Cf(cf) => Ok(Method::Cf(self.cf(cf)?)),
        }
    }

    fn cf(&self, default: Cf) -> Result<Cf> {
        let base = default.describe;
        let neighborhood = match (self.radius, self.neighbors) {
            (Some(radius), _) => Neighborhood::Radius(radius),
            (None, Some(k)) => Neighborhood::Nearest(k),
            (None, None) => base.neighborhood,
        };
        let orientation = match &self.orientation {
            Some(text) => orientation(text)?,
            None => base.orientation,
        };
        let describe = Describe {
            neighborhood,
            normal_neighborhood: self
                .normal_neighbors
                .map(Neighborhood::Nearest)
                .or(base.normal_neighborhood),
            orientation,
            histogram: self.histogram.unwrap_or(base.histogram),
        };
        Ok(Cf {
            describe,
            weights: self.weights.unwrap_or(default.weights),
            beta: self.beta.or(default.beta),
            normalization: self.normalize.unwrap_or(default.normalization),
            solver: self.solver.unwrap_or(default.solver),
            scale: self.scale.unwrap_or(default.scale),
            threads: self.threads.unwrap_or(default.threads),
        })
    }
}

fn orientation(text: &str) -> Result<Orientation> {
    match text {
        "viewpoint" => return Ok(Orientation::Viewpoint),
        "outward" => return Ok(Orientation::Outward),
        "stored" => return Ok(Orientation::Stored),
        _ => {}
    }
    let numbers: Option<Vec<f64>> = text.split(',').map(|x| x.trim().parse().ok()).collect();
    match numbers.as_deref() {
        Some(&[x, y, z]) => Ok(Orientation::Towards([x, y, z])),
        _ => {
            let rule = "must be viewpoint, outward, stored or three numbers x,y,z";
            Err(Error::config("orientation", text, rule))
        }
    }
}
