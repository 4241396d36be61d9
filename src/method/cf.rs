//! CF: the paper's full connection form, solved once.

use serde::{Deserialize, Serialize};

use super::features::{DescriptorScale, FeatureConfig};
use super::registration::{PointCounts, Registration, Timings};
use super::{Cached, MethodRecord, Register, SolvedPose, StopReason};
use crate::cloud::PointCloud;
use crate::descriptor::HistogramScale;
use crate::error::Result;
use crate::keypoint::Keypoints;
use crate::moments::{FullConnection, Moments, check_tolerance};
use crate::par;
use crate::pose::{self, Prior, ScaleEstimate, Solver};
use crate::search::Neighborhood;
use crate::verify::{FitnessRule, MIN_KEYPOINTS, Warning};
use crate::weight::{Bandwidth, Normalization, WeightScheme};

/// Full Connection Form Solution (the paper, section III): describe every point by FPFH, connect
/// all pairs, weight each by descriptor similarity, solve once in closed form.
///
/// Finds any rotation without an initial pose, for clouds of the same surface. The method does not
/// handle partial overlap: below about nine tenths (four fifths with
/// [`multiscale`](Cf::multiscale)) the pose is biased, and the result has a warning.
///
/// Weights of points ([`PointCloud::with_weights`]) multiply the weights of their connections after
/// normalisation ([`FullConnection::with_point_weights`]); points of any weight are used for the
/// descriptors of their neighbours.
///
/// ```
/// use cfreg::{method::{Cf, Register}, weight::WeightScheme};
/// # use cfreg::cloud::shape::boulder;
/// # let (source, target) = (boulder().sample(400, 1)?, boulder().sample(400, 2)?);
/// let cf = Cf { weights: WeightScheme::Cauchy, beta: Some(50.0.into()), ..Cf::default() };
/// let registration = cf.register(&source, &target)?;
/// println!("{:?} {:?}", registration.transform.matrix(), registration.doubts);
/// # Ok::<(), cfreg::Error>(())
/// ```
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(default)]
pub struct Cf {
    /// Settings of the descriptors.
    #[serde(flatten)]
    pub features: FeatureConfig,
    /// Kernel of the squared descriptor distance; default the paper's Gaussian.
    pub weights: WeightScheme,
    /// Squared bandwidth β of the kernel, in squared descriptor units, 1e-12 to 1e12, or a rule by
    /// which it follows from the descriptors ([`Bandwidth::Auto`]). Default that of the histogram's
    /// scale ([`HistogramScale::default_beta`]: the paper's 100), and [`Bandwidth::Auto`] where the
    /// clouds' own descriptors replace FPFH. A smaller β trusts fewer, more
    /// similar pairs; raise it when the weights vanish or the effective connections fall below the
    /// number of points.
    ///
    /// [`HistogramScale::default_beta`]: crate::descriptor::HistogramScale::default_beta
    pub beta: Option<Bandwidth>,
    /// Normalisation of the full connection; default the paper's none. `both` helps under
    /// partial overlap and repeated structure, at three times the cost.
    pub normalization: Normalization,
    /// Largest share of the weight that may be left out to save time, at least 0 and below 1;
    /// default 0, every connection weighted. Only connections of provably that little weight are
    /// left out ([`FullConnection::pruned_moments`] has the guarantee), and only from 5·10⁷
    /// connections on: two clouds of 7,100 points. Set 1e-3 for clouds that large: half the time at
    /// 30,000 points, a quarter at 100,000 (Stanford dragon), the rotation within 1e-4 degrees. No
    /// gain with heavy-tailed kernels such as `cauchy`.
    pub tolerance: f64,
    /// Closed-form solver; all give the same pose.
    pub solver: Solver,
    /// Whether the clouds may differ in scale; default no.
    pub scale: ScaleEstimate,
    /// Constraints on the pose ([`Prior`]); default none.
    pub prior: Prior,
    /// Number of threads, 0 for all cores. Never changes the result.
    pub threads: usize,
}

impl Cf {
    /// Returns the best configuration of the study of weight schemes, still one step: descriptors
    /// at three scales, each with its own normals and including a point's own histogram (Open3D's
    /// scale), a bandwidth from the descriptors, dual softmax.
    ///
    /// On independent samples a quarter of the default's rotation error, at five to six times its
    /// cost (500 to 10,000 points, `cfreg reproduce --only scaling`).
    ///
    /// ```
    /// use cfreg::method::{Cf, Register};
    /// # use cfreg::cloud::shape::boulder;
    /// # let (source, target) = (boulder().sample(500, 1)?, boulder().sample(500, 2)?);
    /// let registration = Cf::multiscale().register(&source, &target)?;
    /// assert!(registration.transform.angle().to_degrees() < 5.0);
    /// # Ok::<(), cfreg::Error>(())
    /// ```
    pub fn multiscale() -> Cf {
        let scale = |(k, normals)| DescriptorScale {
            neighborhood: Neighborhood::Nearest(k),
            normal_neighborhood: Some(Neighborhood::Nearest(normals)),
        };
        Cf {
            features: FeatureConfig {
                neighborhood: Neighborhood::Nearest(100),
                normal_neighborhood: Some(Neighborhood::Nearest(10)),
                more_scales: [(200, 50), (400, 150)].map(scale).to_vec(),
                histogram: HistogramScale::Open3d,
                ..FeatureConfig::default()
            },
            beta: Some(Bandwidth::Auto(Bandwidth::DEFAULT_SHARE)),
            normalization: Normalization::Both,
            ..Cf::default()
        }
    }

    /// Returns the settings with all dependent defaults filled in.
    pub fn resolved(&self) -> Cf {
        Cf { beta: Some(self.bandwidth()), ..self.clone() }
    }

    /// Returns the bandwidth; if none is set, the histogram's default, or that of the descriptors
    /// that replace FPFH.
    pub fn bandwidth(&self) -> Bandwidth {
        self.beta.unwrap_or_else(|| match self.features.replaces_fpfh() {
            true => Bandwidth::Auto(Bandwidth::DEFAULT_SHARE),
            false => self.features.histogram.default_beta().into(),
        })
    }

    /// Checks the ranges.
    ///
    /// # Errors
    /// Those of [`FeatureConfig::validate`], [`Bandwidth::validate`], [`Prior::validate_for`] and
    /// [`check_tolerance`].
    pub fn validate(&self) -> Result<()> {
        self.features.validate()?;
        check_tolerance(self.tolerance)?;
        self.prior.validate_for(self.scale)?;
        self.bandwidth().validate()
    }

    /// Registers with custom weights: `weigh` computes the moments of the full connection, in place
    /// of [`weights`](Self::weights), [`beta`](Self::beta), [`normalization`](Self::normalization)
    /// and [`tolerance`](Self::tolerance).
    ///
    /// The configuration in the result has `custom` for the weights.
    ///
    /// ```
    /// use cfreg::{method::Cf, weight::Normalization};
    /// # use cfreg::cloud::shape::boulder;
    /// # let (source, target) = (boulder().sample(400, 1)?, boulder().sample(400, 2)?);
    /// let cf = Cf::default();
    /// let registration = cf.register_with(&source, &target, |connection| {
    ///     connection.moments(&|d2: f32| 1.0 / (1.0 + d2 * d2), Normalization::Both)
    /// })?;
    /// println!("{:?}", registration.doubts);
    /// # Ok::<(), cfreg::Error>(())
    /// ```
    ///
    /// # Errors
    /// As [`Register::register`], and those of `weigh`.
    pub fn register_with(
        &self,
        source: &PointCloud,
        target: &PointCloud,
        weigh: impl FnOnce(&FullConnection) -> Result<Moments> + Send,
    ) -> Result<Registration> {
        par::with_threads(self.threads, || {
            let named = MethodRecord::new("cf", &self.with_custom_weights());
            let ends = [source.into(), target.into()];
            self.run(ends, None, named, |connection| Ok((weigh(connection)?, None)))
        })?
    }

    /// Returns the settings with unnamed weights.
    pub(super) fn with_custom_weights(&self) -> Cf {
        let (weights, normalization) = (WeightScheme::Custom, Normalization::None);
        Cf { weights, beta: None, normalization, tolerance: 0.0, ..self.clone() }
    }

    /// Computes the moments by the configured weights, and their bandwidth.
    pub(super) fn weighted_moments(
        &self,
        connection: &FullConnection,
    ) -> Result<(Moments, Option<f64>)> {
        let beta = connection.bandwidth(self.bandwidth())?;
        let Cf { weights, normalization, tolerance, .. } = *self;
        let moments = connection.pruned_moments(weights, beta, normalization, tolerance)?;
        Ok((moments, Some(beta)))
    }

    /// Registers all points, or the keypoints of `detector`; `record` is that of the calling
    /// method, with its resolved settings.
    pub(super) fn run(
        &self,
        [source, target]: [Cached<'_>; 2],
        detector: Option<&Keypoints>,
        record: MethodRecord,
        weigh: impl FnOnce(&FullConnection) -> Result<(Moments, Option<f64>)>,
    ) -> Result<Registration> {
        self.validate()?;
        let mut times = Timings::default();
        let [source_side, target_side] =
            self.features.extract_pair([source, target], detector, &mut times)?;
        let (connection, beta, moments) = times.time("moments", || {
            let connection = source_side.connection(&target_side)?;
            let (moments, beta) = weigh(&connection)?;
            Ok::<_, crate::Error>((connection, beta, moments))
        })?;
        let solution = times
            .time("solve", || pose::solve_with(&moments, self.solver, self.scale, &self.prior))?;
        let points = PointCounts { source: source_side.counts(), target: target_side.counts() };
        let fewest = points.source.described.min(points.target.described);
        let few = detector.is_some() && fewest < MIN_KEYPOINTS;
        let doubt = Warning::FewKeypoints { found: fewest, needed: MIN_KEYPOINTS };
        let solved = SolvedPose {
            transform: solution.transform,
            moments: Some(moments),
            singular_values: Some(solution.singular_values),
            connections: connection.pairs(),
            iterations: 1,
            stop: StopReason::OneStep,
            trace: Vec::new(),
            points: Some(points),
            time_s: times,
            method: record,
            warnings: few.then_some(doubt).into_iter().collect(),
            fitness: FitnessRule::GLOBAL,
        };
        let concluded = solved.finish_cached(source, target)?;
        Ok(Registration { beta, ..concluded })
    }
}

impl Register for Cf {
    fn register(&self, source: &PointCloud, target: &PointCloud) -> Result<Registration> {
        self.register_cached(source.into(), target.into())
    }

    fn register_cached(&self, source: Cached<'_>, target: Cached<'_>) -> Result<Registration> {
        par::with_threads(self.threads, || {
            let named = MethodRecord::new("cf", &self.resolved());
            self.run([source, target], None, named, |connection| self.weighted_moments(connection))
        })?
    }
}
