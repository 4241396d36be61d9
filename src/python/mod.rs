//! The extension module `cfreg` for Python: translates, decides nothing.
//!
//! Only this folder names pyo3 and numpy. [`arrays`] turns arrays into clouds and back,
//! [`errors`] is the one doorway out of Python: there the interpreter is released and
//! the crate's errors become exceptions.
//!
//! Doc comments of what Python sees are its docstrings. Defaults stand in the signatures
//! for `help()`; `None` always means the default of the Rust struct, and the module's
//! tests compare the two.

mod arrays;
mod errors;
mod features;
mod moments;
mod registration;

/// Rigid point-cloud registration without correspondences and without an initial guess.
///
/// `register` does everything; `estimate_normals`, `keypoints`, `fpfh`, `moments` and `solve`
/// are its stages, for those who bring their own descriptors or weights.
///
/// Points are numpy arrays (N, 3) of float32 or float64 in any unit, points in rows, with
/// any strides. `source` is moved onto `target`: a pose is the 4x4 matrix T_target_source.
/// Results do not depend on the number of threads. No function holds the interpreter while
/// it computes.
///
/// Errors: TypeError for what is not such an array; ValueError for shapes, values and
/// settings, naming the argument; RegistrationError (a ValueError) where the clouds do not
/// determine an answer.
#[pyo3::pymodule]
mod cfreg {
    #[pymodule_export]
    use super::errors::RegistrationError;
    #[pymodule_export]
    use super::features::{estimate_normals, fpfh, keypoints};
    #[pymodule_export]
    use super::moments::{Moments, moments, solve};
    #[pymodule_export]
    use super::registration::register;

    #[pymodule_export]
    #[expect(non_upper_case_globals, reason = "Python's name for it")]
    const __version__: &str = env!("CARGO_PKG_VERSION");
}
