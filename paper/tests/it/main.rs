//! All tests of the laboratory from outside, in one binary.

mod common;

mod accuracy;
mod overlap;
mod paper;
mod scaling;
mod study;
