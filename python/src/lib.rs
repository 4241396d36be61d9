//! The Python bindings: they translate and make no decisions.
//!
//! Only this folder uses pyo3 and numpy. It builds the extension module `cfreg._native`, the base
//! of the package in the folder `python/cfreg`. This module has clouds, features, moments and the
//! calls of long work; the package has the methods, weights and results under their Python names,
//! and the support of other libraries.
//!
//! `arrays` turns arrays into numbers and back, `interop` arrays and the clouds of other
//! libraries into clouds, `cloud_arg` whatever stands for one; `gil` is the one way into
//! long work: there the interpreter is released and signals are looked after; `shutdown` sees to
//! it that what goes on without the interpreter outlives it in peace; `errors` makes exceptions
//! of the crate's errors, `panics` of its panics.
//!
//! Doc comments of items visible in Python are their docstrings. Defaults are in the signatures for
//! `help()`; the module's tests compare them with the defaults of the Rust structs.

mod arrays;
mod batch;
mod cloud;
mod cloud_arg;
mod custom_method;
mod errors;
mod features;
mod files;
mod gil;
mod interop;
mod moments;
mod panics;
mod registration;
mod report;
mod rows;
mod shutdown;
mod weights;

/// The compiled part of cfreg.
#[pyo3::pymodule(gil_used = false)]
mod _native {
    use pyo3::prelude::*;

    #[pymodule_export]
    use super::batch::{consecutive, read_batch, read_list, register_batch, within, write_g2o};
    #[pymodule_export]
    use super::cloud::PyCloud;
    #[pymodule_export]
    use super::errors::{
        DegenerateError, Error, ExtentError, FileFormatError, InternalError, NoWeightError,
        NonFiniteError, RegistrationError, SettingError, ShapeError, TooFewPointsError,
    };
    #[pymodule_export]
    use super::features::{estimate_normals, fpfh, keypoints};
    #[pymodule_export]
    use super::files::{apply, read, write};
    #[pymodule_export]
    use super::moments::{Moments, moments, moments_of_pairs, solve};
    #[pymodule_export]
    use super::registration::{
        evaluate, is_usable, judge, register, register_pose, rotation_vector, settings,
    };
    #[pymodule_export]
    use super::report::{report, thumbnail};
    #[pymodule_export]
    use super::weights::{check_kernel, kernel_weights};

    #[pymodule_export]
    #[expect(non_upper_case_globals, reason = "Python's name for it")]
    const __version__: &str = env!("CARGO_PKG_VERSION");

    #[pymodule_init]
    fn init(module: &Bound<'_, PyModule>) -> PyResult<()> {
        super::panics::install_panic_hook();
        #[cfg(debug_assertions)]
        super::panics::register(module)?;
        super::shutdown::register(module)
    }
}
