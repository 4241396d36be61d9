//! Data types that everything shares: [`PointCloud`] with its [`Channels`], [`Mesh`],
//! [`Transform`], [`Descriptors`].

mod channels;
mod descriptors;
mod mesh;
mod point_cloud;
mod transform;
mod viewpoints;
mod visible;

pub use channels::{Channels, ColorDepth};
pub use descriptors::Descriptors;
pub use mesh::{MOST_POINTS, Mesh};
pub use point_cloud::{Attributes, Parts, PointCloud};
pub(crate) use point_cloud::{check_weights, too_large, unit};
pub use transform::Transform;
pub use viewpoints::Viewpoints;
