#![doc = include_str!("../README.md")]
#![warn(missing_docs)]

#[cfg(feature = "batch")]
pub mod batch;
#[cfg(feature = "benchmark")]
pub mod benchmark;
#[cfg(feature = "cli")]
pub mod cli;
pub mod cloud;
pub mod descriptor;
pub mod error;
#[cfg(feature = "figures")]
pub mod figure;
pub mod filter;
pub mod io;
pub mod keypoint;
pub mod math;
pub mod method;
pub mod moments;
pub mod normals;
pub mod par;
pub mod pose;
pub mod pose_graph;
#[cfg(feature = "report")]
pub mod report;
pub mod search;
pub mod surface;
pub mod verify;
pub mod visibility;
pub mod weight;

pub use cloud::{Channels, ColorDepth, Descriptors, Mesh, PointCloud, Transform};
pub use error::{Error, Result};
