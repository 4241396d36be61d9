//! The trait [`Descriptor`], FPFH, and the points that descriptors are computed from.

use std::borrow::Cow;

use super::fpfh::{HistogramScale, fpfh_at};
use crate::cloud::Descriptors;
use crate::error::{Error, Result};
use crate::search::Neighbors;

/// Makes N×D descriptors of the points of a cloud: the built-in [`Fpfh`], or one from outside the
/// crate.
///
/// Object safe. A descriptor from outside enters methods as rows that the clouds carry
/// ([`PointCloud::with_descriptors`](crate::PointCloud::with_descriptors));
/// [`FeatureConfig::attach`](crate::method::FeatureConfig::attach) prepares a cloud, computes the
/// rows and attaches them.
///
/// ```
/// use cfreg::descriptor::{Descriptor, PreparedCloud};
/// use cfreg::method::{Cf, FeatureConfig, GivenDescriptors, Register};
/// use cfreg::{Descriptors, Result};
/// # use cfreg::cloud::shape::boulder;
///
/// /// Distance of a point from the farthest of its neighbours.
/// struct Spread;
///
/// impl Descriptor for Spread {
///     fn name(&self) -> &str {
///         "spread"
///     }
///
///     fn describe(&self, cloud: &PreparedCloud<'_>) -> Result<Descriptors> {
///         let spread = |&i: &usize| {
///             let far = |&j: &u32| {
///                 let (p, q) = (cloud.points()[i], cloud.points()[j as usize]);
///                 (0..3).map(|k| (p[k] - q[k]).powi(2)).sum::<f32>()
///             };
///             cloud.neighbors().indices(i).iter().map(far).fold(0.0, f32::max).sqrt()
///         };
///         Descriptors::new(1, cloud.rows().iter().map(spread).collect())
///     }
/// }
///
/// let features = FeatureConfig::default();
/// let source = features.attach(&boulder().sample(400, 1)?, &Spread)?;
/// let target = features.attach(&boulder().sample(400, 2)?, &Spread)?;
/// let features = FeatureConfig {
///     given_descriptors: Some(GivenDescriptors::default()),
///     ..features
/// };
/// let found = Cf { features, ..Cf::default() }.register(&source, &target)?;
/// assert_eq!(found.method.settings["given_descriptors"], "replace:euclidean");
/// # Ok::<(), cfreg::Error>(())
/// ```
pub trait Descriptor: Send + Sync {
    /// Returns the name of the descriptor, for messages.
    fn name(&self) -> &str;

    /// Returns the squared bandwidth β, in squared descriptor units, that suits a kernel of the
    /// squared distance of two rows; `None`, the default, if it is to follow from the descriptors
    /// of the clouds ([`Bandwidth::Auto`](crate::weight::Bandwidth::Auto)).
    fn default_bandwidth(&self) -> Option<f64> {
        None
    }

    /// Returns a row for each of the cloud's [`rows`](PreparedCloud::rows), in their order. A row
    /// of zeros marks a point that has no descriptor; a cloud cannot carry such a row, and
    /// [`attach`](crate::method::FeatureConfig::attach) refuses it.
    ///
    /// # Errors
    /// Those of the descriptor.
    fn describe(&self, cloud: &PreparedCloud<'_>) -> Result<Descriptors>;
}

/// Points with normals and neighbourhoods, as descriptors need them.
#[derive(Clone)]
pub struct PreparedCloud<'a> {
    points: &'a [[f32; 3]],
    normals: &'a [[f32; 3]],
    neighbors: &'a Neighbors,
    rows: Cow<'a, [usize]>,
}

impl<'a> PreparedCloud<'a> {
    /// Prepares all points to be described.
    ///
    /// # Errors
    /// [`Error::Shape`] when points, normals and neighbourhoods differ in number.
    pub fn new(
        points: &'a [[f32; 3]],
        normals: &'a [[f32; 3]],
        neighbors: &'a Neighbors,
    ) -> Result<Self> {
        for (what, found) in [("normals", normals.len()), ("neighbourhoods", neighbors.len())] {
            if found != points.len() {
                let what = format!("{what} for the points of a cloud");
                return Err(Error::Shape { what, expected: points.len(), found });
            }
        }
        Ok(PreparedCloud { points, normals, neighbors, rows: (0..points.len()).collect() })
    }

    /// Limits the points that are described to those at `rows`, in that order.
    ///
    /// # Errors
    /// [`Error::Shape`] for a row that is not a point.
    pub fn at(self, rows: &'a [usize]) -> Result<Self> {
        match rows.iter().find(|&&row| row >= self.points.len()) {
            Some(&found) => {
                let what = "a point to be described".into();
                Err(Error::Shape { what, expected: self.points.len(), found })
            }
            None => Ok(PreparedCloud { rows: rows.into(), ..self }),
        }
    }

    /// Returns all points, (N, 3), about the cloud's origin.
    pub fn points(&self) -> &'a [[f32; 3]] {
        self.points
    }

    /// Returns unit normals of all points; zero marks an undefined normal.
    pub fn normals(&self) -> &'a [[f32; 3]] {
        self.normals
    }

    /// Returns the neighbourhoods of all points.
    pub fn neighbors(&self) -> &'a Neighbors {
        self.neighbors
    }

    /// Returns the numbers of the points that are to be described.
    pub fn rows(&self) -> &[usize] {
        &self.rows
    }
}

/// Fast Point Feature Histograms (Rusu, Blodow and Beetz 2009): 33 bins a row, see
/// [`fpfh`](super::fpfh).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Fpfh {
    /// Scale of the histograms: PCL's (default) or Open3D's.
    pub histogram: HistogramScale,
}

impl Descriptor for Fpfh {
    fn name(&self) -> &str {
        "fpfh"
    }

    fn default_bandwidth(&self) -> Option<f64> {
        Some(self.histogram.default_beta())
    }

    fn describe(&self, cloud: &PreparedCloud<'_>) -> Result<Descriptors> {
        fpfh_at(cloud.points, cloud.normals, cloud.neighbors, &cloud.rows, self.histogram)
    }
}
