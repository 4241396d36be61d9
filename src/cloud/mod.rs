//! Shared data types: [`PointCloud`] with its [`Channels`], [`Mesh`], [`Transform`],
//! [`Descriptors`].

mod channels;
mod descriptors;
mod mesh;
mod point_cloud;
pub mod shape;
mod transform;
mod viewpoint_source;
mod visible_faces;

pub use channels::{Channels, ColorDepth};
pub use descriptors::Descriptors;
pub use mesh::{MAX_SAMPLED_POINTS, Mesh};
pub use point_cloud::{Attributes, Parts, PointCloud};
pub(crate) use point_cloud::{check_weights, find_too_large, normalize_normal};
pub use transform::Transform;
pub use viewpoint_source::ViewpointSource;
