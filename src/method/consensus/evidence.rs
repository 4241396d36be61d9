//! What speaks for a pose: the surfaces themselves, whoever proposed it.

use super::hypotheses::Matches;
use super::scan::{REACH, Surface, squared_distance};
use crate::cloud::Transform;
use crate::math;

/// Cosine of the angle between normals from which on surfaces face alike.
const ALIKE: f64 = 0.7;
/// How far in front of what was seen a point contradicts it, in lengths.
const IN_FRONT: f64 = 3.0;
/// Points of the other surface that a descriptor is compared with.
const PROBES: usize = 48;

/// What a pose has for and against it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Evidence {
    /// Share of one surface's points that lie on the other and face alike, by how well they
    /// do; the larger of the two directions.
    pub(super) overlap: f64,
    /// How much more alike than chance the surfaces look where they lie on each other, in nats
    /// a point, both directions together.
    pub(super) likeness: f64,
    /// Matches that agree ([`Matches::support`]).
    pub(super) support: f64,
    /// Share of the points that stand where the other's sensor looked through, both directions
    /// together; `None` where no sensor's place is known.
    pub(super) contradicted: Option<f64>,
}

/// One direction.
#[derive(Clone, Copy, Default)]
struct Sums {
    points: usize,
    lying: f64,
    likeness: f64,
    looked_at: usize,
    in_front: usize,
}

impl Evidence {
    /// Looks at `most` points of each surface, spread evenly; `pose` moves the source, local
    /// frame to local frame.
    pub(super) fn of(
        [source, target]: [&Surface; 2],
        matches: &Matches,
        pose: &Transform,
        most: usize,
    ) -> Evidence {
        let length = matches.length;
        let there = look(source, target, pose, length, most);
        let back = look(target, source, &pose.inverse(), length, most);
        let share = |part: f64, whole: usize| part / whole.max(1) as f64;
        let contradicted = |sums: Sums| share(sums.in_front as f64, sums.looked_at);
        let known = source.seen.is_some() && target.seen.is_some();
        Evidence {
            // Unit vectors are so to rounding alone.
            overlap: share(there.lying, there.points).max(share(back.lying, back.points)).min(1.0),
            likeness: share(there.likeness, there.points) + share(back.likeness, back.points),
            support: matches.support(pose),
            contradicted: known.then(|| contradicted(there) + contradicted(back)),
        }
    }

    /// The logarithm of the odds that the pose is right, by its evidence alone: what ranks the
    /// poses of a pair.
    ///
    /// Logistic in what speaks for a pose, fitted on poses that this method settled for real
    /// pairs. Constants fitted anew are no better at places that they have not seen
    /// (`python-ref/verdict/verdict.sh`). What is told of the answer is [`Standing::log_odds`].
    ///
    /// [`Standing::log_odds`]: super::standing::Standing::log_odds
    pub(super) fn log_odds(&self) -> f64 {
        let overlap = (self.overlap + 0.01).ln();
        let likeness = (self.likeness + 0.1).max(0.01).ln();
        let support = self.support.ln_1p();
        match self.contradicted {
            Some(share) => {
                8.0 + 2.08 * overlap + 3.97 * likeness + 0.48 * support - 27.7 * share.sqrt()
            }
            None => -5.95 - 1.41 * overlap + 4.29 * likeness + 2.33 * support,
        }
    }
}

/// `from` under `pose`, on and in front of `onto`.
fn look(from: &Surface, onto: &Surface, pose: &Transform, length: f64, most: usize) -> Sums {
    let step = from.len().div_ceil(most).max(1);
    let reach = REACH * length;
    let mut sums = Sums::default();
    for i in (0..from.len()).step_by(step) {
        sums.points += 1;
        let place = pose.apply(from.place(i));
        if let Some(ahead) = onto.seen.as_ref().and_then(|seen| seen.in_front(place)) {
            sums.looked_at += 1;
            sums.in_front += usize::from(ahead > IN_FRONT * length);
        }
        let Some(near) = onto.nearest(place) else { continue };
        if f64::from(near.squared_distance) >= reach * reach {
            continue;
        }
        let j = near.index as usize;
        let normal = onto.normal(j);
        let facing = math::dot(pose.rotate(from.normal(i)), normal);
        if facing <= ALIKE {
            continue;
        }
        let off = math::dot(normal, math::sub(place, onto.place(j))) / (0.75 * reach);
        let lying = (1.0 - off * off).max(0.0) * (facing - ALIKE) / (1.0 - ALIKE);
        sums.lying += lying;
        sums.likeness += lying * likeness(from, onto, i, j);
    }
    sums
}

/// How much more alike two points look than the first and others of the second's surface: minus
/// the logarithm of the share that is as alike, less its mean, 1, for points that have nothing
/// to do with each other. Flat pieces, which look like any other, tell nothing by it.
fn likeness(from: &Surface, onto: &Surface, i: usize, j: usize) -> f64 {
    let row = from.descriptors.row(i);
    let distance = |j: usize| squared_distance(row, onto.descriptors.row(j));
    let own = distance(j);
    let probe = |k: usize| (k * onto.len() + onto.len() / 2) / PROBES;
    let as_alike = (0..PROBES).filter(|&k| distance(probe(k)) <= own).count();
    let share = (as_alike as f64 + 0.5) / (PROBES as f64 + 1.0);
    -share.ln() - 1.0
}
