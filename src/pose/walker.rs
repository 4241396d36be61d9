//! Walker, Shao and Volz 1991: "Estimating 3-D location parameters using dual number
//! quaternions".

use super::{largest_eigenvector, quaternion_matrix};
use crate::error::Result;
use crate::math::{self, Mat3, Vec3};
use crate::moments::Moments;

type Mat4 = [[f64; 4]; 4];

/// Solves for rotation and translation together. With quaternions written (vector, scalar), and
/// Q(r) and W(r) the matrices of the products from the left and from the right:
///
/// C₁ = −2 Σw Q(q)ᵀ W(p), C₂ = Σw I, C₃ = 2 Σw (W(p) − Q(q)); r is the eigenvector of the
/// largest eigenvalue of A = ½ (C₃ᵀ (C₂ + C₂ᵀ)⁻¹ C₃ − C₁ − C₁ᵀ), s = −(C₂ + C₂ᵀ)⁻¹ C₃ r,
/// and t = W(r)ᵀ s.
pub(super) fn solve_pose(moments: &Moments) -> Result<(Mat3, Vec3)> {
    // Means instead of sums, and lengths relative to the clouds' spread, so that no entry depends
    // on the unit: Σw = 1.
    let spread = ((moments.source_squares + moments.target_squares) / moments.weight).sqrt();
    let mean = |sum: Vec3| math::scaled(sum, 1.0 / (moments.weight * spread));
    let (p, q) = (mean(moments.source_sum), mean(moments.target_sum));
    let cross =
        moments.cross.map(|row| math::scaled(row, 1.0 / (moments.weight * spread * spread)));

    let mut c1 = [[0.0; 4]; 4];
    for a in 0..3 {
        for b in 0..3 {
            // Q and W are linear in their vectors, so the sum over pairs needs only Σw p qᵀ.
            let product =
                mul(&transpose(&left_product_matrix(axis(b))), &right_product_matrix(axis(a)));
            add_scaled(&mut c1, &product, -2.0 * cross[a][b]);
        }
    }
    let mut c3 = [[0.0; 4]; 4];
    add_scaled(&mut c3, &right_product_matrix(p), 2.0);
    add_scaled(&mut c3, &left_product_matrix(q), -2.0);

    // C₂ + C₂ᵀ = 2 I.
    let mut a = [[0.0; 4]; 4];
    add_scaled(&mut a, &mul(&transpose(&c3), &c3), 0.25);
    add_scaled(&mut a, &c1, -0.5);
    add_scaled(&mut a, &transpose(&c1), -0.5);

    let r = largest_eigenvector(&a)?;
    let s = apply(&c3, r).map(|x| -0.5 * x);
    let [x, y, z, w] = r;
    let rotation = quaternion_matrix([w, x, y, z]);
    let [tx, ty, tz, _] = apply(&transpose(&right_quaternion_matrix(r)), s);
    // From the sums' origins to the clouds' frames.
    let about_origins = math::scaled([tx, ty, tz], spread);
    let turned = math::mat_vec(&rotation, moments.source_origin);
    Ok((rotation, math::sub(math::add(about_origins, moments.target_origin), turned)))
}

fn axis(k: usize) -> Vec3 {
    let mut axis = [0.0; 3];
    axis[k] = 1.0;
    axis
}

/// Returns Q of the quaternion (v, 0): [K(v), v; −vᵀ, 0].
fn left_product_matrix([x, y, z]: Vec3) -> Mat4 {
    [[0.0, -z, y, x], [z, 0.0, -x, y], [-y, x, 0.0, z], [-x, -y, -z, 0.0]]
}

/// Returns W of the quaternion (v, 0).
fn right_product_matrix([x, y, z]: Vec3) -> Mat4 {
    right_quaternion_matrix([x, y, z, 0.0])
}

/// Returns W of a quaternion (v, s): [s I − K(v), v; −vᵀ, s].
fn right_quaternion_matrix([x, y, z, s]: [f64; 4]) -> Mat4 {
    [[s, z, -y, x], [-z, s, x, y], [y, -x, s, z], [-x, -y, -z, s]]
}

fn transpose(m: &Mat4) -> Mat4 {
    [0, 1, 2, 3].map(|i| [0, 1, 2, 3].map(|j| m[j][i]))
}

fn mul(a: &Mat4, b: &Mat4) -> Mat4 {
    [0, 1, 2, 3].map(|i| [0, 1, 2, 3].map(|j| (0..4).map(|k| a[i][k] * b[k][j]).sum()))
}

fn apply(m: &Mat4, v: [f64; 4]) -> [f64; 4] {
    [0, 1, 2, 3].map(|i| (0..4).map(|k| m[i][k] * v[k]).sum())
}

fn add_scaled(sum: &mut Mat4, term: &Mat4, factor: f64) {
    for (row, other) in sum.iter_mut().zip(term) {
        row.iter_mut().zip(other).for_each(|(x, y)| *x += factor * y);
    }
}
