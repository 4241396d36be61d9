//! Object File Format: vertices and faces as text.

use super::content_error::{ContentError, check_claim, quote_start};
use super::lines::{Lines, number};
use super::mesh_table::MeshTable;

/// The first word of the file: letters for what vertices have, then OFF.
struct Kind {
    /// Numbers before the normal.
    texture: bool,
    color: bool,
    normal: bool,
}

/// Reads vertices and faces; a vertex may have a normal (NOFF) and a colour (COFF).
pub(super) fn parse(content: &[u8]) -> Result<MeshTable, ContentError> {
    let mut lines = OffLines { lines: Lines::new(content, 0, 0) };
    let (first, line) = lines.next("OFF")?;
    let mut words = line.split_ascii_whitespace();
    let kind = words.next().unwrap_or_default();
    let kind = parse_kind(kind).map_err(|what| ContentError::line(first, what))?;
    let rest: Vec<&str> = words.collect();
    let (at, counts) = match rest.is_empty() {
        true => {
            let (at, line) = lines.next("the counts of vertices and faces")?;
            (at, line.split_ascii_whitespace().collect())
        }
        false => (first, rest),
    };
    let count = |at_word: usize| -> Option<u64> { counts.get(at_word)?.parse().ok() };
    let (Some(vertices), Some(faces)) = (count(0), count(1)) else {
        let what = "expected the counts of vertices, faces and edges as text (binary OFF is not \
                    read: write it as text)";
        return Err(ContentError::line(at, what));
    };
    let mut mesh = MeshTable::default();
    // One digit per word, and a space between words.
    let left = lines.lines.rest().len() + 1;
    let vertices =
        check_claim("vertices", vertices, 6, left).map_err(|what| ContentError::line(at, what))?;
    for _ in 0..vertices {
        let (number, line) = lines.next("a vertex")?;
        read_vertex(line, &kind, &mut mesh).map_err(|what| ContentError::line(number, what))?;
    }
    let left = lines.lines.rest().len() + 1;
    let faces =
        check_claim("faces", faces, 2, left).map_err(|what| ContentError::line(at, what))?;
    for _ in 0..faces {
        let (number, line) = lines.next("a face")?;
        read_face(line, &mut mesh).map_err(|what| ContentError::line(number, what))?;
    }
    Ok(mesh)
}

struct OffLines<'a> {
    lines: Lines<'a>,
}

impl<'a> OffLines<'a> {
    /// Returns the next line that is no comment.
    fn next(&mut self, expected: &str) -> Result<(usize, &'a str), ContentError> {
        for line in self.lines.by_ref() {
            let (number, line) = line?;
            let line = line.split('#').next().unwrap_or_default().trim();
            if !line.is_empty() {
                return Ok((number, line));
            }
        }
        let what = format!("the file ends where {expected} is expected: it was cut short");
        Err(ContentError::line(self.lines.number(), what))
    }
}

fn parse_kind(word: &str) -> Result<Kind, String> {
    let letters = word
        .strip_suffix("OFF")
        .ok_or_else(|| format!("expected OFF, COFF, NOFF or CNOFF, found {}", quote_start(word)))?;
    if letters.contains(['4', 'n']) {
        return Err(format!("{} has vertices of other than 3 dimensions", quote_start(word)));
    }
    Ok(Kind {
        texture: letters.contains("ST"),
        color: letters.contains('C'),
        normal: letters.contains('N'),
    })
}

fn read_vertex(line: &str, kind: &Kind, mesh: &mut MeshTable) -> Result<(), String> {
    let parse =
        |word: &str| number(word).ok_or_else(|| format!("{} is no number", quote_start(word)));
    let numbers: Vec<f64> =
        line.split_ascii_whitespace().map(parse).collect::<Result<_, String>>()?;
    let short = || format!("the vertex has {} numbers, which are too few", numbers.len());
    let (place, mut rest) = numbers.split_first_chunk::<3>().ok_or_else(short)?;
    mesh.vertices.push(*place);
    if kind.normal {
        let (normal, others) = rest.split_first_chunk::<3>().ok_or_else(short)?;
        mesh.normals.push(*normal);
        rest = others;
    }
    if kind.color
        && let Some((color, others)) = rest.split_first_chunk::<3>()
    {
        // Whole numbers up to 255, or numbers up to 1.
        let is_whole = !line.split_ascii_whitespace().skip(3).any(|word| word.contains('.'));
        mesh.colors.push(color.map(|value| if is_whole { value / 255.0 } else { value }));
        rest = others;
    }
    if kind.texture && rest.len() < 2 {
        return Err(short());
    }
    Ok(())
}

fn read_face(line: &str, mesh: &mut MeshTable) -> Result<(), String> {
    let mut words = line.split_ascii_whitespace();
    let count = words.next().and_then(|word| word.parse::<usize>().ok());
    let count = count.ok_or("expected the number of corners of a face")?;
    let known = mesh.vertices.len();
    let corner = |word: &str| {
        let corner = word.parse::<u32>().ok().filter(|&corner| (corner as usize) < known);
        corner.ok_or_else(|| format!("the face names vertex {} of {known}", quote_start(word)))
    };
    // The declared number takes no memory: there are never more corners than words.
    let corners = words.take(count).map(corner).collect::<Result<Vec<u32>, String>>()?;
    if corners.len() < count {
        return Err(format!("the face has {} corners, expected {count}", corners.len()));
    }
    mesh.push_face(&corners);
    Ok(())
}
