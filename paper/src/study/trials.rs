//! Trials of many schemes on the same pairs.

use serde::{Deserialize, Serialize};

use super::condition::{Condition, Scenes};
use super::scheme::Scheme;
use crate::experiments::cell::Shape;
use crate::protocol::{REVISION, Trial};
use cfreg::error::{Error, Result};
use cfreg::method::{FeatureConfig, Method, Register, Timings};
use cfreg::moments::FullConnection;
use cfreg::par;
use cfreg::pose::{self, ScaleEstimate, Solver};

/// A scheme or method that registers a pair.
pub(super) enum Entrant<'a> {
    /// Weights once, one solve.
    Scheme(&'a Scheme),
    /// A method to stand beside, by a name for tables.
    Reference(&'static str, Box<Method>),
}

impl Entrant<'_> {
    pub(super) fn name(&self) -> &str {
        match self {
            Entrant::Scheme(scheme) => &scheme.name,
            Entrant::Reference(name, _) => name,
        }
    }
}

/// The result of one entrant in one trial.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct TrialOutcome {
    /// Name of the scheme, or of the method that stands beside.
    pub scheme: String,
    /// Number of the trial.
    pub trial: u64,
    /// Shape of the trial.
    pub shape: Shape,
    /// Rotation error, degrees; this and the next are empty without a pose.
    pub rotation_deg: Option<f64>,
    /// ‖I − R R_gtᵀ‖_F.
    pub frobenius: Option<f64>,
}

impl TrialOutcome {
    /// The paper's measure of a rotation; without a pose that of a half turn.
    pub fn error(&self) -> f64 {
        self.frobenius.unwrap_or(8f64.sqrt())
    }
}

/// Source of the trials: everything that their outcomes depend on, except the schemes.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub(super) struct TrialDraws<'a> {
    pub(super) condition: Condition,
    pub(super) points: usize,
    pub(super) seed: u64,
    pub(super) trials: usize,
    revision: u32,
    version: &'static str,
    models: &'a str,
}

impl<'a> TrialDraws<'a> {
    pub(super) fn new(scenes: &'a Scenes, condition: Condition, seed: u64, trials: usize) -> Self {
        TrialDraws {
            condition,
            points: POINTS,
            seed,
            trials,
            revision: REVISION,
            version: env!("CARGO_PKG_VERSION"),
            models: scenes.digest(condition),
        }
    }
}

/// Number of points of a cloud, as in the paper's tests.
const POINTS: usize = 500;

/// Runs every entrant on every trial: trial by trial, in the order of the entrants.
///
/// # Errors
/// The errors of [`Scenes::trial`]; an entrant without a pose is an outcome.
pub(super) fn run(
    scenes: &Scenes,
    draws: TrialDraws<'_>,
    entrants: &[Entrant<'_>],
) -> Result<Vec<TrialOutcome>> {
    let one = |number: usize| {
        let TrialDraws { condition, points, seed, .. } = draws;
        let number = number as u64;
        let Some((shape, trial)) = scenes.trial(condition, points, seed, number)? else {
            return Ok(Vec::new());
        };
        let mut pair = TrialConnections { trial: &trial, connections: Vec::new() };
        let outcome = |entrant: &Entrant<'_>| {
            let error = pair.pose(entrant).ok().map(|pose| trial.error(&pose));
            TrialOutcome {
                scheme: entrant.name().into(),
                trial: number,
                shape,
                rotation_deg: error.map(|error| error.rotation_deg),
                frobenius: error.map(|error| error.rotation_frobenius),
            }
        };
        Ok::<_, Error>(entrants.iter().map(outcome).collect())
    };
    let all = par::map(draws.trials, || (), |_, number| one(number));
    Ok(all.into_iter().collect::<Result<Vec<_>>>()?.concat())
}

/// A trial, and its full connections by how points are described.
struct TrialConnections<'a> {
    trial: &'a Trial,
    connections: Vec<(FeatureConfig, FullConnection)>,
}

impl TrialConnections<'_> {
    fn pose(&mut self, entrant: &Entrant<'_>) -> Result<cfreg::Transform> {
        match entrant {
            Entrant::Reference(_, method) => {
                Ok(method.register(&self.trial.source, &self.trial.target)?.transform)
            }
            Entrant::Scheme(scheme) => {
                let moments = scheme.moments(self.connection(&scheme.describe)?)?;
                Ok(pose::solve(&moments, Solver::default(), ScaleEstimate::Fixed)?.transform)
            }
        }
    }

    fn connection(&mut self, describe: &FeatureConfig) -> Result<&FullConnection> {
        let at = match self.connections.iter().position(|(known, _)| known == describe) {
            Some(at) => at,
            None => {
                let mut times = Timings::default();
                let source = describe.extract(&self.trial.source, "the source", &mut times)?;
                let target = describe.extract(&self.trial.target, "the target", &mut times)?;
                let made = FullConnection::new(source.view(), target.view())?;
                self.connections.push((describe.clone(), made));
                self.connections.len() - 1
            }
        };
        Ok(&self.connections[at].1)
    }
}
