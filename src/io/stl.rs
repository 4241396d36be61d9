//! STL: triangles, ascii or binary. Corners at exactly one place are one vertex.

use rustc_hash::FxHashMap;

use super::content_error::{ContentError, quote_start};
use super::lines::{Lines, number};
use super::mesh_table::MeshTable;
use super::scalar::Scalar;
use crate::math::Vec3;

/// Bytes before the triangles of a binary file: a comment of 80 bytes, and the count.
pub(super) const HEADER: usize = 84;
/// Bytes of a triangle: its normal, three corners, and an attribute of two bytes.
pub(super) const TRIANGLE: usize = 50;

/// Returns whether the file is binary: its size is that of its count of triangles, or it does not
/// begin as ascii does.
pub(super) fn is_binary(content: &[u8]) -> bool {
    let fits = claimed(content)
        .and_then(|count| (count as usize).checked_mul(TRIANGLE)?.checked_add(HEADER))
        .is_some_and(|size| size == content.len());
    fits || !content.trim_ascii_start().starts_with(b"solid")
}

/// Returns the count of triangles of a binary file.
pub(super) fn claimed(content: &[u8]) -> Option<u32> {
    Some(u32::from_le_bytes(content.get(80..HEADER)?.try_into().ok()?))
}

/// Reads the triangles.
pub(super) fn parse(content: &[u8]) -> Result<MeshTable, ContentError> {
    let mut welder = Welder::default();
    if is_binary(content) {
        let count = claimed(content).ok_or_else(|| {
            let size = content.len();
            ContentError::new(format!("has {size} bytes, and a binary header takes {HEADER}"))
        })?;
        let triangles = content[HEADER..].as_chunks::<TRIANGLE>().0;
        if triangles.len() < count as usize {
            let there = triangles.len();
            let what = format!(
                "the header claims {count} triangles of {TRIANGLE} bytes, and there are bytes for \
                 {there}: it was cut short"
            );
            return Err(ContentError::byte(80, what));
        }
        for triangle in &triangles[..count as usize] {
            let value = |at: usize| Scalar::F32.read(&triangle[at..], false);
            for corner in [12, 24, 36] {
                welder.push([0, 4, 8].map(|axis| value(corner + axis)));
            }
        }
    } else {
        parse_ascii(content, &mut welder)?;
    }
    welder.finish()
}

fn parse_ascii(content: &[u8], welder: &mut Welder) -> Result<(), ContentError> {
    let mut last = 0;
    for line in Lines::new(content, 0, 0) {
        let (at, line) = line?;
        last = at;
        let mut words = line.split_ascii_whitespace();
        let first = words.next().unwrap_or_default().to_ascii_lowercase();
        match first.as_str() {
            "vertex" => {
                let mut place = [f64::NAN; 3];
                for value in &mut place {
                    let word = words.next().unwrap_or_default();
                    *value = number(word).ok_or_else(|| {
                        let found = quote_start(word);
                        ContentError::line(
                            at,
                            format!("{found} is no number, expected vertex x y z"),
                        )
                    })?;
                }
                welder.push(place);
            }
            "endfacet" if !welder.corners.len().is_multiple_of(3) => {
                return Err(ContentError::line(at, "the facet has other than 3 vertices"));
            }
            "solid" | "facet" | "outer" | "endloop" | "endfacet" | "endsolid" => {}
            _ => {
                let what = format!(
                    "found {}, expected solid, facet, outer loop, vertex, endloop, endfacet or \
                     endsolid",
                    quote_start(line)
                );
                return Err(ContentError::line(at, what));
            }
        }
    }
    match welder.corners.len() % 3 {
        0 => Ok(()),
        _ => Err(ContentError::line(last, "the file ends within a facet: it was cut short")),
    }
}

/// Vertices by their place.
#[derive(Default)]
struct Welder {
    vertices: Vec<Vec3>,
    corners: Vec<u32>,
    known: FxHashMap<[u64; 3], u32>,
}

impl Welder {
    fn push(&mut self, place: Vec3) {
        // Adding zero turns -0 into 0.
        let key = place.map(|x| (x + 0.0).to_bits());
        let next = self.vertices.len() as u32;
        let corner = *self.known.entry(key).or_insert(next);
        if corner == next {
            self.vertices.push(place);
        }
        self.corners.push(corner);
    }

    fn finish(self) -> Result<MeshTable, ContentError> {
        if self.vertices.len() > u32::MAX as usize {
            return Err(ContentError::new("has more than 2^32 vertices"));
        }
        let faces = self.corners.as_chunks::<3>().0.to_vec();
        Ok(MeshTable { vertices: self.vertices, faces, ..MeshTable::default() })
    }
}
