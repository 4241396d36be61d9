//! Options that several commands share.

use std::path::{Path, PathBuf};

use clap::{Args, ValueEnum};
use serde_json::{Value, json};

use crate::descriptor::HistogramScale;
use crate::error::{Error, Result};
use crate::filter::Downsampling;
use crate::io;
use crate::method::{Consensus, GivenDescriptors, Method, Pipeline};
use crate::pose::{Prior, RotationBound, ScaleEstimate, Solver};
use crate::verify::VerdictModel;
use crate::weight::{Bandwidth, Normalization, WeightScheme};

/// Constraints on the pose and channels of the points, for registration and for verification.
#[derive(Args, Clone)]
pub(super) struct PriorOptions {
    /// Compare points also by these channels of the clouds, as in intensity:0.5,red,green,blue; a
    /// share of 1 (the default) has as much influence as the whole shape
    #[arg(long, value_name = "NAME[:SHARE],..", value_delimiter = ',')]
    channels: Vec<String>,
    /// A direction that is known in both frames, such as gravity, in the source's frame and, after a
    /// colon, in the target's; if both are equal, it is the axis of rotation: 0,0,1 leaves only the yaw free
    #[arg(long, value_name = "X,Y,Z[:X,Y,Z]", allow_hyphen_values = true)]
    direction: Option<String>,
    /// A pose whose rotation is known, exactly or approximately: a file with its 4×4 matrix
    #[arg(long, value_name = "T.txt")]
    near: Option<PathBuf>,
    /// Largest deviation from the rotation of --near, in degrees [default: 0, exactly known]
    #[arg(long, value_name = "DEG", requires = "near", allow_negative_numbers = true)]
    within: Option<f64>,
}

impl PriorOptions {
    /// Returns the search that verifies a pose under these constraints, with this voxel size if there
    /// is one.
    pub(super) fn verifier(&self, voxel: Option<f64>) -> Result<Consensus> {
        let channels = self.channels.iter().map(|text| text.parse()).collect::<Result<_>>()?;
        let judge = Consensus { voxel, prior: self.prior()?, channels, ..Consensus::default() };
        judge.validate()?;
        Ok(judge)
    }

    /// Returns the name of the first option that is given.
    pub(super) fn given_option(&self) -> Option<&'static str> {
        let all = [
            ("channels", !self.channels.is_empty()),
            ("direction", self.direction.is_some()),
            ("near", self.near.is_some()),
        ];
        all.into_iter().find_map(|(name, typed)| typed.then_some(name))
    }

    /// Returns the constraints on the pose.
    fn prior(&self) -> Result<Prior> {
        let mut prior = Prior::default();
        if let Some(text) = &self.direction {
            let (source, target) = text.split_once(':').unwrap_or((text, text));
            let read = |part: &str| parse_numbers(part).and_then(|all| all.try_into().ok());
            let (Some(source), Some(target)) = (read(source), read(target)) else {
                let rule = "must be X,Y,Z or X,Y,Z:X,Y,Z";
                return Err(Error::config("direction", text, rule));
            };
            prior.direction = Some([source, target]);
        }
        if let Some(path) = &self.near {
            let within_deg = self.within.unwrap_or(0.0);
            let vector = io::read_transform(path)?.rotation_vector();
            prior.rotation = Some(RotationBound { vector, within_deg });
        }
        Ok(prior)
    }
}

/// The method and its settings. Options that are not given keep the defaults of the library.
#[derive(Args, Clone)]
pub(super) struct MethodOptions {
    /// Registration method. Without an initial pose: consensus (for scans that overlap in part), cf
    /// (the paper's full connection), cf-multiscale (at three scales, with a bandwidth from the
    /// descriptors and dual softmax: other defaults below), cf-spectral (its strongest connections,
    /// weighted by those that are compatible with them: one step for scans that overlap in part), cfk
    /// (of keypoints), teaser. From the current pose of the clouds: icp, icp-paper (the paper's
    /// settings), plane-icp, gicp, kc, cpd, dare
    #[arg(long, default_value = "consensus")]
    method: String,
    /// Refine the pose by these methods, one after the other: icp, icp-paper, plane-icp, gicp, kc,
    /// cpd, dare
    #[arg(long, value_name = "METHOD,..", value_delimiter = ',')]
    refine: Vec<String>,
    /// Number of nearest points of a descriptor, the point itself included; a smaller cloud uses all
    /// (cf-spectral: 100) [default: 150]
    #[arg(long, value_name = "K", conflicts_with = "radius", allow_negative_numbers = true)]
    neighbors: Option<usize>,
    /// Compute descriptors from all points within this radius instead, in the unit of the coordinates
    #[arg(long, value_name = "R", allow_negative_numbers = true)]
    radius: Option<f64>,
    /// Additional scales of descriptors, which are concatenated: the number of nearest points of each
    /// and, after a colon, that of its normals, if not those of the first scale
    #[arg(long, value_name = "K[:NORMALS],..", value_delimiter = ',')]
    more_neighbors: Vec<String>,
    /// Number of nearest points of a normal [default: as for descriptors]
    #[arg(long, value_name = "K", allow_negative_numbers = true)]
    normal_neighbors: Option<usize>,
    /// Orientation of normals: viewpoint, outward, stored, or a position x,y,z to face
    /// [default: viewpoint]
    #[arg(long, value_name = "WHERE", allow_hyphen_values = true)]
    orientation: Option<String>,
    /// Scale of FPFH: pcl or open3d [default: pcl]
    #[arg(long)]
    histogram: Option<HistogramScale>,
    /// Kernel: gaussian, laplacian, cauchy, geman-mcclure, truncated, student-t:NU, tukey,
    /// uniform [default: gaussian]
    #[arg(long)]
    weights: Option<WeightScheme>,
    /// Squared bandwidth of the kernel, in squared descriptor units; or auto or auto:SHARE, a share
    /// (0.25) of the median squared distance to the most similar point [default: 100 with --histogram pcl, 400 with
    /// open3d]
    #[arg(long, allow_negative_numbers = true)]
    beta: Option<Bandwidth>,
    /// Normalisation of the full connection: none, source, target, both, sinkhorn:N
    /// [default: none]
    #[arg(long)]
    normalize: Option<Normalization>,
    /// Closed-form solver: arun, horn-quaternion, horn-matrix, walker [default: arun]
    #[arg(long)]
    solver: Option<Solver>,
    /// Estimate a scale: fixed, umeyama, symmetric [default: fixed]
    #[arg(long)]
    scale: Option<ScaleEstimate>,
    #[command(flatten)]
    prior_options: PriorOptions,
    /// Bounds of an estimated scale
    #[arg(long, value_name = "LOW,HIGH")]
    scale_bounds: Option<String>,
    /// Any other setting of the method, by its name in the `config` of --json; with the name of a
    /// refinement in front, a setting of that refinement: --set icp.max_distance=0.05
    #[arg(long, value_name = "[METHOD.]NAME=VALUE", allow_hyphen_values = true)]
    set: Vec<String>,
    /// Verification of poses of methods without a verdict of their own, by a search like that of
    /// consensus: on, off, or auto, which verifies every pose, except, in bulk, those of cf, icp,
    /// plane-icp and gicp, for which a verdict takes longer than the registration
    #[arg(
        long, value_name = "WHEN", num_args = 0..=1, require_equals = true,
        default_value = "auto", default_missing_value = "on"
    )]
    verdict: VerdictMode,
    #[arg(long, value_name = "FILE", help = VERDICT_MODEL)]
    verdict_model: Option<PathBuf>,
    /// Keep rows that mark measurements without a return: 20 or more at exactly one position, mostly
    /// (0, 0, 0)
    #[arg(long)]
    pub(super) keep_no_returns: bool,
    /// Whether many pairs are registered
    #[arg(skip)]
    bulk: bool,
    /// Number of threads, 0 for all cores; never changes the result [default: 0]
    #[arg(long, value_name = "T", allow_negative_numbers = true)]
    pub(super) threads: Option<usize>,
}

/// The help of `--verdict-model`.
pub(super) const VERDICT_MODEL: &str = "Model that ranks poses and gives verdicts, a file like \
                                        src/verify/model.json [default: the built-in one]";

/// Verification of poses that have no verdict.
#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
enum VerdictMode {
    Auto,
    On,
    Off,
}

impl MethodOptions {
    /// Returns the method with all options: a method that starts from a pose starts from that of
    /// `--near`, and the pose is verified as `--verdict` says.
    pub(super) fn chain(&self) -> Result<Pipeline> {
        let mut chain = self.method()?;
        if let Some(near) = &self.prior_options.near
            && chain.first().as_refinement().is_some()
        {
            chain = chain.with_initial(io::read_transform(near)?)?;
        }
        if self.keep_no_returns {
            chain = chain.keep_no_returns();
        }
        let verified = match self.verdict {
            VerdictMode::Auto => !self.bulk || chain.is_slower_than_verdict(),
            VerdictMode::On => true,
            VerdictMode::Off => false,
        };
        let verifier = chain.first().verifier();
        let chain = if verified { chain.with_verification(verifier) } else { chain };
        Ok(match &self.verdict_model {
            Some(path) => chain.with_verdict_model(&VerdictModel::read(path)?),
            None => chain,
        })
    }

    /// Returns the file that the options read.
    pub(super) fn inputs(&self) -> Option<&Path> {
        self.prior_options.near.as_deref()
    }

    /// Returns the method and its refinements with the options that are given.
    pub(super) fn method(&self) -> Result<Pipeline> {
        let mut method: Method = self.method.parse()?;
        let mut refinements =
            self.refine.iter().map(|name| name.parse()).collect::<Result<Vec<Method>>>()?;
        if let Some(threads) = self.threads {
            for refinement in &mut refinements {
                *refinement = refinement.clone().with([("threads", threads.into())])?;
            }
        }
        method = method.with(self.flags())?;
        if let Some(prior) = self.prior()? {
            method = method.with([("prior", json!(prior))])?;
            for refinement in &mut refinements {
                // They keep the scale that was found.
                let prior = Prior { scale: None, ..prior };
                *refinement = refinement.clone().with([("prior", json!(prior))])?;
            }
        }
        for text in &self.set {
            let (name, value) = parse_assignment(text)?;
            let owner = name.split_once('.').and_then(|(owner, field)| {
                let at = self.refine.iter().position(|refine| refine == owner)?;
                Some((at, field))
            });
            match owner {
                Some((at, field)) => {
                    refinements[at] = refinements[at].clone().with([(field, value)])?;
                }
                None => method = method.with([(name, value)])?,
            }
        }
        Pipeline::new(method, refinements)
    }

    /// [`chain`](Self::chain) with `--voxel` for those that make of it what they need: thinning by it would
    /// come too early.
    pub(super) fn with_voxel(&self, thinning: &Downsampling) -> Result<(Pipeline, Downsampling)> {
        let method: Method = self.method.parse()?;
        let own = matches!(method, Method::Consensus(_) | Method::CfSpectral(_));
        let Some(voxel) = thinning.voxel.filter(|_| own) else {
            return Ok((self.chain()?, *thinning));
        };
        let mut options = self.clone();
        // As text, like beta: a NaN must be refused.
        options.set.insert(0, format!("voxel={voxel}"));
        Ok((options.chain()?, Downsampling { voxel: None, ..*thinning }))
    }

    /// [`with_voxel`](Self::with_voxel) with this use of the descriptors that the clouds carry.
    pub(super) fn with_given(
        &self,
        thinning: &Downsampling,
        given: Option<GivenDescriptors>,
    ) -> Result<(Pipeline, Downsampling)> {
        let mut options = self.clone();
        if let Some(given) = given {
            options.set.insert(0, format!("given_descriptors={given}"));
        }
        options.with_voxel(thinning)
    }

    /// Returns the options for pairs that run in parallel: refinements may follow `+` in `--method`,
    /// and `--threads` is the number of pairs.
    pub(super) fn for_batch(&self) -> MethodOptions {
        let mut options = self.clone();
        let mut parts = self.method.split('+').map(String::from);
        options.method = parts.next().unwrap_or_default();
        options.refine.splice(0..0, parts);
        options.threads = None;
        options.bulk = true;
        options
    }

    /// Returns the constraints on the pose, if there are any.
    fn prior(&self) -> Result<Option<Prior>> {
        let mut prior = self.prior_options.prior()?;
        if let Some(text) = &self.scale_bounds {
            let bounds = parse_numbers(text).and_then(|all| <[f64; 2]>::try_from(all).ok());
            let Some(bounds) = bounds else {
                return Err(Error::config("scale-bounds", text, "must be LOW,HIGH"));
            };
            prior.scale = Some(bounds);
        }
        // Validated here, as JSON would turn NaN into null.
        prior.validate()?;
        Ok(Some(prior).filter(|prior| !prior.is_none()))
    }

    /// Returns the options that are given, as settings by name.
    fn flags(&self) -> Vec<(&'static str, Value)> {
        let mut flags = Vec::new();
        let mut add = |name, value: Option<Value>| flags.extend(value.map(|value| (name, value)));
        add("neighbors", self.neighbors.map(Value::from));
        add("radius", self.radius.map(json_number));
        if !self.more_neighbors.is_empty() {
            add("more_neighbors", Some(json!(self.more_neighbors)));
        }
        if !self.prior_options.channels.is_empty() {
            add("channels", Some(json!(self.prior_options.channels)));
        }
        add("normal_neighbors", self.normal_neighbors.map(Value::from));
        if let Some(text) = &self.orientation {
            let (name, value) = parse_orientation(text);
            add(name, Some(value));
        }
        add("histogram", self.histogram.map(|histogram| json!(histogram)));
        add("weights", self.weights.map(|weights| json!(weights)));
        // As text: JSON has no NaN, and a NaN must be refused.
        add("beta", self.beta.map(|beta| beta.to_string().into()));
        add("normalize", self.normalize.map(|normalize| json!(normalize)));
        add("solver", self.solver.map(|solver| json!(solver)));
        add("scale", self.scale.map(|scale| json!(scale)));
        add("threads", self.threads.map(Value::from));
        flags
    }
}

/// Returns the number; NaN and infinity, which JSON lacks, as text, which the setting refuses.
fn json_number(value: f64) -> Value {
    if value.is_finite() { value.into() } else { value.to_string().into() }
}

/// Parses `NAME=VALUE`; a value that is no JSON is a string.
fn parse_assignment(text: &str) -> Result<(&str, Value)> {
    let Some((name, value)) = text.split_once('=') else {
        return Err(Error::config("set", text, "must be NAME=VALUE"));
    };
    let parsed = serde_json::from_str(value).unwrap_or_else(|_| Value::from(value));
    Ok((name.trim(), parsed))
}

/// Parses numbers that are separated by commas.
fn parse_numbers(text: &str) -> Option<Vec<f64>> {
    text.split(',').map(|x| x.trim().parse().ok()).collect()
}

/// Parses an orientation: three numbers are a viewpoint, all else the name of a rule.
fn parse_orientation(text: &str) -> (&'static str, Value) {
    match parse_numbers(text) {
        Some(numbers) if numbers.len() == 3 => ("viewpoint", json!(numbers)),
        _ => ("orientation", text.into()),
    }
}
