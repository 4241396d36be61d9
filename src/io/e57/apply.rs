//! The pose in the header of E57: scans and images move by new poses, and their points, pixels and
//! all else stay byte for byte.

use std::io::{Read, Seek, SeekFrom, Write};

use e57::E57Reader;
use roxmltree::{Document, Node};

use super::{check_header, damaged, run};
use crate::cloud::Transform;
use crate::io::apply::{Moved, Output, WriteFault, from_rotation, multiply, refuse_scale};
use crate::io::content_error::ContentError;
use crate::io::format::Format;
use crate::io::scalar::Scalar;
use crate::math::Vec3;

/// Bytes of the sum that ends each page.
const CHECKSUM: usize = 4;

/// Writes the file with other poses.
pub(in crate::io) fn apply<R: Read + Seek>(
    mut source: R,
    transform: &Transform,
    out: &mut Output<'_>,
) -> Result<Moved, WriteFault> {
    refuse_scale(transform, Format::E57)?;
    let size = check_header(&mut source)?;
    let mut first = [0; 48];
    source.read_exact(&mut first)?;
    source.seek(SeekFrom::Start(0))?;
    let field = |at: usize| Scalar::U64.read(&first[at..], false) as u64;
    let [xml_start, xml_size, page] = [24, 32, 40].map(field);
    let reader = run(|| E57Reader::new(&mut source))?;
    let scans = reader.pointclouds();
    let xml = moved_xml(reader.xml(), transform)?;
    drop(reader);
    let points = scans.iter().fold(0, |sum: u64, scan| sum.saturating_add(scan.records));
    let mut moved = Moved { points, ..Moved::default() };
    if *transform != Transform::IDENTITY {
        moved.differences.change("the poses of the scans moved, their points did not");
    }

    // The description is the last part of most files; where it is not, the new one follows all.
    let data = page - CHECKSUM as u64;
    let kept = xml_start % page;
    let end = (xml_start / page + (kept + xml_size).div_ceil(data)) * page;
    let (start, kept) = if end >= size { (xml_start - kept, kept) } else { (size, 0) };
    source.seek(SeekFrom::Start(start))?;
    let mut tail = vec![0; kept as usize];
    source.read_exact(&mut tail)?;
    tail.extend_from_slice(xml.as_bytes());
    let length = start + (tail.len() as u64).div_ceil(data) * page;
    let sizes = [length, start + kept, xml.len() as u64];
    let table = crc_table();
    if start > 0 {
        let mut first = vec![0; data as usize];
        source.seek(SeekFrom::Start(0))?;
        source.read_exact(&mut first)?;
        store_sizes(&mut first, sizes);
        write_page(&table, first, data, out)?;
        source.seek(SeekFrom::Start(page))?;
        std::io::copy(&mut source.by_ref().take(start - page), out)?;
    } else {
        store_sizes(&mut tail, sizes);
    }
    for part in tail.chunks(data as usize) {
        write_page(&table, part.to_vec(), data, out)?;
    }
    Ok(moved)
}

/// Stores the size of the file, and place and size of the description, in the header.
fn store_sizes(header: &mut [u8], sizes: [u64; 3]) {
    for (at, value) in [16, 24, 32].into_iter().zip(sizes) {
        header[at..at + 8].copy_from_slice(&value.to_le_bytes());
    }
}

/// Writes a page: its bytes, filled up, and their sum.
fn write_page(
    table: &[u32; 256],
    mut bytes: Vec<u8>,
    data: u64,
    out: &mut dyn Write,
) -> std::io::Result<()> {
    bytes.resize(data as usize, 0);
    out.write_all(&bytes)?;
    out.write_all(&crc32c(table, &bytes).to_be_bytes())
}

/// Returns the description with the poses of all scans and images moved.
fn moved_xml(xml: &str, transform: &Transform) -> Result<String, ContentError> {
    let document = Document::parse(xml).map_err(|error| damaged(error.to_string()))?;
    let mut edits: Vec<(std::ops::Range<usize>, String)> = Vec::new();
    let lists = document
        .descendants()
        .filter(|node| node.has_tag_name("data3D") || node.has_tag_name("images2D"));
    for child in
        lists.flat_map(|list| list.children()).filter(|node| node.has_tag_name("vectorChild"))
    {
        let pose = child.children().find(|node| node.has_tag_name("pose"));
        let text = pose_text(pose, transform)?;
        match pose {
            Some(pose) => edits.push((pose.range(), text)),
            None => {
                let end = child.range().end.saturating_sub("</vectorChild>".len());
                if xml.get(end..child.range().end) != Some("</vectorChild>") {
                    return Err(damaged("a scan or image without content".into()));
                }
                edits.push((end..end, text));
            }
        }
    }
    let mut moved = xml.to_string();
    for (range, text) in edits.into_iter().rev() {
        moved.replace_range(range, &text);
    }
    Ok(moved)
}

/// Returns a pose, moved; without one it was the identity.
fn pose_text(pose: Option<Node<'_, '_>>, transform: &Transform) -> Result<String, ContentError> {
    let number = |parent: &str, name: &str, default: f64| -> Result<f64, ContentError> {
        let child = |node: Node<'_, '_>, name: &str| -> Option<String> {
            let found = node.children().find(|own| own.has_tag_name(name))?;
            Some(found.text().unwrap_or_default().trim().to_string())
        };
        let own = pose.and_then(|pose| pose.children().find(|own| own.has_tag_name(parent)));
        match own.and_then(|own| child(own, name)) {
            // A number without text is 0.
            Some(text) if text.is_empty() => Ok(0.0),
            Some(text) => text.parse().map_err(|_| damaged(format!("the pose has {text:?}"))),
            None => Ok(default),
        }
    };
    let mut rotation = [1.0, 0.0, 0.0, 0.0];
    for (value, name) in rotation.iter_mut().zip(["w", "x", "y", "z"]) {
        *value = number("rotation", name, *value)?;
    }
    let mut translation: Vec3 = [0.0; 3];
    for (value, name) in translation.iter_mut().zip(["x", "y", "z"]) {
        *value = number("translation", name, 0.0)?;
    }
    let [x, y, z] = transform.apply(translation);
    let [w, i, j, k] = multiply(from_rotation(&transform.rotation), rotation);
    let float = |name: &str, value: f64| format!("<{name} type=\"Float\">{value:?}</{name}>");
    Ok(format!(
        "<pose type=\"Structure\"><rotation type=\"Structure\">{}{}{}{}</rotation>\
         <translation type=\"Structure\">{}{}{}</translation></pose>",
        float("w", w),
        float("x", i),
        float("y", j),
        float("z", k),
        float("x", x),
        float("y", y),
        float("z", z)
    ))
}

/// The table of CRC-32C (Castagnoli), reflected.
fn crc_table() -> [u32; 256] {
    std::array::from_fn(|byte| {
        (0..8).fold(
            byte as u32,
            |sum, _| if sum & 1 == 1 { sum >> 1 ^ 0x82f6_3b78 } else { sum >> 1 },
        )
    })
}

fn crc32c(table: &[u32; 256], bytes: &[u8]) -> u32 {
    !bytes.iter().fold(!0, |sum, &byte| table[usize::from(sum as u8 ^ byte)] ^ sum >> 8)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_sum_is_that_of_the_standard() {
        // RFC 3720, B.4: 32 bytes of zeros, and of ones.
        let table = crc_table();
        assert_eq!(crc32c(&table, &[0; 32]), 0x8a91_36aa);
        assert_eq!(crc32c(&table, &[255; 32]), 0x62a8_ab43);
    }

    #[test]
    fn poses_move_and_appear() {
        let xml = "<e57Root><data3D><vectorChild><name>a</name><pose><translation><x>1</x><y/>\
                   </translation></pose></vectorChild><vectorChild><name>b</name></vectorChild>\
                   </data3D></e57Root>";
        let up = Transform::rigid(crate::math::IDENTITY, [0.0, 0.0, 2.5]);
        let moved = moved_xml(xml, &up).unwrap();
        assert_eq!(moved.matches("<z type=\"Float\">2.5</z>").count(), 2, "{moved}");
        assert_eq!(moved.matches("<x type=\"Float\">1.0</x>").count(), 1, "{moved}");
        assert!(Document::parse(&moved).is_ok() && moved.contains("<name>b</name>"));
    }
}
