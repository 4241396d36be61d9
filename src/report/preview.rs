//! Two clouds before and after as a still picture: for pages without WebGL, notebooks and papers.

use super::camera::{Camera, Viewport};
use super::display::DisplayCloud;
use crate::cloud::Transform;
use crate::figure::{Content, Dot, Figure, Panel, Scene};
use crate::math::{self, Vec3};

/// Colours of source and target: orange and blue of Okabe and Ito (2008), which most people can
/// distinguish.
pub(super) const COLOURS: [[u8; 3]; 2] = [[230, 159, 0], [0, 114, 178]];
/// Part of the viewport's radius that is shown: clouds seldom fill a ball. Chosen by hand.
const VISIBLE_RADIUS_SHARE: f64 = 0.95;
/// Brightness of a surface seen edge-on. Chosen by hand.
const MIN_BRIGHTNESS: f64 = 0.45;

/// A pose of the source in the target's frame, with its title.
pub(super) struct PoseView<'a> {
    pub(super) title: &'a str,
    pub(super) pose: Transform,
    pub(super) frame: Viewport,
}

/// Draws both clouds with the source at each of `stands`, one panel each, of `size` pixels.
pub(super) fn draw_preview(
    [source, target]: [&DisplayCloud; 2],
    look: &Camera,
    stands: &[PoseView<'_>],
    most: usize,
    size: (u32, u32),
    named: bool,
) -> Figure {
    let ends = [ShadedPoints::new(source, most), ShadedPoints::new(target, most)];
    let axes = look.axes();
    let turn = |direction: Vec3| math::mat_vec(&axes, direction);
    // One scale for all panels.
    let reach = stands.iter().map(|stand| stand.frame.radius).fold(0.0, f64::max);
    let mut panels = Vec::new();
    for stand in stands {
        let own = Transform::IDENTITY;
        let mut seen: Vec<(f64, Dot)> = Vec::new();
        for (k, (lit, pose)) in ends.iter().zip([&stand.pose, &own]).enumerate() {
            for (&place, &normal) in lit.places.iter().zip(&lit.normals) {
                let at = turn(math::sub(pose.apply(place), target.middle));
                let facing = turn(pose.rotate(normal))[2].abs();
                let light = if normal == [0.0; 3] {
                    1.0
                } else {
                    MIN_BRIGHTNESS + (1.0 - MIN_BRIGHTNESS) * facing
                };
                let colour = COLOURS[k].map(|part| (f64::from(part) * light).round() as u8);
                seen.push((at[2], Dot { at: [at[0], at[1]], colour }));
            }
        }
        seen.sort_by(|a, b| a.0.total_cmp(&b.0));
        let names = ["source", "target"].into_iter().zip(COLOURS);
        let [x, y, _] = turn(stand.frame.center);
        panels.push(Panel {
            title: stand.title.into(),
            content: Content::Scene(Scene {
                names: if named { names.map(|(n, c)| (n.into(), c)).collect() } else { Vec::new() },
                dots: seen.into_iter().map(|(_, dot)| dot).collect(),
                middle: [x, y],
                reach: VISIBLE_RADIUS_SHARE * reach,
                radius: 0.6 * ends[0].spacing.max(ends[1].spacing),
            }),
        });
    }
    Figure { columns: panels.len(), panels, size }
}

/// A sample of a cloud, in its own frame, with its normals.
struct ShadedPoints {
    places: Vec<Vec3>,
    normals: Vec<Vec3>,
    spacing: f64,
}

impl ShadedPoints {
    /// Selects at most `most` of the shown points.
    fn new(shown: &DisplayCloud, most: usize) -> ShadedPoints {
        let step = shown.cloud.len().div_ceil(most).max(1);
        let vectors = shown.normal_vectors.iter().step_by(step);
        ShadedPoints {
            places: shown.cloud.positions().step_by(step).collect(),
            normals: vectors.map(|n| n.map(f64::from)).collect(),
            spacing: shown.spacing * (step as f64).sqrt(),
        }
    }
}
