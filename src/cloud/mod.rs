//! Data types that everything shares: [`PointCloud`], [`Transform`], [`Descriptors`].

mod descriptors;
mod point_cloud;
mod transform;

pub use descriptors::Descriptors;
pub use point_cloud::PointCloud;
pub use transform::Transform;
