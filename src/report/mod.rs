//! Pages that show whether a registration's pose can be trusted.
//!
//! A page is one file that needs no network: styles, scripts and points are inside. Without WebGL a
//! still picture replaces the view.

mod arrows;
mod batch;
mod benchmark;
mod camera;
mod display;
mod page;
mod pair;
mod pair_result;
mod preview;
mod saved_result;
pub mod table_page;
mod tables;
mod text;
mod weight_view;

pub use batch::BatchReport;
pub use benchmark::write_benchmark;
pub use page::is_report_page;
pub use pair::PairReport;
pub use saved_result::SavedResult;
