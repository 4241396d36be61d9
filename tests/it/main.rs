//! All tests of the crate from outside, in one binary: it links once. Those that measure their own
//! process have files of their own beside this folder.

mod common;

mod adversaries;
mod architecture;
mod batch;
mod cached;
mod cases;
mod cf_spectral;
mod cfk;
mod channels;
mod circles;
mod cli;
mod cli_files;
mod cli_given;
mod cli_verdict;
mod closed_forms;
mod colours;
mod connections;
mod consensus;
mod covariance;
mod cpd;
mod custom_descriptor;
mod custom_kernel;
mod custom_method;
mod dare;
mod digests;
mod equivariance;
mod foreign_files;
mod formats;
mod golden;
mod golden_weights;
mod hostile_files;
mod icp;
mod io;
mod kernel_correlation;
mod licenses;
mod methods;
mod moments;
// Its tests are lines of a shell.
#[cfg(unix)]
mod outputs;
mod pairs;
mod point_weights;
mod prior;
mod registration;
mod report;
mod teaser;
mod teaser_reference;
mod trust;
mod verdict_equivariance;
mod verdicts;
mod weights;
