//! The report of a pair.

use std::borrow::Cow;

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use serde::Serialize;

use super::arrows::Arrow;
use super::camera::{Camera, Viewport};
use super::display::DisplayCloud;
use super::page;
use super::pair_result::PairResult;
use super::preview::{PoseView, draw_preview};
use super::tables::{self, Histogram, Input, PoseText, Stage, Uncertainty};
use super::text::{self, Headline};
use super::weight_view::WeightView;
use crate::cloud::{PointCloud, Transform};
use crate::error::Result;
use crate::figure::Figure;
use crate::math::{self, Vec3};
use crate::method::{Method, Registration, WeightGraph};
use crate::search;
use crate::verify;

/// Two clouds, and their registration result.
///
/// ```
/// use cfreg::method::{Method, Register};
/// use cfreg::report::PairReport;
/// # use cfreg::cloud::shape::boulder;
/// # let (source, target) = (boulder().sample(600, 1)?, boulder().sample(600, 2)?);
/// let found = Method::register(&"consensus".parse()?, &source, &target)?;
/// let html = PairReport::new(&found, &source, &target).html()?;
/// assert!(html.starts_with("<!doctype html>"));
/// # Ok::<(), cfreg::Error>(())
/// ```
pub struct PairReport<'a> {
    result: PairResult<'a>,
    source: &'a PointCloud,
    target: &'a PointCloud,
    /// Names of the clouds; default `source` and `target`.
    pub names: [String; 2],
    /// The command that reproduces the result; default none.
    pub command: Option<String>,
    /// The true pose, if known.
    pub truth: Option<Transform>,
    /// Most points of either cloud that are shown, at least 1; default 100,000.
    pub points: usize,
}

/// Default of [`Pair::points`]: 200,000 together rotate smoothly on a laptop.
const DEFAULT_MAX_POINTS: usize = 100_000;
/// Largest residual on the colour scale, in inlier distances. Chosen by hand.
const MAX_RESIDUAL_FACTOR: f64 = 5.0;
/// Points of either cloud in the still picture that replaces the view, and in a figure for papers.
/// Chosen by hand.
const PREVIEW_POINTS: usize = 40_000;
const FIGURE_POINTS: usize = 12_000;
/// Distance to which a remote source is moved for display, in radii of both after registration.
/// Chosen by hand.
const MAX_START_DISTANCE: f64 = 2.5;

/// Data for the page's scripts.
#[derive(Serialize)]
struct ViewerData<'a> {
    source: &'a DisplayCloud,
    target: &'a DisplayCloud,
    look: Camera,
    /// Radius of the arrows.
    radius: f64,
    stands: Vec<ViewerPose>,
    /// Largest residual on the colour scale, and the inlier distance.
    residual: [f64; 2],
    arrows: &'a [Arrow],
    weights: Option<&'a WeightView>,
}

/// A displayed source pose: from coordinates about its middle to coordinates about the target's.
#[derive(Serialize)]
struct ViewerPose {
    name: &'static str,
    matrix: [[f64; 4]; 4],
    #[serde(flatten)]
    frame: Viewport,
}

impl ViewerPose {
    fn new(stand: &PoseView<'static>, middles: [Vec3; 2]) -> ViewerPose {
        ViewerPose {
            name: stand.title,
            matrix: relative_to_centers(&stand.pose, middles).matrix(),
            frame: stand.frame,
        }
    }
}

/// Data for the page's text.
#[derive(Serialize)]
struct PageText<'a> {
    names: &'a [String; 2],
    /// The names without folders if these names differ.
    titles: [String; 2],
    method: String,
    headline: Headline,
    stands: Vec<&'static str>,
    poses: Vec<PoseText>,
    uncertainty: Option<Uncertainty>,
    arrows: &'a [Arrow],
    fit: Vec<(&'static str, String)>,
    histogram: Histogram,
    weights: Option<&'a WeightView>,
    weights_absent: Option<String>,
    inputs: [Input; 2],
    units_differ: Option<String>,
    stages: Vec<Stage>,
    seconds: String,
    config: String,
    command: Option<&'a str>,
    thinned: bool,
    far: Option<String>,
    picture: String,
    version: &'static str,
}

impl<'a> PairReport<'a> {
    /// Creates a report on a result; the clouds are those that were passed to the method. The page
    /// shows the weights that the result holds ([`Registration::weight_graph`]); of a result without
    /// them, as one that was saved, they are computed again.
    pub fn new(
        found: &'a Registration,
        source: &'a PointCloud,
        target: &'a PointCloud,
    ) -> PairReport<'a> {
        PairReport::from_result(PairResult::from_registration(found), source, target)
    }

    pub(super) fn from_result(
        result: PairResult<'a>,
        source: &'a PointCloud,
        target: &'a PointCloud,
    ) -> PairReport<'a> {
        PairReport {
            names: ["source", "target"].map(String::from),
            command: None,
            truth: None,
            points: DEFAULT_MAX_POINTS,
            result,
            source,
            target,
        }
    }

    /// Renders the page as one file.
    ///
    /// # Errors
    /// [`Error::TooFewPoints`](crate::Error::TooFewPoints) for an empty cloud, errors of drawing,
    /// and those of [`Method::weight_graph`](crate::method::Method::weight_graph) that the page
    /// does not report itself.
    pub fn html(&self) -> Result<String> {
        let result = &self.result;
        let pose = result.pose;
        let [mut source, mut target] = self.display_clouds()?;
        let near = self.inlier_distance()?;
        let most = MAX_RESIDUAL_FACTOR * near;
        source.set_residuals(self.target, &pose, 1.0, most)?;
        target.set_residuals(self.source, &pose.inverse(), pose.scale, most)?;
        let (weights, weights_absent) = self.add_weights(&mut source, &mut target, near);
        let look = Camera::facing(&target.cloud);
        let stands = self.pose_views(&source, &target);
        let still =
            draw_preview([&source, &target], &look, &stands[..2], PREVIEW_POINTS, (480, 420), true);
        let covariance = result.verdict.as_ref().and_then(|verdict| verdict.covariance.as_ref());
        let arrows = covariance
            .map_or_else(Vec::new, |known| Arrow::unconstrained_motions(known, target.middle));
        let middles = [source.middle, target.middle];
        let view = ViewerData {
            source: &source,
            target: &target,
            look,
            radius: stands[1].frame.radius,
            stands: stands.iter().map(|stand| ViewerPose::new(stand, middles)).collect(),
            residual: [most, near],
            arrows: &arrows,
            weights: weights.as_ref(),
        };
        let inputs = tables::inputs(result.registration, [self.source, self.target], &self.names)?;
        let diagonals = [self.source.diagonal(), self.target.diagonal()];
        let times = result.registration.map(|found| found.time_s.clone()).unwrap_or_default();
        let settings = result.registration.map(|found| &found.method.settings);
        let text = PageText {
            titles: text::distinct_names(&self.names),
            names: &self.names,
            method: result.method_names(),
            headline: Headline::new(result),
            stands: stands.iter().map(|stand| stand.title).collect(),
            poses: self.poses(),
            uncertainty: covariance.map(Uncertainty::new),
            arrows: &arrows,
            fit: tables::fit_rows(result),
            histogram: Histogram::new(&source.distances, most, near),
            weights: weights.as_ref(),
            weights_absent,
            inputs,
            units_differ: tables::unit_warning(diagonals, pose.scale),
            stages: Stage::from_stages(&times),
            seconds: text::format_number(times.total()),
            config: serde_json::to_string_pretty(&settings).unwrap_or_default(),
            command: self.command.as_deref(),
            thinned: [&source, &target].iter().any(|cloud| cloud.shown + cloud.strays < cloud.of),
            far: self.offset_text(&source, &target),
            picture: STANDARD.encode(still.png()?),
            version: env!("CARGO_PKG_VERSION"),
        };
        page::render_pair(&text, &view)
    }

    /// Draws the clouds before and after, side by side, for papers.
    ///
    /// # Errors
    /// [`Error::TooFewPoints`](crate::Error::TooFewPoints) for an empty cloud.
    pub fn figure(&self) -> Result<Figure> {
        let [source, target] = self.display_clouds()?;
        let (look, stands) = (Camera::facing(&target.cloud), self.pose_views(&source, &target));
        Ok(draw_preview([&source, &target], &look, &stands[..2], FIGURE_POINTS, (520, 480), true))
    }

    /// Draws the aligned pair alone, small.
    ///
    /// # Errors
    /// Those of [`figure`](Self::figure).
    pub fn thumbnail(&self, size: (u32, u32)) -> Result<Figure> {
        let [source, target] = self.display_clouds()?;
        let (look, pose) = (Camera::facing(&target.cloud), self.result.pose);
        let frame = Viewport::new(&source, &target, &pose);
        let after = [PoseView { title: "", pose, frame }];
        let most = (size.0 * size.1 / 4) as usize;
        Ok(draw_preview([&source, &target], &look, &after, most, size, false))
    }

    fn display_clouds(&self) -> Result<[DisplayCloud; 2]> {
        for (cloud, what) in [(self.source, "the source"), (self.target, "the target")] {
            if cloud.is_empty() {
                let (what, found, needed) = (what.into(), 0, 1);
                return Err(crate::Error::TooFewPoints { what, found, needed });
            }
        }
        crate::par::join_pair([self.source, self.target], |cloud| {
            DisplayCloud::new(cloud, self.points.max(1))
        })
    }

    /// Returns the inlier distance.
    fn inlier_distance(&self) -> Result<f64> {
        let told = self.result.evaluation.map(|fit| fit.max_distance);
        match told.filter(|&distance| distance > 0.0 && distance.is_finite()) {
            Some(distance) => Ok(distance),
            None => {
                let scale = self.result.pose.scale;
                let found = verify::default_distance(self.source, self.target, scale)?;
                Ok(if found > 0.0 { found } else { 1.0 })
            }
        }
    }

    /// Assigns the method's weights to the points that are shown; otherwise returns the reason for
    /// their absence.
    fn add_weights(
        &self,
        source: &mut DisplayCloud,
        target: &mut DisplayCloud,
        near: f64,
    ) -> (Option<WeightView>, Option<String>) {
        let pose = &self.result.pose;
        let told = |text: &str| (None, Some(text.to_string()));
        let connections = match self.weight_graph() {
            Ok(connections) => connections,
            Err(absent) => return (None, Some(absent)),
        };
        let connections = &*connections;
        let both = [&mut *source, &mut *target];
        for (k, shown) in both.into_iter().enumerate() {
            let received = &connections.weight_sums[k];
            let mut sorted = received.clone();
            sorted.sort_by(f64::total_cmp);
            let Some(&most) = sorted.get(sorted.len() * 99 / 100).filter(|&&most| most > 0.0)
            else {
                continue;
            };
            let points = &connections.points[k];
            let scale = if k == 0 { pose.scale } else { 1.0 };
            let spacing = median_spacing(points).max(near / scale);
            if let Err(error) = shown.set_weights(points, received, 2.0 * spacing, most) {
                return told(&format!("They could not be shown: {error}."));
            }
        }
        let middles = [source.middle, target.middle];
        (Some(WeightView::new(connections, pose, middles, near)), None)
    }

    /// Returns the weights that the result holds, or computes them again; otherwise the reason for
    /// their absence.
    fn weight_graph(&self) -> std::result::Result<Cow<'_, WeightGraph>, String> {
        let Some(found) = self.result.registration else {
            return Err("The result does not say with which settings it was made.".into());
        };
        if let Some(held) = &found.weight_graph {
            return Ok(Cow::Borrowed(held));
        }
        let record = &found.first().method;
        if record.settings.get("given_correspondences").is_some() {
            return Err("The correspondences were given, and the result does not hold them.".into());
        }
        let Some(method) = record.parse::<Method>() else {
            return Err("The result does not say with which settings it was made.".into());
        };
        match method.weight_graph(self.source, self.target, &self.result.pose) {
            Ok(Some(connections)) => Ok(Cow::Owned(connections)),
            Ok(None) if matches!(method, Method::Cf(_) | Method::Cfk(_)) => {
                Err("The weights were a function that is not here any more.".into())
            }
            Ok(None) => Err(
                "This method connects points by where the pose puts them: colour the clouds by \
                 residual to see which."
                    .into(),
            ),
            Err(error) => Err(format!("They could not be made again: {error}.")),
        }
    }

    /// Returns the displayed poses of the source: as in its file, the result, and the alternatives.
    fn pose_views(&self, source: &DisplayCloud, target: &DisplayCloud) -> Vec<PoseView<'static>> {
        let stand =
            |title, pose| PoseView { title, pose, frame: Viewport::new(source, target, &pose) };
        let after = stand("after", self.result.pose);
        let mut before = Transform::IDENTITY;
        if let Some((off, beside)) = self.initial_offset(source, target, after.frame) {
            let nearer = math::scaled(math::normalized(off), beside);
            before.translation = math::sub(nearer, off);
        }
        let other = self.result.verdict.as_ref().and_then(|verdict| verdict.runner_up.as_ref());
        let mut stands = vec![stand("before", before), after];
        stands.extend(other.map(|other| stand("other", other.transform)));
        stands.extend(self.truth.map(|truth| stand("truth", truth)));
        stands
    }

    /// Returns the vector from the target to the source, and the display distance, if they are too
    /// far apart in their files to be seen together.
    fn initial_offset(
        &self,
        source: &DisplayCloud,
        target: &DisplayCloud,
        after: Viewport,
    ) -> Option<(Vec3, f64)> {
        let off = math::sub(source.middle, target.middle);
        let beside = MAX_START_DISTANCE * after.radius;
        (math::norm(off) > beside).then_some((off, beside))
    }

    /// Returns that distance.
    fn offset_text(&self, source: &DisplayCloud, target: &DisplayCloud) -> Option<String> {
        let after = Viewport::new(source, target, &self.result.pose);
        self.initial_offset(source, target, after)
            .map(|(off, _)| text::format_number(math::norm(off)))
    }

    fn poses(&self) -> Vec<PoseText> {
        let result = &self.result;
        let mut poses = vec![PoseText::new("The pose", &result.pose, None)];
        if let Some(other) = result.verdict.as_ref().and_then(|verdict| verdict.runner_up.as_ref())
        {
            let probability = Some(text::format_percent(other.probability));
            poses.push(PoseText::new("The best other pose", &other.transform, probability));
        }
        poses.extend(self.truth.map(|truth| PoseText::new("The true pose", &truth, None)));
        poses
    }
}

/// Converts a motion between the clouds' own frames to coordinates about their middles.
fn relative_to_centers(pose: &Transform, [source, target]: [Vec3; 2]) -> Transform {
    Transform { translation: math::sub(pose.apply(source), target), ..*pose }
}

/// Returns the median distance of points to the nearest one, 0 if it is unknown.
fn median_spacing(points: &[Vec3]) -> f64 {
    let Some(&first) = points.first() else { return 0.0 };
    let local: Vec<[f32; 3]> =
        points.iter().map(|&p| math::sub(p, first).map(|x| x as f32)).collect();
    search::resolution(&local).unwrap_or(0.0)
}
