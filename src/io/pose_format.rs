//! Poses as other programs write them.

use std::fmt;
use std::path::Path;
use std::str::FromStr;

use super::apply::from_rotation;
use crate::cloud::Transform;
use crate::error::{Error, Result};
use crate::math::{self, IDENTITY, Vec3};

/// A convention of another program for a pose; quaternions are of unit length, with w of 0 or more.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
#[non_exhaustive]
pub enum PoseFormat {
    /// Four rows of four numbers, as [`write_transform`](super::write_transform) writes them.
    #[default]
    Matrix,
    /// The same numbers column by column, as OpenGL and Matlab have them.
    ColumnMajor,
    /// CloudCompare's four rows of four, for clouds that it shifted by this vector when it loaded
    /// them; zero where it did not.
    CloudCompare(Vec3),
    /// JSON of a node of Open3D's pose graphs: 16 numbers column by column.
    Open3d,
    /// COLMAP's images.txt: qw qx qy qz tx ty tz.
    Colmap,
    /// ROS tf: x y z qx qy qz qw.
    Tf,
    /// TUM: timestamp (0) tx ty tz qx qy qz qw.
    Tum,
    /// KITTI: the first three rows in one line.
    Kitti,
}

/// Names as [`FromStr`] reads them.
const NAMES: [(&str, PoseFormat); 8] = [
    ("matrix", PoseFormat::Matrix),
    ("column-major", PoseFormat::ColumnMajor),
    ("cloudcompare", PoseFormat::CloudCompare([0.0; 3])),
    ("open3d", PoseFormat::Open3d),
    ("colmap", PoseFormat::Colmap),
    ("tf", PoseFormat::Tf),
    ("tum", PoseFormat::Tum),
    ("kitti", PoseFormat::Kitti),
];

impl PoseFormat {
    /// Formats a pose, with enough digits to read each number back exactly, and a line end.
    ///
    /// # Errors
    /// [`Error::Config`] for a scale other than 1 in a format of quaternions.
    ///
    /// ```
    /// use cfreg::{Transform, io::PoseFormat};
    /// let tum = PoseFormat::Tum.format(&Transform::IDENTITY)?;
    /// assert_eq!(tum, "0 0 0 0 0 0 0 1\n");
    /// # Ok::<(), cfreg::Error>(())
    /// ```
    pub fn format(self, transform: &Transform) -> Result<String> {
        let has_quaternion = matches!(self, PoseFormat::Colmap | PoseFormat::Tf | PoseFormat::Tum);
        if has_quaternion && transform.scale != 1.0 {
            let rule = format!("{self} has no place for the scale: write matrix or kitti");
            return Err(Error::config("pose-format", transform.scale, rule));
        }
        let [w, i, j, k] = from_rotation(&transform.rotation);
        let [x, y, z] = transform.translation;
        let m = transform.matrix();
        let columns = || -> Vec<f64> { (0..16).map(|at| m[at % 4][at / 4]).collect() };
        Ok(match self {
            PoseFormat::Matrix => rows(&m),
            PoseFormat::ColumnMajor => {
                let turned: [[f64; 4]; 4] =
                    std::array::from_fn(|r| std::array::from_fn(|c| m[c][r]));
                rows(&turned)
            }
            PoseFormat::CloudCompare(shift) => {
                let there = Transform::rigid(IDENTITY, shift);
                let back = Transform::rigid(IDENTITY, math::scaled(shift, -1.0));
                rows(&there.after(&transform.after(&back)).matrix())
            }
            PoseFormat::Open3d => {
                let numbers: Vec<String> = columns().iter().map(|x| format!("{x:?}")).collect();
                format!(
                    "{{\"class_name\": \"PoseGraphNode\", \"pose\": [{}], \"version_major\": 1, \
                     \"version_minor\": 0}}\n",
                    numbers.join(", ")
                )
            }
            PoseFormat::Colmap => line(&[w, i, j, k, x, y, z]),
            PoseFormat::Tf => line(&[x, y, z, i, j, k, w]),
            PoseFormat::Tum => line(&[0.0, x, y, z, i, j, k, w]),
            PoseFormat::Kitti => line(m[..3].as_flattened()),
        })
    }
}

/// Writes a pose in the convention of a program.
///
/// # Errors
/// Those of [`PoseFormat::format`], and [`Error::Io`] when the system refuses; an existing file is
/// then unchanged.
pub fn write_pose(path: impl AsRef<Path>, transform: &Transform, format: PoseFormat) -> Result<()> {
    let text = format.format(transform)?;
    super::write_atomically(path.as_ref(), |out| out.write_all(text.as_bytes()))
}

fn rows(matrix: &[[f64; 4]; 4]) -> String {
    matrix.iter().map(|row| line(row)).collect()
}

fn line(numbers: &[f64]) -> String {
    // Adding zero turns -0 into 0.
    let words: Vec<String> = numbers.iter().map(|x| (x + 0.0).to_string()).collect();
    words.join(" ") + "\n"
}

impl fmt::Display for PoseFormat {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let PoseFormat::CloudCompare([x, y, z]) = self
            && [*x, *y, *z] != [0.0; 3]
        {
            return write!(f, "cloudcompare:{x},{y},{z}");
        }
        let named = NAMES.iter().find(|(_, format)| format == self);
        f.write_str(named.map_or("matrix", |(name, _)| name))
    }
}

impl FromStr for PoseFormat {
    type Err = String;

    fn from_str(text: &str) -> std::result::Result<Self, String> {
        if let Some((_, format)) = NAMES.iter().find(|(name, _)| *name == text) {
            return Ok(*format);
        }
        let shift = text.strip_prefix("cloudcompare:").and_then(|shift| {
            let numbers: Vec<f64> =
                shift.split(',').map(|word| word.trim().parse().ok()).collect::<Option<_>>()?;
            let numbers: Vec3 = numbers.try_into().ok()?;
            numbers.iter().all(|x| x.is_finite()).then_some(numbers)
        });
        shift.map(PoseFormat::CloudCompare).ok_or_else(|| {
            let names: Vec<&str> = NAMES.iter().map(|(name, _)| *name).collect();
            format!("expected {} or cloudcompare:X,Y,Z", names.join(", "))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_convention_has_its_order() {
        // A quarter turn about z, then a step.
        let turn = [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]];
        let pose = Transform::rigid(turn, [1.0, 2.0, 3.0]);
        let half = std::f64::consts::FRAC_1_SQRT_2;
        let text = |name: &str| name.parse::<PoseFormat>().unwrap().format(&pose).unwrap();
        assert_eq!(text("matrix"), "0 -1 0 1\n1 0 0 2\n0 0 1 3\n0 0 0 1\n");
        assert_eq!(text("column-major"), "0 1 0 0\n-1 0 0 0\n0 0 1 0\n1 2 3 1\n");
        assert_eq!(text("kitti"), "0 -1 0 1 1 0 0 2 0 0 1 3\n");
        let numbers = |name: &str| -> Vec<f64> {
            text(name).split_whitespace().map(|word| word.parse().unwrap()).collect()
        };
        let near = |found: Vec<f64>, expected: &[f64]| {
            found.len() == expected.len()
                && found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-15)
        };
        assert!(near(numbers("colmap"), &[half, 0.0, 0.0, half, 1.0, 2.0, 3.0]));
        assert!(near(numbers("tf"), &[1.0, 2.0, 3.0, 0.0, 0.0, half, half]));
        assert!(near(numbers("tum"), &[0.0, 1.0, 2.0, 3.0, 0.0, 0.0, half, half]));
        assert!(text("open3d").contains("[0.0, 1.0, 0.0, 0.0, -1.0, 0.0"));
        // CloudCompare moves q + s from p + s.
        let shifted = numbers("cloudcompare:-10,0,0");
        assert!(near(vec![shifted[3], shifted[7]], &[1.0 - 10.0, 2.0 + 10.0]), "{shifted:?}");
        assert!("cloudcompare:1,2".parse::<PoseFormat>().unwrap_err().contains("kitti"));
        let scaled = Transform { scale: 2.0, ..pose };
        assert!(
            PoseFormat::Tum.format(&scaled).is_err() && PoseFormat::Kitti.format(&scaled).is_ok()
        );
    }
}
