//! Pages that a person opens after a registration: whether to trust the pose, seen at a glance.
//!
//! A page is one file that needs no network: styles, scripts and the points are all in it. Where there is no WebGL a still picture takes the place of the view.

mod arrows;
mod batch;
mod benchmark;
mod display;
mod facts;
mod kept;
mod links;
pub mod listing;
mod look;
mod page;
mod pair;
mod picture;
mod tables;
mod words;

pub use batch::Bulk;
pub use benchmark::benchmark;
pub use kept::Kept;
pub use page::is_ours;
pub use pair::Pair;
