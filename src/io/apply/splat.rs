//! Gaussian splats: their rotations, scales and spherical harmonics under a pose.
//!
//! The colour of a splat depends on the direction d from the viewer as the sum of c_m Y_m(d) over
//! the real spherical harmonics of the degrees 1 to 3 (Kerbl et al. 2023, the constants of
//! Ramamoorthi & Hanrahan 2001). Turned by R, it is c'_m with the sum of c'_m Y_m(d) equal to that of
//! c_m Y_m(Rᵀd). Each degree turns in itself, by a matrix that a few directions determine.

use crate::cloud::Transform;
use crate::io::apply::quaternion::{from_rotation, multiply};
use crate::math::{self, Vec3};

/// The columns of the numbers of a splat.
#[derive(Debug, Clone, Default)]
pub(super) struct SplatColumns {
    /// rot_0 to rot_3: w, x, y, z.
    rotation: [usize; 4],
    /// scale_0 to scale_2: logarithms.
    scales: [usize; 3],
    /// f_rest_0, ...: for each of three colours the coefficients of the degrees from 1 on.
    harmonics: Vec<usize>,
}

/// The motion of splats under a pose.
pub(super) struct SplatMotion {
    columns: SplatColumns,
    quaternion: [f64; 4],
    log_scale: f64,
    /// The matrices of the degrees 1, 2 and 3, as many as there are.
    degrees: Vec<Vec<Vec<f64>>>,
}

impl SplatColumns {
    /// Finds the columns; the error names what is missing or of an unknown number.
    pub fn find(names: &[&str]) -> Result<SplatColumns, String> {
        let place = |name: &str| {
            let found = names.iter().position(|own| *own == name);
            found.ok_or_else(|| {
                format!("the splats have no {name}, without which they cannot be turned")
            })
        };
        let mut columns = SplatColumns::default();
        for (k, column) in columns.rotation.iter_mut().enumerate() {
            *column = place(&format!("rot_{k}"))?;
        }
        for (k, column) in columns.scales.iter_mut().enumerate() {
            *column = place(&format!("scale_{k}"))?;
        }
        let count = names.iter().filter(|name| name.starts_with("f_rest_")).count();
        if ![0, 9, 24, 45].contains(&count) {
            return Err(format!(
                "the splats have {count} spherical harmonics f_rest, expected 0, 9, 24 or 45"
            ));
        }
        columns.harmonics =
            (0..count).map(|k| place(&format!("f_rest_{k}"))).collect::<Result<_, _>>()?;
        Ok(columns)
    }
}

impl SplatMotion {
    pub fn new(columns: SplatColumns, transform: &Transform) -> SplatMotion {
        let degrees = match columns.harmonics.len() / 3 {
            0 => 0,
            3 => 1,
            8 => 2,
            _ => 3,
        };
        SplatMotion {
            quaternion: from_rotation(&transform.rotation),
            log_scale: transform.scale.ln(),
            degrees: (1..=degrees).map(|degree| degree_matrix(degree, transform)).collect(),
            columns,
        }
    }

    /// Moves the numbers of a splat beside its centre; `values` has those of all columns. Returns
    /// the columns that change.
    pub fn apply(&self, values: &[f64]) -> Vec<(usize, f64)> {
        let SplatColumns { rotation, scales, harmonics } = &self.columns;
        let own = rotation.map(|column| values[column]);
        let mut moved: Vec<(usize, f64)> =
            rotation.iter().copied().zip(multiply(self.quaternion, own)).collect();
        moved.extend(scales.iter().map(|&column| (column, values[column] + self.log_scale)));
        for color in harmonics.chunks((harmonics.len() / 3).max(1)) {
            let mut first = 0;
            for matrix in &self.degrees {
                let columns = &color[first..first + matrix.len()];
                for (row, &column) in matrix.iter().zip(columns) {
                    let sum =
                        row.iter().zip(columns).map(|(weight, &other)| weight * values[other]);
                    moved.push((column, sum.sum()));
                }
                first += matrix.len();
            }
        }
        moved
    }
}

/// Returns the real spherical harmonics of a degree at a unit direction, in the order and with the
/// signs of the splats.
fn harmonics(degree: usize, [x, y, z]: Vec3) -> Vec<f64> {
    let (xx, yy, zz) = (x * x, y * y, z * z);
    match degree {
        1 => vec![-y, z, -x].into_iter().map(|value| 0.4886025119029199 * value).collect(),
        2 => vec![
            1.0925484305920792 * x * y,
            -1.0925484305920792 * y * z,
            0.31539156525252005 * (2.0 * zz - xx - yy),
            -1.0925484305920792 * x * z,
            0.5462742152960396 * (xx - yy),
        ],
        _ => vec![
            -0.5900435899266435 * y * (3.0 * xx - yy),
            2.890611442640554 * x * y * z,
            -0.4570457994644658 * y * (4.0 * zz - xx - yy),
            0.3731763325901154 * z * (2.0 * zz - 3.0 * xx - 3.0 * yy),
            -0.4570457994644658 * x * (4.0 * zz - xx - yy),
            1.445305721320277 * z * (xx - yy),
            -0.5900435899266435 * x * (xx - 3.0 * yy),
        ],
    }
}

/// Directions that determine seven coefficients and more: evenly spread (a spiral).
fn directions() -> Vec<Vec3> {
    const COUNT: usize = 24;
    let direction = |k: usize| {
        let z = 1.0 - (2.0 * k as f64 + 1.0) / COUNT as f64;
        let (sin, cos) = (k as f64 * 2.399963229728653).sin_cos();
        let level = (1.0 - z * z).sqrt();
        [level * cos, level * sin, z]
    };
    (0..COUNT).map(direction).collect()
}

/// Returns the matrix that turns the coefficients of a degree: the least-squares solution of
/// A c' = B c over directions, which is exact.
fn degree_matrix(degree: usize, transform: &Transform) -> Vec<Vec<f64>> {
    let back = math::transpose(&transform.rotation);
    let directions = directions();
    let a: Vec<Vec<f64>> = directions.iter().map(|&d| harmonics(degree, d)).collect();
    let b: Vec<Vec<f64>> =
        directions.iter().map(|&d| harmonics(degree, math::mat_vec(&back, d))).collect();
    let size = 2 * degree + 1;
    let product = |left: &[Vec<f64>], right: &[Vec<f64>]| -> Vec<Vec<f64>> {
        let entry = |i: usize, j: usize| left.iter().zip(right).map(|(l, r)| l[i] * r[j]).sum();
        (0..size).map(|i| (0..size).map(|j| entry(i, j)).collect()).collect()
    };
    solve(product(&a, &a), product(&a, &b))
}

/// Solves `left` X = `right` for a positive definite `left` (Gauss without pivots).
fn solve(mut left: Vec<Vec<f64>>, mut right: Vec<Vec<f64>>) -> Vec<Vec<f64>> {
    let size = left.len();
    for k in 0..size {
        let pivot = left[k][k];
        left[k].iter_mut().chain(right[k].iter_mut()).for_each(|x| *x /= pivot);
        for i in (0..size).filter(|&i| i != k) {
            let factor = left[i][k];
            for j in 0..size {
                left[i][j] -= factor * left[k][j];
                right[i][j] -= factor * right[k][j];
            }
        }
    }
    right
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_look_turns_with_the_splat() {
        let turn = Transform::from_rotation_vector([0.4, -1.2, 2.0]);
        let names: Vec<String> = (0..4)
            .map(|k| format!("rot_{k}"))
            .chain((0..3).map(|k| format!("scale_{k}")))
            .chain((0..45).map(|k| format!("f_rest_{k}")))
            .collect();
        let names: Vec<&str> = names.iter().map(String::as_str).collect();
        let motion = SplatMotion::new(SplatColumns::find(&names).unwrap(), &turn);
        let values: Vec<f64> = (0..52).map(|k| ((k * 37 + 11) % 29) as f64 / 7.0 - 2.0).collect();
        let mut moved = values.clone();
        motion.apply(&values).iter().for_each(|&(column, value)| moved[column] = value);
        // The colour seen along a direction is that seen before along the direction turned back.
        let color = |values: &[f64], channel: usize, d: Vec3| -> f64 {
            let all = (1..=3).flat_map(|degree| harmonics(degree, d));
            all.zip(&values[7 + 15 * channel..]).map(|(y, c)| y * c).sum()
        };
        for d in [[1.0, 0.0, 0.0], [0.6, 0.0, -0.8], [0.36, 0.48, 0.8]] {
            for channel in 0..3 {
                let before = color(&values, channel, turn.inverse().rotate(d));
                let after = color(&moved, channel, d);
                assert!((before - after).abs() < 1e-12, "{before} {after}");
            }
        }
        let scaled = SplatMotion::new(motion.columns.clone(), &Transform { scale: 2.0, ..turn });
        let log = scaled.apply(&values).iter().find(|(column, _)| *column == 4).unwrap().1;
        assert!((log - values[4] - 2f64.ln()).abs() < 1e-15);
        assert!(SplatColumns::find(&names[..30]).is_err());
    }
}
