//! Cloud arguments of every accepted kind.

use std::path::PathBuf;

use pyo3::prelude::*;

use super::cloud::PyCloud;
use super::errors::ShapeError;
use super::gil::released;
use super::interop::BadRows;
use cfreg::cloud::PointCloud;
use cfreg::io;

/// A cloud argument: a `PointCloud`, or a cloud created from another accepted object or a file.
pub(super) enum AnyCloud<'py> {
    Given(Bound<'py, PyCloud>),
    Made(Box<PointCloud>),
}

impl<'py> AnyCloud<'py> {
    /// Reads a cloud argument; `name` is its name in errors, and `normals` replace its own. If bad
    /// rows are refused, points are named by row numbers, which a file does not have.
    pub(super) fn read(
        any: &Bound<'py, PyAny>,
        name: &str,
        normals: Option<&Bound<'py, PyAny>>,
        bad_rows: BadRows,
    ) -> PyResult<Self> {
        let boxed = |made| AnyCloud::Made(Box::new(made));
        match (any.cast::<PyCloud>(), normals) {
            (Ok(given), None) => Ok(AnyCloud::Given(given.clone())),
            (_, None) if bad_rows == BadRows::Drop => match any.extract::<PathBuf>() {
                Ok(path) => released(any.py(), || io::read(&path)).map(boxed),
                Err(_) => PyCloud::made(any, name, None, bad_rows).map(boxed),
            },
            _ => PyCloud::made(any, name, normals, bad_rows).map(boxed),
        }
    }

    /// Reads a cloud whose points are named by their rows in the input.
    pub(super) fn by_rows(any: &Bound<'py, PyAny>, name: &str) -> PyResult<Self> {
        let cloud = Self::read(any, name, None, BadRows::Refuse)?;
        match cloud.get().dropped() {
            0 => Ok(cloud),
            dropped => Err(ShapeError::new_err(format!(
                "{name}: this PointCloud has left out {dropped} rows, so that the rows after \
                 them have moved up: give the array, or for rows of its points \
                 PointCloud({name}.points)"
            ))),
        }
    }

    /// Returns the cloud.
    pub(super) fn get(&self) -> &PointCloud {
        match self {
            AnyCloud::Given(given) => given.get().cloud(),
            AnyCloud::Made(cloud) => cloud,
        }
    }
}
