//! The viewpoints towards which the normals of two clouds point, where the clouds name none.

use super::cache::{Cached, HeapSize};
use super::consensus::viewpoint_sample::ViewpointSample;
use crate::cloud::PointCloud;
use crate::error::Result;
use crate::math::{self, Vec3};
use crate::normals::OrientedBy;
use crate::par;
use crate::visibility::ViewpointEstimates;

/// A viewpoint in the cloud's own frame, and its source.
pub(super) type ChosenViewpoint = (Vec3, OrientedBy);

/// The known viewpoint of a cloud, or estimates of it.
struct ViewpointEvidence {
    /// The viewpoint of the cloud or the plausible origin of its frame.
    known: Option<ChosenViewpoint>,
    /// Estimates from outside and from inside, with their costs; empty if it is known.
    estimates: [Option<(Vec3, f64)>; 2],
}

#[derive(PartialEq)]
struct EvidenceKey(f64);

impl HeapSize for ViewpointEvidence {
    fn bytes(&self) -> usize {
        size_of::<ViewpointEvidence>()
    }
}

impl ViewpointEvidence {
    /// Collects the evidence of a cloud with points about `spacing` apart.
    fn new(cloud: &PointCloud, spacing: f64) -> Result<Self> {
        let known = |at, by| ViewpointEvidence { known: Some((at, by)), estimates: [None; 2] };
        if let Some(at) = cloud.viewpoint() {
            return Ok(known(at, OrientedBy::CloudViewpoint));
        }
        let sample = ViewpointSample::new(cloud, spacing)?;
        let (origin, local) = (cloud.frame_origin(), cloud.origin());
        if sample.may_be_viewpoint(math::sub(origin, local)) {
            return Ok(known(origin, OrientedBy::FrameOrigin));
        }
        let found =
            ViewpointEstimates::compute(sample.oriented_sample(), &sample.neighborhood_offsets);
        let global =
            |best: Option<(Vec3, f64)>| best.map(|(at, cost)| (math::add(at, local), cost));
        Ok(ViewpointEvidence { known: None, estimates: [found.outside, found.inside].map(global) })
    }
}

/// Chooses the viewpoints of two clouds with points about `spacing` apart: those that they name; the
/// origin of a frame, if few points would be hidden from it; else estimates, both from outside or
/// both from inside, whichever hide fewer points together. `None` for a cloud without an estimate.
pub(super) fn choose_viewpoints(
    clouds: [Cached<'_>; 2],
    spacing: f64,
) -> Result<[Option<ChosenViewpoint>; 2]> {
    let evidence = par::join_pair(clouds, |side| {
        side.get_or_compute(EvidenceKey(spacing), || ViewpointEvidence::new(side.cloud, spacing))
    })?;
    let cost = |kind: usize| -> f64 {
        let unknown = evidence.iter().filter(|side| side.known.is_none());
        unknown.map(|side| side.estimates[kind].map_or(f64::INFINITY, |(_, cost)| cost)).sum()
    };
    let kind = usize::from(cost(1) < cost(0));
    Ok(evidence.map(|side| {
        let either = side.estimates[kind].or(side.estimates[1 - kind]);
        side.known.or(either.map(|(at, _)| (at, OrientedBy::Guess)))
    }))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cloud::Transform;
    use crate::cloud::shape::boulder;

    #[test]
    fn a_known_viewpoint_stays_and_others_are_on_one_side() {
        let whole = boulder().sample(2000, 1).unwrap();
        let seen = whole.clone().with_viewpoint([0.1, 0.0, 0.2]).unwrap();
        let far = Transform { translation: [50.0, 8.0, -30.0], ..Transform::IDENTITY };
        let moved = whole.transformed(&far).unwrap();
        let choose = |a: &PointCloud, b: &PointCloud| {
            choose_viewpoints([a.into(), b.into()], 0.05).unwrap().map(Option::unwrap)
        };
        let [named, origin] = choose(&seen, &whole);
        assert_eq!(named, ([0.1, 0.0, 0.2], OrientedBy::CloudViewpoint));
        assert_eq!(origin, ([0.0; 3], OrientedBy::FrameOrigin));
        // From the origin of its frame half of the moved shape would be hidden; it is whole, so that
        // only positions inside see all of it.
        let [first, second] = choose(&moved, &moved);
        assert_eq!((first, first.1), (second, OrientedBy::Guess));
        let off = math::norm(math::sub(first.0, far.translation));
        assert!(off < 0.5 * whole.diagonal(), "{off}");
    }
}
