//! Protocols that measure the methods, and the shapes they can be measured on without
//! any file.

pub mod accuracy;
#[cfg(feature = "figures")]
pub mod benchmark;
#[cfg(feature = "figures")]
pub mod figure;
mod model;
mod motion;
#[cfg(feature = "figures")]
pub mod paper;
pub mod protocol;
#[cfg(feature = "figures")]
pub mod scaling;
pub mod shape;
#[cfg(feature = "figures")]
mod sheet;
mod spread;
#[cfg(feature = "figures")]
pub mod study;
mod views;

pub use model::Model;
pub use motion::Motion;
pub use spread::Spread;
pub use views::Views;
