//! The error type of the crate.
//!
//! Every variant carries its cause, so that a message names the file, line, field or value and what
//! to do about it. `Err` means that no pose could be computed; a pose with warnings is `Ok` and
//! contains these warnings (see [`crate::verify`]).

use std::path::{Path, PathBuf};

/// `Result` with the crate's [`Error`].
pub type Result<T, E = Error> = std::result::Result<T, E>;

/// All reasons why a result could not be computed.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// Fewer usable points than required.
    #[error("{what} has {found} usable points, at least {needed} are needed")]
    TooFewPoints {
        /// The cloud or set of points.
        what: String,
        /// Number of points present.
        found: usize,
        /// Number of points required.
        needed: usize,
    },

    /// A value passed by the caller is NaN or infinite.
    ///
    /// Clouds drop and count NaN and infinite points instead; this is for descriptors, weights and
    /// moments, where dropping would hide an error of the caller.
    #[error("{what} has a NaN or infinite value at index {index}: remove or repair it first")]
    NonFinite {
        /// The container of the value.
        what: String,
        /// Row of the value.
        index: usize,
    },

    /// Two inputs that must have the same length or dimension differ.
    #[error("{what}: expected {expected}, found {found}")]
    Shape {
        /// The compared inputs.
        what: String,
        /// The required size.
        expected: usize,
        /// The size found.
        found: usize,
    },

    /// A setting by name that the method does not have, or of the wrong type.
    #[error("{name} = {value}: {rule}")]
    Setting {
        /// The name as passed.
        name: String,
        /// The value as JSON.
        value: String,
        /// The valid values.
        rule: String,
    },

    /// The coordinates span more, or less, than squared distances in f32 can represent.
    #[error(
        "coordinates span {extent:e} units, spans between 1e-15 and 1e15 can be computed with: \
         look for stray points or change the unit"
    )]
    Extent {
        /// Longest side of the bounding box.
        extent: f64,
    },

    /// A finite coordinate that is too large to compute with.
    #[error(
        "point {index} has the coordinate {value:e}: coordinates within 1e75 of zero can be \
         computed with, NaN marks points that are to be left out"
    )]
    Coordinate {
        /// Index of the point, from 0, in input order.
        index: usize,
        /// The first of its coordinates that is too large.
        value: f64,
    },

    /// No connection has any weight, so that there is nothing to solve.
    #[error(
        "no connection has any weight: nothing is alike, or near enough under the pose to start \
         from; check the clouds (lines, planes and a few points look alike everywhere){}{}",
        if advice.is_empty() { "" } else { ", or " },
        advice
    )]
    NoWeight {
        /// Possible remedies, in settings of the method; empty without a known method.
        advice: &'static str,
    },

    /// The weighted pairs do not determine a rotation.
    #[error(
        "the weighted connections do not determine a rotation: rank {rank} of the \
         cross-covariance, singular values relative to the clouds' spread {0:.3e}, {1:.3e}, \
         {2:.3e}; at least two must exceed 1e-8 (collinear, planar or featureless clouds, \
         weights that do not tell points apart, or clouds too far from each other for a method \
         that starts where they lie)",
        .singular_values[0], .singular_values[1], .singular_values[2]
    )]
    Degenerate {
        /// Number of non-negligible singular values, 0 or 1.
        rank: usize,
        /// Singular values of the cross-covariance over the product of the two
        /// weighted standard deviations, in `[0, 1]`, descending.
        singular_values: [f64; 3],
    },

    /// A setting outside its range, or two that contradict each other.
    #[error("{field} = {value}: {rule}")]
    Config {
        /// Name of the setting, as in the configuration struct.
        field: &'static str,
        /// The value of the setting.
        value: String,
        /// The valid values.
        rule: String,
    },

    /// The work was interrupted before it was done ([`par::Interrupt`](crate::par::Interrupt)).
    #[error("interrupted before there was an answer")]
    Interrupted,

    /// A file with invalid content.
    #[error("{}{}: {what}", .path.display(), FilePosition(*.line, *.byte))]
    Parse {
        /// The file.
        path: PathBuf,
        /// Line, from 1, in a text part.
        line: Option<usize>,
        /// Byte, from 0, in a binary part.
        byte: Option<u64>,
        /// The error, and the expected content.
        what: String,
    },

    /// The operating system refused to read or write.
    #[error("{}: {source}", .path.display())]
    Io {
        /// The file or folder.
        path: PathBuf,
        /// The error of the system.
        source: std::io::Error,
    },
}

impl Error {
    /// An [`Error::NoWeight`] of any method.
    pub(crate) const NO_WEIGHT: Error = Error::NoWeight { advice: "" };

    /// Creates an [`Error::Io`] for `path`.
    pub fn io(path: impl AsRef<Path>, source: std::io::Error) -> Self {
        Error::Io { path: path.as_ref().to_path_buf(), source }
    }

    /// Creates an [`Error::Parse`] of the text in `path`, with the line if one is known.
    pub fn parse(path: impl AsRef<Path>, line: Option<usize>, what: impl Into<String>) -> Self {
        Error::Parse { path: path.as_ref().to_path_buf(), line, byte: None, what: what.into() }
    }

    /// Creates an [`Error::Config`] that shows `value` as the user would write it.
    pub fn config(
        field: &'static str,
        value: impl std::fmt::Display,
        rule: impl Into<String>,
    ) -> Self {
        Error::Config { field, value: value.to_string(), rule: rule.into() }
    }
}

/// Formats as `:line 3`, `:byte 120` or nothing.
struct FilePosition(Option<usize>, Option<u64>);

impl std::fmt::Display for FilePosition {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match (self.0, self.1) {
            (Some(line), _) => write!(f, ", line {line}"),
            (None, Some(byte)) => write!(f, ", byte {byte}"),
            (None, None) => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_parse_error_names_file_and_position() {
        let at = |line, byte| Error::Parse {
            path: "a.ply".into(),
            line,
            byte,
            what: "no vertices".into(),
        };
        assert_eq!(at(Some(3), None).to_string(), "a.ply, line 3: no vertices");
        assert_eq!(at(None, Some(9)).to_string(), "a.ply, byte 9: no vertices");
        assert_eq!(at(None, None).to_string(), "a.ply: no vertices");
    }

    #[test]
    fn advice_is_said_where_there_is_one() {
        assert!(Error::NO_WEIGHT.to_string().ends_with("look alike everywhere)"));
        let advised = Error::NoWeight { advice: "raise beta" };
        assert!(advised.to_string().ends_with("look alike everywhere), or raise beta"));
    }

    #[test]
    fn errors_stay_small() {
        assert!(size_of::<Error>() <= 96, "{}", size_of::<Error>());
    }
}
