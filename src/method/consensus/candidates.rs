//! Every pose that was weighed before the answer, with its evidence: what the verdict is fitted on.

use super::evidence::Evidence;
use super::standing::Standing;
use super::{Consensus, global};
use crate::cloud::{PointCloud, Transform};
use crate::error::Result;
use crate::method::registration::Timings;
use crate::par;

/// A pose that [`Consensus`] judged, and what it had for and against it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Judged {
    /// Source into target frame.
    pub transform: Transform,
    /// Share of a surface that lies on the other and faces alike, in [0, 1].
    pub overlap: f64,
    /// How much more alike than chance the surfaces look there, nats a point.
    pub likeness: f64,
    /// Matches that agree, at least 0.
    pub support: f64,
    /// Share of the points, summed over both directions, that stand where the other's sensor
    /// looked through, in [0, 2]; `None` where no sensor's place is known.
    pub contradicted: Option<f64>,
    /// Settled poses that are this one; for the answer alone.
    pub votes: Option<usize>,
    /// Standard deviation of its shift in lengths, within bounds; for the answer alone.
    pub spread: Option<f64>,
    /// Whether it is the answer, judged after its last settling.
    pub answer: bool,
}

impl Judged {
    fn settled(transform: Transform, evidence: &Evidence) -> Judged {
        let Evidence { overlap, likeness, support, contradicted } = *evidence;
        let (votes, spread, answer) = (None, None, false);
        Judged { transform, overlap, likeness, support, contradicted, votes, spread, answer }
    }

    fn answer(transform: Transform, standing: &Standing) -> Judged {
        let (votes, spread) = (Some(standing.votes), Some(standing.spread));
        Judged { votes, spread, answer: true, ..Judged::settled(transform, &standing.evidence) }
    }
}

impl Consensus {
    /// Every settled pose of every way to see the clouds, way by way and the most probable of
    /// each first, and last the answer of [`register`](crate::method::Register::register).
    ///
    /// # Errors
    /// Those of `register`.
    pub fn candidates(&self, source: &PointCloud, target: &PointCloud) -> Result<Vec<Judged>> {
        par::with_threads(self.threads, || {
            let search = self.search(source.into(), target.into(), &mut Timings::default())?;
            let mut judged = Vec::new();
            for attempt in &search.attempts {
                let [from, onto] = &attempt.surfaces;
                judged.extend(attempt.candidates.iter().map(|candidate| {
                    Judged::settled(global(&candidate.pose, from, onto), &candidate.evidence)
                }));
            }
            let [from, onto] = &search.attempts[search.best].surfaces;
            let pose = &search.settled.pose;
            let covariance = search.covariance(pose);
            let standing = search.standing(pose, search.evidence, covariance.as_ref());
            judged.push(Judged::answer(global(pose, from, onto), &standing));
            Ok(judged)
        })?
    }
}
