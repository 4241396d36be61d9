//! How many different patches of surface agree: a wall agrees with any wall.

use std::collections::BTreeMap;

use crate::math::{self, Vec3};

/// Depth of a patch along its direction, in voxels. Chosen by hand.
const DEPTH: f64 = 8.0;
/// Cells of directions along each side of a face of the cube: 54 cells of about 30 degrees.
const CELLS: f64 = 3.0;

/// Weights of points, by the patch that they are on: the points whose normals have about one
/// direction, and that are about equally far along it.
#[derive(Debug, Clone, Default)]
pub(super) struct SurfacePatches(BTreeMap<(u8, i64), f64>);

impl SurfacePatches {
    /// Counts a point with a unit `normal`.
    pub(super) fn add(&mut self, point: Vec3, normal: Vec3, weight: f64, voxel_size: f64) {
        let (cell, center) = direction_cell(normal);
        let depth = (math::dot(center, point) / (DEPTH * voxel_size)).floor() as i64;
        *self.0.entry((cell, depth)).or_default() += weight;
    }

    /// Returns the effective number of patches, at least 0: the exponential of the entropy of their
    /// shares, n for n patches of equal weight.
    pub(super) fn effective_number(&self) -> f64 {
        let total: f64 = self.0.values().sum();
        if total <= 0.0 {
            return 0.0;
        }
        let shares = self.0.values().map(|weight| weight / total).filter(|&share| share > 0.0);
        shares.map(|share| -share * share.ln()).sum::<f64>().exp()
    }
}

/// Returns the cell of a direction, on the faces of a cube, and the direction of its centre.
fn direction_cell(direction: Vec3) -> (u8, Vec3) {
    let size = |axis: usize| direction[axis].abs();
    let axis = if size(0) >= size(1).max(size(2)) { 0 } else { 1 + usize::from(size(2) > size(1)) };
    let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
    let cell = |x: f64| ((x / size(axis) + 1.0) * 0.5 * CELLS).floor().clamp(0.0, CELLS - 1.0);
    let (a, b) = (cell(direction[u]), cell(direction[v]));
    let coordinate = |cell: f64| (2.0 * cell + 1.0) / CELLS - 1.0;
    let mut center = [0.0; 3];
    center[axis] = direction[axis].signum();
    center[u] = coordinate(a);
    center[v] = coordinate(b);
    let face = 2 * axis + usize::from(direction[axis] < 0.0);
    let cell = (face as f64 * CELLS * CELLS + a * CELLS + b) as u8;
    (cell, math::normalized(center))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_plane_is_one_patch_and_a_box_is_six() {
        let mut plane = SurfacePatches::default();
        let mut box_ = SurfacePatches::default();
        for i in 0..400 {
            let (x, y) = (f64::from(i % 20), f64::from(i / 20));
            plane.add([x, y, 3.0], [0.0, 0.0, 1.0], 1.0, 1.0);
            for (point, normal) in [
                ([x, y, 0.0], [0.0, 0.0, -1.0]),
                ([x, y, 20.0], [0.0, 0.0, 1.0]),
                ([x, 0.0, y], [0.0, -1.0, 0.0]),
                ([x, 20.0, y], [0.0, 1.0, 0.0]),
                ([0.0, x, y], [-1.0, 0.0, 0.0]),
                ([20.0, x, y], [1.0, 0.0, 0.0]),
            ] {
                box_.add(point, normal, 1.0, 1.0);
            }
        }
        assert!((plane.effective_number() - 1.0).abs() < 1e-12);
        assert!((box_.effective_number() - 6.0).abs() < 1e-9);
        assert_eq!(SurfacePatches::default().effective_number(), 0.0);
    }

    #[test]
    fn a_sphere_has_a_patch_for_most_directions() {
        let mut sphere = SurfacePatches::default();
        for normal in crate::visibility::fibonacci_directions(2000) {
            sphere.add(math::scaled(normal, 10.0), normal, 1.0, 1.0);
        }
        let found = sphere.effective_number();
        assert!((45.0..110.0).contains(&found), "{found}");
    }
}
