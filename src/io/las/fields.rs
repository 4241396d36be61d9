//! The fields of a point of LAS, by format.

use super::header::{LasHeader, POINT_SIZES, number};
use crate::io::scalar::Scalar;

/// The place of a field in the record of a point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Place {
    Number(Scalar),
    /// Bits of a byte: the lowest, and how many.
    Bits(u32, u32),
}

/// A field beside the position.
#[derive(Debug, Clone)]
pub(super) struct LasField {
    pub name: String,
    /// Bytes of the record before it.
    pub at: usize,
    pub place: Place,
    pub scale: f64,
    pub offset: f64,
}

impl LasField {
    fn new(name: &str, at: usize, place: Place) -> Self {
        LasField { name: name.into(), at, place, scale: 1.0, offset: 0.0 }
    }

    /// Returns the value in a record.
    pub fn value(&self, record: &[u8]) -> f64 {
        let bytes = record.get(self.at..).unwrap_or_default();
        match self.place {
            Place::Number(scalar) => scalar.read(bytes, false) * self.scale + self.offset,
            Place::Bits(first, count) => {
                let byte = bytes.first().copied().unwrap_or_default();
                f64::from(byte >> first & ((1u16 << count) - 1) as u8)
            }
        }
    }

    /// Stores a value in a record.
    pub fn store(&self, record: &mut [u8], value: f64) {
        match self.place {
            Place::Number(scalar) => {
                let stored = (value - self.offset) / self.scale;
                scalar.write(&mut record[self.at..], false, stored);
            }
            Place::Bits(first, count) => {
                let mask = ((1u16 << count) - 1) as u8;
                let bits = (value.round().clamp(0.0, f64::from(mask)) as u8) << first;
                record[self.at] = record[self.at] & !(mask << first) | bits;
            }
        }
    }
}

/// Degrees of a step of `scan_angle` in formats 6 and above.
const ANGLE_STEP: f64 = 0.006;

/// Returns the fields of a format beside the position, as laspy names them.
pub(super) fn standard(format: u8) -> Vec<LasField> {
    use Place::{Bits, Number};
    let field = LasField::new;
    let mut fields = vec![field("intensity", 12, Number(Scalar::U16))];
    if format < 6 {
        fields.extend([
            field("return_number", 14, Bits(0, 3)),
            field("number_of_returns", 14, Bits(3, 3)),
            field("scan_direction_flag", 14, Bits(6, 1)),
            field("edge_of_flight_line", 14, Bits(7, 1)),
            field("classification", 15, Bits(0, 5)),
            field("synthetic", 15, Bits(5, 1)),
            field("key_point", 15, Bits(6, 1)),
            field("withheld", 15, Bits(7, 1)),
            field("scan_angle", 16, Number(Scalar::I8)),
            field("user_data", 17, Number(Scalar::U8)),
            field("point_source_id", 18, Number(Scalar::U16)),
        ]);
    } else {
        let angle = LasField { scale: ANGLE_STEP, ..field("scan_angle", 18, Number(Scalar::I16)) };
        fields.extend([
            field("return_number", 14, Bits(0, 4)),
            field("number_of_returns", 14, Bits(4, 4)),
            field("synthetic", 15, Bits(0, 1)),
            field("key_point", 15, Bits(1, 1)),
            field("withheld", 15, Bits(2, 1)),
            field("overlap", 15, Bits(3, 1)),
            field("scanner_channel", 15, Bits(4, 2)),
            field("scan_direction_flag", 15, Bits(6, 1)),
            field("edge_of_flight_line", 15, Bits(7, 1)),
            field("classification", 16, Number(Scalar::U8)),
            field("user_data", 17, Number(Scalar::U8)),
            angle,
            field("point_source_id", 20, Number(Scalar::U16)),
        ]);
    }
    let (time, color) = match format {
        0 => (None, None),
        1 | 4 => (Some(20), None),
        2 => (None, Some(20)),
        3 | 5 => (Some(20), Some(28)),
        6 | 9 => (Some(22), None),
        _ => (Some(22), Some(30)),
    };
    fields.extend(time.map(|at| field("gps_time", at, Number(Scalar::F64))));
    if let Some(at) = color {
        let names = ["red", "green", "blue"].into_iter().enumerate();
        fields.extend(names.map(|(k, name)| field(name, at + 2 * k, Number(Scalar::U16))));
    }
    if matches!(format, 8 | 10) {
        fields.push(field("nir", 36, Number(Scalar::U16)));
    }
    fields
}

/// Bytes of a description of extra bytes.
pub(super) const DESCRIPTOR: usize = 192;

/// Returns the extra fields that the file describes, as far as records hold them.
pub(super) fn extra(header: &LasHeader) -> Vec<LasField> {
    let content = header.vlr("LASF_Spec", 4).unwrap_or_default();
    let mut at = POINT_SIZES[usize::from(header.format)];
    let mut fields = Vec::new();
    for described in content.as_chunks::<DESCRIPTOR>().0 {
        let (kind, options) = (described[2], described[3]);
        let scalar = match kind {
            1 => Scalar::U8,
            2 => Scalar::I8,
            3 => Scalar::U16,
            4 => Scalar::I16,
            5 => Scalar::U32,
            6 => Scalar::I32,
            7 => Scalar::U64,
            8 => Scalar::I64,
            9 => Scalar::F32,
            10 => Scalar::F64,
            // Bytes without a type, or the arrays of 1.4's first revisions.
            0 => {
                at += usize::from(options);
                continue;
            }
            _ => break,
        };
        let name = String::from_utf8_lossy(&described[4..36]);
        let mut field = LasField::new(name.trim_end_matches('\0'), at, Place::Number(scalar));
        if options & 8 != 0 {
            field.scale = number(described, 112, Scalar::F64);
        }
        if options & 16 != 0 {
            field.offset = number(described, 136, Scalar::F64);
        }
        at += scalar.size();
        if at > header.record_size {
            break;
        }
        fields.push(field);
    }
    fields
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fields_lie_within_the_record_and_keep_their_values() {
        for format in 0..=10u8 {
            let size = POINT_SIZES[usize::from(format)];
            let mut record = vec![0; size];
            for (number, field) in standard(format).iter().enumerate() {
                let value = if field.place == Place::Bits(0, 1) { 1.0 } else { field.scale };
                field.store(&mut record, value);
                assert_eq!(field.value(&record), value, "{format} {number} {}", field.name);
            }
            let all = standard(format);
            // No field has changed another.
            let bits = all.iter().map(|field| field.value(&record)).sum::<f64>();
            assert!(bits > 0.0 && all.iter().all(|field| field.value(&record) != 0.0));
        }
    }
}
