//! Points with an f64 origin, so that map coordinates keep their digits in f32.

mod attributes;
mod origin;
mod parts;

use std::sync::Arc;

pub use attributes::Attributes;
pub(crate) use attributes::{check_weights, normalize_normal};
pub use parts::Parts;

use self::origin::{DIGITS, MIN_OFFSET_FACTOR, exponent, round_origin, to_local};
use crate::cloud::{Channels, Descriptors, Transform};
use crate::error::{Error, Result};
use crate::math::{self, Vec3};

/// The largest coordinate: fourth powers, which areas and covariances need, stay finite in f64
/// (1e300).
const MAX_COORDINATE: f64 = 1e75;

/// Finds the first finite coordinate of a point that is too large to compute with.
pub(crate) fn find_too_large(point: Vec3) -> Option<f64> {
    point.into_iter().find(|x| x.is_finite() && x.abs() > MAX_COORDINATE)
}

/// Points, optionally with unit normals, weights, named channels, descriptors and a viewpoint.
///
/// Point `i` is at `origin + points[i]`: coordinates are stored in f32 relative to an f64 origin
/// near the cloud. The origin is the centre of the bounding box, rounded to the power of ten at or
/// above the cloud's size. A cloud around zero therefore has origin zero and keeps its f32
/// coordinates bit for bit, and a cloud moved by any multiple of that power of ten (a UTM offset,
/// say) has the same `points`.
///
/// Non-finite input points are dropped and counted in [`dropped`](Self::dropped).
#[derive(Debug, Clone, PartialEq, Default)]
pub struct PointCloud {
    points: Vec<[f32; 3]>,
    origin: Vec3,
    frame_origin: Vec3,
    normals: Option<Vec<[f32; 3]>>,
    weights: Option<Vec<f32>>,
    channels: Channels,
    descriptors: Option<Arc<Descriptors>>,
    viewpoint: Option<Vec3>,
    dropped: usize,
    no_returns: usize,
}

impl PointCloud {
    /// Creates a cloud from coordinates in any unit; points with a NaN or infinite coordinate are
    /// dropped and counted. An empty cloud is valid.
    ///
    /// # Errors
    /// [`Error::Extent`] when the longest side of the bounding box is above 1e15 or
    /// above 0 and below 1e-15: squared distances would leave the range of f32.
    /// [`Error::Coordinate`] for a finite coordinate beyond 1e75: its fourth power would leave the
    /// range of f64.
    ///
    /// ```
    /// let utm = cfreg::PointCloud::new(&[[5e5, 5.6e6, 12.0], [5e5 + 0.125, 5.6e6, f64::NAN]])?;
    /// assert_eq!((utm.len(), utm.dropped()), (1, 1));
    /// assert_eq!(utm.position(0), [5e5, 5.6e6, 12.0]);
    /// # Ok::<(), cfreg::Error>(())
    /// ```
    pub fn new(points: &[[f64; 3]]) -> Result<Self> {
        let finite = |p: &&[f64; 3]| p.iter().all(|x| x.is_finite());
        let far = |(index, &p)| finite(&&p).then(|| Some((index, find_too_large(p)?))).flatten();
        match points.iter().enumerate().find_map(far) {
            Some((index, value)) => Err(Error::Coordinate { index, value }),
            None => Self::from_finite(points.iter().filter(finite).copied(), points.len()),
        }
    }

    /// Creates a cloud from f32 coordinates.
    ///
    /// # Errors
    /// [`Error::Extent`] as [`new`](Self::new).
    pub fn from_f32(points: &[[f32; 3]]) -> Result<Self> {
        let wide = points.iter().map(|point| point.map(f64::from));
        Self::from_finite(wide.filter(|p| p.iter().all(|x| x.is_finite())), points.len())
    }

    /// Creates a cloud with one normal a point, same order. Normals are scaled to unit length; a
    /// zero or non-finite normal becomes zero, which means "undefined".
    ///
    /// # Errors
    /// [`Error::Shape`] when the lengths differ, [`Error::Extent`] as for
    /// [`new`](Self::new).
    pub fn with_normals(points: &[[f64; 3]], normals: &[[f64; 3]]) -> Result<Self> {
        Self::with_attributes(points, Attributes { normals: Some(normals), ..Default::default() })
    }

    fn from_finite(points: impl Iterator<Item = Vec3> + Clone, given: usize) -> Result<Self> {
        let mut low = [f64::INFINITY; 3];
        let mut high = [f64::NEG_INFINITY; 3];
        let mut bounded = true;
        let mut count = 0;
        for p in points.clone() {
            count += 1;
            for axis in 0..3 {
                // Points that a transform made too large may be NaN, too.
                bounded &= p[axis].abs() <= MAX_COORDINATE;
                low[axis] = low[axis].min(p[axis]);
                high[axis] = high[axis].max(p[axis]);
            }
        }
        if !bounded {
            return Err(Error::Extent { extent: f64::INFINITY });
        }
        if low[0] > high[0] {
            return Ok(PointCloud { dropped: given, ..Default::default() });
        }
        let extent = (0..3).map(|axis| high[axis] - low[axis]).fold(0.0, f64::max);
        if extent > 1e15 || (extent > 0.0 && extent < 1e-15) {
            return Err(Error::Extent { extent });
        }
        let center = math::scaled(math::add(low, high), 0.5);
        let origin = round_origin(center, extent, 1.0);
        let frame_origin = round_origin(center, extent, MIN_OFFSET_FACTOR);
        let digits = 10f64.powi((DIGITS - exponent(extent)).clamp(-300, 300));
        let local = |p: Vec3| [0, 1, 2].map(|axis| to_local(p[axis], origin[axis], digits));
        // Exact capacity: no spare room.
        let mut kept: Vec<[f32; 3]> = Vec::with_capacity(count);
        kept.extend(points.map(local));
        let points = kept;
        let dropped = given - points.len();
        Ok(PointCloud { points, origin, frame_origin, dropped, ..Default::default() })
    }

    /// Sets the viewpoint of the cloud, in the cloud's own frame.
    ///
    /// # Errors
    /// [`Error::Config`] when a coordinate of the viewpoint is not finite, or beyond 1e75.
    pub fn with_viewpoint(mut self, viewpoint: Vec3) -> Result<Self> {
        if viewpoint.iter().any(|x| !x.is_finite()) || find_too_large(viewpoint).is_some() {
            let value = format!("{viewpoint:?}");
            let rule = "every coordinate must be finite, and within 1e75 of zero";
            return Err(Error::config("viewpoint", value, rule));
        }
        self.viewpoint = Some(viewpoint);
        Ok(self)
    }

    /// Returns the number of points.
    pub fn len(&self) -> usize {
        self.points.len()
    }

    /// Returns the approximate memory use in bytes.
    pub(crate) fn bytes(&self) -> usize {
        let triples = 1 + usize::from(self.normals.is_some());
        let single = usize::from(self.weights.is_some()) + self.channels.names().len();
        let wide = self.descriptors().map_or(0, |rows| rows.dim());
        self.len() * 4 * (3 * triples + single + wide)
    }

    /// Returns whether there is no point.
    pub fn is_empty(&self) -> bool {
        self.points.is_empty()
    }

    /// Returns the points relative to [`origin`](Self::origin), all finite.
    pub fn points(&self) -> &[[f32; 3]] {
        &self.points
    }

    /// Returns the offset from [`points`](Self::points) to the cloud's own frame.
    pub fn origin(&self) -> Vec3 {
        self.origin
    }

    /// Returns point `i` in the cloud's own frame.
    ///
    /// # Panics
    /// When `i` is not below [`len`](Self::len).
    pub fn position(&self, i: usize) -> Vec3 {
        math::add(self.origin, self.points[i].map(f64::from))
    }

    /// Returns all points in the cloud's own frame, in order.
    pub fn positions(&self) -> impl ExactSizeIterator<Item = Vec3> + Clone + '_ {
        (0..self.len()).map(|i| self.position(i))
    }

    /// Returns the unit normals, one a point, if the cloud has them. A zero vector marks a point
    /// with an undefined normal.
    pub fn normals(&self) -> Option<&[[f32; 3]]> {
        self.normals.as_deref()
    }

    /// Returns the viewpoint of the cloud, in its own frame, if the cloud has one.
    pub fn viewpoint(&self) -> Option<Vec3> {
        self.viewpoint
    }

    /// Returns the zero of the cloud's frame: the default viewpoint of a cloud that names none.
    ///
    /// For a cloud whose centre is within about 50 times its size of zero this *is* zero. In map
    /// coordinates zero has no meaning. There the result is the nearest multiple of a round length
    /// (100 times the power of ten at or above the cloud's size), so that it moves along with the
    /// cloud when a map offset is added.
    pub fn frame_origin(&self) -> Vec3 {
        self.frame_origin
    }

    /// Returns the number of points with a NaN or infinite coordinate that were dropped.
    pub fn dropped(&self) -> usize {
        self.dropped
    }

    /// Returns the number of rows that marked measurements without a return and were removed
    /// ([`filter::remove_no_returns`](crate::filter::remove_no_returns)).
    pub fn no_returns(&self) -> usize {
        self.no_returns
    }

    /// Adds to the number of rows that were removed because they marked missing returns.
    pub(crate) fn with_no_returns(mut self, rows: usize) -> Self {
        self.no_returns += rows;
        self
    }

    /// Returns the lowest and highest corner in the cloud's own frame; `None` when empty.
    pub fn bounds(&self) -> Option<(Vec3, Vec3)> {
        let mut points = self.points.iter();
        let first = *points.next()?;
        let (low, high) = points.fold((first, first), |(low, high), p| {
            let pick = |f: fn(f32, f32) -> f32, a: [f32; 3]| [0, 1, 2].map(|i| f(a[i], p[i]));
            (pick(f32::min, low), pick(f32::max, high))
        });
        let global = |p: [f32; 3]| math::add(self.origin, p.map(f64::from));
        Some((global(low), global(high)))
    }

    /// Returns the diagonal of the bounding box; 0 when empty.
    pub fn diagonal(&self) -> f64 {
        self.bounds().map_or(0.0, |(low, high)| math::norm(math::sub(high, low)))
    }

    /// Returns the mean of the points in the cloud's own frame, summed in f64 about the
    /// [`origin`](Self::origin); the origin when empty.
    pub fn centroid(&self) -> Vec3 {
        let sum = self.points.iter().fold([0.0; 3], |sum, p| math::add(sum, p.map(f64::from)));
        math::add(self.origin, math::scaled(sum, 1.0 / self.len().max(1) as f64))
    }

    /// Selects the points at `indices`, in that order, with their normals, weights, channels and
    /// descriptors.
    /// [`dropped`](Self::dropped) and the origin stay.
    ///
    /// # Panics
    /// When an index is not below [`len`](Self::len).
    pub fn select(&self, indices: &[usize]) -> PointCloud {
        let pick = |values: &[[f32; 3]]| indices.iter().map(|&i| values[i]).collect();
        let pick_numbers =
            |values: &[f32]| -> Vec<f32> { indices.iter().map(|&i| values[i]).collect() };
        PointCloud {
            points: pick(&self.points),
            normals: self.normals.as_deref().map(pick),
            weights: self.weights().map(pick_numbers),
            channels: self.channels.map(pick_numbers),
            descriptors: self.descriptors().map(|rows| rows.select(indices).into()),
            ..*self
        }
    }

    /// Replaces the points and their attributes: viewpoint, frame and [`dropped`](Self::dropped)
    /// stay.
    ///
    /// # Errors
    /// The errors of [`with_attributes`](Self::with_attributes).
    pub fn with_points(&self, points: &[[f64; 3]], has: Attributes<'_>) -> Result<PointCloud> {
        let new = Self::with_attributes(points, has)?;
        Ok(PointCloud {
            frame_origin: self.frame_origin,
            viewpoint: self.viewpoint,
            dropped: self.dropped + new.dropped,
            no_returns: self.no_returns,
            ..new
        })
    }

    /// Moves the cloud by `transform`: points, normals and viewpoint; weights, channels
    /// and descriptors stay.
    ///
    /// # Errors
    /// [`Error::Extent`] when a scale or a translation moves it out of range.
    pub fn transformed(&self, transform: &Transform) -> Result<PointCloud> {
        let moved = self.positions().map(|p| transform.apply(p));
        let rotate = |n: &[f32; 3]| transform.rotate(n.map(f64::from)).map(|x| x as f32);
        Ok(PointCloud {
            normals: self.normals.as_ref().map(|normals| normals.iter().map(rotate).collect()),
            weights: self.weights.clone(),
            channels: self.channels.clone(),
            descriptors: self.descriptors.clone(),
            viewpoint: self.viewpoint.map(|v| transform.apply(v)),
            dropped: self.dropped,
            no_returns: self.no_returns,
            ..Self::from_finite(moved, self.len())?
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cloud_around_zero_keeps_its_bits() {
        let points = [[0.1f32, -0.05, 0.033], [1e-7, 0.2, -0.1]];
        let cloud = PointCloud::new(&points.map(|p| p.map(f64::from))).unwrap();
        assert_eq!(cloud.origin(), [0.0; 3]);
        assert_eq!(cloud.points(), points);
    }

    #[test]
    fn a_map_offset_leaves_the_local_points_alone() {
        let near: Vec<Vec3> =
            (0..50).map(|i| [i as f64 / 64.0, 0.5, (i % 7) as f64 / 8.0]).collect();
        let far: Vec<Vec3> = near.iter().map(|&p| math::add(p, [5e5, 5.6e6, 300.0])).collect();
        let (near, far) = (PointCloud::new(&near).unwrap(), PointCloud::new(&far).unwrap());
        assert_eq!(near.points(), far.points());
        assert_eq!(math::sub(far.origin(), near.origin()), [5e5, 5.6e6, 300.0]);
        assert_eq!(near.frame_origin(), [0.0; 3]);
        assert_eq!(far.frame_origin(), [5e5, 5.6e6, 300.0]);
    }

    #[test]
    fn decimals_survive_a_map_offset() {
        // Values as in text files, through f64 or through f32: none is exact in binary.
        let decimals: Vec<Vec3> = (0..200)
            .map(|i| [f64::from(i) * 7.813e-4 - 0.0947, 0.0359793 + f64::from(i) * 1e-5, 0.0012345])
            .collect();
        let singles = decimals.iter().map(|p| p.map(|x| f64::from(x as f32))).collect();
        for near in [decimals, singles] {
            let far: Vec<Vec3> = near.iter().map(|&p| math::add(p, [5e5, 5.6e6, 300.0])).collect();
            let (near, far) = (PointCloud::new(&near).unwrap(), PointCloud::new(&far).unwrap());
            assert_eq!(near.points(), far.points());
        }
    }

    #[test]
    fn single_precision_is_taken_as_it_is() {
        let points = [[0.1f32, 2.5, -3.0], [f32::NAN, 0.0, 0.0], [1.0, 1e-7, 0.0]];
        let wide = PointCloud::new(&points.map(|p| p.map(f64::from))).unwrap();
        assert_eq!(PointCloud::from_f32(&points).unwrap(), wide);
    }

    #[test]
    fn zero_is_the_frame_origin_of_what_is_near() {
        // A 9 cm object seen from a distance of one metre.
        let near = PointCloud::new(&[[0.0, 0.0, 1.0], [0.09, 0.0, 1.0]]).unwrap();
        assert_eq!(near.frame_origin(), [0.0; 3]);
    }

    #[test]
    fn odd_extents_have_a_defined_result() {
        assert!(PointCloud::new(&[]).unwrap().is_empty());
        let same = PointCloud::new(&[[1e75, 0.0, 0.0]; 3]).unwrap();
        assert_eq!(same.position(2), [1e75, 0.0, 0.0]);
        for far in [1e76, -1e154, 1e308, -f64::MAX] {
            for points in [vec![[0.0; 3], [f64::NAN; 3], [0.0, far, 0.0]], vec![[far; 3]; 3]] {
                let (first, cloud) = (points.len() - 1, PointCloud::new(&points));
                let Err(Error::Coordinate { index, value }) = cloud else { panic!("{far}") };
                assert!(value == far && (index == first || index == 0));
            }
            let seen = same.clone().with_viewpoint([0.0, far, 0.0]);
            assert!(matches!(seen, Err(Error::Config { field: "viewpoint", .. })), "{far}");
            // A point that is dropped anyway may have any attribute.
            assert_eq!(PointCloud::new(&[[far, f64::NAN, 0.0]]).unwrap().dropped(), 1);
        }
        let huge = Transform { translation: [1e200, 0.0, 0.0], ..Transform::IDENTITY };
        assert!(matches!(same.transformed(&huge), Err(Error::Extent { .. })));
        for far in [1e16, 1e74, 1e-16] {
            let cloud = PointCloud::new(&[[0.0; 3], [far, 0.0, 0.0]]);
            assert!(matches!(cloud, Err(Error::Extent { .. })), "{far}");
        }
        let wide = PointCloud::new(&[[-1e75, 0.0, 0.0], [1e75, 0.0, 0.0]]);
        assert!(matches!(wide, Err(Error::Extent { .. })));
    }

    #[test]
    fn normals_stay_with_their_points() {
        let points = [[0.0; 3], [f64::INFINITY, 0.0, 0.0], [1.0, 0.0, 0.0]];
        let normals = [[0.0, 0.0, 2.0], [1.0, 0.0, 0.0], [f64::NAN, 0.0, 0.0]];
        let cloud = PointCloud::with_normals(&points, &normals).unwrap();
        assert_eq!(cloud.normals().unwrap(), [[0.0, 0.0, 1.0], [0.0; 3]]);
        assert_eq!(cloud.select(&[1]).normals().unwrap(), [[0.0; 3]]);
        assert!(PointCloud::with_normals(&points, &normals[..2]).is_err());
    }
}
