//! The depth image of a scan: the nearest surface in each direction from the viewpoint.

use super::{NearestDepths, Pixel, median, record_nearest};
use crate::math::{self, Vec3};

/// Measured depth in each direction from the viewpoint.
pub struct DepthImage {
    viewpoint: Vec3,
    /// Width of a pixel, as the tangent of an angle.
    side: f64,
    nearest: NearestDepths<f32>,
}

impl DepthImage {
    /// Returns the approximate memory use in bytes.
    pub(crate) fn bytes(&self) -> usize {
        self.nearest.capacity() * (size_of::<(Pixel, f32)>() + 1)
    }

    /// Creates the image of `points` from `viewpoint`; a pixel is as wide as `spacing` at the
    /// median distance. `None` if the viewpoint is in the middle of the points, at the same
    /// position as most of them.
    pub fn new(
        points: impl ExactSizeIterator<Item = Vec3> + Clone,
        viewpoint: Vec3,
        spacing: f64,
    ) -> Option<DepthImage> {
        let rays = points.map(|point| math::sub(point, viewpoint));
        let side = spacing / median(rays.clone().map(math::norm).collect())?;
        // A pixel of more than half a face is useless; below 1e-8 its number overflows.
        if !(1e-8..1.0).contains(&side) {
            return None;
        }
        let mut nearest = NearestDepths::default();
        for ray in rays {
            let depth = math::norm(ray) as f32;
            if depth > 0.0 {
                record_nearest(&mut nearest, Pixel::from_direction(ray, side), depth);
            }
        }
        Some(DepthImage { viewpoint, side, nearest })
    }

    /// Returns how far `place` is in front of the nearest surface that was seen in its direction
    /// (or right beside it); negative behind. `None` if nothing was seen.
    pub fn clearance(&self, place: Vec3) -> Option<f64> {
        let ray = math::sub(place, self.viewpoint);
        let distance = math::norm(ray);
        if distance <= 0.0 {
            return None;
        }
        let pixel = Pixel::from_direction(ray, self.side);
        self.nearest.get(&pixel)?;
        // The minimum over adjacent pixels: a surface has gaps between its points.
        let seen = pixel.neighborhood().filter_map(|pixel| self.nearest.get(&pixel));
        let seen = seen.copied().fold(f32::INFINITY, f32::min);
        Some(f64::from(seen) - distance)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_wall_hides_what_is_behind_and_nothing_in_front() {
        let wall =
            (0..400).map(|i| [0.1 * f64::from(i % 20) - 1.0, 0.1 * f64::from(i / 20) - 1.0, 5.0]);
        let viewpoint = [0.0, 0.0, 1.0];
        let image = DepthImage::new(wall.collect::<Vec<_>>().into_iter(), viewpoint, 0.1).unwrap();
        let front = image.clearance([0.02, 0.02, 3.0]).unwrap();
        assert!((front - 2.0).abs() < 0.02, "{front}");
        assert!((image.clearance([0.02, 0.02, 8.0]).unwrap() + 3.0).abs() < 0.02);
        // Beside the wall, behind the sensor, at its position.
        assert_eq!(image.clearance([9.0, 0.0, 5.0]), None);
        assert_eq!(image.clearance([0.0, 0.0, -3.0]), None);
        assert_eq!(image.clearance(viewpoint), None);
    }

    #[test]
    fn no_image_without_a_distance() {
        let same = [[1.0, 2.0, 3.0]; 5];
        assert!(DepthImage::new(same.into_iter(), same[0], 0.1).is_none());
        assert!(DepthImage::new([].into_iter(), same[0], 0.1).is_none());
    }
}
