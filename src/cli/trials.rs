//! `cfreg demo` and `cfreg accuracy`: pairs with a known truth.

use std::path::PathBuf;

use clap::Args;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use serde::Serialize;

use super::options::MethodOptions;
use super::register::summary;
use super::{Outcome, matrix_text, outputs, print, print_json, progress, say};
use crate::cloud::Transform;
use crate::error::{Error, Result};
use crate::experiment::accuracy::{Report, Settings, run};
use crate::experiment::shape::boulder;
use crate::experiment::{Model, Motion};
use crate::io;
use crate::method::{Register, Registration};
use crate::verify::{PoseError, pose_error};

#[derive(Args)]
pub(super) struct Demo {
    #[command(flatten)]
    method: MethodOptions,
    /// Points of each of the two independent samples
    #[arg(long, value_name = "N", default_value_t = 2000, allow_negative_numbers = true)]
    points: usize,
    /// Seed of shape samples and motion
    #[arg(long, value_name = "S", default_value_t = 0)]
    seed: u64,
    /// Also write source.pcd, target.pcd (with their viewpoints) and truth.txt to this folder
    #[arg(long, value_name = "DIR")]
    write: Option<PathBuf>,
    /// Print one JSON object instead of the matrix
    #[arg(long)]
    json: bool,
}

#[derive(Serialize)]
struct Known<'a> {
    #[serde(flatten)]
    registration: &'a Registration,
    truth: Transform,
    error: PoseError,
}

impl Demo {
    pub(super) fn run(&self) -> Result<Outcome> {
        let method = self.method.chain()?;
        let mesh = boulder();
        let (first, second) =
            (self.seed.wrapping_mul(2), self.seed.wrapping_mul(2).wrapping_add(1));
        let source = mesh.sample(self.points, first)?;
        let target = mesh.sample(self.points, second)?;
        let mut rng = ChaCha8Rng::seed_from_u64(self.seed);
        let mut truth = Motion::Large.draw(source.centroid(), &mut rng);
        truth.translation = [2.0, -1.0, 0.5];
        // Both were "seen" from where the shape has its zero.
        let source = source.with_viewpoint([0.0; 3])?;
        let target = target.with_viewpoint([0.0; 3])?.transformed(&truth)?;
        if let Some(folder) = &self.write {
            std::fs::create_dir_all(folder).map_err(|error| Error::io(folder, error))?;
            let files = ["source.pcd", "target.pcd", "truth.txt"].map(|name| folder.join(name));
            // A pair of an earlier demo has all three.
            let earlier =
                files.iter().all(|file| file.is_file()) && io::read_transform(&files[2]).is_ok();
            for file in &files {
                outputs::check_unnamed("write", file, |_| earlier)?;
            }
            io::write(folder.join("source.pcd"), &source)?;
            io::write(folder.join("target.pcd"), &target)?;
            io::write_transform(folder.join("truth.txt"), &truth)?;
        }
        let registration = method.register(&source, &target)?;
        let error = pose_error(&registration.transform, &truth, source.centroid());
        if self.json {
            print_json(&Known { registration: &registration, truth, error })?;
        } else {
            say(&format!(
                "two independent samples of one shape, {} points each, one of them moved\n{}",
                self.points,
                summary(&registration)
            ));
            print(&matrix_text(&registration.transform.matrix()))?;
            let turned = Transform::rigid(truth.rotation, [0.0; 3]).angle().to_degrees();
            say(&format!(
                "truth: turned by {turned:.1} deg; the pose is off by {:.3} deg and {:.4} ({:.2} % of the shape)\n",
                error.rotation_deg,
                error.translation,
                100.0 * error.translation / source.diagonal()
            ));
        }
        Ok(if registration.is_usable() { Outcome::Trusted } else { Outcome::Doubted })
    }
}

#[derive(Args)]
pub(super) struct Accuracy {
    /// Model to sample: a cloud of at least --points points
    model: PathBuf,
    /// Sample the faces or the range grid of a PLY file evenly by area, as the paper does,
    /// not its points
    #[arg(long)]
    by_area: bool,
    #[command(flatten)]
    method: MethodOptions,
    /// Pairs to register
    #[arg(long, default_value_t = Settings::default().trials)]
    trials: usize,
    /// Points of each sample
    #[arg(long, default_value_t = Settings::default().points)]
    points: usize,
    /// small: rotation vectors in [-pi/8, pi/8)^3 about the centroid; large: in
    /// [-pi/2, pi/2)^3 about the origin
    #[arg(long, default_value_t = Settings::default().motion)]
    motion: Motion,
    /// Seed of motions and samples
    #[arg(long, default_value_t = Settings::default().seed)]
    seed: u64,
    /// Print one JSON object with every trial instead of text
    #[arg(long)]
    json: bool,
}

impl Accuracy {
    pub(super) fn run(&self) -> Result<Outcome> {
        let method = self.method.method()?;
        let model: Model = match self.by_area {
            true => io::read_mesh(&self.model)?.into(),
            false => io::read(&self.model)?.into(),
        };
        let Accuracy { trials, points, motion, seed, .. } = *self;
        let bar = progress(trials as u64, "trials");
        let settings = Settings { trials, points, motion, seed };
        let report = run(&model, &method, settings, |done| bar.set_position(done as u64))?;
        bar.finish_and_clear();
        if self.json {
            print_json(&report)?;
        } else {
            print(&text(&report))?;
        }
        Ok(if report.failures() < trials { Outcome::Trusted } else { Outcome::NoAnswer })
    }
}

fn text(report: &Report) -> String {
    let line = |name: &str, measure: fn(&PoseError) -> f64| {
        let (mean, deviation) = report.statistics(measure);
        format!("{name:<22}{mean:.4} +- {deviation:.4}\n")
    };
    format!(
        "{} trials, {} points, {} rotations; {} without an answer, {} doubted\n{}{}{}",
        report.settings.trials,
        report.settings.points,
        report.settings.motion,
        report.failures(),
        report.doubted,
        line("||I - R Rgt^T||_F", |e| e.rotation_frobenius),
        line("rotation error (deg)", |e| e.rotation_deg),
        line("translation error", |e| e.translation),
    )
}
