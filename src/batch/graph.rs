//! Graphs of poses: what optimisers make one frame of.

use std::collections::{HashMap, VecDeque};
use std::fmt::Write;
use std::path::Path;

use super::Row;
use super::row::symmetric;
use crate::cloud::Transform;
use crate::error::{Error, Result};
use crate::io;
use crate::math::cholesky::Mat6;
use crate::math::{self, Vec3};

/// How those who read a graph measure how far a rotation is from that of an edge.
///
/// Either way errors are those of Z⁻¹ Xᵢ⁻¹ Xⱼ, with Z of the edge, Xᵢ of the target and Xⱼ of the
/// source: the pose is perturbed on its right, in the source's frame, and the shift stands before
/// the rotation. What perturbs on the left, as the example of pose graphs of Ceres does, wants
/// another information.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Tangent {
    /// By the vector part of the unit quaternion, half the rotation vector: g2o
    /// (`EdgeSE3`, whose error is `toVectorMQT` of that pose).
    #[default]
    Quaternion,
    /// By the rotation vector: GTSAM (`BetweenFactor<Pose3>`), whose reader of such files puts the
    /// rotation before the shift, as it has them.
    RotationVector,
}

/// Clouds, and the poses between them that may be used.
///
/// Edges count as independent of each other: a pair that is listed both ways is two edges, and
/// its information counts twice. Each [part](Self::parts) floats by itself: optimisers want one
/// vertex of each held.
///
/// ```
/// use cfreg::batch::{Graph, Tangent};
/// // Of the rows of `batch::results::read`.
/// let graph = Graph::of(&[])?;
/// assert_eq!(graph.g2o(Tangent::Quaternion), "");
/// # Ok::<(), cfreg::Error>(())
/// ```
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Graph {
    names: Vec<String>,
    edges: Vec<Edge>,
    /// Rows whose pose may not be used ([`Row::is_usable`]), or that have none.
    pub not_accepted: usize,
    /// Rows whose pose may be, but without a covariance (of methods without a verdict), with a scale,
    /// or of a cloud to itself.
    pub left_out: usize,
}

/// Longest shifts: as far as coordinates of clouds go.
const LONGEST: f64 = 1e75;
/// Largest entry of an information, which is multiplied by squares of lengths: both together stay
/// below the 1.8e308 of f64.
const LARGEST: f64 = 1e150;

/// A pose between two clouds, by their numbers.
#[derive(Debug, Clone, PartialEq)]
struct Edge {
    source: usize,
    target: usize,
    pose: Transform,
    information: Mat6,
    center: Vec3,
    probability: f64,
}

impl Graph {
    /// The graph of the rows of a list: an edge for each whose pose may be used ([`Row::is_usable`]). Clouds
    /// are numbered as they come, those without an edge too.
    ///
    /// # Errors
    /// [`Error::Config`] with the pair for numbers that are no pose, and for those that leave the
    /// range of f64 where they are multiplied.
    pub fn of<'a>(rows: impl IntoIterator<Item = &'a Row>) -> Result<Graph> {
        let mut graph = Graph::default();
        let mut numbers: HashMap<&str, usize> = HashMap::new();
        for row in rows {
            let mut number = |name: &'a str| {
                *numbers.entry(name).or_insert_with(|| {
                    graph.names.push(name.into());
                    graph.names.len() - 1
                })
            };
            // The target first: its frame is the one that others are told in.
            let target = number(&row.target);
            let source = number(&row.source);
            let pose = row.transform();
            if row.pose.is_some() && pose.is_none() {
                let rule = "its pose is not a rotation and a shift: was the file changed?";
                return Err(Error::config("rows", format!("pair {}", row.index), rule));
            }
            let Some(pose) = pose.filter(|_| row.is_usable()) else {
                graph.not_accepted += 1;
                continue;
            };
            let (Some(information), Some(center)) = (row.information, row.center) else {
                graph.left_out += 1;
                continue;
            };
            if pose.scale != 1.0 || source == target {
                graph.left_out += 1;
                continue;
            }
            let lengths = pose.translation.iter().chain(&center);
            let far = lengths.into_iter().any(|x| x.abs() > LONGEST);
            if far || information.iter().any(|x| x.abs() > LARGEST) {
                let rule = format!(
                    "lengths above {LONGEST:e} or information above {LARGEST:e} cannot be computed \
                     with: was the file changed?"
                );
                return Err(Error::config("rows", format!("pair {}", row.index), rule));
            }
            let probability = row.probability.unwrap_or(0.0);
            let information = symmetric(&information);
            graph.edges.push(Edge { source, target, pose, information, center, probability });
        }
        Ok(graph)
    }

    /// Writes the names of the clouds, CSV with the columns `vertex` and `cloud`; a file that was
    /// there is replaced.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn write_names(&self, path: &Path) -> Result<()> {
        let failed = |error| super::list::csv_error(path, error);
        let mut table = csv::Writer::from_writer(Vec::new());
        table.write_record(["vertex", "cloud"]).map_err(failed)?;
        for (number, name) in self.names.iter().enumerate() {
            table.write_record([&number.to_string(), name]).map_err(failed)?;
        }
        let content = table.into_inner().map_err(|error| failed(error.into_error().into()))?;
        io::write_bytes(path, &content)
    }

    /// Names of the clouds, by their numbers in the graph.
    pub fn names(&self) -> &[String] {
        &self.names
    }

    /// Number of accepted poses.
    pub fn edges(&self) -> usize {
        self.edges.len()
    }

    /// Parts of the graph that no edge connects, a cloud without one counted too.
    pub fn parts(&self) -> usize {
        self.placed().1
    }

    /// Where each cloud stands to begin with, by the most probable edges that connect all they
    /// can, and the number of parts; the first cloud of each part stands at the origin.
    fn placed(&self) -> (Vec<Transform>, usize) {
        let mut order: Vec<&Edge> = self.edges.iter().collect();
        order.sort_by(|a, b| b.probability.total_cmp(&a.probability));
        let mut roots: Vec<usize> = (0..self.names.len()).collect();
        let mut ways: Vec<Vec<(usize, Transform)>> = vec![Vec::new(); self.names.len()];
        for edge in order {
            let [source, target] = [edge.source, edge.target].map(|cloud| root(&mut roots, cloud));
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

    /// The graph as g2o has it, for those who measure rotations by `tangent`: a line
    /// `VERTEX_SE3:QUAT number x y z qx qy qz qw` for the pose of each cloud, and a line
    /// `EDGE_SE3:QUAT target source x y z qx qy qz qw` with the upper triangle of the information,
    /// row by row, for that of a source in the frame of its target. Rows of the information are x, y,
    /// z, then the rotation about x, y, z, both in the source's frame; 0 along motions that nothing
    /// holds.
    pub fn g2o(&self, tangent: Tangent) -> String {
        let mut text = String::new();
        let mut line = |words: &[&str], numbers: &mut dyn Iterator<Item = f64>| {
            text += &words.join(" ");
            // Adding zero turns -0 into 0. Text takes all that is written.
            numbers.for_each(|x| _ = write!(text, " {:?}", x + 0.0));
            text.push('\n');
        };
        for (number, pose) in self.placed().0.iter().enumerate() {
            let number = number.to_string();
            line(&["VERTEX_SE3:QUAT", &number], &mut place(pose).into_iter());
        }
        for edge in &self.edges {
            let [target, source] = [edge.target, edge.source].map(|cloud| cloud.to_string());
            let information = edge.information_in(tangent);
            let triangle = (0..6).flat_map(|i| information[i][i..].to_vec());
            let mut numbers = place(&edge.pose).into_iter().chain(triangle);
            line(&["EDGE_SE3:QUAT", &target, &source], &mut numbers);
        }
        text
    }

    /// Writes [`g2o`](Self::g2o) to a file; one that was there is replaced.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn write(&self, path: &Path, tangent: Tangent) -> Result<()> {
        io::write_bytes(path, self.g2o(tangent).as_bytes())
    }
}

impl Edge {
    /// The information of (t, r) with the true pose T·(t, r): a shift and, as `tangent` has it, a
    /// rotation in the source's frame, where that of the row is of (ω, τ) with the true pose
    /// p ↦ exp(ω)(T p − c) + c + τ. The rotation vector in the source's frame is h r, with h = 2 for
    /// the vector part of a quaternion, else 1. To first order, with T = (R, s),
    ///
    /// ω = h R r,    τ = R t + (s − c) × h R r,
    ///
    /// as T·(t, r) moves the point c by τ: T maps R⁻¹(c − s) there, and a turn by ω about s moves it by
    /// ω × (c − s) too. So (ω, τ) = B (t, r), and the information is Bᵀ I B.
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
fn place(pose: &Transform) -> [f64; 7] {
    let vector = pose.rotation_vector();
    let (sin, cos) = (0.5 * math::norm(vector)).sin_cos();
    let [x, y, z] = math::scaled(math::normalized(vector), sin);
    let [a, b, c] = pose.translation;
    [a, b, c, x, y, z, cos]
}

/// The first of those that are connected with it.
fn root(roots: &mut [usize], mut cloud: usize) -> usize {
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

    /// Twelve uniform numbers, near enough a normal one.
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
            // Whitened errors, as those who read the graph measure them.
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
                let [x, y, z, i, j, k, _] = place(&off);
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

    fn row(source: &str, target: &str, decision: &str, pose: Transform, probability: f64) -> Row {
        Row {
            source: source.into(),
            target: target.into(),
            trusted: Some(decision == "accept"),
            decision: Some(decision.into()),
            probability: Some(probability),
            pose: Some(std::array::from_fn(|k| pose.matrix()[k / 4][k % 4])),
            information: Some([1.0; 21]),
            center: Some([0.0; 3]),
            ..Row::default()
        }
    }

    #[test]
    fn clouds_stand_where_the_best_edges_put_them() {
        let (one, two) = (pose([0.0, 0.3, 0.0], [1.0; 3]), pose([0.5, 0.0, 0.2], [0.0, 2.0, 0.0]));
        let wrong = pose([0.0; 3], [50.0; 3]);
        let rows = [
            row("c", "a", "accept", wrong, 0.7),
            row("b", "a", "accept", one, 0.99),
            row("b", "c", "accept", two.inverse(), 0.98),
            row("d", "a", "ambiguous", one, 0.9),
            row("e", "e", "accept", Transform::IDENTITY, 0.9),
        ];
        let graph = Graph::of(&rows).unwrap();
        assert_eq!(graph.names(), ["a", "c", "b", "d", "e"]);
        assert_eq!((graph.edges(), graph.parts()), (3, 3));
        assert_eq!((graph.not_accepted, graph.left_out), (1, 1));
        let placed = graph.placed().0;
        for (found, expected) in [(placed[2], one), (placed[1], one.after(&two))] {
            let off = found.inverse().after(&expected);
            assert!(off.angle() < 1e-12 && math::norm(off.translation) < 1e-12);
        }
        let text = graph.g2o(Tangent::Quaternion);
        let lines: Vec<Vec<&str>> = text.lines().map(|line| line.split(' ').collect()).collect();
        assert_eq!(lines[0][..2], ["VERTEX_SE3:QUAT", "0"]);
        assert_eq!(lines[0][2..], ["0.0", "0.0", "0.0", "0.0", "0.0", "0.0", "1.0"]);
        assert_eq!((lines[6][0], &lines[6][1..3]), ("EDGE_SE3:QUAT", &["0", "2"][..]));
        assert!(lines.len() == 8 && lines[6].len() == 3 + 7 + 21);
        assert_eq!(lines[6][3..6], ["1.0"; 3]);
        for (information, center) in [(1e308, 0.0), (1.0, -1e80)] {
            let row = Row {
                information: Some([information; 21]),
                center: Some([center; 3]),
                ..row("b", "a", "accept", one, 0.9)
            };
            let said = Graph::of(&[row]).unwrap_err().to_string();
            assert!(said.starts_with("rows = pair 0: ") && said.contains("1e75"), "{said}");
        }
        let mut sheared = row("b", "a", "accept", one, 0.9);
        sheared.index = 7;
        sheared.pose = Some(std::array::from_fn(|k| k as f64));
        let said = Graph::of(&[sheared]).unwrap_err().to_string();
        assert!(said.starts_with("rows = pair 7: its pose is not a rotation"), "{said}");
        // A pose may be accepted and yet doubted, as where the clouds are flat.
        let doubted = Row { trusted: Some(false), ..row("b", "a", "accept", one, 0.99) };
        let failed = Row { error: Some("none".into()), ..row("b", "a", "accept", one, 0.99) };
        let untold = Row { trusted: None, ..row("b", "a", "accept", one, 0.99) };
        let graph = Graph::of(&[doubted, failed, untold]).unwrap();
        assert_eq!((graph.edges(), graph.not_accepted), (0, 3));
    }
}
