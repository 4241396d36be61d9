//! The first round: every place of the grid on a few trials, and the choice of finalists.

use std::path::Path;

use serde::{Deserialize, Serialize};

use super::condition::{Condition, Scenes};
use super::ranking::{self, Errors};
use super::scheme::{GridPoint, Scheme};
use super::trials::{self, Entrant, TrialDraws, TrialOutcome};
use super::without_duplicates;
use crate::csv_cache;
use cfreg::error::Result;

/// A place of the grid in one condition.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ScreeningResult {
    /// Name of the scheme: the next four fields.
    pub scheme: String,
    /// Settings of the descriptors.
    pub points: String,
    /// The kernel.
    pub kernel: String,
    /// Its bandwidth.
    pub beta: String,
    /// The normalisation.
    pub normalize: String,
    /// Kind of the condition.
    pub condition: String,
    /// Its amount: deviation of noise in metres, outliers a point, share of overlap.
    pub amount: f64,
    /// Mean of ‖I − R R_gtᵀ‖_F; trials without a pose count as half turns.
    pub mean_frobenius: f64,
    /// Median rotation error, degrees; empty if half of the trials have no pose.
    pub median_deg: Option<f64>,
    /// Number of trials without a pose.
    pub failures: usize,
}

/// Screens `grid` in one condition, or reads the earlier screening.
pub(super) fn run(
    scenes: &Scenes,
    draws: TrialDraws<'_>,
    grid: &[Scheme],
    folder: &Path,
) -> Result<Vec<ScreeningResult>> {
    let path = folder.join(format!("screening_{}.csv", draws.condition.stem()));
    let maker = ("screening", draws);
    let same = |rows: &Vec<ScreeningResult>| {
        rows.len() == grid.len() && rows.iter().zip(grid).all(|(row, at)| row.scheme == at.name)
    };
    if let Some(known) = csv_cache::read(&path, &maker).filter(same) {
        return Ok(known);
    }
    let entrants: Vec<Entrant<'_>> = grid.iter().map(Entrant::Scheme).collect();
    let outcomes = trials::run(scenes, draws, &entrants)?;
    let errors = Errors::from_outcomes(draws.condition, &outcomes, grid.len());
    let means = errors.means(0..errors.trials());
    let row = |at: usize| {
        let of = outcomes.iter().skip(at).step_by(grid.len());
        row(&grid[at], draws.condition, means[at], of)
    };
    let rows: Vec<ScreeningResult> = (0..grid.len()).map(row).collect();
    csv_cache::write(&path, &maker, &rows)?;
    Ok(rows)
}

fn row<'a>(
    scheme: &Scheme,
    condition: Condition,
    mean_frobenius: f64,
    outcomes: impl Iterator<Item = &'a TrialOutcome>,
) -> ScreeningResult {
    let mut degrees: Vec<f64> =
        outcomes.map(|outcome| outcome.rotation_deg.unwrap_or(f64::INFINITY)).collect();
    degrees.sort_by(f64::total_cmp);
    let at = |index: usize| degrees.get(index).copied();
    let middle = [(degrees.len().max(1) - 1) / 2, degrees.len() / 2].map(at);
    let median = middle[0].zip(middle[1]).map(|(a, b)| (a + b) / 2.0).filter(|m| m.is_finite());
    let GridPoint { points, kernel, beta, normalize } = scheme.place.unwrap_or(GridPoint::PAPER);
    let (kind, amount) = condition.kind();
    ScreeningResult {
        scheme: scheme.name.clone(),
        points: points.name(),
        kernel: kernel.to_string(),
        beta: beta.to_string(),
        normalize: normalize.to_string(),
        condition: kind.into(),
        amount,
        mean_frobenius,
        median_deg: median,
        failures: degrees.iter().filter(|degrees| degrees.is_infinite()).count(),
    }
}

/// Numbers of finalists by the score over all kinds of conditions, and over each kind. Chosen by
/// hand.
const BEST_OVERALL: usize = 8;
const BEST_OF_KIND: usize = 2;

/// Selects the finalists: the paper's scheme, the steps from it to [`Place::BEST`], the control,
/// and the best of the screening, overall and of each kind; each once, in this order.
pub(super) fn finalists<'a>(
    screened: &[ScreeningResult],
    conditions: &[Condition],
    grid: &'a [Scheme],
) -> Vec<&'a Scheme> {
    let at =
        |place: &GridPoint| grid.iter().position(|scheme| scheme.place.as_ref() == Some(place));
    let base = at(&GridPoint::PAPER).unwrap_or(0);
    let mut chosen: Vec<usize> = GridPoint::STEPS.iter().filter_map(at).collect();
    // The grid begins with the uniform kernel.
    chosen.push(0);
    let scores = scores(screened, conditions, base);
    for column in 0..scores.first().map_or(0, Vec::len) {
        let mut order: Vec<usize> = (0..grid.len()).collect();
        order.sort_by(|&a, &b| scores[a][column].total_cmp(&scores[b][column]));
        order.truncate(if column == 0 { BEST_OVERALL } else { BEST_OF_KIND });
        chosen.extend(order);
    }
    without_duplicates(chosen).into_iter().map(|at| &grid[at]).collect()
}

/// Computes [`ranking::scores`] of all places, against the one numbered `base`.
pub(super) fn scores(
    screened: &[ScreeningResult],
    conditions: &[Condition],
    base: usize,
) -> Vec<Vec<f64>> {
    let places = screened.len() / conditions.len().max(1);
    let means: Vec<Vec<f64>> = screened
        .chunks(places.max(1))
        .map(|rows| rows.iter().map(|row| row.mean_frobenius).collect())
        .collect();
    ranking::scores(conditions, &means, base)
}
