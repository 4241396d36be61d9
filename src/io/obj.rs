//! Wavefront OBJ: vertices, their colours and normals, faces.

use super::content_error::{ContentError, quote_start};
use super::differences::Differences;
use super::lines::{Lines, number};
use super::mesh_table::MeshTable;
use crate::math::Vec3;

/// Reads vertices and faces. Normals are those of the vertices where each corner of a face names
/// the normal of the same number as its vertex.
pub(super) fn parse(content: &[u8]) -> Result<(MeshTable, Differences), ContentError> {
    let mut reader = ObjReader { shares_numbers: true, ..ObjReader::default() };
    for line in Lines::new(content, 0, 0) {
        let (number, line) = line?;
        reader.read_line(line).map_err(|what| ContentError::line(number, what))?;
    }
    reader.finish()
}

#[derive(Default)]
struct ObjReader {
    mesh: MeshTable,
    /// Corners of all faces, by the number of the vertex from 1, with the line of the first of them
    /// that has no vertex yet.
    corners: Vec<u32>,
    normals: Vec<Vec3>,
    /// Whether all corners have the number of their vertex for that of their normal.
    shares_numbers: bool,
    texture_places: usize,
    others: usize,
}

impl ObjReader {
    fn read_line(&mut self, line: &str) -> Result<(), String> {
        let mut words = line.split_ascii_whitespace();
        match words.next().unwrap_or_default() {
            "v" => {
                let numbers = numbers(words, "v x y z, or v x y z r g b")?;
                let (place, rest) = first_three(&numbers).ok_or_else(|| {
                    format!("the vertex has {} numbers, expected 3 or more", numbers.len())
                })?;
                if rest.len() >= 3 {
                    self.mesh.colors.extend(first_three(&rest[rest.len() - 3..]).map(|own| own.0));
                }
                self.mesh.vertices.push(place);
            }
            "vn" => {
                let numbers = numbers(words, "vn x y z")?;
                let normal = first_three(&numbers).ok_or("the normal has fewer than 3 numbers")?;
                self.normals.push(normal.0);
            }
            "f" => self.read_face(words)?,
            "vt" => self.texture_places += 1,
            word if word.starts_with('#') => {}
            _ => self.others += 1,
        }
        Ok(())
    }

    fn read_face<'a>(&mut self, words: impl Iterator<Item = &'a str>) -> Result<(), String> {
        self.corners.clear();
        for word in words {
            let mut parts = word.split('/');
            let vertex = index(parts.next(), self.mesh.vertices.len());
            let vertex = vertex.ok_or_else(|| {
                let known = self.mesh.vertices.len();
                format!("the face names vertex {}, of {known} before it", quote_start(word))
            })?;
            self.corners.push(vertex);
            let normal = parts.nth(1).filter(|word| !word.is_empty());
            self.shares_numbers &=
                normal.is_some() && index(normal, self.normals.len()) == Some(vertex);
        }
        self.mesh.push_face(&self.corners);
        Ok(())
    }

    fn finish(mut self) -> Result<(MeshTable, Differences), ContentError> {
        let mut differences = Differences::default();
        if self.shares_numbers && self.normals.len() == self.mesh.vertices.len() {
            self.mesh.normals = self.normals;
        } else {
            differences.leave_out_all(self.normals.len(), "normal of face corners");
        }
        if self.mesh.colors.len() != self.mesh.vertices.len() {
            differences.leave_out_all(self.mesh.colors.len(), "colour of some vertices");
            self.mesh.colors.clear();
        }
        differences.leave_out_all(self.texture_places, "texture coordinate");
        differences.leave_out_all(self.others, "line of groups, materials or curves");
        Ok((self.mesh, differences))
    }
}

/// Returns the index from 0 of an index from 1, or from -1 for the last of `known`.
fn index(word: Option<&str>, known: usize) -> Option<u32> {
    let number: i64 = word?.parse().ok()?;
    let index = if number > 0 { number - 1 } else { i64::try_from(known).ok()? + number };
    (number != 0 && index >= 0 && (index as u64) < known as u64)
        .then(|| u32::try_from(index).ok())
        .flatten()
}

fn first_three(numbers: &[f64]) -> Option<(Vec3, &[f64])> {
    numbers.split_first_chunk::<3>().map(|(first, rest)| (*first, rest))
}

fn numbers<'a>(words: impl Iterator<Item = &'a str>, expected: &str) -> Result<Vec<f64>, String> {
    let words = words.take_while(|word| !word.starts_with('#'));
    let parse = |word: &str| {
        number(word)
            .ok_or_else(|| format!("{} is no number, expected {expected}", quote_start(word)))
    };
    words.map(parse).collect()
}
