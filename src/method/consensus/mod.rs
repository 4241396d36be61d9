//! Consensus: matches of the full connection that agree with each other, judged on the surfaces.

mod filtered_cloud;
mod hypotheses;
mod result;
mod scale_mismatch;
mod scan;
mod scored_pose;
mod trial;
mod verify;
mod viewpoint_sample;
mod weight_graph;

use serde::{Deserialize, Serialize};

use self::filtered_cloud::FilteredCloud;
use self::hypotheses::PointPair;
use self::scan::{Scan, ViewpointHypothesis};
pub use self::scored_pose::ScoredPose;
use self::trial::ViewpointTrial;
use super::registration::Timings;
use super::{Cached, Channel, Register, Registration};
use crate::cloud::{PointCloud, Transform};
use crate::error::{Error, Result};
use crate::math::{self, Vec3};
use crate::normals::OrientedBy;
use crate::par;
use crate::pose::{Prior, ScaleEstimate};
use crate::surface::{INLIER_DISTANCE, RefineOptions, Refined, Surface, refine, to_cloud_frames};
use crate::verify::{PoseEvidence, VerdictModel};

/// Global registration of scans that overlap in part: the method for clouds of which nothing is
/// known.
///
/// The full connection of both clouds is made sparse (pairs that are each other's most alike by
/// FPFH); each match weighs the others by how many matches both are compatible with, and is
/// solved in closed form ([SC²-PCR], Chen et al., CVPR 2022); the poses are judged on the
/// surfaces themselves: how much of them lies on each other, how alike it looks there, what
/// stands where a sensor looked through. The best are settled point to plane and judged again.
/// The [`Verdict`](crate::verify::Verdict) tells how probable the answer is and what else it
/// might be.
///
/// All lengths follow from one, [`voxel`](Self::voxel), and that from the clouds: the unit does
/// not matter, nor where the clouds stand. Where the place of a sensor is known
/// ([`PointCloud::viewpoint`]) it serves twice, to orient normals and to tell what was empty;
/// where it is not, it is guessed. Returns at the limit of a sensor's range are no surface and
/// left out ([`MaxRangeReturns`](crate::visibility::MaxRangeReturns)). Where a pose lays one sensor on the
/// other, what is near to them is left out as well: a vehicle, or whoever carries the sensor, is
/// seen alike from wherever it goes.
///
/// Weights of points ([`PointCloud::with_weights`]) count where poses are solved: a match, and a
/// pair of surface points, is multiplied by those of its two points, each the mean of its cube.
/// Surfaces, and the verdict, are those of all points.
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
    /// The length that all others follow from, in the unit of the coordinates, above 0: clouds
    /// are thinned to one point per cube of this side. Default [`filter::voxel_size_for`](crate::filter::voxel_size_for) of 5000
    /// points, of the cloud where it is longer.
    pub voxel: Option<f64>,
    /// Matches from which a pose is sought, at least 1; default 200. More find smaller
    /// overlaps, at a cost that grows with them.
    pub seeds: usize,
    /// What is known of the pose beforehand ([`Prior`]), its scale left out; default nothing.
    /// Poses of matches are exactly the best allowed; on the surfaces the nearest allowed pose
    /// is taken after each step.
    pub prior: Prior,
    /// Channels of the clouds ([`PointCloud::channels`]) by which points are compared too, as
    /// [`FeatureConfig::concatenate_channels`](super::FeatureConfig::concatenate_channels) says; default none. They find matches and
    /// count where surfaces look alike; the pose is settled on the shape alone.
    pub channels: Vec<Channel>,
    /// Whether returns at the limit of a sensor's range are looked for and left out; default
    /// true. False where a round wall or a sky that was modelled is taken for such: the reasons
    /// of the verdict say how many points are left out.
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
            range_limit: true,
            keep_no_returns: false,
            model: None,
            threads: 0,
        }
    }
}

/// Points that a cloud is thinned to.
pub(super) const DOWNSAMPLED_POINTS: usize = 5000;
/// How they are settled, and by as many points they are judged then.
const COARSE_REFINEMENT: RefineOptions =
    RefineOptions { max_points: 1000, max_iterations: 12, tolerance: 0.01 };
/// How the answer is settled: to where its own errors are larger than those of the last step.
const FINE_REFINEMENT: RefineOptions =
    RefineOptions { max_points: usize::MAX, max_iterations: 100, tolerance: 1e-4 };
/// Poses that move points apart by less than this, in lengths, are one.
const DUPLICATE_POSE: f64 = 3.0;
/// And from this on a runner-up is another answer.
const DISTINCT_POSE: f64 = 8.0;
/// A pose that is judged is as good as the one that it settles on, if that is nearer than this.
const MAX_REFINE_SHIFT: f64 = 1.0;
/// Times as far from the middle as half the points are, from which on a point is a stray.
const OUTLIER_FACTOR: f64 = 30.0;

/// All that was tried on two clouds, and what came out best.
pub(super) struct ConsensusSearch<'a> {
    /// With its length in force.
    config: Consensus,
    voxel_size: f64,
    scans: [Scan<'a>; 2],
    /// Correspondences from elsewhere, in place of those by descriptors.
    given: Option<&'a [PointPair]>,
    /// From where they were seen, where that is known.
    known_viewpoints: [Option<ViewpointHypothesis>; 2],
    trials: Vec<ViewpointTrial>,
    /// Which of them has the answer.
    best_trial: usize,
    refined: Refined,
    evidence: PoseEvidence,
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

    /// The same with another model for the verdict.
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

    /// The length that all others follow from.
    fn choose_voxel_size(&self, ends: [&FilteredCloud<'_>; 2]) -> Result<f64> {
        if let Some(voxel) = self.voxel {
            return Ok(voxel);
        }
        let [source, target] =
            par::join_pair(ends, |whole| whole.voxel_size_for(DOWNSAMPLED_POINTS))?;
        let side = source.max(target);
        if side <= 0.0 {
            // All points in one place.
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

    /// The search whose best pose is the answer.
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

    /// The search among all that belongs to the place, and what travels with the sensors.
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
            par::join_pair(named, |(cloud, name)| Scan::new(cloud, length, &self.channels, name))
        })?;
        let ends = || scans.each_ref();
        let sensors =
            times.time("viewpoints", || par::join_pair(ends(), |scan| scan.known_viewpoint()))?;
        let attempts = config.run_trials(&scans, sensors, given, length, times)?;
        let odds = |attempt: &ViewpointTrial| {
            attempt.candidates.first().map_or(f64::NEG_INFINITY, |best| best.log_odds)
        };
        // The first of those that are equally good.
        let ranked = attempts.iter().enumerate().rev();
        let best = ranked.max_by(|(_, a), (_, b)| odds(a).total_cmp(&odds(b)));
        let Some((best, at, first)) =
            best.and_then(|(best, at)| Some((best, at, at.candidates.first()?)))
        else {
            return Err(Error::NO_WEIGHT);
        };
        let ends = at.surface_refs();
        let settled = times.time("refine", || {
            refine(ends, &first.pose, INLIER_DISTANCE * length, FINE_REFINEMENT, &self.prior)
        });
        let evidence = at.evidence(&settled.pose, COARSE_REFINEMENT.max_points);
        Ok(ConsensusSearch {
            config,
            given,
            voxel_size: length,
            scans,
            known_viewpoints: sensors,
            trials: attempts,
            best_trial: best,
            refined: settled,
            evidence,
        })
    }
}

impl ConsensusSearch<'_> {
    /// The points that were searched, without those that were left out.
    pub(super) fn clouds(&self) -> [Cached<'_>; 2] {
        self.scans.each_ref().map(|scan| scan.filtered_cloud().cached())
    }

    /// The pose that came out best, between the clouds' own frames.
    fn best_pose(&self) -> Transform {
        let [from, onto] = &self.trials[self.best_trial].surfaces;
        to_cloud_frames(&self.refined.pose, from, onto)
    }

    /// The search once more without what may travel with the sensors, where `pose`, between the
    /// clouds' own frames, lays one on the other: their carriers do by it, wherever they went.
    /// The origin of a frame, which may be that of a shape, is no sensor here.
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

/// Eight points spread over the surface, in the order of its points; less those that are as far
/// away from the others as a stray return, which would tell poses apart by itself.
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

/// Mean distance between where two poses put `places`.
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
