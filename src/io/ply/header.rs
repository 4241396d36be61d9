//! The header of a PLY file.

use std::collections::HashSet;

use crate::io::content_error::{ContentError, MAX_HEADER_BYTES, quote_start};
use crate::io::scalar::Scalar;

/// The layout of the body.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::io) enum Encoding {
    Ascii,
    Binary { big_endian: bool },
}

/// The type of a property.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::io) enum PropertyKind {
    Scalar(Scalar),
    /// The type of its length, then that of its values.
    List(Scalar, Scalar),
}

/// A column of an element.
#[derive(Debug, Clone)]
pub(in crate::io) struct Property {
    pub name: String,
    pub kind: PropertyKind,
}

/// A table of the file, such as its vertices.
#[derive(Debug, Clone)]
pub(in crate::io) struct Element {
    pub name: String,
    pub count: usize,
    pub properties: Vec<Property>,
}

/// The header, and its size.
#[derive(Debug)]
pub(in crate::io) struct PlyHeader {
    pub encoding: Encoding,
    pub elements: Vec<Element>,
    /// Lines `obj_info`, without that word.
    pub infos: Vec<String>,
    /// Lines `comment` and `obj_info`.
    pub comments: usize,
    pub bytes: usize,
    pub lines: usize,
}

const PROPERTY: &str = "after an element: property TYPE NAME or property list TYPE TYPE NAME (the \
                        first an integer), TYPE being char, uchar, short, ushort, int, uint, float, double or int8 ... \
                        int64, float32, float64";
const ELEMENT: &str = "element NAME COUNT with a count of 0 or more";
const FORMAT: &str = "once: format ascii|binary_little_endian|binary_big_endian 1.0";

impl PlyHeader {
    /// Reads a header of any dialect. Lines end as the first one does: `\n`, `\r\n`, or `\r` as on
    /// old Macs.
    pub fn by_line(content: &[u8]) -> Result<PlyHeader, ContentError> {
        let start = &content[..content.len().min(MAX_HEADER_BYTES)];
        let ending = match start.iter().position(|&byte| byte == b'\n' || byte == b'\r') {
            Some(at) if start[at] == b'\r' && start.get(at + 1) != Some(&b'\n') => b'\r',
            _ => b'\n',
        };
        let mut header = PlyHeader {
            encoding: Encoding::Ascii,
            elements: Vec::new(),
            infos: Vec::new(),
            comments: 0,
            bytes: 0,
            lines: 0,
        };
        let mut has_format = false;
        let mut names = HashSet::new();
        for line in start.split_inclusive(|&byte| byte == ending) {
            header.bytes += line.len();
            header.lines += 1;
            let number = header.lines;
            // Comments come in any encoding; all other header text is ascii.
            let line = String::from_utf8_lossy(line);
            let line = line.trim();
            if number == 1 {
                if line != "ply" {
                    let what = format!("expected ply, found {}", quote_start(line));
                    return Err(ContentError::line(1, what));
                }
                continue;
            }
            if line == "end_header" {
                let what =
                    || ContentError::new(format!("the header has no format, expected {FORMAT}"));
                return has_format.then_some(header).ok_or_else(what);
            }
            let expected = header.read_line(line, &mut has_format);
            if let Err(expected) = expected {
                let what = format!(
                    "header line {} is not understood, expected {expected}",
                    quote_start(line)
                );
                return Err(ContentError::line(number, what));
            }
            if line.starts_with("element")
                && let Some(element) = header.elements.last()
                && !names.insert(element.name.clone())
            {
                let what = format!("header line {} repeats a name", quote_start(line));
                return Err(ContentError::line(number, what));
            }
        }
        let read = start.len();
        Err(ContentError::new(format!("there is no end_header in the first {read} bytes")))
    }

    /// Takes a line up; the error says what is expected instead.
    fn read_line(&mut self, line: &str, has_format: &mut bool) -> Result<(), &'static str> {
        let words: Vec<&str> = line.split_ascii_whitespace().collect();
        match words[..] {
            [] => {}
            ["comment", ..] => self.comments += 1,
            ["obj_info", ..] => {
                self.comments += 1;
                self.infos.push(line["obj_info".len()..].trim().to_string());
            }
            ["format", name, _] if !*has_format => {
                *has_format = true;
                self.encoding = match name {
                    "ascii" => Encoding::Ascii,
                    "binary_little_endian" => Encoding::Binary { big_endian: false },
                    "binary_big_endian" => Encoding::Binary { big_endian: true },
                    _ => return Err(FORMAT),
                };
            }
            ["format", ..] => return Err(FORMAT),
            ["element", name, count] => {
                let count = count.parse().map_err(|_| ELEMENT)?;
                self.elements.push(Element { name: name.into(), count, properties: Vec::new() });
            }
            ["element", ..] => return Err(ELEMENT),
            ["property", ..] => {
                let property = property(&words).ok_or(PROPERTY)?;
                self.elements.last_mut().ok_or(PROPERTY)?.properties.push(property);
            }
            _ => return Err("format, comment, obj_info, element, property or end_header"),
        }
        Ok(())
    }

    /// Returns the element of that name.
    pub fn element(&self, name: &str) -> Option<&Element> {
        self.elements.iter().find(|element| element.name == name)
    }
}

fn property(words: &[&str]) -> Option<Property> {
    let (name, kind) = match *words {
        [_, "list", length, value, name] => {
            // A length is a whole number: floats are no integer type.
            let length = scalar(length).filter(|length| length.is_integer())?;
            (name, PropertyKind::List(length, scalar(value)?))
        }
        [_, kind, name] => (name, PropertyKind::Scalar(scalar(kind)?)),
        _ => return None,
    };
    Some(Property { name: name.into(), kind })
}

fn scalar(name: &str) -> Option<Scalar> {
    Some(match name {
        "char" | "int8" => Scalar::I8,
        "uchar" | "uint8" => Scalar::U8,
        "short" | "int16" => Scalar::I16,
        "ushort" | "uint16" => Scalar::U16,
        "int" | "int32" => Scalar::I32,
        "uint" | "uint32" => Scalar::U32,
        "int64" | "long" | "longlong" => Scalar::I64,
        "uint64" | "ulong" | "ulonglong" => Scalar::U64,
        "float" | "float32" => Scalar::F32,
        "double" | "float64" => Scalar::F64,
        _ => return None,
    })
}

impl PropertyKind {
    /// Returns the fewest bytes in binary: a list may be empty.
    pub fn smallest_size(self) -> usize {
        let (PropertyKind::Scalar(scalar) | PropertyKind::List(scalar, _)) = self;
        scalar.size()
    }
}

impl Element {
    /// Returns the bytes of a row in binary, if every row has as many.
    pub fn stride(&self) -> Option<usize> {
        let size = |property: &Property| match property.kind {
            PropertyKind::Scalar(scalar) => Some(scalar.size()),
            PropertyKind::List(..) => None,
        };
        self.properties.iter().map(size).sum()
    }
}
