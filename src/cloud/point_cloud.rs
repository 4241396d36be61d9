//! Points with an f64 origin, so that map coordinates lose nothing in f32.

use std::borrow::Cow;

use crate::cloud::{Channels, Transform};
use crate::error::{Error, Result};
use crate::math::{self, Vec3};

/// Points, optionally with unit normals, weights, named channels and the place they were seen
/// from.
///
/// Point `i` is at `origin + points[i]`: coordinates are kept in f32 relative to an
/// f64 origin near the cloud. The origin is the centre of the bounding box rounded
/// to the power of ten at or above the cloud's size. A cloud around zero therefore
/// has origin zero and keeps its f32 coordinates bit for bit, and a cloud moved by
/// any multiple of that power of ten (a UTM offset, say) has the same `points`.
///
/// Non-finite points are dropped on the way in and counted in
/// [`dropped`](Self::dropped).
#[derive(Debug, Clone, PartialEq, Default)]
pub struct PointCloud {
    points: Vec<[f32; 3]>,
    origin: Vec3,
    frame_origin: Vec3,
    normals: Option<Vec<[f32; 3]>>,
    weights: Option<Vec<f32>>,
    channels: Channels,
    viewpoint: Option<Vec3>,
    dropped: usize,
}

/// What points may have beside their place: one row for each point that is handed in, also for
/// those that will be dropped.
#[derive(Debug, Clone, Copy, Default)]
pub struct Attributes<'a> {
    /// As of [`PointCloud::with_normals`].
    pub normals: Option<&'a [Vec3]>,
    /// As of [`PointCloud::with_weights`].
    pub weights: Option<&'a [f64]>,
    /// As of [`PointCloud::with_channels`].
    pub channels: Option<&'a Channels>,
}

/// A [`PointCloud`] taken apart; each field is what the method of its name returns.
#[derive(Debug, Clone, PartialEq)]
#[expect(missing_docs, reason = "said by the methods")]
pub struct Parts {
    pub points: Vec<[f32; 3]>,
    pub origin: Vec3,
    pub frame_origin: Vec3,
    pub normals: Option<Vec<[f32; 3]>>,
    pub weights: Option<Vec<f32>>,
    pub channels: Channels,
    pub viewpoint: Option<Vec3>,
    pub dropped: usize,
}

impl PointCloud {
    /// A cloud from coordinates in any unit; points with a NaN or infinite
    /// coordinate are dropped and counted. An empty cloud is a cloud.
    ///
    /// # Errors
    /// [`Error::Extent`] when the longest side of the bounding box is above 1e15 or
    /// above 0 and below 1e-15: squared distances would leave the range of f32.
    ///
    /// ```
    /// let utm = cfreg::PointCloud::new(&[[5e5, 5.6e6, 12.0], [5e5 + 0.125, 5.6e6, f64::NAN]])?;
    /// assert_eq!((utm.len(), utm.dropped()), (1, 1));
    /// assert_eq!(utm.position(0), [5e5, 5.6e6, 12.0]);
    /// # Ok::<(), cfreg::Error>(())
    /// ```
    pub fn new(points: &[[f64; 3]]) -> Result<Self> {
        let finite = |p: &&[f64; 3]| p.iter().all(|x| x.is_finite());
        Self::from_finite(points.iter().filter(finite).copied(), points.len())
    }

    /// The same from f32.
    ///
    /// # Errors
    /// As [`new`](Self::new).
    pub fn from_f32(points: &[[f32; 3]]) -> Result<Self> {
        let wide = points.iter().map(|point| point.map(f64::from));
        Self::from_finite(wide.filter(|p| p.iter().all(|x| x.is_finite())), points.len())
    }

    /// A cloud with one normal a point, same order. Normals are scaled to unit
    /// length; a zero or non-finite normal becomes zero, which means "undefined".
    ///
    /// # Errors
    /// [`Error::Shape`] when the lengths differ, [`Error::Extent`] as for
    /// [`new`](Self::new).
    pub fn with_normals(points: &[[f64; 3]], normals: &[[f64; 3]]) -> Result<Self> {
        Self::with_attributes(points, Attributes { normals: Some(normals), ..Default::default() })
    }

    /// A cloud with what its points have beside their place, in the same order. What is dropped
    /// takes its normal, its weight and its channels along.
    ///
    /// # Errors
    /// [`Error::Shape`] when there is not one row a point, and those of [`new`](Self::new) and
    /// [`with_weights`](Self::with_weights).
    pub fn with_attributes(points: &[[f64; 3]], attributes: Attributes<'_>) -> Result<Self> {
        let Attributes { normals, weights, channels } = attributes;
        let number = |what: &str, found: usize| match found == points.len() {
            true => Ok(()),
            false => {
                let what = format!("{what} for the points of a cloud");
                Err(Error::Shape { what, expected: points.len(), found })
            }
        };
        normals.map_or(Ok(()), |normals| number("normals", normals.len()))?;
        weights.map_or(Ok(()), |weights| number("weights", weights.len()))?;
        channels.map_or(Ok(()), |channels| channels.check(points.len()))?;
        let mut cloud = Self::new(points)?;
        let finite = |&i: &usize| points[i].iter().all(|x| x.is_finite());
        let kept: Vec<usize> = (0..points.len()).filter(finite).collect();
        cloud.normals = normals.map(|normals| kept.iter().map(|&i| unit(normals[i])).collect());
        if let Some(channels) = channels {
            cloud.channels = channels.map(|values| kept.iter().map(|&i| values[i]).collect());
        }
        match weights {
            Some(weights) => cloud.with_weights(kept.iter().map(|&i| weights[i]).collect()),
            None => Ok(cloud),
        }
    }

    /// The cloud put together from what [`parts`](Self::parts) took apart, bit for bit.
    ///
    /// # Errors
    /// [`Error::NonFinite`] for a value that no cloud has, [`Error::Shape`] when there is not
    /// one normal, weight or value of a channel a point, [`Error::Config`] for a weight below 0.
    pub fn from_parts(parts: Parts) -> Result<Self> {
        let Parts { points, origin, frame_origin, normals, weights, channels, viewpoint, dropped } =
            parts;
        let vectors = points.iter().chain(normals.iter().flatten());
        if let Some(index) = vectors.into_iter().position(|v| v.iter().any(|x| !x.is_finite())) {
            return Err(Error::NonFinite { what: "the parts of a cloud".into(), index });
        }
        let places = [Some(origin), Some(frame_origin), viewpoint];
        if places.iter().flatten().flatten().any(|x| !x.is_finite()) {
            return Err(Error::NonFinite { what: "the places of a cloud".into(), index: 0 });
        }
        channels.check(points.len())?;
        let numbers = [
            ("normals", normals.as_ref().map(Vec::len)),
            ("weights", weights.as_ref().map(Vec::len)),
        ];
        for (name, found) in numbers {
            if let Some(found) = found.filter(|&found| found != points.len()) {
                let what = format!("{name} for the points of a cloud");
                return Err(Error::Shape { what, expected: points.len(), found });
            }
        }
        weights.as_deref().map_or(Ok(()), check_weights)?;
        let cloud = PointCloud {
            points,
            origin,
            frame_origin,
            normals,
            weights,
            channels,
            viewpoint,
            dropped,
        };
        Ok(cloud)
    }

    /// All that the cloud consists of, to be kept elsewhere.
    pub fn parts(&self) -> Parts {
        let PointCloud {
            points,
            origin,
            frame_origin,
            normals,
            weights,
            channels,
            viewpoint,
            dropped,
        } = self.clone();
        Parts { points, origin, frame_origin, normals, weights, channels, viewpoint, dropped }
    }

    fn from_finite(points: impl Iterator<Item = Vec3> + Clone, given: usize) -> Result<Self> {
        let mut low = [f64::INFINITY; 3];
        let mut high = [f64::NEG_INFINITY; 3];
        for p in points.clone() {
            for axis in 0..3 {
                low[axis] = low[axis].min(p[axis]);
                high[axis] = high[axis].max(p[axis]);
            }
        }
        if low[0] > high[0] {
            return Ok(PointCloud { dropped: given, ..Default::default() });
        }
        let extent = (0..3).map(|axis| high[axis] - low[axis]).fold(0.0, f64::max);
        if extent > 1e15 || (extent > 0.0 && extent < 1e-15) {
            return Err(Error::Extent { extent });
        }
        let center = math::scaled(math::add(low, high), 0.5);
        let origin = snapped(center, extent, 1.0);
        let frame_origin = snapped(center, extent, FAR);
        let digits = 10f64.powi((DIGITS - exponent(extent)).clamp(-300, 300));
        let local = |p: Vec3| [0, 1, 2].map(|axis| local(p[axis], origin[axis], digits));
        let points: Vec<[f32; 3]> = points.map(local).collect();
        let dropped = given - points.len();
        Ok(PointCloud { points, origin, frame_origin, dropped, ..Default::default() })
    }

    /// Sets the place the cloud was seen from, in the cloud's own frame.
    ///
    /// # Errors
    /// [`Error::Config`] when it is not finite.
    pub fn with_viewpoint(mut self, viewpoint: Vec3) -> Result<Self> {
        if viewpoint.iter().any(|x| !x.is_finite()) {
            let value = format!("{viewpoint:?}");
            return Err(Error::config("viewpoint", value, "every coordinate must be finite"));
        }
        self.viewpoint = Some(viewpoint);
        Ok(self)
    }

    /// Sets how much each point counts: a weight of 2 is as good as having the point twice, 0 as
    /// not connecting it. Every method honours them, as its description says; only their ratios
    /// within a cloud matter. One for each point that is there: points that were dropped have
    /// none ([`with_attributes`](Self::with_attributes) takes all).
    ///
    /// # Errors
    /// [`Error::Shape`] when there is not one weight a point, [`Error::NonFinite`] for one that
    /// is not finite in f32, [`Error::Config`] for one below 0, or when all are 0.
    ///
    /// ```
    /// let cloud = cfreg::PointCloud::new(&[[0.0; 3], [1.0, 0.0, 0.0]])?;
    /// assert_eq!(cloud.with_weights(vec![0.5, 2.0])?.weights(), Some(&[0.5, 2.0][..]));
    /// # Ok::<(), cfreg::Error>(())
    /// ```
    pub fn with_weights(mut self, weights: Vec<f64>) -> Result<Self> {
        if weights.len() != self.len() {
            let what = "weights for the points of a cloud".into();
            return Err(Error::Shape { what, expected: self.len(), found: weights.len() });
        }
        let weights: Vec<f32> = weights.into_iter().map(|weight| weight as f32).collect();
        check_weights(&weights)?;
        if !weights.is_empty() && weights.iter().all(|&weight| weight == 0.0) {
            return Err(Error::config("weights", 0, "one at least must be above 0"));
        }
        self.weights = Some(weights);
        Ok(self)
    }

    /// The cloud with other channels in place of its own, one value a point that is there.
    ///
    /// # Errors
    /// [`Error::Shape`] when a channel has not one value a point.
    pub fn with_channels(self, channels: Channels) -> Result<Self> {
        channels.check(self.len())?;
        Ok(PointCloud { channels, ..self })
    }

    /// Number of points.
    pub fn len(&self) -> usize {
        self.points.len()
    }

    /// Whether there is no point.
    pub fn is_empty(&self) -> bool {
        self.points.is_empty()
    }

    /// Points relative to [`origin`](Self::origin), all finite.
    pub fn points(&self) -> &[[f32; 3]] {
        &self.points
    }

    /// What to add to [`points`](Self::points) to be in the cloud's own frame.
    pub fn origin(&self) -> Vec3 {
        self.origin
    }

    /// Point `i` in the cloud's own frame.
    ///
    /// # Panics
    /// When `i` is not below [`len`](Self::len).
    pub fn position(&self, i: usize) -> Vec3 {
        math::add(self.origin, self.points[i].map(f64::from))
    }

    /// All points in the cloud's own frame, in order.
    pub fn positions(&self) -> impl ExactSizeIterator<Item = Vec3> + Clone + '_ {
        (0..self.len()).map(|i| self.position(i))
    }

    /// Unit normals, one a point, if the cloud has them. A zero vector marks a point
    /// whose normal is undefined.
    pub fn normals(&self) -> Option<&[[f32; 3]]> {
        self.normals.as_deref()
    }

    /// How much each point counts, finite and 0 or more, if the cloud says so; else all alike.
    pub fn weights(&self) -> Option<&[f32]> {
        self.weights.as_deref()
    }

    /// Weights in shares of their mean, so that only their ratios matter; `None` without
    /// weights, and where all that are left are 0.
    pub(crate) fn relative_weights(&self) -> Option<Vec<f32>> {
        let weights = self.weights()?;
        let sum: f64 = weights.iter().map(|&weight| f64::from(weight)).sum();
        let share = weights.len() as f64 / sum;
        let relative = |&weight: &f32| (f64::from(weight) * share) as f32;
        Some(match sum > 0.0 {
            true => weights.iter().map(relative).collect(),
            false => weights.to_vec(),
        })
    }

    /// The points that count: the cloud itself, without those of weight 0.
    pub(crate) fn counting(&self) -> Cow<'_, PointCloud> {
        match self.weights() {
            Some(weights) if weights.contains(&0.0) => {
                let above: Vec<usize> = (0..self.len()).filter(|&i| weights[i] > 0.0).collect();
                Cow::Owned(self.select(&above))
            }
            _ => Cow::Borrowed(self),
        }
    }

    /// The same without weights.
    pub(crate) fn unweighted(&self) -> PointCloud {
        PointCloud { weights: None, ..self.clone() }
    }

    /// Numbers of the points by name; empty where there are none.
    pub fn channels(&self) -> &Channels {
        &self.channels
    }

    /// Where the cloud was seen from, in its own frame, if it says so.
    pub fn viewpoint(&self) -> Option<Vec3> {
        self.viewpoint
    }

    /// The zero of the cloud's frame, where a sensor stands that says nothing else.
    ///
    /// For a cloud whose centre lies within about 50 times its size of zero this *is*
    /// zero. In map coordinates zero means nothing: there it is the nearest multiple of
    /// a round length (100 times the power of ten at or above the cloud's size), so that
    /// it moves along with the cloud when a map offset is added.
    pub fn frame_origin(&self) -> Vec3 {
        self.frame_origin
    }

    /// Points with a NaN or infinite coordinate that were left out.
    pub fn dropped(&self) -> usize {
        self.dropped
    }

    /// Lowest and highest corner in the cloud's own frame; `None` when empty.
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

    /// Diagonal of the bounding box; 0 when empty.
    pub fn diagonal(&self) -> f64 {
        self.bounds().map_or(0.0, |(low, high)| math::norm(math::sub(high, low)))
    }

    /// Mean of the points in the cloud's own frame, summed in f64 about the
    /// [`origin`](Self::origin); the origin when empty.
    pub fn centroid(&self) -> Vec3 {
        let sum = self.points.iter().fold([0.0; 3], |sum, p| math::add(sum, p.map(f64::from)));
        math::add(self.origin, math::scaled(sum, 1.0 / self.len().max(1) as f64))
    }

    /// The points named by `indices`, in that order; normals, weights and channels alike.
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
            ..*self
        }
    }

    /// Other points, with what they have, in the place of these: viewpoint, frame and
    /// [`dropped`](Self::dropped) stay.
    ///
    /// # Errors
    /// Those of [`with_attributes`](Self::with_attributes).
    pub fn replaced(&self, points: &[[f64; 3]], has: Attributes<'_>) -> Result<PointCloud> {
        let new = Self::with_attributes(points, has)?;
        Ok(PointCloud {
            frame_origin: self.frame_origin,
            viewpoint: self.viewpoint,
            dropped: self.dropped + new.dropped,
            ..new
        })
    }

    /// The cloud moved by `transform`: points, normals and viewpoint; weights and channels stay.
    ///
    /// # Errors
    /// [`Error::Extent`] when a scale takes it out of range.
    pub fn transformed(&self, transform: &Transform) -> Result<PointCloud> {
        let moved = self.positions().map(|p| transform.apply(p));
        let rotate = |n: &[f32; 3]| transform.rotate(n.map(f64::from)).map(|x| x as f32);
        Ok(PointCloud {
            normals: self.normals.as_ref().map(|normals| normals.iter().map(rotate).collect()),
            weights: self.weights.clone(),
            channels: self.channels.clone(),
            viewpoint: self.viewpoint.map(|v| transform.apply(v)),
            dropped: self.dropped,
            ..Self::from_finite(moved, self.len())?
        })
    }
}

/// Refuses what is no weight.
fn check_weights(weights: &[f32]) -> Result<()> {
    if let Some(index) = weights.iter().position(|weight| !weight.is_finite()) {
        return Err(Error::NonFinite { what: "weights of the points of a cloud".into(), index });
    }
    match weights.iter().find(|&&weight| weight < 0.0) {
        Some(weight) => Err(Error::config("weights", weight, "must be 0 or more")),
        None => Ok(()),
    }
}

/// Sizes from zero at which a frame's own zero stops meaning a viewpoint.
const FAR: f64 = 100.0;

/// `center` rounded to multiples of `factor` times the power of ten at or above `extent`.
///
/// For steps of 1 and more the multiples are exact in f64; below, the division
/// by a whole power of ten is correctly rounded, so equal multiples are equal bits.
fn snapped(center: Vec3, extent: f64, factor: f64) -> Vec3 {
    if extent == 0.0 {
        return center;
    }
    let exponent = exponent(extent) + factor.log10() as i32;
    let power = 10f64.powi(exponent.abs());
    center.map(|x| {
        let snapped =
            if exponent >= 0 { (x / power).round() * power } else { (x * power).round() / power };
        // A cloud of size 1e-12 at 1e300 has no finite multiple: leave it there.
        let snapped = if snapped.is_finite() { snapped } else { x };
        snapped + 0.0
    })
}

/// Exponent of the power of ten at or above `extent`; 0 for no extent.
fn exponent(extent: f64) -> i32 {
    if extent > 0.0 { extent.log10().ceil() as i32 } else { 0 }
}

/// Decimal digits below the power of ten at or above a cloud's size that a coordinate is
/// taken to have been written with.
const DIGITS: i32 = 8;

/// `x` relative to `origin`.
///
/// Beside a map offset f64 has lost the last digits of `x`. Where a number with few
/// decimals (a multiple of 1/`digits`) lies within that loss, it is what was written, and
/// taking it gives the same bits as without the offset.
fn local(x: f64, origin: f64, digits: f64) -> f32 {
    let local = x - origin;
    if origin == 0.0 {
        return local as f32;
    }
    let lost = x.abs().next_up() - x.abs();
    let written = (local * digits).round() / digits;
    (if (written - local).abs() <= lost { written } else { local }) as f32
}

/// `normal` at unit length in f32; zero when it has no direction.
fn unit(normal: Vec3) -> [f32; 3] {
    let unit = math::normalized(normal).map(|x| x as f32);
    if unit.iter().all(|x| x.is_finite()) { unit } else { [0.0; 3] }
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
        // As text files have them, through f64 or through f32: none is exact in binary.
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
    fn parts_make_the_same_cloud() {
        let points = [[5e5, 5.6e6, 0.1], [5e5 + 0.3, 5.6e6, 0.2], [f64::NAN; 3]];
        let cloud = PointCloud::with_normals(&points, &[[0.0, 0.3, 0.4]; 3]).unwrap();
        let cloud = cloud.with_viewpoint([5e5, 5.6e6, 9.0]).unwrap();
        assert_eq!(PointCloud::from_parts(cloud.parts()).unwrap(), cloud);
        let mut short = cloud.parts();
        short.normals.as_mut().unwrap().pop();
        assert!(matches!(PointCloud::from_parts(short), Err(Error::Shape { .. })));
        let mut nan = cloud.parts();
        nan.points[1][2] = f32::NAN;
        assert!(matches!(PointCloud::from_parts(nan), Err(Error::NonFinite { index: 1, .. })));
        let mut nowhere = cloud.parts();
        nowhere.viewpoint = Some([f64::INFINITY; 3]);
        assert!(PointCloud::from_parts(nowhere).is_err());
    }

    #[test]
    fn single_precision_is_taken_as_it_is() {
        let points = [[0.1f32, 2.5, -3.0], [f32::NAN, 0.0, 0.0], [1.0, 1e-7, 0.0]];
        let wide = PointCloud::new(&points.map(|p| p.map(f64::from))).unwrap();
        assert_eq!(PointCloud::from_f32(&points).unwrap(), wide);
    }

    #[test]
    fn zero_is_the_frame_origin_of_what_is_near() {
        // A 9 cm object seen from one metre.
        let near = PointCloud::new(&[[0.0, 0.0, 1.0], [0.09, 0.0, 1.0]]).unwrap();
        assert_eq!(near.frame_origin(), [0.0; 3]);
    }

    #[test]
    fn odd_extents_have_a_defined_result() {
        assert!(PointCloud::new(&[]).unwrap().is_empty());
        let same = PointCloud::new(&[[1e300, 0.0, 0.0]; 3]).unwrap();
        assert_eq!(same.position(2), [1e300, 0.0, 0.0]);
        for far in [1e16, 1e300, 1e-16] {
            let cloud = PointCloud::new(&[[0.0; 3], [far, 0.0, 0.0]]);
            assert!(matches!(cloud, Err(Error::Extent { .. })), "{far}");
        }
        let wide = PointCloud::new(&[[-1.7e308, 0.0, 0.0], [1.7e308, 0.0, 0.0]]);
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

    #[test]
    fn what_points_have_stays_with_them() {
        let points = [[0.0; 3], [f64::NAN, 0.0, 0.0], [1.0, 0.0, 0.0], [2.0, 0.0, 0.0]];
        let channels = Channels::default().with("red", vec![0.1, 0.2, 0.3, 0.4]).unwrap();
        let weights = [1.0, -5.0, 0.0, 4.0];
        let has =
            Attributes { weights: Some(&weights), channels: Some(&channels), ..Default::default() };
        let cloud = PointCloud::with_attributes(&points, has).unwrap();
        assert_eq!(cloud.weights(), Some(&[1.0, 0.0, 4.0][..]));
        assert_eq!(cloud.channels().get("red"), Some(&[0.1, 0.3, 0.4][..]));
        let turned = cloud.transformed(&Transform::from_rotation_vector([1.0, 0.0, 2.0])).unwrap();
        let back = turned.select(&[2, 0]);
        assert_eq!(back.weights(), Some(&[4.0, 1.0][..]));
        assert_eq!(back.channels().get("red"), Some(&[0.4, 0.1][..]));
        assert_eq!(PointCloud::from_parts(cloud.parts()).unwrap(), cloud);
        assert_eq!(cloud.counting().len(), 2);
        assert_eq!(back.relative_weights().unwrap(), [1.6, 0.4]);
    }

    #[test]
    fn what_is_no_weight_is_refused() {
        let cloud = PointCloud::new(&[[0.0; 3], [1.0, 0.0, 0.0]]).unwrap();
        let refused = |weights: [f64; 2]| cloud.clone().with_weights(weights.to_vec()).unwrap_err();
        assert!(matches!(refused([1.0, f64::NAN]), Error::NonFinite { index: 1, .. }));
        assert!(matches!(refused([1e39, 1.0]), Error::NonFinite { index: 0, .. }));
        assert_eq!(refused([1.0, -2.0]).to_string(), "weights = -2: must be 0 or more");
        assert!(matches!(refused([0.0, 0.0]), Error::Config { field: "weights", .. }));
        assert!(matches!(cloud.clone().with_weights(vec![1.0]), Err(Error::Shape { .. })));
        let mut parts = cloud.parts();
        parts.weights = Some(vec![1.0, -1.0]);
        assert!(PointCloud::from_parts(parts).is_err());
    }
}
