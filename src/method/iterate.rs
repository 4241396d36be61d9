//! The loop of ICP, Kernel Correlation, CPD and DARE: compute weights at the pose, solve, check
//! whether to stop.

use super::termination::{IterationRecord, StopReason};
use crate::cloud::Transform;
use crate::error::Result;

/// One iteration of a method, with the state it leaves.
pub(super) struct Iteration<S> {
    /// The pose after the iteration.
    pub(super) transform: Transform,
    /// The objective of the method.
    pub(super) objective: f64,
    /// Sum of the weights, Σw.
    pub(super) weight: f64,
    /// σ of the Gaussian kernels, in the target's unit, for methods that have one.
    pub(super) bandwidth: Option<f64>,
    /// The reason to stop, if there is one.
    pub(super) stop: Option<StopReason>,
    pub(super) state: S,
}

/// The end of the iterations, with the state of the last one.
pub(super) struct Iterated<S> {
    pub(super) transform: Transform,
    pub(super) iterations: u32,
    pub(super) stop: StopReason,
    /// Every iteration if a trace was requested; else empty.
    pub(super) trace: Vec<IterationRecord>,
    pub(super) state: S,
}

/// Calls `step` with 1, 2, … until it returns a reason to stop.
///
/// # Errors
/// The first one of `step`.
pub(super) fn iterate<S>(
    keep_trace: bool,
    mut step: impl FnMut(u32) -> Result<Iteration<S>>,
) -> Result<Iterated<S>> {
    let mut trace = Vec::new();
    let mut iterations = 0;
    loop {
        iterations += 1;
        let Iteration { transform, objective, weight, bandwidth, stop, state } = step(iterations)?;
        if keep_trace {
            let iteration = iterations;
            trace.push(IterationRecord { iteration, transform, objective, weight, bandwidth });
        }
        if let Some(stop) = stop {
            return Ok(Iterated { transform, iterations, stop, trace, state });
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::error::Error;

    #[test]
    fn it_ends_at_a_reason_or_an_error() {
        let step = |k: u32| Iteration {
            transform: Transform::IDENTITY,
            objective: f64::from(k),
            weight: 1.0,
            bandwidth: None,
            stop: (k == 3).then_some(StopReason::IterationLimit),
            state: 10 * k,
        };
        let done = iterate(true, |k| Ok(step(k))).unwrap();
        assert_eq!((done.iterations, done.state, done.trace.len()), (3, 30, 3));
        assert_eq!(done.stop, StopReason::IterationLimit);
        assert!(done.trace.iter().all(|it| it.objective == f64::from(it.iteration)));
        assert!(iterate(false, |k| Ok(step(k))).unwrap().trace.is_empty());
        let failed = |k: u32| if k == 2 { Err(Error::NO_WEIGHT) } else { Ok(step(k)) };
        assert!(iterate(true, failed).is_err());
    }
}
