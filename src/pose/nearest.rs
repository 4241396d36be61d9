//! The rotation nearest to a matrix that is approximately a rotation.

use crate::error::{Error, Result};
use crate::math::{self, Mat3};

/// Maximum distance of a matrix from a rotation, as the Frobenius norm of the difference: float32
/// and five printed decimals stay below it, and the nearest rotation differs by at most 0.006
/// degrees. Chosen by hand.
pub const MAX_ROTATION_ERROR: f64 = 1e-4;

/// Finds the rotation nearest to `matrix` in the Frobenius norm, and the norm of the difference.
///
/// ```
/// let (rotation, error) = cfreg::pose::nearest_rotation(&[
///     [0.0, -1.0000013, 0.0],
///     [1.0000013, 0.0, 0.0],
///     [0.0, 0.0, 1.0000013],
/// ])?;
/// assert_eq!(rotation[0], [0.0, -1.0, 0.0]);
/// assert!((error - 1.3e-6 * 3f64.sqrt()).abs() < 1e-12);
/// # Ok::<(), cfreg::Error>(())
/// ```
///
/// # Errors
/// [`Error::Config`] for entries that are not finite, for reflections, and where the difference is
/// above [`MAX_ROTATION_ERROR`]; the error reports the difference.
pub fn nearest_rotation(matrix: &Mat3) -> Result<(Mat3, f64)> {
    let bad = |value: String, rule: &str| Err(Error::config("rotation", value, rule));
    if matrix.as_flattened().iter().any(|entry| !entry.is_finite()) {
        return bad(rows(matrix), "every entry must be finite");
    }
    let determinant = math::determinant(matrix);
    if determinant < 0.0 {
        let value = format!("a reflection, of determinant {determinant:.6}");
        let rule = "it turns a left hand into a right hand, which no rotation does (determinant 1): \
                    change the sign of one axis or exchange two, where the matrix was made";
        return bad(value, rule);
    }
    let Some(rotation) = polar(matrix) else {
        return bad(
            rows(matrix),
            "its rows are not independent, so that no rotation is near to it",
        );
    };
    let error = math::frobenius(&math::mat_sub(matrix, &rotation));
    if error > MAX_ROTATION_ERROR {
        let value = format!("a matrix that is {error:.3e} away from the nearest rotation");
        let rule = format!(
            "at most {MAX_ROTATION_ERROR:e} is taken for rounding (Frobenius norm of the difference; \
             determinant {determinant:.6}): divide a scale out, give more digits, or give the \
             rotation vector"
        );
        return bad(value, &rule);
    }
    Ok((rotation, error))
}

/// Computes the orthogonal polar factor of a matrix of positive determinant, by Newton's iteration
/// X ← (X + X⁻ᵀ) / 2; `None` where it does not converge.
fn polar(matrix: &Mat3) -> Option<Mat3> {
    let mut x = *matrix;
    for _ in 0..100 {
        let [a, b, c] = x;
        let determinant = math::determinant(&x);
        let inverse = [math::cross(b, c), math::cross(c, a), math::cross(a, b)]
            .map(|row| math::scaled(row, 1.0 / determinant));
        let next = [0, 1, 2].map(|i| math::scaled(math::add(x[i], inverse[i]), 0.5));
        let change = math::frobenius(&math::mat_sub(&next, &x));
        x = next;
        if !change.is_finite() {
            return None;
        }
        if change < 1e-14 {
            return Some(x);
        }
    }
    None
}

fn rows(matrix: &Mat3) -> String {
    format!("{matrix:?}")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cloud::Transform;

    #[test]
    fn what_is_nearly_a_rotation_becomes_the_nearest_one() {
        let exact = Transform::from_rotation_vector([0.4, -1.1, 2.0]).rotation;
        let (same, error) = nearest_rotation(&exact).unwrap();
        assert!(error < 1e-15 && math::frobenius(&math::mat_sub(&same, &exact)) < 1e-15);
        // A symmetric factor does not change the nearest rotation.
        let stretch = [[1.00002, 1e-5, 0.0], [1e-5, 0.99998, -2e-5], [0.0, -2e-5, 1.00001]];
        let (found, error) = nearest_rotation(&math::mat_mul(&exact, &stretch)).unwrap();
        assert!(math::frobenius(&math::mat_sub(&found, &exact)) < 1e-14);
        assert!((error - 4.359e-5).abs() < 1e-8, "{error:e}");
    }

    #[test]
    fn what_is_no_rotation_is_refused_with_how_far_it_is_off() {
        let scaled = |by: f64| [[by, 0.0, 0.0], [0.0, by, 0.0], [0.0, 0.0, by]];
        for (matrix, words) in [
            (scaled(1.01), "1.732e-2 away"),
            (scaled(2.0), "1.732e0 away"),
            (scaled(-1.0), "a reflection, of determinant -1.000000"),
            (scaled(0.0), "not independent"),
            (scaled(1e-200), "not independent"),
            (scaled(f64::NAN), "must be finite"),
            (scaled(f64::INFINITY), "must be finite"),
        ] {
            let error = nearest_rotation(&matrix).unwrap_err().to_string();
            assert!(error.contains(words), "{words}: {error}");
        }
    }
}
