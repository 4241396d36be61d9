//! `cfreg demo`: a pair whose pose is known.

use std::path::PathBuf;

use clap::Args;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde::Serialize;

use super::options::MethodOptions;
use super::register::summary;
use super::{CommandOutcome, log, matrix_text, outputs, print, print_json};
use crate::cloud::Transform;
use crate::cloud::shape::boulder;
use crate::error::{Error, Result};
use crate::io;
use crate::method::{Register, Registration};
use crate::verify::{PoseError, pose_error};

#[derive(Args)]
pub(super) struct DemoCommand {
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
struct DemoOutput<'a> {
    #[serde(flatten)]
    registration: &'a Registration,
    truth: Transform,
    error: PoseError,
}

impl DemoCommand {
    pub(super) fn run(&self) -> Result<CommandOutcome> {
        let method = self.method.chain()?;
        let mesh = boulder();
        let (first, second) =
            (self.seed.wrapping_mul(2), self.seed.wrapping_mul(2).wrapping_add(1));
        let source = mesh.sample(self.points, first)?;
        let target = mesh.sample(self.points, second)?;
        let truth = Transform { translation: [2.0, -1.0, 0.5], ..large_rotation(self.seed) };
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
                outputs::check_default_path("write", file, |_| earlier)?;
            }
            io::write(folder.join("source.pcd"), &source)?;
            io::write(folder.join("target.pcd"), &target)?;
            io::write_transform(folder.join("truth.txt"), &truth)?;
        }
        let registration = method.register(&source, &target)?;
        let error = pose_error(&registration.transform, &truth, source.centroid());
        if self.json {
            print_json(&DemoOutput { registration: &registration, truth, error })?;
        } else {
            log(&format!(
                "two samples of one shape, {} points each; the second is moved by a known pose\n{}",
                self.points,
                summary(&registration)
            ));
            print(&matrix_text(&registration.transform.matrix()))?;
            let turned = Transform::rigid(truth.rotation, [0.0; 3]).angle().to_degrees();
            log(&format!(
                "the true rotation is {turned:.3} deg; the pose is off by {:.3} deg and {:.2} % of the \
                 size of the shape\n",
                error.rotation_deg,
                100.0 * error.translation / source.diagonal()
            ));
        }
        Ok(if registration.is_usable() { CommandOutcome::Trusted } else { CommandOutcome::Doubted })
    }
}

/// A rotation vector uniform in [−π/2, π/2)³, the large motions of the paper (section IV-A).
fn large_rotation(seed: u64) -> Transform {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let half = std::f64::consts::FRAC_PI_2;
    Transform::from_rotation_vector([(); 3].map(|()| half * (2.0 * rng.random::<f64>() - 1.0)))
}
