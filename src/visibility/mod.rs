//! What a sensor saw, and from where.
//!
//! A scan says more than where surfaces are: everything between the sensor and them was empty.
//! [`DepthImage`] keeps that, `viewpoint` finds the place of the sensor where no file tells it,
//! [`MaxRangeReturns`] the points that are no surface.

mod depth_image;
mod max_range_returns;
mod viewpoint;

pub use depth_image::DepthImage;
pub use max_range_returns::MaxRangeReturns;
pub use viewpoint::{OrientedSample, ViewpointEstimates, ViewpointSide};

use rustc_hash::FxHashMap;

use crate::math::Vec3;

/// The pixel of a direction on the six faces of a cube about the viewpoint: unlike longitude
/// and latitude it has no poles.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
struct Pixel {
    face: u8,
    at: [i32; 2],
}

impl Pixel {
    /// Of a direction that is not zero; `side` is the width of a pixel on a cube of half side 1.
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

    /// The pixel and those around it on the same face.
    fn neighborhood(self) -> impl Iterator<Item = Pixel> {
        let shift = |x: i32, d: i32| x.saturating_add(d);
        (-1..=1).flat_map(move |u| {
            (-1..=1)
                .map(move |v| Pixel { at: [shift(self.at[0], u), shift(self.at[1], v)], ..self })
        })
    }
}

/// The median of `distances` from a viewpoint, at which pixels are measured; `None` of none.
fn median(mut distances: Vec<f64>) -> Option<f64> {
    if distances.is_empty() {
        return None;
    }
    let middle = distances.len() / 2;
    Some(*distances.select_nth_unstable_by(middle, f64::total_cmp).1)
}

/// The distance of what is nearest in each pixel.
type NearestDepths<D> = FxHashMap<Pixel, D>;

/// Notes that something is at `distance` in `pixel`, of which the nearest is kept.
fn record_nearest<D: Copy + PartialOrd>(nearest: &mut NearestDepths<D>, pixel: Pixel, distance: D) {
    let seen = nearest.entry(pixel).or_insert(distance);
    if distance < *seen {
        *seen = distance;
    }
}

/// `count` directions spread evenly over the sphere: a Fibonacci lattice.
fn fibonacci_directions(count: usize) -> impl Iterator<Item = Vec3> {
    let golden = std::f64::consts::PI * (3.0 - 5f64.sqrt());
    (0..count).map(move |i| {
        let z = 1.0 - (2.0 * i as f64 + 1.0) / count as f64;
        let (sine, cosine) = (golden * i as f64).sin_cos();
        let around = (1.0 - z * z).sqrt();
        [around * cosine, around * sine, z]
    })
}
