//! `cfreg demo`: a pair whose pose is known.

use std::path::PathBuf;

use clap::Args;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde::Serialize;

use super::options::MethodOptions;
use super::{CommandOutcome, outputs, print, print_json};
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
    /// Also write the clouds source.pcd and target.pcd and the true pose truth.txt to this folder
    #[arg(long, value_name = "DIR")]
    write: Option<PathBuf>,
    /// Print one JSON object, which has the matrix, instead of four lines
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
        // The viewpoint, in the middle of the shape, orients normals alike in both clouds.
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
            print(&self.text(&registration, &truth, &error, source.diagonal()))?;
        }
        Ok(if registration.is_usable() { CommandOutcome::Trusted } else { CommandOutcome::Doubted })
    }

    /// The four lines of the demo: the clouds, the pose, the verdict, the error.
    fn text(
        &self,
        found: &Registration,
        truth: &Transform,
        error: &PoseError,
        size: f64,
    ) -> String {
        let verdict = match &found.verdict {
            Some(verdict) => {
                let percent = 100.0 * verdict.probability;
                format!(
                    "{}, the pose is right with a probability of {percent:.1} %",
                    verdict.decision
                )
            }
            None if found.trusted => "none, and no warning".into(),
            None => "none, but a warning (--json prints it)".into(),
        };
        format!(
            "Clouds:  two independent samples of one shape, {} points each; the second is moved\n\
             Pose:    {}, found by {} in {:.2} s\n\
             Verdict: {verdict}\n\
             Truth:   {}; the error is {:.3} degrees and {:.2} % of the size of the shape\n",
            self.points,
            pose_text(&found.transform),
            found.method_names(),
            found.time_s.total(),
            pose_text(truth),
            error.rotation_deg,
            100.0 * error.translation / size
        )
    }
}

/// Rotation angle and translation of a pose, in words.
fn pose_text(pose: &Transform) -> String {
    let [x, y, z] = pose.translation;
    let degrees = Transform::rigid(pose.rotation, [0.0; 3]).angle().to_degrees();
    format!("rotation by {degrees:.2} degrees, translation by {x:.3} {y:.3} {z:.3}")
}

/// A rotation vector uniform in [−π/2, π/2)³, the large motions of the paper (section IV-A).
fn large_rotation(seed: u64) -> Transform {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let half = std::f64::consts::FRAC_PI_2;
    Transform::from_rotation_vector([(); 3].map(|()| half * (2.0 * rng.random::<f64>() - 1.0)))
}
