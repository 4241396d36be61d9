//! Rigid registration of two point clouds without correspondences and without an initial guess.
//!
//! The main job is to find the pose of one scan in the frame of another, and to say whether it is
//! right. [`method::Consensus`] does it, without a parameter:
//!
//! ```
//! use cfreg::cloud::shape::boulder;
//! use cfreg::method::{Consensus, Register};
//! use cfreg::{Transform, verify};
//!
//! // Two independent samples of one surface, the second one turned. From files: cfreg::io::read.
//! let truth = Transform::from_rotation_vector([0.5, -0.8, 0.3]);
//! let source = boulder().sample(2000, 1)?;
//! let target = boulder().sample(2000, 2)?.transformed(&truth)?;
//!
//! let found = Consensus::default().register(&source, &target)?;
//! let error = verify::pose_error(&found.transform, &truth, source.centroid());
//! assert!(found.is_usable() && error.rotation_deg < 1.0, "{error:?} {:?}", found.doubts);
//! # Ok::<(), cfreg::Error>(())
//! ```
//!
//! Same input gives the same bits, for any number of threads. A wrong input is an [`Error`] that
//! names the file, line, field or value; an answer with grounds for doubt is `Ok`, with the grounds.
//!
//! # Modules
//!
//! - [`cloud`], [`io`]: clouds, poses, and their files; [`filter`]: fewer points
//! - [`method`]: everything that registers, and [`Registration`](method::Registration), its result
//! - [`verify`]: the verdict on a pose, its covariance, warnings, errors against a known truth
//! - [`weight`], [`moments`], [`pose`]: weights on the full connection, their sums, closed forms
//! - [`normals`], [`descriptor`], [`keypoint`]: features; [`search`]: nearest neighbours
//! - [`surface`], [`visibility`]: surfaces of scans, and the space that a sensor saw to be empty
//! - [`pose_graph`]: edges of verified poses, and their export
//! - [`math`], [`par`], [`error`]: small algebra, ordered parallel loops, the one error type
#![cfg_attr(feature = "batch", doc = "- [`batch`]: lists of pairs, resumable")]
#![cfg_attr(feature = "benchmark", doc = "- [`benchmark`]: methods over pairs with known poses")]
#![cfg_attr(feature = "report", doc = "- [`report`]: pages of results; [`figure`]: figures")]
//!
//! # Features
//!
//! None is on by default. `batch` has lists of pairs, `parquet` their Parquet files, `figures` the
//! module `figure`, `benchmark` the module of that name, `report` pages of results, and `cli` the
//! command line with all of these.
#![warn(missing_docs)]
// Helpers of optional parts are compiled in every build: a gate at each would have to follow all who
// call it.
#![cfg_attr(not(feature = "cli"), allow(dead_code, unused_imports, unused_mut))]

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

// The Rust examples of the README and of the manual are tests of the documentation.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct ReadmeDoctests;
#[cfg(doctest)]
#[doc = include_str!("../docs/quick_start.md")]
struct QuickStartDoctests;
#[cfg(doctest)]
#[doc = include_str!("../docs/methods.md")]
struct MethodsDoctests;
#[cfg(doctest)]
#[doc = include_str!("../docs/weights.md")]
struct WeightsDoctests;
