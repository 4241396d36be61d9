//! Data types that everything shares: [`PointCloud`] with its [`Channels`], [`Mesh`],
//! [`Transform`], [`Descriptors`].

mod channels;
mod descriptors;
mod mesh;
mod point_cloud;
mod transform;
mod viewpoints;
mod visible;

pub use channels::Channels;
pub use descriptors::Descriptors;
pub use mesh::{MOST_POINTS, Mesh};
pub(crate) use point_cloud::check_weights;
pub use point_cloud::{Attributes, Parts, PointCloud};
pub use transform::Transform;
pub use viewpoints::Viewpoints;
