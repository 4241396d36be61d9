//! Cloud arguments of every accepted kind.

use std::path::PathBuf;

use pyo3::prelude::*;

use super::cloud::PyCloud;
use super::errors::{ShapeError, argument_error};
use super::gil::run_interruptible;
use super::interop::BadRows;
use super::rows::RowSelection;
use cfreg::cloud::PointCloud;
use cfreg::io;

/// A cloud that was handed over: a `PointCloud`, or made from whatever stands for one, a file too.
pub(super) enum CloudArg<'py> {
    Given(Bound<'py, PyCloud>),
    Made(Box<PointCloud>),
}

impl<'py> CloudArg<'py> {
    /// `name` is what errors call the cloud; `normals` take the place of its own. Where bad rows
    /// are refused, rows have numbers, which those of a file have not.
    pub(super) fn read(
        any: &Bound<'py, PyAny>,
        name: &str,
        normals: Option<&Bound<'py, PyAny>>,
        bad_rows: BadRows,
    ) -> PyResult<Self> {
        let boxed = |made| CloudArg::Made(Box::new(made));
        match (any.cast::<PyCloud>(), normals) {
            (Ok(given), None) => Ok(CloudArg::Given(given.clone())),
            (_, None) if bad_rows == BadRows::Drop => match any.extract::<PathBuf>() {
                Ok(path) => run_interruptible(any.py(), || io::read(&path)).map(boxed),
                Err(_) => PyCloud::from_any(any, name, None, bad_rows).map(boxed),
            },
            _ => PyCloud::from_any(any, name, normals, bad_rows).map(boxed),
        }
    }

    /// A cloud whose points are named by their rows in what was handed over.
    pub(super) fn read_indexed(any: &Bound<'py, PyAny>, name: &str) -> PyResult<Self> {
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

    /// The cloud with descriptors (N, D), one row for each row of `points`, which it was made of;
    /// `name` is what errors call them.
    pub(super) fn with_descriptors(
        self,
        points: &Bound<'py, PyAny>,
        descriptors: &Bound<'py, PyAny>,
        name: &str,
    ) -> PyResult<Self> {
        let cloud = self.get();
        let rows = match points.cast::<PyCloud>().is_ok() || points.extract::<PathBuf>().is_ok() {
            true => RowSelection::new(cloud.len()),
            false => RowSelection::from_points(points, cloud)?,
        };
        let descriptors = rows.descriptors(descriptors, name)?;
        let made = cloud.clone().with_descriptors(descriptors);
        made.map(|made| CloudArg::Made(Box::new(made))).map_err(|error| argument_error(name, error))
    }

    /// Returns the cloud.
    pub(super) fn get(&self) -> &PointCloud {
        match self {
            CloudArg::Given(given) => given.get().cloud(),
            CloudArg::Made(cloud) => cloud,
        }
    }
}
