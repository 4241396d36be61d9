//! The experiments of `cfreg`: those of the paper, the study of weight schemes, and the scaling of
//! time and memory, with their tables and figures.
//!
//! They use only the public API of `cfreg`. The program `cfreg-paper` runs all of them:
//!
//! ```sh
//! cargo run --release -p cfreg-paper -- reproduce
//! ```
#![warn(missing_docs)]

pub mod accuracy;
mod csv_cache;
pub mod experiments;
mod files;
mod mean_std;
mod model;
mod motion;
pub mod overlap;
pub mod protocol;
pub mod scaling;
pub mod study;
mod views;

pub use mean_std::MeanStd;
pub use model::Model;
pub use motion::Motion;
pub use views::Views;
