//! Protocols that measure the methods, and the shapes they can be measured on without
//! any file.

pub mod accuracy;
mod model;
pub mod shape;

pub use model::Model;
