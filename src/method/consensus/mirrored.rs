//! Whether the mirror image of the source fits the target better: one of the clouds is reversed, or
//! they show a left and a right part.

use std::sync::Arc;

use super::ConsensusSearch;
use super::trial::{LocalScoredPose, match_features};
use crate::cloud::Descriptors;
use crate::descriptor::{BINS, mirrored_rows};
use crate::surface::{SEARCH_RADIUS, Surface, SurfaceIndex};
use crate::verify::Evidence;

/// Conflict of a pose above which its mirror image is searched for: of 614 correct answers of real
/// pairs (`cfreg benchmark --candidates`) 10 % have more than 0.061; a mirrored bunny has 0.08. Chosen
/// by hand between them.
const MIN_CONFLICT: f64 = 0.05;
/// Standard deviation of the residuals above which the mirror image is searched for, in voxels: 10 %
/// of the same answers have more than 0.404. With both bounds one answer in six is searched.
const MIN_RESIDUAL_STD: f64 = 0.4;
/// Number of correspondences from which a mirrored pose is searched. Chosen by hand.
const SEEDS: usize = 50;
/// Number of mirrored poses that are refined. Chosen by hand.
const REFINED: usize = 4;

impl ConsensusSearch<'_> {
    /// Returns the overlap of the mirror image of the source, if it fits better than the source at a
    /// pose with this `evidence`: more overlap, and less conflict.
    pub(super) fn find_mirrored(&self, evidence: &Evidence) -> Option<f64> {
        let doubtful =
            evidence.surface_conflict > MIN_CONFLICT || evidence.residual_std > MIN_RESIDUAL_STD;
        if !doubtful || self.given.is_some() {
            return None;
        }
        let [source, target] = &self.trials[self.best_trial].surfaces;
        let surfaces = [Arc::new(mirror(source, self.voxel_size)?), target.clone()];
        let best = self.best_pose_of(&surfaces)?.evidence;
        (best.overlap > evidence.overlap && best.surface_conflict < evidence.surface_conflict)
            .then_some(best.overlap)
    }

    /// Searches for the best pose of two surfaces by FPFH, because it is unknown how the descriptors that
    /// clouds carry change in a mirror; `None` if nothing corresponds.
    fn best_pose_of(&self, surfaces: &[Arc<Surface>; 2]) -> Option<LocalScoredPose> {
        let matches = match_features(surfaces, fpfh, self.voxel_size).ok()?;
        let hypotheses = matches.generate_hypotheses(SEEDS, &self.config.prior);
        let ends = surfaces.each_ref().map(|surface| &**surface);
        self.config.score_hypotheses(ends, &matches, hypotheses, REFINED).into_iter().next()
    }
}

/// The descriptors of a surface that its shape alone makes.
fn fpfh(side: &Surface) -> &Descriptors {
    &side.descriptors
}

/// The mirror image of a surface, about its origin; `None` if its descriptors are too few values.
fn mirror(surface: &Surface, voxel_size: f64) -> Option<Surface> {
    let dim = surface.descriptors.dim();
    if dim < BINS {
        return None;
    }
    let flip = |v: &[f32; 3]| [-v[0], v[1], v[2]];
    let points: Vec<[f32; 3]> = surface.points.iter().map(flip).collect();
    let rows = mirrored_rows(surface.descriptors.as_slice(), dim);
    Some(Surface {
        index: SurfaceIndex::new(&points, SEARCH_RADIUS * voxel_size).ok()?.into(),
        points,
        normals: surface.normals.iter().map(flip).collect(),
        descriptors: Descriptors::new(dim, rows).ok()?,
        matching: None,
        depth_image: None,
        ..surface.clone()
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cloud::PointCloud;
    use crate::descriptor::{HistogramScale, fpfh};
    use crate::search::{Neighborhood, Neighbors};

    #[test]
    fn descriptors_of_a_mirrored_surface_are_those_of_its_mirror_image() {
        let at = |i: usize| {
            let (x, y) = ((i % 40) as f64, (i / 40) as f64);
            [x, y, 4.0 * (0.3 * x).sin() + 3.0 * (0.2 * y + 0.1 * x).cos()]
        };
        let cloud = PointCloud::new(&(0..1600).map(at).collect::<Vec<_>>()).unwrap();
        let near = Neighbors::find(cloud.points(), Neighborhood::Nearest(60)).unwrap();
        let describe = |points: &[[f32; 3]], normals: &[[f32; 3]]| {
            fpfh(points, normals, &near, HistogramScale::Open3d).unwrap()
        };
        let mut surface = Surface::of_cloud(&cloud, 3.0);
        surface.descriptors = describe(&surface.points, &surface.normals);
        let mirrored = mirror(&surface, 1.0).unwrap();
        let made = describe(&mirrored.points, &mirrored.normals);
        let off = made.as_slice().iter().zip(mirrored.descriptors.as_slice());
        let off = off.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        // A block sums to 200; an angle on the edge of a bin may change it.
        assert!(off < 4.0, "{off}");
        let changed = surface.descriptors.as_slice().iter().zip(made.as_slice());
        assert!(changed.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max) > 20.0);
    }
}
