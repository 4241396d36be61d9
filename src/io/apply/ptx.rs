//! PTX: the poses in the headers of its scans move, and the points stay as they are.

use std::io::Write;

use super::{Moved, WriteFault, refuse_scale};
use crate::cloud::Transform;
use crate::io::content_error::ContentError;
use crate::io::format::Format;
use crate::io::lines::{Lines, number};

/// Moves every scan of a file.
pub(super) fn apply(
    content: &[u8],
    transform: &Transform,
    out: &mut dyn Write,
) -> Result<Moved, WriteFault> {
    refuse_scale(transform, Format::Ptx)?;
    let mut moved = Moved::default();
    let mut lines = Lines::new(content, 0, 0);
    let start = content.as_ptr() as usize;
    let mut written = 0;
    while let Some(first) = lines.next() {
        let (_, columns) = first?;
        let rows = header_line(&mut lines)?;
        let mut header = Vec::new();
        for _ in 0..8 {
            header.push(header_line(&mut lines)?);
        }
        let begin = header[0].as_ptr() as usize - start;
        let end = header[7].as_ptr() as usize - start + header[7].len();
        out.write_all(&content[written..begin])?;
        out.write_all(move_header(&header, transform)?.as_bytes())?;
        written = end;
        let count = [columns, rows].map(|word| word.parse::<u64>().ok());
        let count = count[0].zip(count[1]).and_then(|(columns, rows)| columns.checked_mul(rows));
        let count = count.ok_or_else(|| {
            ContentError::line(lines.number(), "expected the numbers of columns and rows of a scan")
        })?;
        for index in 0..count {
            if lines.next().transpose()?.is_none() {
                let what =
                    format!("the file ends before point {index} of {count}: it was cut short");
                return Err(ContentError::line(lines.number(), what).into());
            }
        }
        moved.points += count;
    }
    out.write_all(&content[written..])?;
    Ok(moved)
}

fn header_line<'a>(lines: &mut Lines<'a>) -> Result<&'a str, ContentError> {
    match lines.next().transpose()? {
        Some((_, line)) => Ok(line),
        None => {
            Err(ContentError::line(lines.number(), "the file ends within the header of a scan"))
        }
    }
}

/// Returns the place and the axes of the scanner, and its matrix, moved.
fn move_header(lines: &[&str], transform: &Transform) -> Result<String, ContentError> {
    let mut text = String::new();
    for (index, line) in lines.iter().enumerate() {
        let words: Option<Vec<f64>> = line.split_ascii_whitespace().map(number).collect();
        let words = words.filter(|words| words.len() == if index < 4 { 3 } else { 4 });
        let words = words.ok_or_else(|| {
            ContentError::new(format!("line {} of a scan's header is not understood", index + 3))
        })?;
        let own = [words[0], words[1], words[2]];
        // Rows are multiplied from the left: the axes of the scan, then its place.
        let moved = match index {
            0 | 7 => transform.apply(own),
            _ => transform.rotate(own),
        };
        let ending = if index < 7 { "\n" } else { "" };
        let last = words.get(3).map_or(String::new(), |last| format!(" {last}"));
        text += &format!("{} {} {}{last}{ending}", moved[0], moved[1], moved[2]);
    }
    Ok(text)
}
