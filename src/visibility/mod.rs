//! Visibility: free space, viewpoints and returns at maximum range.
//!
//! A scan contains more than surfaces: everything between the sensor and them was free space.
//! [`DepthImage`] represents it, `viewpoint` estimates the position of the sensor if no file names
//! it, and [`MaxRangeReturns`] finds the points that are no surface.

mod depth_image;
mod max_range_returns;
mod viewpoint;

pub use depth_image::DepthImage;
pub use max_range_returns::MaxRangeReturns;
pub use viewpoint::{OrientedSample, ViewpointEstimates, ViewpointSide};

use rustc_hash::FxHashMap;

use crate::math::Vec3;

/// The pixel of a direction on the six faces of a cube about the viewpoint: unlike longitude and
/// latitude it has no poles.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
struct Pixel {
    face: u8,
    at: [i32; 2],
}

impl Pixel {
    /// Returns the pixel of a direction that is not zero; `side` is the width of a pixel on a cube
    /// of half side 1.
    fn from_direction(direction: Vec3, side: f64) -> Pixel {
        let size = direction.map(f64::abs);
        let axis = if size[0] >= size[1] && size[0] >= size[2] {
            0
        } else if size[1] >= size[2] {
            1
        } else {
            2
        };
        let at = [1, 2].map(|next| {
            let across = direction[(axis + next) % 3] / size[axis] / side;
            across.floor() as i32
        });
        Pixel { face: 2 * axis as u8 + u8::from(direction[axis] > 0.0), at }
    }

    /// Returns the pixel and the adjacent ones on the same face.
    fn neighborhood(self) -> impl Iterator<Item = Pixel> {
        let shift = |x: i32, d: i32| x.saturating_add(d);
        (-1..=1).flat_map(move |u| {
            (-1..=1)
                .map(move |v| Pixel { at: [shift(self.at[0], u), shift(self.at[1], v)], ..self })
        })
    }
}

/// Returns the median of `distances` from a viewpoint, at which pixels are measured; `None` if
/// empty.
fn median(mut distances: Vec<f64>) -> Option<f64> {
    if distances.is_empty() {
        return None;
    }
    let middle = distances.len() / 2;
    Some(*distances.select_nth_unstable_by(middle, f64::total_cmp).1)
}

/// The distance of the nearest surface in each pixel.
type NearestDepths<D> = FxHashMap<Pixel, D>;

/// Records a surface at `distance` in `pixel`; the nearest is kept.
fn record_nearest<D: Copy + PartialOrd>(nearest: &mut NearestDepths<D>, pixel: Pixel, distance: D) {
    let seen = nearest.entry(pixel).or_insert(distance);
    if distance < *seen {
        *seen = distance;
    }
}

/// Returns `count` directions spread evenly over the sphere: a Fibonacci lattice.
pub(crate) fn fibonacci_directions(count: usize) -> impl Iterator<Item = Vec3> {
    let golden = std::f64::consts::PI * (3.0 - 5f64.sqrt());
    (0..count).map(move |i| {
        let z = 1.0 - (2.0 * i as f64 + 1.0) / count as f64;
        let (sine, cosine) = (golden * i as f64).sin_cos();
        let around = (1.0 - z * z).sqrt();
        [around * cosine, around * sine, z]
    })
}
