//! 3-vectors and 3×3 matrices (rows of columns) in f64; sums and products of vectors in f32, too.

use num_traits::Float;

/// A 3-vector.
pub type Vec3 = [f64; 3];
/// A 3×3 matrix as three rows.
pub type Mat3 = [[f64; 3]; 3];

/// The 3×3 identity.
pub const IDENTITY: Mat3 = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];

// Always inlined: vector code that calls one of these becomes scalar if the call is not inlined,
// and another division of the crate into codegen units is enough to prevent inlining.

/// Returns `a + b`.
#[inline(always)]
pub fn add<T: Float>(a: [T; 3], b: [T; 3]) -> [T; 3] {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}

/// Returns `a − b`.
#[inline(always)]
pub fn sub<T: Float>(a: [T; 3], b: [T; 3]) -> [T; 3] {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

/// Returns `s a`.
#[inline(always)]
pub fn scaled<T: Float>(a: [T; 3], s: T) -> [T; 3] {
    [a[0] * s, a[1] * s, a[2] * s]
}

/// Returns `a · b`.
#[inline(always)]
pub fn dot<T: Float>(a: [T; 3], b: [T; 3]) -> T {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// Returns `a × b`.
#[inline(always)]
pub fn cross<T: Float>(a: [T; 3], b: [T; 3]) -> [T; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// Returns the Euclidean length.
#[inline(always)]
pub fn norm<T: Float>(a: [T; 3]) -> T {
    dot(a, a).sqrt()
}

/// Returns `a / ‖a‖`, or the zero vector when `a` is zero.
pub fn normalized(a: Vec3) -> Vec3 {
    let length = norm(a);
    if length > 0.0 { scaled(a, 1.0 / length) } else { [0.0; 3] }
}

/// Returns `a bᵀ`.
pub fn outer(a: Vec3, b: Vec3) -> Mat3 {
    a.map(|x| scaled(b, x))
}

/// Returns `M v`.
pub fn mat_vec(m: &Mat3, v: Vec3) -> Vec3 {
    m.map(|row| dot(row, v))
}

/// Returns `Mᵀ`.
pub fn transpose(m: &Mat3) -> Mat3 {
    [0, 1, 2].map(|i| [m[0][i], m[1][i], m[2][i]])
}

/// Returns `A B`.
pub fn mat_mul(a: &Mat3, b: &Mat3) -> Mat3 {
    let columns = transpose(b);
    a.map(|row| columns.map(|column| dot(row, column)))
}

/// Returns `A − B`.
pub fn mat_sub(a: &Mat3, b: &Mat3) -> Mat3 {
    [0, 1, 2].map(|i| sub(a[i], b[i]))
}

/// Returns the sum of the diagonal.
pub fn trace(m: &Mat3) -> f64 {
    m[0][0] + m[1][1] + m[2][2]
}

/// Returns the determinant.
pub fn determinant(m: &Mat3) -> f64 {
    dot(m[0], cross(m[1], m[2]))
}

/// Returns the Frobenius norm `‖M‖_F`.
pub fn frobenius(m: &Mat3) -> f64 {
    m.iter().map(|&row| dot(row, row)).sum::<f64>().sqrt()
}
