//! Reported probabilities against the share of correct poses: numbers and a figure.

use super::BenchmarkRow;
use crate::error::{Error, Result};
use crate::figure::{Axes, Content, Curve, Figure, Panel};

/// Classes of the probability. Chosen by hand.
const BIN_COUNT: usize = 10;

/// Poses whose probabilities are in the same tenth.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct ReliabilityBin {
    /// Lower end of the class; the upper is a tenth more.
    pub from: f64,
    /// Number of poses, at least 1.
    pub poses: usize,
    /// Mean of the reported probabilities.
    pub predicted: f64,
    /// Share of correct poses.
    pub observed: f64,
}

/// Returns the tenths that have poses, in order; rows without a probability are ignored.
pub fn reliability_bins<'a>(
    rows: impl IntoIterator<Item = &'a BenchmarkRow>,
) -> Vec<ReliabilityBin> {
    let mut sums = [(0usize, 0.0, 0usize); BIN_COUNT];
    for row in rows {
        if let Some(told) = row.probability {
            let (poses, all, right) = &mut sums[((10.0 * told) as usize).min(BIN_COUNT - 1)];
            *poses += 1;
            *all += told;
            *right += usize::from(row.right);
        }
    }
    let told = sums.into_iter().enumerate().filter(|(_, (poses, ..))| *poses > 0);
    told.map(|(k, (poses, told, right))| ReliabilityBin {
        from: 0.1 * k as f64,
        poses,
        predicted: told / poses as f64,
        observed: right as f64 / poses as f64,
    })
    .collect()
}

/// Computes the expected calibration error: the mean over poses of the difference between reported
/// probability and share of correct poses.
pub fn calibration_error(classes: &[ReliabilityBin]) -> f64 {
    let off =
        |class: &ReliabilityBin| class.poses as f64 * (class.predicted - class.observed).abs();
    let all: usize = classes.iter().map(|class| class.poses).sum();
    classes.iter().map(off).sum::<f64>() / all as f64
}

/// Draws a curve for each method that reports probabilities, shaded where 95 % of the observed
/// shares would be, and the diagonal of perfect calibration.
///
/// # Errors
/// [`Error::Config`] of `figure` if no method reports a probability.
pub fn figure(rows: &[BenchmarkRow]) -> Result<Figure> {
    let mut methods: Vec<&str> = Vec::new();
    for row in rows.iter().filter(|row| row.probability.is_some()) {
        if !methods.contains(&row.method.as_str()) {
            methods.push(&row.method);
        }
    }
    if methods.is_empty() {
        return Err(Error::config(
            "figure",
            "empty",
            "no method told a probability: consensus does",
        ));
    }
    let told = methods.into_iter().map(|method| {
        let classes = reliability_bins(rows.iter().filter(|row| row.method == method));
        Curve {
            name: method.into(),
            points: classes.iter().map(|class| [class.predicted, class.observed]).collect(),
            band: classes.iter().map(interval).collect(),
            guide: false,
        }
    });
    let diagonal = Curve {
        name: "told = true".into(),
        points: vec![[0.0, 0.0], [1.0, 1.0]],
        guide: true,
        ..Curve::default()
    };
    let content = Content::Curves {
        x: "probability told, mean of a tenth".into(),
        y: "share of right poses".into(),
        axes: Axes::Linear,
        curves: std::iter::once(diagonal).chain(told).collect(),
    };
    let panel = Panel { title: "Told and true".into(), content };
    Ok(Figure { panels: vec![panel], columns: 1, size: (620, 460) })
}

/// Returns the 95 % confidence interval of the true share from the observed one (Wilson 1927).
fn interval(class: &ReliabilityBin) -> [f64; 2] {
    const Z: f64 = 1.96;
    let (n, share) = (class.poses as f64, class.observed);
    let middle = share + Z * Z / (2.0 * n);
    let half = Z * (share * (1.0 - share) / n + Z * Z / (4.0 * n * n)).sqrt();
    [-half, half].map(|off| ((middle + off) / (1.0 + Z * Z / n)).clamp(0.0, 1.0))
}

#[cfg(test)]
mod tests {
    use super::super::SuccessCriterion;
    use super::*;

    fn row(method: &str, right: bool, probability: Option<f64>) -> BenchmarkRow {
        BenchmarkRow {
            dataset: "rooms".into(),
            source: "a".into(),
            target: "b".into(),
            overlap: None,
            method: method.into(),
            right,
            rule: SuccessCriterion::Indoor,
            rotation_deg: None,
            translation: None,
            accepted: true,
            ambiguous: false,
            probability,
            nees: None,
            seconds: 0.1,
            error: String::new(),
        }
    }

    #[test]
    fn a_curve_is_what_was_told_and_what_was_right() {
        let rows = [
            row("consensus", false, Some(0.02)),
            row("icp", true, None),
            row("consensus", true, Some(0.91)),
            row("consensus", true, Some(1.0)),
            row("consensus", true, Some(0.94)),
            row("consensus", false, Some(0.95)),
        ];
        let [low, high] = reliability_bins(&rows)[..] else { panic!("two classes") };
        assert_eq!((low.from, low.poses, low.predicted, low.observed), (0.0, 1, 0.02, 0.0));
        assert_eq!((high.from, high.poses, high.observed), (0.9, 4, 0.75));
        assert!((high.predicted - 0.95).abs() < 1e-12);
        // A fifth of the poses differ by 0.02, four fifths by 0.2.
        assert!((calibration_error(&reliability_bins(&rows)) - 0.164).abs() < 1e-12);
        let Content::Curves { curves, .. } = &figure(&rows).unwrap().panels[0].content else {
            panic!("no curves")
        };
        // The diagonal, and the one method that reports probabilities.
        assert_eq!(curves.len(), 2);
        assert!(curves[0].guide && curves[1].name == "consensus");
        assert_eq!(curves[1].points, [[low.predicted, 0.0], [high.predicted, 0.75]]);
        assert!(figure(&rows[1..2]).is_err());
    }

    #[test]
    fn few_poses_tell_little() {
        let of = |poses, right| {
            interval(&ReliabilityBin { from: 0.0, poses, predicted: 0.5, observed: right })
        };
        // Wilson's for 8 of 10 and for none of one.
        let [low, high] = of(10, 0.8);
        assert!((low - 0.490).abs() < 1e-3 && (high - 0.943).abs() < 1e-3, "{low} {high}");
        let [low, high] = of(1, 0.0);
        assert!(low == 0.0 && (high - 0.793).abs() < 1e-3, "{low} {high}");
    }
}
