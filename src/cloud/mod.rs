//! Data types that everything shares: [`PointCloud`], [`Mesh`], [`Transform`],
//! [`Descriptors`].

mod descriptors;
mod mesh;
mod point_cloud;
mod transform;
mod visible;

pub use descriptors::Descriptors;
pub use mesh::{MOST_POINTS, Mesh};
pub use point_cloud::{Parts, PointCloud};
pub use transform::Transform;
