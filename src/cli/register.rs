//! `cfreg register`.

use std::path::PathBuf;

use clap::Args;
use serde::Serialize;

use super::given::GivenOptions;
use super::options::MethodOptions;
use super::report_options::ReportOptions;
use super::{CommandOutcome, input, log, matrix_text, outputs, print, print_json, progress};
use crate::cloud::{PointCloud, Transform, ViewpointSource};
use crate::error::{Error, Result};
use crate::filter::Downsampling;
use crate::method::{Method, Pipeline, Register as _, Registration};
use crate::report::PairReport;
use crate::verify::{Decision, Warning};
use crate::{io, math, par};

#[derive(Args)]
pub(super) struct RegisterCommand {
    /// Cloud that is moved: PLY, PCD, LAS, LAZ, E57, PTX, PTS, OBJ, STL, OFF, NPY, NPZ, KITTI .bin,
    /// text, or gzip of these; FILE.e57#2 is the second scan
    source: PathBuf,
    /// Cloud that stays
    target: PathBuf,
    #[command(flatten)]
    method: MethodOptions,
    #[command(flatten)]
    given: GivenOptions,
    #[command(flatten)]
    thinning: Downsampling,
    #[arg(long, value_name = "WHERE", default_value_t, help = input::VIEWPOINTS_HELP)]
    viewpoints: ViewpointSource,
    /// How the pose is printed and written to --output: matrix, column-major, cloudcompare,
    /// cloudcompare:X,Y,Z (its global shift), open3d, colmap, tf, tum, kitti
    #[arg(long, value_name = "FORMAT", default_value_t)]
    pose_format: io::PoseFormat,
    /// Print one JSON object instead of the matrix
    #[arg(long)]
    json: bool,
    /// Also write the pose to this file
    #[arg(long, value_name = "T.txt")]
    output: Option<PathBuf>,
    /// Also write the whole source, moved into the target's frame; in its own format everything but
    /// coordinates and normals stays
    #[arg(long, value_name = "OUT")]
    write_aligned: Option<PathBuf>,
    #[command(flatten)]
    pictures: ReportOptions,
}

/// The object that `--json` prints: the registration, and the inputs of the command.
#[derive(Serialize)]
struct RegisterOutput<'a> {
    #[serde(flatten)]
    registration: &'a Registration,
    source: String,
    target: String,
    thinning: &'a Downsampling,
    viewpoints: ViewpointSource,
    #[serde(flatten)]
    given: &'a GivenOptions,
    /// The command line, quoted for a shell.
    command: String,
}

impl RegisterCommand {
    pub(super) fn run(&self) -> Result<CommandOutcome> {
        let (method, thinning) = self.method.with_given(&self.thinning, self.given.setting())?;
        self.given.check(&thinning)?;
        self.check_files()?;
        let method = match self.pictures.report {
            Some(_) => method.with_weight_graph(),
            None => method,
        };
        let threads = self.method.threads.unwrap_or(0);
        let bar = progress(0, "registering");
        let (mut registration, clouds) =
            par::with_threads(threads, || self.register(&method, &thinning))??;
        bar.finish_and_clear();
        self.write_poses(&mut registration)?;
        for doubt in &registration.doubts {
            log(&format!("cfreg: warning: {doubt}\n"));
        }
        if !registration.is_usable() {
            log(&format!("cfreg: try {} (see --help)\n", advice(&registration)));
        }
        let answer = RegisterOutput {
            registration: &registration,
            source: self.source.display().to_string(),
            target: self.target.display().to_string(),
            thinning: &self.thinning,
            viewpoints: self.viewpoints,
            given: &self.given,
            command: command_line(),
        };
        if self.pictures.is_requested() {
            let bar = progress(0, "drawing");
            let [source, target] = &clouds;
            let mut pair = PairReport::new(&registration, source, target);
            pair.names = [answer.source.clone(), answer.target.clone()];
            pair.command = Some(answer.command.clone());
            par::with_threads(threads, || self.pictures.write(&pair))??;
            bar.finish_and_clear();
        }
        if self.json {
            print_json(&answer)?;
        } else {
            log(&summary(&registration));
            log(&local_text(&registration.transform, &clouds));
            print(&match self.pose_format {
                io::PoseFormat::Matrix => matrix_text(&registration.transform.matrix()),
                other => other.format(&registration.transform)?,
            })?;
        }
        Ok(if registration.is_usable() { CommandOutcome::Trusted } else { CommandOutcome::Doubted })
    }

    /// Refuses outputs that cannot be written, before minutes of work, not after.
    fn check_files(&self) -> Result<()> {
        if let Some(path) = &self.write_aligned {
            io::check_applicable(&self.source, path)?;
            if self.source.exists() && !self.source.is_file() {
                let rule = "reads the source once more, which must be a file for that";
                return Err(Error::config("write-aligned", path.display(), rule));
            }
        }
        self.pictures.check()?;
        let [report, figure] = self.pictures.outputs();
        let outputs = [
            ("output", self.output.as_deref()),
            ("write-aligned", self.write_aligned.as_deref()),
            report,
            figure,
        ];
        let mut inputs = vec![self.source.as_path(), &self.target];
        inputs.extend(self.method.inputs());
        inputs.extend(self.given.inputs());
        outputs::check(&inputs, &outputs)
    }

    /// Reads the files and registers the clouds; returns them too.
    fn register(
        &self,
        method: &Pipeline,
        thinning: &Downsampling,
    ) -> Result<(Registration, [PointCloud; 2])> {
        let start = std::time::Instant::now();
        let matches = self.given.read_matches()?;
        let [source, target] = input::read_pair_given(
            [self.source.as_path(), &self.target],
            thinning,
            self.viewpoints,
            self.method.keep_no_returns,
            &self.given,
        )?;
        let seconds = start.elapsed().as_secs_f64();
        let mut registration = match matches {
            Some((pairs, scores)) => {
                method.register_correspondences(&source, &target, &pairs, scores.as_deref())?
            }
            None => method.register(&source, &target)?,
        };
        registration.time_s.0.insert(0, ("read".into(), seconds));
        Ok((registration, [source, target]))
    }

    /// Writes the matrix and the moved source, where they are asked for.
    fn write_poses(&self, registration: &mut Registration) -> Result<()> {
        if let Some(path) = &self.output {
            io::write_pose(path, &registration.transform, self.pose_format)?;
        }
        if let Some(path) = &self.write_aligned {
            let start = std::time::Instant::now();
            let moved = io::apply(&self.source, &registration.transform, path)?;
            if !moved.differences.is_empty() {
                log(&format!("cfreg: {}: {}\n", path.display(), moved.differences));
            }
            registration.time_s.add("write", start.elapsed().as_secs_f64());
        }
        Ok(())
    }
}

/// Returns the translation about an origin near clouds in map coordinates, where that of their own
/// frame says little; empty for clouds near zero.
fn local_text(transform: &Transform, [source, target]: &[PointCloud; 2]) -> String {
    let origin = target.frame_origin();
    if origin == [0.0; 3] || source.frame_origin() == [0.0; 3] {
        return String::new();
    }
    let [x, y, z] = math::sub(transform.apply(origin), origin);
    let [a, b, c] = origin;
    format!("about the origin {a} {b} {c}: translation {x:.4} {y:.4} {z:.4}\n")
}

/// Returns the command line of this process, quoted for a shell.
fn command_line() -> String {
    let words: Vec<String> =
        std::env::args_os().skip(1).map(|word| word.to_string_lossy().into_owned()).collect();
    let words = std::iter::once("cfreg").chain(words.iter().map(String::as_str));
    // Words with a zero byte cannot come from a command line.
    shlex::try_join(words).unwrap_or_default()
}

/// Returns what may help against a warning, in options that the method takes.
fn advice(registration: &Registration) -> &'static str {
    let as_good =
        |doubt: &Warning| matches!(doubt, Warning::Ambiguous { .. } | Warning::Unobservable { .. });
    let other_scale = |doubt: &Warning| matches!(doubt, Warning::ScaleMismatch { .. });
    if registration.doubts.contains(&Warning::Mirrored) {
        return "the source mirrored back: exchange or negate the axis that was changed";
    }
    match &registration.method.parse() {
        Some(Method::Consensus(_)) if registration.doubts.iter().any(other_scale) => {
            "the source scaled (cfreg convert --transform, 4 by 4 numbers with the scale on the diagonal)"
        }
        // More seeds would find only the alternatives again.
        Some(Method::Consensus(_)) if registration.doubts.iter().any(as_good) => {
            "something that distinguishes the poses: --channels, --direction, --near, or the viewpoints of the sensors (VIEWPOINT of PCD, or --viewpoints origin)"
        }
        Some(Method::Consensus(_)) => {
            "--set seeds=1000, another --voxel, or the viewpoints of the sensors (VIEWPOINT of PCD, or --viewpoints origin)"
        }
        Some(Method::Cf(cf)) if cf.features.more_scales.is_empty() => {
            "--method cf-multiscale, --refine gicp, another --voxel, or --orientation"
        }
        Some(Method::Cf(_)) => "--refine gicp, another --voxel, or --orientation",
        Some(Method::CfSpectral(_)) => {
            "--refine gicp, another --voxel, or the sensors' places (VIEWPOINT of PCD, or --viewpoints origin)"
        }
        Some(Method::Cfk(_)) => {
            "--normalize both, --refine gicp, another --voxel, or --orientation"
        }
        Some(Method::Teaser(_)) => "--refine gicp, another --set noise_bound, or --orientation",
        _ => "an initial pose nearer to the result, as by --method cf-multiscale --refine",
    }
}

/// Returns the result in a few lines: decision and probability first.
fn summary(registration: &Registration) -> String {
    let r = registration;
    let mut lines = Vec::new();
    if let Some(verdict) = &r.verdict {
        let probability = verdict.probability;
        lines.push(format!("{}: right with probability {probability:.3}", verdict.decision));
        if verdict.decision != Decision::Accept {
            lines.extend(verdict.reasons.iter().map(|reason| format!("  {reason}")));
        }
    }
    let [x, y, z] = r.transform.translation;
    lines.push(format!(
        "rotation {:.3} deg, translation {x:.4} {y:.4} {z:.4}",
        Transform::rigid(r.transform.rotation, [0.0; 3]).angle().to_degrees()
    ));
    lines.push(format!(
        "fitness {:.3} of the source and {:.3} of the target within {:.4}, RMSE {:.4}",
        r.evaluation.fitness,
        r.evaluation.target_fitness,
        r.evaluation.max_distance,
        r.evaluation.inlier_rmse
    ));
    lines.push(format!(
        "{}: {} + {} points in {:.2} s",
        r.method.name,
        r.points.source.described,
        r.points.target.described,
        r.time_s.total()
    ));
    lines.join("\n") + "\n"
}
