//! Consensus: consistent correspondences of the full connection, verified on the surfaces.

mod alternatives;
mod filtered_cloud;
mod fine_pose;
mod hypotheses;
mod mirrored;
mod result;
mod scale_mismatch;
mod scan;
mod scored_pose;
mod trial;
mod verify;
pub(super) mod viewpoint_sample;
mod weight_graph;

use serde::{Deserialize, Serialize};

use self::filtered_cloud::FilteredCloud;
use self::fine_pose::{FinePose, MIN_PROBABILITY_FOR_ALTERNATIVES, best_trial};
pub(super) use self::hypotheses::PointPair;
use self::scan::{Scan, ViewpointHypothesis};
pub use self::scored_pose::ScoredPose;
use self::trial::{LocalScoredPose, ViewpointTrial};
use super::registration::Timings;
use super::{Cached, Channel, GivenDescriptors, Register, Registration};
use crate::cloud::{PointCloud, Transform};
use crate::error::{Error, Result};
use crate::math::{self, Vec3};
use crate::normals::OrientedBy;
use crate::par;
use crate::pose::{Prior, ScaleEstimate};
use crate::surface::{RefineOptions, Refined, Surface, to_cloud_frames};
use crate::verify::VerdictModel;

/// Global registration of scans that overlap in part: the method for clouds without prior
/// knowledge.
///
/// The full connection of both clouds is made sparse (mutual nearest neighbours by FPFH); each
/// correspondence weights the others by the number of correspondences that are compatible with
/// both, and is solved in closed form ([SC²-PCR], Chen et al., CVPR 2022); the poses are scored on
/// the surfaces themselves: their overlap, the similarity of the overlapping surfaces, and points
/// in free space. The best poses are refined point to plane and scored again. The
/// [`Verdict`](crate::verify::Verdict) gives the probability of the best pose and the best
/// alternative.
///
/// All distances follow from the voxel size, [`voxel`](Self::voxel), and that from the clouds: the
/// result does not depend on the unit or on the initial position of the clouds. A known viewpoint
/// ([`PointCloud::viewpoint`]) is used twice, to orient normals and to find free space; an unknown
/// viewpoint is estimated. Returns at the limit of a sensor's range are not a surface and are left
/// out ([`MaxRangeReturns`](crate::visibility::MaxRangeReturns)). If a pose aligns the two sensor
/// positions, points near the sensors are left out as well: the ego-vehicle, or the person who
/// moves the sensor, looks the same from everywhere.
///
/// Weights of points ([`PointCloud::with_weights`]) count in solves: the weight of a
/// correspondence, or of a surface pair, is multiplied by those of its two points, each the mean of
/// its cube. Surfaces and the verdict use all points.
///
/// ```
/// use cfreg::method::{Consensus, Register};
/// # use cfreg::cloud::shape::boulder;
/// # let (source, target) = (boulder().sample(2000, 1)?, boulder().sample(2000, 2)?);
/// let registration = Consensus::default().register(&source, &target)?;
/// let verdict = registration.verdict.unwrap();
/// println!("{} {:.3}", verdict.decision, verdict.probability);
/// assert!(registration.transform.angle().to_degrees() < 2.0);
/// # Ok::<(), cfreg::Error>(())
/// ```
///
/// [SC²-PCR]: https://arxiv.org/abs/2203.14453
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Consensus {
    /// The voxel size, from which all other distances follow, in the unit of the coordinates, above
    /// 0: clouds are downsampled to one point per cube of this side. Default
    /// [`filter::voxel_size_for`](crate::filter::voxel_size_for) of 5000 points, the larger of both
    /// clouds.
    pub voxel: Option<f64>,
    /// Number of correspondences from which a pose is searched, at least 1; default 200. More seeds
    /// find smaller overlaps, at proportional cost.
    pub seeds: usize,
    /// Constraints on the pose ([`Prior`]), except on its scale; default none. Poses of
    /// correspondences are exactly the best allowed; on the surfaces each step is projected to the
    /// nearest allowed pose.
    pub prior: Prior,
    /// Channels of the clouds ([`PointCloud::channels`]) by which points are compared too, see
    /// [`FeatureConfig::concatenate_channels`](super::FeatureConfig::concatenate_channels); default
    /// none. Channels are used for correspondences and for the similarity of surfaces; the pose is
    /// refined on the shape alone.
    pub channels: Vec<Channel>,
    /// Use of the descriptors that both clouds carry, such as learned ones
    /// ([`PointCloud::with_descriptors`]); default none: they are not used. Correspondences are
    /// found by them, or by them, by FPFH and by both; the similarity of surfaces, on which the
    /// verdict's model was fitted, stays that of FPFH.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub given_descriptors: Option<GivenDescriptors>,
    /// Whether returns at the limit of a sensor's range are detected and left out; default true.
    /// Set false if a round wall or a modelled sky is detected as a range limit: the reasons of the
    /// verdict give the number of points left out.
    pub range_limit: bool,
    /// Whether rows that mark measurements without a return ([`filter::find_no_returns`]) are kept;
    /// default false: they are left out, and counted in [`Registration::points`].
    ///
    /// [`filter::find_no_returns`]: crate::filter::find_no_returns
    pub keep_no_returns: bool,
    /// The model that ranks poses and gives the verdict; default the built-in one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub model: Option<Box<VerdictModel>>,
    /// Threads, 0 for all cores. Never changes the result.
    pub threads: usize,
}

impl Default for Consensus {
    fn default() -> Self {
        Consensus {
            voxel: None,
            seeds: 200,
            prior: Prior::default(),
            channels: Vec::new(),
            given_descriptors: None,
            range_limit: true,
            keep_no_returns: false,
            model: None,
            threads: 0,
        }
    }
}

/// Number of points that a cloud is downsampled to. Chosen by hand.
pub(super) const DOWNSAMPLED_POINTS: usize = 5000;
/// Refinement of hypotheses, which are scored by as many points afterwards. Chosen by hand.
const COARSE_REFINEMENT: RefineOptions =
    RefineOptions { max_points: 1000, max_iterations: 12, tolerance: 0.01 };
/// Refinement of the best pose: until its own errors are larger than the last step. Chosen by hand.
const FINE_REFINEMENT: RefineOptions =
    RefineOptions { max_points: usize::MAX, max_iterations: 100, tolerance: 1e-4 };
/// Poses with a mean displacement below this, in voxel sizes, are duplicates. Chosen by hand.
const DUPLICATE_POSE: f64 = 3.0;
/// Mean displacement from which on a runner-up is a different pose, in voxel sizes. Chosen by hand.
const DISTINCT_POSE: f64 = 8.0;
/// A verified pose is scored as its refined pose if both are nearer than this, in voxel sizes.
/// Chosen by hand.
const MAX_REFINE_SHIFT: f64 = 1.0;
/// Distance from the centre, in medians, above which a point is an outlier. Chosen by hand.
const OUTLIER_FACTOR: f64 = 30.0;

/// All trials on two clouds, and the best result.
pub(super) struct ConsensusSearch<'a> {
    /// With the resolved voxel size.
    config: Consensus,
    voxel_size: f64,
    scans: [Scan<'a>; 2],
    /// Correspondences from elsewhere, in place of those by descriptors.
    given: Option<&'a [PointPair]>,
    /// From where they were seen, where that is known.
    known_viewpoints: [Option<ViewpointHypothesis>; 2],
    trials: Vec<ViewpointTrial>,
    /// Number of the trial with the best pose.
    best_trial: usize,
    refined: Refined,
    /// The best pose, with its evidence.
    best: LocalScoredPose,
    /// Poses that could rival the best one, most probable first.
    alternatives: Vec<LocalScoredPose>,
}

impl Consensus {
    /// Checks the ranges.
    ///
    /// # Errors
    /// [`Error::Config`] with the name of the first setting that is out of its range.
    pub fn validate(&self) -> Result<()> {
        if let Some(voxel) = self.voxel.filter(|&voxel| !(voxel > 0.0 && voxel <= 1e15)) {
            return Err(Error::config("voxel", voxel, "must be above 0 and at most 1e15"));
        }
        if self.seeds == 0 {
            return Err(Error::config("seeds", 0, "must be at least 1"));
        }
        self.channels.iter().try_for_each(Channel::validate)?;
        self.verdict_model().validate()?;
        self.prior.validate_for(ScaleEstimate::Fixed)
    }

    /// Replaces the model for the verdict.
    pub fn model(self, model: VerdictModel) -> Self {
        Consensus { model: Some(model.into()), ..self }
    }

    /// Whether channels or a prior distinguish the pose from rotations that fit as well.
    pub(super) fn distinguishes_rotations(&self) -> bool {
        !self.channels.is_empty() || !self.prior.is_none()
    }

    /// The model in force.
    pub(super) fn verdict_model(&self) -> &VerdictModel {
        self.model.as_deref().unwrap_or(VerdictModel::built_in())
    }

    /// Returns the voxel size, from which all other distances follow.
    fn choose_voxel_size(&self, ends: [&FilteredCloud<'_>; 2]) -> Result<f64> {
        if let Some(voxel) = self.voxel {
            return Ok(voxel);
        }
        let [source, target] =
            par::join_pair(ends, |whole| whole.voxel_size_for(DOWNSAMPLED_POINTS))?;
        let side = source.max(target);
        if side <= 0.0 {
            // All points at one position.
            return Err(Error::Degenerate { rank: 0, singular_values: [0.0; 3] });
        }
        Ok(side)
    }

    fn run(
        &self,
        source: Cached<'_>,
        target: Cached<'_>,
        given: Option<&[PointPair]>,
    ) -> Result<Registration> {
        let mut times = Timings::default();
        self.search(source, target, given, &mut times)?.to_registration(times)
    }

    /// Runs the search for the best pose.
    pub(super) fn search<'a>(
        &self,
        source: Cached<'a>,
        target: Cached<'a>,
        given: Option<&'a [PointPair]>,
        times: &mut Timings,
    ) -> Result<ConsensusSearch<'a>> {
        let search = self.filter_and_search(source, target, given, times)?;
        let pose = search.best_pose();
        Ok(search.remove_ego_vehicle(&pose, times))
    }

    /// Runs the search on all points of the scenes, with the ego-vehicles.
    fn filter_and_search<'a>(
        &self,
        source: Cached<'a>,
        target: Cached<'a>,
        given: Option<&'a [PointPair]>,
        times: &mut Timings,
    ) -> Result<ConsensusSearch<'a>> {
        self.validate()?;
        for (end, what) in [(source, "the source"), (target, "the target")] {
            if end.cloud.len() < 3 {
                let found = end.cloud.len();
                return Err(Error::TooFewPoints { what: what.into(), found, needed: 3 });
            }
        }
        if let Some(given) = self.given_descriptors {
            given.check_pair(source.cloud, target.cloud)?;
        }
        let whole = |end| FilteredCloud::new(end, self.range_limit, self.keep_no_returns);
        let clouds = times.time("range limit", || par::join_pair([source, target], whole))?;
        self.search_filtered(clouds, given, times)
    }

    fn search_filtered<'a>(
        &self,
        [source, target]: [FilteredCloud<'a>; 2],
        given: Option<&'a [PointPair]>,
        times: &mut Timings,
    ) -> Result<ConsensusSearch<'a>> {
        let length = times.time("thin", || self.choose_voxel_size([&source, &target]))?;
        let config = Consensus { voxel: Some(length), ..self.clone() };
        let scans = times.time("thin", || {
            let named = [(source, "the source"), (target, "the target")];
            par::join_pair(named, |(cloud, name)| Scan::new(cloud, length, self, name))
        })?;
        let ends = || scans.each_ref();
        let sensors =
            times.time("viewpoints", || par::join_pair(ends(), |scan| scan.known_viewpoint()))?;
        let trials = config.run_trials(&scans, sensors, given, length, times)?;
        let Some(best_trial) = best_trial(&trials) else { return Err(Error::NO_WEIGHT) };
        let trial = &trials[best_trial];
        let best = times.time("refine", || self.refine_candidates(trial, length));
        let Some(mut best) = best else { return Err(Error::NO_WEIGHT) };
        let mut alternatives = Vec::new();
        if self.usual_probability(best.scored.evidence) > MIN_PROBABILITY_FOR_ALTERNATIVES {
            alternatives =
                times.time("alternatives", || self.find_alternatives(&mut best, trial, length));
        }
        let FinePose { refined, scored } = best;
        Ok(ConsensusSearch {
            config,
            given,
            voxel_size: length,
            scans,
            known_viewpoints: sensors,
            trials,
            best_trial,
            refined,
            best: scored,
            alternatives,
        })
    }
}

impl ConsensusSearch<'_> {
    /// Returns the points that were searched, without those left out.
    pub(super) fn clouds(&self) -> [Cached<'_>; 2] {
        self.scans.each_ref().map(|scan| scan.filtered_cloud().cached())
    }

    /// Returns the best pose, between the clouds' own frames.
    fn best_pose(&self) -> Transform {
        let [from, onto] = &self.trials[self.best_trial].surfaces;
        to_cloud_frames(&self.refined.pose, from, onto)
    }

    /// Repeats the search without the ego-vehicles if `pose`, between the clouds' own frames,
    /// aligns the two sensor positions: such a pose also aligns the ego-vehicles, wherever they
    /// moved. The origin of a frame, which may be that of a shape, is not used as a sensor position
    /// here.
    fn remove_ego_vehicle(self, pose: &Transform, times: &mut Timings) -> Self {
        let known = |view: Option<ViewpointHypothesis>| match view {
            Some(ViewpointHypothesis::Known(at, by)) if by != OrientedBy::FrameOrigin => Some(at),
            _ => None,
        };
        let [Some(source), Some(target)] = self.known_viewpoints.map(known) else { return self };
        let off = math::norm(math::sub(pose.apply(source), target));
        if off > self.voxel_size {
            return self;
        }
        let far =
            [self.scans[0].remove_ego_vehicle(source), self.scans[1].remove_ego_vehicle(target)];
        self.config.search_filtered(far, self.given, times).unwrap_or(self)
    }
}

/// Returns eight points spread over the surface, in the order of its points, except those as far
/// away from the others as a stray return, which would alone decide whether poses differ.
fn probe_points(surface: &Surface) -> Vec<Vec3> {
    let all: Vec<Vec3> = (0..8).map(|k| surface.point(k * (surface.len() - 1) / 7)).collect();
    let middle = |mut values: Vec<f64>| {
        values.sort_by(f64::total_cmp);
        values[values.len() / 2]
    };
    let center = [0, 1, 2].map(|axis| middle(all.iter().map(|place| place[axis]).collect()));
    let off = |place: &Vec3| math::norm(math::sub(*place, center));
    let most = OUTLIER_FACTOR * middle(all.iter().map(off).collect());
    all.into_iter().filter(|place| off(place) <= most).collect()
}

/// Returns the mean distance between the positions of `places` under two poses.
fn mean_displacement(a: &Transform, b: &Transform, places: &[Vec3]) -> f64 {
    let off = |&place: &Vec3| math::norm(math::sub(a.apply(place), b.apply(place)));
    places.iter().map(off).sum::<f64>() / places.len() as f64
}

impl Consensus {
    /// Registers by correspondences that are given: indices of a source and of a target point each,
    /// with `scores` or all alike. They take the place of those by descriptors; the poses that they
    /// propose are verified on the surfaces as any other.
    ///
    /// At most 2,500 are used, those with the largest scores; a score is the weight of a
    /// correspondence where poses are solved, and one of 0 leaves it out.
    ///
    /// # Errors
    /// [`Error::Shape`] for an index beyond its cloud and for another number of scores,
    /// [`Error::Config`] for a score that is negative or not finite, [`Error::TooFewPoints`] for
    /// fewer than three correspondences, and those of [`Register::register`].
    pub fn register_correspondences(
        &self,
        source: &PointCloud,
        target: &PointCloud,
        pairs: &[(u32, u32)],
        scores: Option<&[f32]>,
    ) -> Result<Registration> {
        let given = PointPair::from_indices(source, target, pairs, scores)?;
        par::with_threads(self.threads, || self.run(source.into(), target.into(), Some(&given)))?
    }
}

impl Register for Consensus {
    fn register(&self, source: &PointCloud, target: &PointCloud) -> Result<Registration> {
        self.register_cached(source.into(), target.into())
    }

    fn register_cached(&self, source: Cached<'_>, target: Cached<'_>) -> Result<Registration> {
        par::with_threads(self.threads, || self.run(source, target, None))?
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn settings_out_of_range_name_the_field() {
        for bad in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            let found = Consensus { voxel: Some(bad), ..Consensus::default() }.validate();
            assert!(matches!(found, Err(Error::Config { field: "voxel", .. })), "{bad}");
        }
        let found = Consensus { seeds: 0, ..Consensus::default() }.validate();
        assert!(matches!(found, Err(Error::Config { field: "seeds", .. })));
    }
}
