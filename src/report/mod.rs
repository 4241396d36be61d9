//! Pages that a person opens after a registration: whether to trust the pose, seen at a glance.
//!
//! A page is one file that needs no network: styles, scripts, a WebGL library and the points
//! are all in it. Where there is no WebGL a still picture takes the place of the view.

mod arrows;
mod display;
mod facts;
mod kept;
mod links;
mod look;
mod page;
mod pair;
mod picture;
mod tables;
mod words;

pub use kept::Kept;
pub use pair::Pair;
