//! Second-order weights: connections count as far as connections that are compatible with them do.
//!
//! Two connections (pᵢ, qᵢ) and (pⱼ, qⱼ) are compatible, C_ij = 1, if their source points are as
//! far apart as their target points (Leordeanu and Hebert, ICCV 2005): every rigid motion keeps
//! lengths. Many wrong connections are compatible with a right one by chance, but few are also
//! compatible with the same others. The second order C ∘ C² counts these others (SC²-PCR, Chen et
//! al., CVPR 2022). The weights of the connections are the squares of its leading eigenvector: of
//! all unit vectors v the one for which vᵀ (C ∘ C²) v is largest.

use pulp::{Simd, WithSimd};
use serde::{Deserialize, Serialize};

use crate::error::{Error, Result};
use crate::math::{self, Vec3};
use crate::par;

/// Compatibility of connections, and the weights that follow from it.
///
/// The defaults are chosen by hand. Lengths are in units of the resolution of the clouds, the `unit` of
/// [`second_order_weights`](Self::second_order_weights).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Compatibility {
    /// Largest difference between the two lengths of compatible connections, above 0 and at most
    /// 1000, in units; default 1.5: either end may be off by a part of the resolution.
    pub length_tolerance: f64,
    /// Length below which two connections are not compatible, 0 to 1000, in units; default 2. Points
    /// that are close to each other keep their distance under nearly every pose.
    pub min_length: f64,
    /// Largest difference between the cosines of the angles of their two normals, above 0 and at
    /// most 2; default 0.5. 2 compares no normals.
    pub normal_tolerance: f64,
}

impl Default for Compatibility {
    fn default() -> Self {
        Compatibility { length_tolerance: 1.5, min_length: 2.0, normal_tolerance: 0.5 }
    }
}

/// One end of the connections: a position and a normal for each connection.
#[derive(Debug, Clone, Copy)]
pub struct ConnectionEnds<'a> {
    /// Positions of the points, about any origin.
    pub points: &'a [[f32; 3]],
    /// Unit normals of the points; `None`: normals are not compared.
    pub normals: Option<&'a [[f32; 3]]>,
}

/// Weights of the second order.
#[derive(Debug, Clone, PartialEq)]
pub struct SecondOrderWeights {
    /// Weight of each connection, 0 to 1; the largest is 1.
    pub weights: Vec<f64>,
    /// The two largest eigenvalues of the second-order compatibility; the second is 0 if there is
    /// none above 0.
    pub eigenvalues: [f64; 2],
    /// Number of multiplications until the first eigenvector stood still.
    pub iterations: u32,
}

/// Most connections that can be compared: their compatibility takes the square of them in bits, and
/// its second order up to eight bytes a pair, 800 MB.
pub const MAX_CONNECTIONS: usize = 10_000;
/// Largest change of an entry of the eigenvector, of length 1, at which the multiplication ends.
/// Chosen by hand: weights are squares of entries, their rounding is smaller than that of f32.
const TOLERANCE: f64 = 1e-7;
/// Most multiplications. Two equal eigenvalues, two poses with the same support, never settle; the
/// weights are then those of a mixture. Chosen by hand.
const MAX_ITERATIONS: u32 = 200;

impl Compatibility {
    /// Checks the ranges.
    ///
    /// # Errors
    /// [`Error::Config`] that names the setting.
    pub fn validate(&self) -> Result<()> {
        let Compatibility { length_tolerance, min_length, normal_tolerance } = *self;
        if !(length_tolerance > 0.0 && length_tolerance <= 1000.0) {
            let rule = "must be above 0 and at most 1000";
            return Err(Error::config("length_tolerance", length_tolerance, rule));
        }
        if !(0.0..=1000.0).contains(&min_length) {
            return Err(Error::config("min_length", min_length, "must be between 0 and 1000"));
        }
        if !(normal_tolerance > 0.0 && normal_tolerance <= 2.0) {
            let rule = "must be above 0 and at most 2";
            return Err(Error::config("normal_tolerance", normal_tolerance, rule));
        }
        Ok(())
    }

    /// Computes the weights of the connections from `source` to `target`, the k-th of either side
    /// being connection k; `unit` is the resolution of the clouds, in their unit.
    ///
    /// With K connections of which E pairs are compatible: K² comparisons, E K / 64 counts of words,
    /// 2 E multiplications an iteration; K² / 8 + 16 E bytes. The bits of the result do not depend
    /// on the number of threads.
    ///
    /// ```
    /// use cfreg::weight::{Compatibility, ConnectionEnds};
    /// // Five connections under one motion, and one of another.
    /// let source = [[0.0, 0.0, 0.0], [9.0, 0.0, 0.0], [0.0, 8.0, 0.0], [0.0, 0.0, 7.0], [5.0; 3], [9.0; 3]];
    /// let mut target = source.map(|[x, y, z]| [-y, x, z]);
    /// target[5] = [40.0, 0.0, 0.0];
    /// let [source, target] =
    ///     [&source, &target].map(|points| ConnectionEnds { points, normals: None });
    /// let found = Compatibility::default().second_order_weights(source, target, 1.0)?;
    /// assert!(found.weights[..5].iter().all(|&weight| weight > 0.3) && found.weights[5] == 0.0);
    /// # Ok::<(), cfreg::Error>(())
    /// ```
    ///
    /// # Errors
    /// [`Error::Shape`] unless both ends have as many points, and normals if any;
    /// [`Error::Config`] for settings, a unit or a number of connections out of range;
    /// [`Error::NoWeight`] if no three connections are compatible with each other.
    pub fn second_order_weights(
        &self,
        source: ConnectionEnds<'_>,
        target: ConnectionEnds<'_>,
        unit: f64,
    ) -> Result<SecondOrderWeights> {
        self.validate()?;
        check_ends(source, target)?;
        if !(unit > 0.0 && unit.is_finite()) {
            return Err(Error::config("unit", unit, "must be above 0 and finite"));
        }
        let first = CompatibilityBits::new(self, [source, target], unit);
        let second = SecondOrder::new(&first);
        let start: Vec<f64> = second.rows.iter().map(|row| row.sum()).collect();
        let Some(leading) = leading_eigenvector(&second, start, None) else {
            return Err(Error::NO_WEIGHT);
        };
        // Where the first eigenvector is small, so that the second starts nearly orthogonal to it; and
        // a little everywhere, in no order: two poses of equal support share the first eigenvector.
        let most = leading.vector.iter().fold(0.0, |most: f64, &x| most.max(x));
        let rest = second.rows.iter().zip(&leading.vector);
        let spread = |k: usize| 0.1 * ((0.618_034 * k as f64).fract() - 0.5);
        let rest = rest.enumerate();
        let rest = rest.map(|(k, (row, &x))| row.sum() * (1.0 - x / most + spread(k))).collect();
        let next = leading_eigenvector(&second, rest, Some(&leading.vector));
        let squared = leading.vector.iter().map(|&x| (x / most).powi(2)).collect();
        Ok(SecondOrderWeights {
            weights: squared,
            eigenvalues: [leading.value, next.map_or(0.0, |next| next.value.max(0.0))],
            iterations: leading.iterations,
        })
    }
}

fn check_ends(source: ConnectionEnds<'_>, target: ConnectionEnds<'_>) -> Result<()> {
    let expected = source.points.len();
    let sizes =
        [Some(target.points.len()), source.normals.map(<[_]>::len), target.normals.map(<[_]>::len)];
    if let Some(found) = sizes.into_iter().flatten().find(|&found| found != expected) {
        return Err(Error::Shape { what: "ends of connections".into(), expected, found });
    }
    if expected > MAX_CONNECTIONS {
        let rule = format!("at most {MAX_CONNECTIONS} can be compared");
        return Err(Error::config("connections", expected, rule));
    }
    Ok(())
}

/// C as rows of bits.
struct CompatibilityBits {
    len: usize,
    words: usize,
    bits: Vec<u64>,
}

/// Positions and normals of one end, one array a coordinate.
struct Columns {
    points: [Vec<f32>; 3],
    normals: Option<[Vec<f32>; 3]>,
}

impl Columns {
    fn new(ends: ConnectionEnds<'_>) -> Columns {
        let n = ends.points.len().max(1) as f64;
        let sum =
            ends.points.iter().fold([0.0; 3], |sum: Vec3, p| math::add(sum, p.map(f64::from)));
        // Lengths of points far from the origin would lose digits.
        let center = math::scaled(sum, 1.0 / n);
        let axis = |of: &[[f32; 3]], a: usize, shift: f64| -> Vec<f32> {
            of.iter().map(|p| (f64::from(p[a]) - shift) as f32).collect()
        };
        Columns {
            points: [0, 1, 2].map(|a| axis(ends.points, a, center[a])),
            normals: ends.normals.map(|normals| [0, 1, 2].map(|a| axis(normals, a, 0.0))),
        }
    }

    /// Writes the distances of all points from point `i`.
    #[inline(always)]
    fn distances(&self, i: usize, lengths: &mut [f32]) {
        let [x, y, z] = &self.points;
        let at = [x[i], y[i], z[i]];
        for (((length, x), y), z) in lengths.iter_mut().zip(x).zip(y).zip(z) {
            let [x, y, z] = [x - at[0], y - at[1], z - at[2]];
            *length = (x * x + y * y + z * z).sqrt();
        }
    }

    /// Writes the cosines of the angles of all normals with normal `i`.
    #[inline(always)]
    fn cosines(normals: &[Vec<f32>; 3], i: usize, cosines: &mut [f32]) {
        let [x, y, z] = normals;
        let at = [x[i], y[i], z[i]];
        for (((cosine, x), y), z) in cosines.iter_mut().zip(x).zip(y).zip(z) {
            *cosine = x * at[0] + y * at[1] + z * at[2];
        }
    }
}

impl CompatibilityBits {
    fn new(rule: &Compatibility, ends: [ConnectionEnds<'_>; 2], unit: f64) -> Self {
        let len = ends[0].points.len();
        let words = len.div_ceil(64).max(1);
        let columns = ends.map(Columns::new);
        let normal_tolerance =
            if rule.normal_tolerance >= 2.0 { f32::INFINITY } else { rule.normal_tolerance as f32 };
        let [tolerance, min_length] =
            [rule.length_tolerance, rule.min_length].map(|length| (length * unit) as f32);
        let mut bits = vec![0; len * words];
        let scratch = || [(); 4].map(|()| vec![0.0f32; len]);
        par::for_each_row(&mut bits, words, scratch, |scratch: &mut [Vec<f32>; 4], i, row| {
            pulp::Arch::new().dispatch(FillRow {
                columns: &columns,
                limits: [tolerance, min_length, normal_tolerance],
                i,
                scratch,
                row,
            });
        });
        CompatibilityBits { len, words, bits }
    }

    fn row(&self, i: usize) -> &[u64] {
        &self.bits[i * self.words..(i + 1) * self.words]
    }
}

/// Fills the row of one connection: compiled once per instruction set.
struct FillRow<'a> {
    columns: &'a [Columns; 2],
    /// Largest difference of lengths, smallest length, largest difference of cosines.
    limits: [f32; 3],
    i: usize,
    scratch: &'a mut [Vec<f32>; 4],
    row: &'a mut [u64],
}

impl WithSimd for FillRow<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let FillRow { columns: [source, target], limits, i, scratch, row } = self;
        let [tolerance, min_length, normal_tolerance] = limits;
        let [a, b, m, n] = scratch;
        source.distances(i, a);
        target.distances(i, b);
        let normals = match (&source.normals, &target.normals) {
            (Some(from), Some(onto)) if normal_tolerance.is_finite() => Some((from, onto)),
            _ => None,
        };
        if let Some((from, onto)) = normals {
            Columns::cosines(from, i, m);
            Columns::cosines(onto, i, n);
            m.iter_mut().zip(&*n).for_each(|(m, n)| *m = (*m - n).abs());
        } else {
            m.fill(0.0);
        }
        for ((word, (a, b)), m) in
            row.iter_mut().zip(a.chunks(64).zip(b.chunks(64))).zip(m.chunks(64))
        {
            *word = 0;
            for (k, ((a, b), m)) in a.iter().zip(b).zip(m).enumerate() {
                let is = (a - b).abs() <= tolerance
                    && *a >= min_length
                    && *b >= min_length
                    && *m <= normal_tolerance;
                *word |= u64::from(is) << k;
            }
        }
        row[i / 64] &= !(1 << (i % 64));
    }
}

/// C ∘ C², row by row.
struct SecondOrder {
    rows: Vec<SecondOrderRow>,
}

/// The entries of a row above 0: columns, ascending, and numbers of common neighbours.
struct SecondOrderRow {
    columns: Vec<u32>,
    counts: Vec<f32>,
}

impl SecondOrderRow {
    fn sum(&self) -> f64 {
        self.counts.iter().map(|&count| f64::from(count)).sum()
    }
}

impl SecondOrder {
    fn new(first: &CompatibilityBits) -> SecondOrder {
        let row = |i: usize| {
            let (mut columns, mut counts) = (Vec::new(), Vec::new());
            pulp::Arch::new().dispatch(CountRow {
                first,
                i,
                columns: &mut columns,
                counts: &mut counts,
            });
            SecondOrderRow { columns, counts }
        };
        SecondOrder { rows: par::map(first.len, || (), |(), i| row(i)) }
    }

    /// Multiplies by a vector, and leaves `without`, an eigenvector of length 1, out of the result.
    fn multiply(&self, x: &[f64], without: Option<&[f64]>) -> Vec<f64> {
        let product = |i: usize| {
            let SecondOrderRow { columns, counts } = &self.rows[i];
            let terms = columns.iter().zip(counts);
            terms.map(|(&j, &count)| f64::from(count) * x[j as usize]).sum::<f64>()
        };
        let mut found = par::map_blocks(
            self.rows.len(),
            64,
            || (),
            |(), block| block.map(product).collect::<Vec<f64>>(),
        )
        .concat();
        if let Some(without) = without {
            let along = dot(&found, without);
            found.iter_mut().zip(without).for_each(|(x, v)| *x -= along * v);
        }
        found
    }
}

/// Counts the common neighbours of a connection and each of its neighbours: compiled once per
/// instruction set, of which most have an instruction that counts bits.
struct CountRow<'a> {
    first: &'a CompatibilityBits,
    i: usize,
    columns: &'a mut Vec<u32>,
    counts: &'a mut Vec<f32>,
}

impl WithSimd for CountRow<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let own = self.first.row(self.i);
        for (at, &word) in own.iter().enumerate() {
            let mut rest = word;
            while rest != 0 {
                let j = 64 * at + rest.trailing_zeros() as usize;
                rest &= rest - 1;
                let pairs = own.iter().zip(self.first.row(j));
                let common: u32 = pairs.map(|(a, b)| (a & b).count_ones()).sum();
                if common > 0 {
                    self.columns.push(j as u32);
                    self.counts.push(common as f32);
                }
            }
        }
    }
}

struct Eigenpair {
    value: f64,
    vector: Vec<f64>,
    iterations: u32,
}

/// Returns the leading eigenvector, or that among the vectors orthogonal to `without`, by the power
/// method; `None` if there is nothing but zeros.
fn leading_eigenvector(
    matrix: &SecondOrder,
    start: Vec<f64>,
    without: Option<&[f64]>,
) -> Option<Eigenpair> {
    let mut vector = start;
    if let Some(without) = without {
        let along = dot(&vector, without);
        vector.iter_mut().zip(without).for_each(|(x, v)| *x -= along * v);
    }
    normalize(&mut vector)?;
    let (mut value, mut iterations) = (0.0, 0);
    while iterations < MAX_ITERATIONS {
        let mut next = matrix.multiply(&vector, without);
        value = dot(&next, &vector);
        iterations += 1;
        normalize(&mut next)?;
        let change =
            next.iter().zip(&vector).fold(0.0, |most: f64, (a, b)| most.max((a - b).abs()));
        vector = next;
        if change < TOLERANCE {
            break;
        }
    }
    Some(Eigenpair { value, vector, iterations })
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// Scales a vector to length 1; `None` for one without length.
fn normalize(vector: &mut [f64]) -> Option<()> {
    let length = dot(vector, vector).sqrt();
    if length.is_nan() || length <= 0.0 {
        return None;
    }
    vector.iter_mut().for_each(|x| *x /= length);
    Some(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    /// Returns ends of `right` connections under a quarter turn, and of `wrong` ones.
    fn ends(right: usize, wrong: usize) -> [Vec<[f32; 3]>; 2] {
        let mut rng = ChaCha8Rng::seed_from_u64(3);
        let mut place = || [(); 3].map(|()| 100.0 * rng.random::<f32>());
        let source: Vec<[f32; 3]> = (0..right + wrong).map(|_| place()).collect();
        let target = source.iter().enumerate().map(|(k, &[x, y, z])| match k < right {
            true => [-y, x, z],
            false => place(),
        });
        let target = target.collect();
        [source, target]
    }

    fn rule() -> Compatibility {
        Compatibility { normal_tolerance: 2.0, ..Compatibility::default() }
    }

    fn weigh(rule: Compatibility, [source, target]: &[Vec<[f32; 3]>; 2]) -> SecondOrderWeights {
        let end = |points| ConnectionEnds { points, normals: None };
        rule.second_order_weights(end(source), end(target), 1.0).unwrap()
    }

    /// The definition, entry by entry.
    fn second_order(rule: Compatibility, [source, target]: &[Vec<[f32; 3]>; 2]) -> Vec<Vec<f64>> {
        let n = source.len();
        let length = |of: &[[f32; 3]], i: usize, j: usize| math::norm(math::sub(of[i], of[j]));
        let first = |i: usize, j: usize| {
            let (a, b) = (length(source, i, j), length(target, i, j));
            let kept = f64::from((a - b).abs()) <= rule.length_tolerance;
            i != j && kept && f64::from(a.min(b)) >= rule.min_length
        };
        let common = |i, j| (0..n).filter(|&k| first(i, k) && first(k, j)).count() as f64;
        let entry = |i, j| if first(i, j) { common(i, j) } else { 0.0 };
        (0..n).map(|i| (0..n).map(|j| entry(i, j)).collect()).collect()
    }

    #[test]
    fn weights_are_the_squared_leading_eigenvector() {
        let ends = ends(25, 105);
        let found = weigh(rule(), &ends);
        let matrix = second_order(rule(), &ends);
        let vector: Vec<f64> = found.weights.iter().map(|w| w.sqrt()).collect();
        let length = dot(&vector, &vector).sqrt();
        for (i, row) in matrix.iter().enumerate() {
            let product = dot(row, &vector);
            let want = found.eigenvalues[0] * vector[i];
            assert!((product - want).abs() < 1e-4 * found.eigenvalues[0] * length, "{i}");
        }
        // The trace of M² bounds the sum of squared eigenvalues.
        let squares: f64 = matrix.iter().flatten().map(|x| x * x).sum();
        let [first, second] = found.eigenvalues;
        assert!(second >= 0.0 && second < first);
        assert!(first * first + second * second <= (1.0 + 1e-9) * squares);
        // Right connections carry the weight.
        let right: f64 = found.weights[..25].iter().sum();
        assert!(right > 0.99 * found.weights.iter().sum::<f64>());
    }

    #[test]
    fn two_poses_with_equal_support_have_equal_eigenvalues() {
        let [source, target] = ends(30, 0);
        // The same points once more, under another motion, far away in the target.
        let again = source.iter().map(|&[x, y, z]| [x + 1000.0, -z, y]);
        let target: Vec<[f32; 3]> = target.into_iter().chain(again).collect();
        let both = [[source.clone(), source].concat(), target];
        let [first, second] = weigh(rule(), &both).eigenvalues;
        assert!(second > 0.95 * first, "{second} {first}");
    }

    #[test]
    fn normals_that_turn_apart_are_not_compatible() {
        let [source, target] = ends(40, 0);
        let turned = |[x, y, z]: [f32; 3]| [-y, x, z];
        let normal = |k: usize| if k.is_multiple_of(2) { [1.0, 0.0, 0.0] } else { [0.0, 0.6, 0.8] };
        let own: Vec<[f32; 3]> = (0..40).map(normal).collect();
        let mut other: Vec<[f32; 3]> = own.iter().copied().map(turned).collect();
        other[7] = [0.0, -0.8, -0.6];
        let [source, target] = [(&source, &own), (&target, &other)]
            .map(|(points, normals)| ConnectionEnds { points, normals: Some(normals) });
        let found = Compatibility::default().second_order_weights(source, target, 1.0).unwrap();
        assert_eq!(found.weights[7], 0.0);
        assert!((0..40).filter(|&k| k != 7).all(|k| found.weights[k] > 0.1));
        let all = rule().second_order_weights(source, target, 1.0).unwrap();
        assert!(all.weights[7] > 0.1);
    }

    #[test]
    fn threads_and_units_change_nothing() {
        let ends = ends(60, 300);
        let found = weigh(rule(), &ends);
        for threads in [1, 3] {
            assert_eq!(par::with_threads(threads, || weigh(rule(), &ends)).unwrap(), found);
        }
        let scaled = ends.map(|end| end.into_iter().map(|p| p.map(|x| 1024.0 * x)).collect());
        let [source, target]: &[Vec<[f32; 3]>; 2] = &scaled;
        let end = |points| ConnectionEnds { points, normals: None };
        let other = rule().second_order_weights(end(source), end(target), 1024.0).unwrap();
        assert_eq!(other, found);
    }

    #[test]
    fn odd_input_is_refused() {
        let points = [[0.0; 3], [5.0, 0.0, 0.0]];
        let end = |points, normals| ConnectionEnds { points, normals };
        let run = |rule: Compatibility, unit| {
            rule.second_order_weights(end(&points, None), end(&points, None), unit)
        };
        // Two connections have no third one in common.
        assert!(matches!(run(rule(), 1.0), Err(Error::NoWeight { .. })));
        for unit in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            assert!(matches!(run(rule(), unit), Err(Error::Config { field: "unit", .. })));
        }
        let one = rule().second_order_weights(end(&points, None), end(&points[..1], None), 1.0);
        assert!(matches!(one, Err(Error::Shape { .. })));
        let few = end(&points, Some(&points[..1]));
        let one = rule().second_order_weights(few, few, 1.0);
        assert!(matches!(one, Err(Error::Shape { .. })));
        let none = rule().second_order_weights(end(&[], None), end(&[], None), 1.0);
        assert!(matches!(none, Err(Error::NoWeight { .. })));
        for bad in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            let field = |rule: Compatibility| match run(rule, 1.0) {
                Err(Error::Config { field, .. }) => field,
                other => panic!("{other:?}"),
            };
            assert_eq!(
                field(Compatibility { length_tolerance: bad, ..rule() }),
                "length_tolerance"
            );
            assert_eq!(
                field(Compatibility { normal_tolerance: bad, ..rule() }),
                "normal_tolerance"
            );
            if bad != 0.0 {
                assert_eq!(field(Compatibility { min_length: bad, ..rule() }), "min_length");
            }
        }
        // Many connections at the same places: compatible with none.
        let many = vec![[1.0f32; 3]; 100];
        let same = rule().second_order_weights(end(&many, None), end(&many, None), 1.0);
        assert!(matches!(same, Err(Error::NoWeight { .. })));
    }
}
