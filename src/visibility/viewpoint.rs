//! Estimation of a scan's viewpoint from the scan alone.
//!
//! Seen from the sensor, no surface hides another and few are at grazing incidence. From another
//! position both happen. For a shell two positions remain possible: an object seen from outside has
//! the same shape as a hollow seen from inside. [`ViewpointEstimates::compute`] returns the best of
//! each.

use super::{NearestDepths, Pixel, fibonacci_directions, median, record_nearest};
use crate::math::{self, Vec3};
use crate::par;

/// A scan, downsampled so that its points are about `spacing` apart.
#[derive(Clone, Copy)]
pub struct OrientedSample<'a> {
    /// Positions about any origin.
    pub points: &'a [[f32; 3]],
    /// Their normals, of either sign; zero where undefined.
    pub normals: &'a [[f32; 3]],
    /// Distance of neighbouring points.
    pub spacing: f64,
}

/// Side of the surfaces that a viewpoint is on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ViewpointSide {
    /// Surfaces are convex towards it: an object seen from outside.
    Outside,
    /// Surfaces are concave towards it: a room seen from inside.
    Inside,
}

/// The best viewpoints, with the cost of each ([`OrientedSample::visibility_cost`]).
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct ViewpointEstimates {
    /// From outside.
    pub outside: Option<(Vec3, f64)>,
    /// From inside.
    pub inside: Option<(Vec3, f64)>,
}

/// Width of a pixel in spacings at the median distance: most contain a point or two.
const PIXEL: f64 = 2.0;
/// Depth behind the nearest point, in pixel widths, from which a point counts as hidden. Chosen by
/// hand.
const MIN_HIDDEN_DEPTH: f64 = 3.0;
/// Cosine of ray and normal below which incidence is grazing. Chosen by hand.
const MIN_INCIDENCE_COSINE: f64 = 0.2;
/// Number of directions tried at each distance. Chosen by hand.
const DIRECTIONS: usize = 48;
/// Distances tried, in root mean square radii about the centroid. Chosen by hand.
const DISTANCES: [f64; 6] = [0.4, 0.8, 1.3, 2.0, 3.5, 100.0];
/// Number of the best candidates that are refined. Chosen by hand.
const REFINED_CANDIDATES: usize = 4;

impl OrientedSample<'_> {
    /// Returns the cost of `viewpoint`, 0 (none) to some 3: the share of points hidden by others,
    /// half the share at grazing incidence, twice the share within three spacings.
    pub fn visibility_cost(&self, viewpoint: Vec3) -> f64 {
        self.cost(viewpoint, &mut NearestDepths::default())
    }

    fn cost(&self, viewpoint: Vec3, nearest: &mut NearestDepths<f64>) -> f64 {
        nearest.clear();
        let n = self.points.len();
        let ray = |point: &[f32; 3]| math::sub(point.map(f64::from), viewpoint);
        let all: Vec<f64> = self.points.iter().map(|p| math::norm(ray(p))).collect();
        let Some(median) = median(all.clone()) else { return 0.0 };
        let side = (PIXEL * self.spacing / median).clamp(1e-8, 1.0);
        let pixels: Vec<Pixel> =
            self.points.iter().map(|p| Pixel::from_direction(ray(p), side)).collect();
        for (&pixel, &distance) in pixels.iter().zip(&all) {
            record_nearest(nearest, pixel, distance);
        }
        let (mut hidden, mut grazed, mut close) = (0, 0, 0);
        for i in 0..n {
            let distance = all[i];
            let width = (side * distance).max(self.spacing);
            hidden += usize::from(distance - nearest[&pixels[i]] > MIN_HIDDEN_DEPTH * width);
            let across = math::dot(ray(&self.points[i]), self.normals[i].map(f64::from)).abs();
            grazed += usize::from(across < MIN_INCIDENCE_COSINE * distance);
            close += usize::from(distance < 3.0 * self.spacing);
        }
        (hidden as f64 + 0.5 * grazed as f64 + 2.0 * close as f64) / n as f64
    }

    /// Orients the normals towards `viewpoint`.
    pub fn orient_normals(&self, viewpoint: Vec3) -> Vec<[f32; 3]> {
        let turned = |(point, normal): (&[f32; 3], &[f32; 3])| {
            let ray = math::sub(viewpoint, point.map(f64::from));
            let away = math::dot(ray, normal.map(f64::from)) < 0.0;
            if away { normal.map(|x| -x) } else { *normal }
        };
        self.points.iter().zip(self.normals).map(turned).collect()
    }

    /// Returns whether surfaces are convex or concave towards `viewpoint`; `toward` is, for every
    /// point, the vector from it to the mean of its neighbours.
    fn side(&self, viewpoint: Vec3, toward: &[Vec3]) -> ViewpointSide {
        let normals = self.orient_normals(viewpoint);
        let bends = normals.iter().zip(toward).map(|(n, &m)| math::dot(n.map(f64::from), m));
        if bends.sum::<f64>() < 0.0 { ViewpointSide::Outside } else { ViewpointSide::Inside }
    }

    fn centroid_and_radius(&self) -> (Vec3, f64) {
        let n = self.points.len() as f64;
        let sum = self.points.iter().fold([0.0; 3], |sum, p| math::add(sum, p.map(f64::from)));
        let center = math::scaled(sum, 1.0 / n);
        let square = |p: &[f32; 3]| {
            let from = math::sub(p.map(f64::from), center);
            math::dot(from, from)
        };
        (center, (self.points.iter().map(square).sum::<f64>() / n).sqrt())
    }
}

impl ViewpointEstimates {
    /// Computes the best viewpoints of `sight`; `toward` is, for every point, the vector from it to
    /// the mean of its neighbours.
    pub fn compute(sight: OrientedSample<'_>, toward: &[Vec3]) -> ViewpointEstimates {
        if sight.points.is_empty() {
            return ViewpointEstimates { outside: None, inside: None };
        }
        let (center, radius) = sight.centroid_and_radius();
        let shells = DISTANCES.iter().flat_map(|&distance| {
            fibonacci_directions(DIRECTIONS)
                .map(move |d| math::add(center, math::scaled(d, distance * radius)))
        });
        let places: Vec<Vec3> = std::iter::once(center).chain(shells).collect();
        let judged = |nearest: &mut NearestDepths<f64>, at: Vec3| (at, sight.cost(at, nearest));
        let mut all =
            par::map(places.len(), NearestDepths::default, |nearest, i| judged(nearest, places[i]));
        all.sort_by(|a, b| a.1.total_cmp(&b.1));
        let better =
            par::map(all.len().min(REFINED_CANDIDATES), NearestDepths::default, |nearest, i| {
                pattern_search(all[i], center, radius, |at| judged(nearest, at))
            });
        all.extend(better);
        all.sort_by(|a, b| a.1.total_cmp(&b.1));
        let best = |side| all.iter().find(|(at, _)| sight.side(*at, toward) == side).copied();
        ViewpointEstimates {
            outside: best(ViewpointSide::Outside),
            inside: best(ViewpointSide::Inside),
        }
    }
}

/// Steps along the axes, halved if none improves (pattern search).
fn pattern_search(
    start: (Vec3, f64),
    center: Vec3,
    radius: f64,
    mut judged: impl FnMut(Vec3) -> (Vec3, f64),
) -> (Vec3, f64) {
    let (mut best, mut step) = (start, 0.3);
    while step > 0.04 {
        let reach = step * math::norm(math::sub(best.0, center)).max(0.2 * radius);
        let before = best.1;
        for k in 0..6 {
            let mut at = best.0;
            at[k / 2] += if k % 2 == 0 { reach } else { -reach };
            let found = judged(at);
            if found.1 < best.1 {
                best = found;
            }
        }
        if best.1 >= before {
            step /= 2.0;
        }
    }
    best
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns points of a sphere of radius 1 with z above `lowest`, some 0.06 apart, their
    /// normals, and the vectors to their neighbours.
    fn cap(lowest: f64) -> (Vec<[f32; 3]>, Vec<Vec3>) {
        let points: Vec<Vec3> = fibonacci_directions(3000).filter(|p| p[2] > lowest).collect();
        let toward = points.iter().map(|&p| math::scaled(p, -0.01)).collect();
        (points.iter().map(|p| p.map(|x| x as f32)).collect(), toward)
    }

    #[test]
    fn a_cap_is_seen_from_above_or_from_within() {
        let (points, toward) = cap(0.2);
        let sight = OrientedSample { points: &points, normals: &points, spacing: 0.065 };
        let found = ViewpointEstimates::compute(sight, &toward);
        let (outside, cost) = found.outside.unwrap();
        assert!(outside[2] > 1.0 && cost < 0.1, "{found:?}");
        let (inside, cost) = found.inside.unwrap();
        assert!(inside[2] < 0.7 && cost < 0.1, "{found:?}");
        // From the side a part of it hides the rest or is at grazing incidence.
        assert!(sight.visibility_cost([30.0, 0.0, 0.0]) > 0.2);
    }

    #[test]
    fn a_whole_sphere_has_no_viewpoint_outside() {
        let (points, toward) = cap(-2.0);
        let sight = OrientedSample { points: &points, normals: &points, spacing: 0.065 };
        let found = ViewpointEstimates::compute(sight, &toward);
        assert!(found.outside.is_none_or(|(_, cost)| cost > 0.3), "{found:?}");
        assert!(found.inside.unwrap().1 < 0.1);
    }

    #[test]
    fn nothing_has_no_viewpoint() {
        let sight = OrientedSample { points: &[], normals: &[], spacing: 1.0 };
        let none = ViewpointEstimates { outside: None, inside: None };
        assert_eq!(ViewpointEstimates::compute(sight, &[]), none);
    }
}
