//! The tables of a report: poses, fit, inputs, times.

use serde::Serialize;

use super::pair_result::PairResult;
use super::text;
use crate::cloud::{PointCloud, Transform};
use crate::error::Result;
use crate::math;
use crate::method::{CloudCounts, Registration, Timings};
use crate::search;
use crate::verify::PoseCovariance;

/// A pose in several notations.
#[derive(Debug, Clone, Serialize)]
pub(super) struct PoseText {
    pub(super) title: &'static str,
    pub(super) probability: Option<String>,
    /// Rows, each number with the fewest digits that read back exactly.
    pub(super) matrix: Vec<Vec<String>>,
    /// The whole matrix, for copying.
    pub(super) matrix_text: String,
    /// Rounded values, for reading.
    pub(super) axis_angle: String,
    pub(super) axis_angle_text: String,
    pub(super) quaternion: String,
    pub(super) quaternion_text: String,
    pub(super) shift: String,
    pub(super) scale: Option<String>,
}

impl PoseText {
    pub(super) fn new(
        title: &'static str,
        pose: &Transform,
        probability: Option<String>,
    ) -> PoseText {
        // Adding zero turns -0 into 0.
        let rows = pose.matrix().map(|row| row.map(|x| format!("{:?}", x + 0.0)));
        let vector = pose.rotation_vector();
        let angle = math::norm(vector);
        let axis = math::normalized(vector);
        let half = (angle / 2.0).sin();
        let [x, y, z] = math::scaled(axis, half);
        let quaternion = [x, y, z, (angle / 2.0).cos()];
        let all = |numbers: &[f64]| {
            numbers.iter().map(|x| format!("{:?}", x + 0.0)).collect::<Vec<_>>().join(" ")
        };
        let rounded = |numbers: &[f64], digits: usize| {
            let words = numbers.iter().map(|x| format!("{:.digits$}", x + 0.0));
            words.collect::<Vec<_>>().join(", ")
        };
        PoseText {
            title,
            probability,
            matrix: pose.matrix().map(|row| row.map(text::format_number).into()).into(),
            matrix_text: rows.map(|row| row.join(" ")).join("\n"),
            axis_angle: format!("{:.3}° about ({})", angle.to_degrees(), rounded(&axis, 4)),
            axis_angle_text: all(&vector),
            quaternion: rounded(&quaternion, 5),
            quaternion_text: all(&quaternion),
            shift: pose.translation.map(text::format_number).join(", "),
            scale: (pose.scale != 1.0).then(|| text::format_number(pose.scale)),
        }
    }
}

/// Uncertainty of the pose, if it is correct.
#[derive(Debug, Clone, Serialize)]
pub(super) struct Uncertainty {
    pub(super) rotation: String,
    pub(super) shift: String,
    pub(super) loose: usize,
}

impl Uncertainty {
    /// Computes the root mean squares over the three axes, one standard deviation each.
    pub(super) fn new(covariance: &PoseCovariance) -> Uncertainty {
        let root = |first: usize| {
            let trace: f64 = (first..first + 3).map(|k| covariance.matrix[k][k]).sum();
            (trace / 3.0).max(0.0).sqrt()
        };
        Uncertainty {
            rotation: text::format_number(root(0).to_degrees()),
            shift: text::format_number(root(3)),
            loose: covariance.unobservable.len(),
        }
    }
}

/// Describes the fit of the clouds.
pub(super) fn fit_rows(result: &PairResult<'_>) -> Vec<(&'static str, String)> {
    let mut rows = Vec::new();
    if let Some(verdict) = &result.verdict {
        let overlap = text::format_percent(verdict.overlap);
        rows.push(("Overlap", format!("{overlap} of a surface lies on the other and faces alike")));
    }
    if let Some(fit) = &result.evaluation {
        let distance = text::format_number(fit.max_distance);
        let shares = [fit.fitness, fit.target_fitness].map(text::format_percent);
        rows.push(("Source on target", format!("{} of the points within {distance}", shares[0])));
        rows.push(("Target on source", format!("{} of the points", shares[1])));
        if fit.inlier_rmse.is_finite() {
            let rmse = text::format_number(fit.inlier_rmse);
            rows.push(("Distance of those", format!("{rmse} (root mean square)")));
        }
        let beyond = fit.chance_corrected_fitness();
        rows.push(("Beyond chance", text::format_percent(beyond.max(0.0))));
    }
    if let Some(found) = result.registration {
        let all = text::format_count(found.connections as usize);
        let effective = text::format_number(found.effective_connections);
        rows.push(("Connections", format!("{all}, {effective} effective")));
        let stop = serde_word(&found.stop).replace('-', " ");
        rows.push(("Iterations", format!("{}, ended by {stop}", found.iterations)));
    }
    rows
}

/// Returns the word by which a value without fields is serialised.
fn serde_word(value: &impl Serialize) -> String {
    match serde_json::to_value(value) {
        Ok(serde_json::Value::String(word)) => word,
        _ => String::new(),
    }
}

/// A histogram of the distances of points to the other cloud.
#[derive(Debug, Clone, Serialize)]
pub(super) struct Histogram {
    /// Heights as shares of the highest, from 0 on, and the label of each bar.
    pub(super) bars: Vec<(f64, String)>,
    /// Share of the points beyond the last bar.
    pub(super) beyond: String,
    /// Position of the inlier distance along the bars, as a share.
    pub(super) near: f64,
    pub(super) near_text: String,
    pub(super) most_text: String,
}

/// Bars of a histogram. Chosen by hand.
const BIN_COUNT: usize = 40;

impl Histogram {
    /// Counts distances up to `most`.
    pub(super) fn new(distances: &[f32], most: f64, near: f64) -> Histogram {
        let mut counts = [0usize; BIN_COUNT];
        let mut beyond = 0;
        for &distance in distances {
            let share = f64::from(distance) / most;
            match share < 1.0 {
                true => counts[(share * BIN_COUNT as f64) as usize] += 1,
                false => beyond += 1,
            }
        }
        let highest = counts.iter().copied().max().unwrap_or(0).max(1) as f64;
        let all = distances.len().max(1) as f64;
        let edge = |k: usize| text::format_number(most * k as f64 / BIN_COUNT as f64);
        let bar = |(k, &count): (usize, &usize)| {
            let percent = text::format_percent(count as f64 / all);
            (count as f64 / highest, format!("{percent} from {} to {}", edge(k), edge(k + 1)))
        };
        Histogram {
            bars: counts.iter().enumerate().map(bar).collect(),
            beyond: text::format_percent(f64::from(beyond) / all),
            near: near / most,
            near_text: text::format_number(near),
            most_text: text::format_number(most),
        }
    }
}

/// The properties of a cloud.
#[derive(Debug, Clone, Serialize)]
pub(super) struct Input {
    pub(super) name: String,
    pub(super) used: String,
    pub(super) dropped: String,
    pub(super) described: Option<String>,
    pub(super) keypoints: Option<String>,
    pub(super) oriented_by: Option<String>,
    pub(super) diagonal: String,
    pub(super) resolution: String,
    pub(super) unit: &'static str,
    pub(super) viewpoint: Option<String>,
    pub(super) channels: Option<String>,
}

pub(super) fn inputs(
    found: Option<&Registration>,
    clouds: [&PointCloud; 2],
    names: &[String; 2],
) -> Result<[Input; 2]> {
    let counts = found.map(|found| found.first().points);
    let counts = counts.map(|counts| [counts.source, counts.target]);
    let input = |k: usize| {
        let (cloud, counts): (_, Option<CloudCounts>) = (clouds[k], counts.map(|both| both[k]));
        let channels: Vec<&str> = cloud.channels().names().collect();
        let dropped = counts.map_or(cloud.dropped(), |counts| counts.dropped);
        Ok(Input {
            name: names[k].clone(),
            used: text::format_count(counts.map_or(cloud.len(), |counts| counts.used)),
            dropped: text::format_count(dropped),
            described: counts.map(|counts| text::format_count(counts.described)),
            keypoints: counts.and_then(|counts| counts.keypoints).map(text::format_count),
            oriented_by: counts.and_then(|counts| counts.oriented_by).map(|by| serde_word(&by)),
            diagonal: text::format_number(cloud.diagonal()),
            resolution: text::format_number(search::resolution(cloud.points())?),
            unit: text::guess_unit(cloud.diagonal()),
            viewpoint: cloud.viewpoint().map(|at| at.map(text::format_number).join(", ")),
            channels: (!channels.is_empty()).then(|| channels.join(", ")),
        })
    };
    Ok([input(0)?, input(1)?])
}

/// Ratio of sizes above which clouds may be in different units. Chosen by hand.
const MAX_SIZE_RATIO: f64 = 50.0;

/// Returns a message if one cloud is very much larger.
pub(super) fn unit_warning([source, target]: [f64; 2], scale: f64) -> Option<String> {
    let ratio = (source * scale).max(target) / (source * scale).min(target);
    let smaller = if source * scale < target { "source" } else { "target" };
    (ratio > MAX_SIZE_RATIO && ratio.is_finite()).then(|| {
        format!(
            "The {smaller} is {} times smaller: have both one unit?",
            text::format_number(ratio)
        )
    })
}

/// A stage and its time.
#[derive(Debug, Clone, Serialize)]
pub(super) struct Stage {
    pub(super) name: String,
    pub(super) seconds: String,
    /// Share of the longest.
    pub(super) share: f64,
}

impl Stage {
    pub(super) fn from_stages(stages: &Timings) -> Vec<Stage> {
        let longest = stages.0.iter().map(|stage| stage.1).fold(0.0, f64::max);
        let longest = if longest > 0.0 { longest } else { 1.0 };
        let told = |(name, seconds): &(std::borrow::Cow<'static, str>, f64)| Stage {
            name: name.to_string(),
            seconds: format!("{seconds:.3}"),
            share: seconds / longest,
        };
        stages.0.iter().map(told).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pose_is_written_so_that_it_is_read_back() {
        let mut pose = Transform::from_rotation_vector([0.1, 2.0, -0.3]);
        pose.translation = [1.0 / 3.0, 0.0, -5e6];
        let posed = PoseText::new("a pose", &pose, None);
        let read = |text: &str| -> Vec<f64> {
            text.split_whitespace().map(|word| word.parse().unwrap()).collect()
        };
        assert_eq!(read(&posed.matrix_text), pose.matrix().as_flattened());
        let [x, y, z, w] = read(&posed.quaternion_text).try_into().unwrap();
        assert!((x * x + y * y + z * z + w * w - 1.0).abs() < 1e-12);
        // R = I + 2 w [v] + 2 [v]²: one entry determines the sign.
        assert!((2.0 * (x * y + z * w) - pose.rotation[1][0]).abs() < 1e-12);
        let vector = read(&posed.axis_angle_text);
        assert!((vector[1] - 2.0).abs() < 1e-12);
        assert_eq!(posed.scale, None);
    }

    #[test]
    fn a_histogram_counts_all_points() {
        let found = Histogram::new(&[0.0, 0.01, 0.99, 1.0, f32::INFINITY], 1.0, 0.2);
        assert_eq!((found.bars.len(), found.bars[0].0, found.bars[39].0), (BIN_COUNT, 1.0, 0.5));
        assert_eq!((found.beyond.as_str(), found.near), ("40 %", 0.2));
        assert_eq!(Histogram::new(&[], 1.0, 0.2).beyond, "0 %");
    }

    #[test]
    fn very_different_sizes_are_told() {
        assert_eq!(unit_warning([1.0, 2.0], 1.0), None);
        assert!(unit_warning([1.0, 1000.0], 1.0).unwrap().contains("source"));
        assert_eq!(unit_warning([1.0, 1000.0], 900.0), None);
        assert_eq!(unit_warning([0.0, 0.0], 1.0), None);
    }
}
