//! The header of a PLY file as ply-rs reads it. Dialects that ply-rs refuses, or of which it loses a
//! part, are read by [`PlyHeader::by_line`] itself: integers of 64
//! bits, repeated properties, lines that end as on old Macs.

use ply_rs_bw::parser::{Parser, Reader};
use ply_rs_bw::ply::{DefaultElement, Encoding as PlyEncoding, PropertyType, ScalarType};

use super::header::{Element, Encoding, PlyHeader, Property, PropertyKind};
use crate::io::content_error::{ContentError, MAX_HEADER_BYTES};
use crate::io::scalar::Scalar;

/// Reads the header, by ply-rs if it is no dialect.
pub(in crate::io) fn parse(content: &[u8]) -> Result<PlyHeader, ContentError> {
    read(content).map_or_else(|| PlyHeader::by_line(content), Ok)
}

/// Reads a header by ply-rs; `None` if it is none, or of a dialect.
fn read(content: &[u8]) -> Option<PlyHeader> {
    let start = &content[..content.len().min(MAX_HEADER_BYTES)];
    let (mut bytes, mut lines, mut elements, mut properties) = (0, 0, 0, 0);
    let mut ended = false;
    for line in start.split_inclusive(|&byte| byte == b'\n') {
        (bytes, lines) = (bytes + line.len(), lines + 1);
        elements += usize::from(line.starts_with(b"element"));
        properties += usize::from(line.starts_with(b"property"));
        if line.trim_ascii() == b"end_header" {
            ended = true;
            break;
        }
    }
    if !ended {
        return None;
    }
    // Comments come in any encoding; all other header text is ascii.
    let text = String::from_utf8_lossy(&start[..bytes]);
    let header =
        Parser::<DefaultElement>::new().read_header(&mut Reader::new(text.as_bytes())).ok()?;
    let all: Vec<Element> = header
        .elements
        .values()
        .map(|element| Element {
            name: element.name.clone(),
            count: element.count,
            properties: element
                .properties
                .values()
                .map(|property| Property {
                    name: property.name.clone(),
                    kind: kind(&property.data_type),
                })
                .collect(),
        })
        .collect();
    // A repeated name replaces the earlier one, and would shift every value after it.
    let kept: usize = all.iter().map(|element| element.properties.len()).sum();
    let is_whole = |property: &Property| match property.kind {
        PropertyKind::List(length, _) => length.is_integer(),
        PropertyKind::Scalar(_) => true,
    };
    let has_lengths = all.iter().flat_map(|element| &element.properties).all(is_whole);
    (all.len() == elements && kept == properties && has_lengths).then(|| PlyHeader {
        encoding: match header.encoding {
            PlyEncoding::Ascii => Encoding::Ascii,
            PlyEncoding::BinaryLittleEndian => Encoding::Binary { big_endian: false },
            PlyEncoding::BinaryBigEndian => Encoding::Binary { big_endian: true },
        },
        elements: all,
        infos: header.obj_infos.iter().map(|info| info.trim().to_owned()).collect(),
        comments: header.comments.len() + header.obj_infos.len(),
        bytes,
        lines,
    })
}

fn kind(data_type: &PropertyType) -> PropertyKind {
    match data_type {
        PropertyType::Scalar(value) => PropertyKind::Scalar(scalar(value)),
        PropertyType::List(length, value) => PropertyKind::List(scalar(length), scalar(value)),
    }
}

fn scalar(kind: &ScalarType) -> Scalar {
    match kind {
        ScalarType::Char => Scalar::I8,
        ScalarType::UChar => Scalar::U8,
        ScalarType::Short => Scalar::I16,
        ScalarType::UShort => Scalar::U16,
        ScalarType::Int => Scalar::I32,
        ScalarType::UInt => Scalar::U32,
        ScalarType::Float => Scalar::F32,
        ScalarType::Double => Scalar::F64,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const HEADER: &str = "ply\nformat binary_big_endian 1.0\ncomment caf\u{e9}\nobj_info num_rows 4\n\
                          element vertex 3\nproperty float x\nproperty uchar red\n\
                          element face 2\nproperty list uchar int vertex_indices\nend_header\n";

    #[test]
    fn both_readers_agree_on_the_standard() {
        let (read, own) = (read(HEADER.as_bytes()).unwrap(), PlyHeader::by_line(HEADER.as_bytes()));
        assert_eq!(format!("{read:?}"), format!("{:?}", own.unwrap()));
    }

    #[test]
    fn dialects_are_left_to_the_other_reader() {
        for (from, to) in [("float x", "int64 x"), ("uchar red", "float x"), ("\n", "\r")] {
            let dialect = HEADER.replace(from, to);
            assert!(read(dialect.as_bytes()).is_none(), "{dialect}");
            assert!(parse(dialect.as_bytes()).is_ok(), "{dialect}");
        }
    }
}
