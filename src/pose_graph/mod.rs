//! Pose graphs: the input from which optimisers compute one common frame.

use std::collections::{HashMap, VecDeque};
use std::fmt::Write;
use std::path::Path;

use crate::cloud::Transform;
use crate::error::{Error, Result};
use crate::io;
use crate::math::cholesky::Mat6;
use crate::math::{self, Vec3};

/// How a reader of the graph measures the rotation error of an edge.
///
/// With both, the error is that of Z⁻¹ Xᵢ⁻¹ Xⱼ, with Z of the edge, Xᵢ of the target and Xⱼ of the
/// source: the pose is perturbed on its right, in the source's frame, and the translation comes
/// before the rotation. A reader that perturbs on the left, as the pose graph example of Ceres,
/// needs another information matrix.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Tangent {
    /// The vector part of the unit quaternion, half the rotation vector: g2o (`EdgeSE3`, whose
    /// error is `toVectorMQT` of that pose).
    #[default]
    Quaternion,
    /// The rotation vector: GTSAM (`BetweenFactor<Pose3>`), whose reader of such files reorders the
    /// matrix to rotation before translation, its own order.
    RotationVector,
}

/// Clouds, and the accepted poses between them.
///
/// Edges count as independent of each other: a pair that is listed both ways is two edges, and
/// its information counts twice. Each [part](Self::component_count) floats by itself: optimisers want one
/// vertex of each held.
///
/// ```
/// use cfreg::Transform;
/// use cfreg::pose_graph::{PoseEdge, PoseGraph, Tangent};
/// let mut graph = PoseGraph::new();
/// graph.add_edge(&PoseEdge {
///     source: "scan1.ply",
///     target: "scan0.ply",
///     pose: Transform::IDENTITY,
///     information: [0, 1, 2, 3, 4, 5].map(|i| [0, 1, 2, 3, 4, 5].map(|j| f64::from(i == j))),
///     center: [0.0; 3],
///     probability: 0.99,
/// })?;
/// assert_eq!((graph.names().len(), graph.component_count()), (2, 1));
/// assert!(graph.g2o(Tangent::Quaternion).contains("EDGE_SE3:QUAT 0 1"));
/// # Ok::<(), cfreg::Error>(())
/// ```
#[derive(Debug, Clone, PartialEq, Default)]
pub struct PoseGraph {
    names: Vec<String>,
    edges: Vec<Edge>,
    /// Vertex numbers of the clouds by their names.
    vertices: HashMap<String, usize>,
}

/// Longest translation: the range of cloud coordinates.
const MAX_LENGTH: f64 = 1e75;
/// Largest entry of an information matrix. Entries are multiplied by squared lengths, and the
/// products stay below the 1.8e308 of f64.
const MAX_INFORMATION: f64 = 1e150;

/// A verified pose between two clouds.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PoseEdge<'a> {
    /// Name of the moving cloud.
    pub source: &'a str,
    /// Name of the fixed cloud.
    pub target: &'a str,
    /// Maps source points into the target's frame; its scale is 1.
    pub pose: Transform,
    /// Information of a rotation vector about `center` and of a translation, as returned by
    /// [`PoseCovariance::information`](crate::verify::PoseCovariance::information).
    pub information: Mat6,
    /// The centre of rotation, in the target's frame.
    pub center: Vec3,
    /// The probability that the pose is correct.
    pub probability: f64,
}

/// A pose between two clouds, given by their vertex numbers.
#[derive(Debug, Clone, PartialEq)]
struct Edge {
    source: usize,
    target: usize,
    pose: Transform,
    information: Mat6,
    center: Vec3,
    probability: f64,
}

impl PoseGraph {
    /// Returns a graph without clouds.
    pub fn new() -> PoseGraph {
        PoseGraph::default()
    }

    /// The vertex of a cloud, a new one for a name that is not there.
    pub fn add_vertex(&mut self, name: &str) -> usize {
        if let Some(&vertex) = self.vertices.get(name) {
            return vertex;
        }
        self.names.push(name.into());
        self.vertices.insert(name.into(), self.names.len() - 1);
        self.names.len() - 1
    }

    /// Adds an edge between two clouds; clouds that are not in the graph become vertices.
    ///
    /// # Errors
    /// [`Error::Config`] for an edge from a cloud to itself, for a pose that is not a rotation and
    /// a translation, and for numbers whose products leave the range of f64.
    pub fn add_edge(&mut self, edge: &PoseEdge<'_>) -> Result<()> {
        let PoseEdge { source, target, pose, information, center, probability } = *edge;
        let refuse = |rule: &str| Err(Error::config("edge", format!("{source} to {target}"), rule));
        if source == target {
            return refuse("joins a cloud to itself");
        }
        if pose.scale != 1.0 || Transform::from_matrix(pose.matrix()).is_err() {
            return refuse("has a pose that is not a rotation and a shift");
        }
        let lengths = pose.translation.iter().chain(&center);
        let is_far = lengths.into_iter().any(|x| x.is_nan() || x.abs() > MAX_LENGTH);
        if is_far
            || information.as_flattened().iter().any(|x| x.is_nan() || x.abs() > MAX_INFORMATION)
        {
            return refuse(&format!(
                "has lengths above {MAX_LENGTH:e} or information above {MAX_INFORMATION:e}, which \
                 cannot be computed with: was the file changed?"
            ));
        }
        // The target first: poses are told in its frame.
        let target = self.add_vertex(target);
        let source = self.add_vertex(source);
        self.edges.push(Edge { source, target, pose, information, center, probability });
        Ok(())
    }

    /// Returns the names of the clouds, by their vertex numbers.
    pub fn names(&self) -> &[String] {
        &self.names
    }

    /// Number of accepted poses.
    pub fn edge_count(&self) -> usize {
        self.edges.len()
    }

    /// Parts of the graph that no edge connects, a cloud without one counted too.
    pub fn component_count(&self) -> usize {
        self.initial_poses().1
    }

    /// Where each cloud stands to begin with, by the most probable edges that connect all they
    /// can, and the number of parts; the first cloud of each part stands at the origin.
    fn initial_poses(&self) -> (Vec<Transform>, usize) {
        let mut order: Vec<&Edge> = self.edges.iter().collect();
        order.sort_by(|a, b| b.probability.total_cmp(&a.probability));
        let mut roots: Vec<usize> = (0..self.names.len()).collect();
        let mut ways: Vec<Vec<(usize, Transform)>> = vec![Vec::new(); self.names.len()];
        for edge in order {
            let [source, target] =
                [edge.source, edge.target].map(|cloud| find_root(&mut roots, cloud));
            if source != target {
                roots[source.max(target)] = source.min(target);
                ways[edge.target].push((edge.source, edge.pose));
                ways[edge.source].push((edge.target, edge.pose.inverse()));
            }
        }
        let mut placed: Vec<Option<Transform>> = vec![None; self.names.len()];
        let mut parts = 0;
        for first in 0..self.names.len() {
            if placed[first].is_some() {
                continue;
            }
            parts += 1;
            placed[first] = Some(Transform::IDENTITY);
            let mut next = VecDeque::from([(first, Transform::IDENTITY)]);
            while let Some((cloud, pose)) = next.pop_front() {
                for (other, way) in &ways[cloud] {
                    if placed[*other].is_none() {
                        let there = pose.after(way);
                        placed[*other] = Some(there);
                        next.push_back((*other, there));
                    }
                }
            }
        }
        (placed.into_iter().map(|pose| pose.unwrap_or(Transform::IDENTITY)).collect(), parts)
    }

    /// Returns the graph as g2o text, for readers that measure rotations by `tangent`. Each cloud
    /// is a line `VERTEX_SE3:QUAT number x y z qx qy qz qw` with its pose. Each edge is a line
    /// `EDGE_SE3:QUAT target source x y z qx qy qz qw` with the pose of the source in the frame of
    /// the target, then the upper triangle of the information matrix, row by row. Rows of that
    /// matrix are x, y, z, then the rotation about x, y, z, both in the source's frame; it is 0
    /// along unconstrained motions.
    pub fn g2o(&self, tangent: Tangent) -> String {
        let mut text = String::new();
        let mut line = |words: &[&str], numbers: &mut dyn Iterator<Item = f64>| {
            text += &words.join(" ");
            // Adding zero turns -0 into 0. Writing to a string cannot fail.
            numbers.for_each(|x| _ = write!(text, " {:?}", x + 0.0));
            text.push('\n');
        };
        for (number, pose) in self.initial_poses().0.iter().enumerate() {
            let number = number.to_string();
            line(&["VERTEX_SE3:QUAT", &number], &mut translation_and_quaternion(pose).into_iter());
        }
        for edge in &self.edges {
            let [target, source] = [edge.target, edge.source].map(|cloud| cloud.to_string());
            let information = edge.information_in(tangent);
            let triangle = (0..6).flat_map(|i| information[i][i..].to_vec());
            let mut numbers = translation_and_quaternion(&edge.pose).into_iter().chain(triangle);
            line(&["EDGE_SE3:QUAT", &target, &source], &mut numbers);
        }
        text
    }

    /// Writes [`g2o`](Self::g2o) to a file; an existing file is replaced.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn write(&self, path: &Path, tangent: Tangent) -> Result<()> {
        io::write_bytes(path, self.g2o(tangent).as_bytes())
    }
}

impl Edge {
    /// Returns the information of (t, r) with the true pose T·(t, r): a translation and a rotation
    /// in the source's frame, parameterised by `tangent`. The information of the edge is that of
    /// (ω, τ) with the true pose p ↦ exp(ω)(T p − c) + c + τ. The rotation vector in the source's
    /// frame is h r, with h = 2 for the vector part of a quaternion, else 1. To first order, with T
    /// = (R, s),
    ///
    /// ω = h R r, τ = R t + (s − c) × h R r,
    ///
    /// as T·(t, r) moves the point c by τ: T maps R⁻¹(c − s) to c, and a rotation by ω about s also
    /// moves c by ω × (c − s). So (ω, τ) = B (t, r), and the information is Bᵀ I B.
    fn information_in(&self, tangent: Tangent) -> Mat6 {
        let half = match tangent {
            Tangent::Quaternion => 2.0,
            Tangent::RotationVector => 1.0,
        };
        let arm = math::sub(self.pose.translation, self.center);
        let mut b = [[0.0; 6]; 6];
        for axis in 0..3 {
            let column = std::array::from_fn(|i| self.pose.rotation[i][axis]);
            let turn = math::scaled(column, half);
            let swing = math::cross(arm, turn);
            for i in 0..3 {
                b[3 + i][axis] = column[i];
                b[i][3 + axis] = turn[i];
                b[3 + i][3 + axis] = swing[i];
            }
        }
        let of = |i: usize, j: usize| -> f64 {
            let row = |k: usize| (0..6).map(|l| self.information[k][l] * b[l][j]).sum::<f64>();
            (0..6).map(|k| b[k][i] * row(k)).sum()
        };
        std::array::from_fn(|i| std::array::from_fn(|j| 0.5 * (of(i, j) + of(j, i))))
    }
}

/// Shift and unit quaternion (x, y, z, w).
fn translation_and_quaternion(pose: &Transform) -> [f64; 7] {
    let vector = pose.rotation_vector();
    let (sin, cos) = (0.5 * math::norm(vector)).sin_cos();
    let [x, y, z] = math::scaled(math::normalized(vector), sin);
    let [a, b, c] = pose.translation;
    [a, b, c, x, y, z, cos]
}

/// The first of those that are connected with it.
fn find_root(roots: &mut [usize], mut cloud: usize) -> usize {
    while roots[cloud] != cloud {
        roots[cloud] = roots[roots[cloud]];
        cloud = roots[cloud];
    }
    cloud
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    use super::*;
    use crate::math::cholesky;

    fn pose(vector: Vec3, translation: Vec3) -> Transform {
        Transform { translation, ..Transform::from_rotation_vector(vector) }
    }

    /// Returns the sum of twelve uniform numbers, an approximately normal number.
    fn normal(random: &mut ChaCha8Rng) -> f64 {
        (0..12).map(|_| random.random::<f64>()).sum::<f64>() - 6.0
    }

    #[test]
    fn the_information_is_that_of_perturbed_poses() {
        let mut random = ChaCha8Rng::seed_from_u64(3);
        let spread: [[f64; 6]; 6] = std::array::from_fn(|i| {
            std::array::from_fn(|j| {
                let size = if i < 3 { 1e-4 } else { 2e-3 };
                size * (f64::from(u8::from(i == j)) + 0.4 * (random.random::<f64>() - 0.5))
            })
        });
        let covariance: Mat6 = std::array::from_fn(|i| {
            std::array::from_fn(|j| (0..6).map(|k| spread[i][k] * spread[j][k]).sum())
        });
        let factor = cholesky::factor(&covariance).unwrap();
        let unit = |k: usize| std::array::from_fn(|i| f64::from(u8::from(i == k)));
        let information = std::array::from_fn(|k| cholesky::solve(&factor, &unit(k)));
        let (measured, center) = (pose([0.4, -1.1, 0.7], [3.0, -2.0, 5.0]), [1.0, 4.0, -2.0]);
        let edge =
            Edge { source: 1, target: 0, pose: measured, information, center, probability: 1.0 };
        for tangent in [Tangent::Quaternion, Tangent::RotationVector] {
            let told = edge.information_in(tangent);
            let factor = cholesky::factor(&told).unwrap();
            // Whitened errors, as a reader of the graph measures them.
            let mut scatter = [[0.0; 6]; 6];
            const TRIALS: usize = 20_000;
            for _ in 0..TRIALS {
                let drawn: [f64; 6] = std::array::from_fn(|_| normal(&mut random));
                let [a, b, c, x, y, z] =
                    spread.map(|row| row.iter().zip(drawn).map(|(s, d)| s * d).sum::<f64>());
                let turn = Transform::from_rotation_vector([a, b, c]);
                let shift = math::sub(math::add(center, [x, y, z]), turn.rotate(center));
                let truth = Transform { translation: shift, ..turn }.after(&measured);
                let off = measured.inverse().after(&truth);
                let [x, y, z, i, j, k, _] = translation_and_quaternion(&off);
                let rotation = match tangent {
                    Tangent::Quaternion => [i, j, k],
                    Tangent::RotationVector => off.rotation_vector(),
                };
                let error = [x, y, z, rotation[0], rotation[1], rotation[2]];
                // L of L Lᵀ, transposed.
                let white: [f64; 6] =
                    std::array::from_fn(|i| (i..6).map(|j| factor[j][i] * error[j]).sum());
                for i in 0..6 {
                    (0..6).for_each(|j| scatter[i][j] += white[i] * white[j] / TRIALS as f64);
                }
            }
            for (i, row) in scatter.iter().enumerate() {
                for (j, value) in row.iter().enumerate() {
                    let expected = f64::from(u8::from(i == j));
                    assert!((value - expected).abs() < 0.05, "{tangent:?} {i} {j}: {value}");
                }
            }
        }
    }

    /// An edge with the identity as information.
    fn edge<'a>(
        source: &'a str,
        target: &'a str,
        pose: Transform,
        probability: f64,
    ) -> PoseEdge<'a> {
        let information = std::array::from_fn(|i| std::array::from_fn(|j| f64::from(i == j)));
        PoseEdge { source, target, pose, information, center: [0.0; 3], probability }
    }

    #[test]
    fn clouds_stand_where_the_best_edges_put_them() {
        let (one, two) = (pose([0.0, 0.3, 0.0], [1.0; 3]), pose([0.5, 0.0, 0.2], [0.0, 2.0, 0.0]));
        let wrong = pose([0.0; 3], [50.0; 3]);
        let mut graph = PoseGraph::new();
        graph.add_edge(&edge("c", "a", wrong, 0.7)).unwrap();
        graph.add_edge(&edge("b", "a", one, 0.99)).unwrap();
        graph.add_edge(&edge("b", "c", two.inverse(), 0.98)).unwrap();
        assert_eq!((graph.add_vertex("d"), graph.add_vertex("a")), (3, 0));
        assert_eq!(graph.names(), ["a", "c", "b", "d"]);
        assert_eq!((graph.edge_count(), graph.component_count()), (3, 2));
        let placed = graph.initial_poses().0;
        for (found, expected) in [(placed[2], one), (placed[1], one.after(&two))] {
            let off = found.inverse().after(&expected);
            assert!(off.angle() < 1e-12 && math::norm(off.translation) < 1e-12);
        }
        let text = graph.g2o(Tangent::Quaternion);
        let lines: Vec<Vec<&str>> = text.lines().map(|line| line.split(' ').collect()).collect();
        assert_eq!(lines[0][..2], ["VERTEX_SE3:QUAT", "0"]);
        assert_eq!(lines[0][2..], ["0.0", "0.0", "0.0", "0.0", "0.0", "0.0", "1.0"]);
        assert_eq!((lines[5][0], &lines[5][1..3]), ("EDGE_SE3:QUAT", &["0", "2"][..]));
        assert!(lines.len() == 7 && lines[5].len() == 3 + 7 + 21);
        assert_eq!(lines[5][3..6], ["1.0"; 3]);
    }

    #[test]
    fn edges_that_cannot_be_computed_with_are_refused() {
        let mut graph = PoseGraph::new();
        let good = edge("b", "a", Transform::IDENTITY, 0.9);
        let scaled = Transform { scale: 2.0, ..Transform::IDENTITY };
        let mut large = good;
        large.information[2][3] = 1e308;
        let mut unknown = good;
        unknown.information[0][0] = f64::NAN;
        let far = PoseEdge { center: [0.0, -1e80, 0.0], ..good };
        for (bad, why) in [
            (edge("a", "a", Transform::IDENTITY, 0.9), "to itself"),
            (PoseEdge { pose: scaled, ..good }, "not a rotation and a shift"),
            (large, "1e150"),
            (unknown, "1e150"),
            (far, "1e75"),
        ] {
            let said = graph.add_edge(&bad).unwrap_err().to_string();
            assert!(said.starts_with("edge = ") && said.contains(why), "{said}");
        }
        assert_eq!((graph.edge_count(), graph.names().len()), (0, 0));
    }
}
