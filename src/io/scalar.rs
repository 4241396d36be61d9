//! Numbers in binary files.

/// The type of a number in a binary file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Scalar {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    I64,
    U64,
    F16,
    F32,
    F64,
}

impl Scalar {
    /// Returns the bytes of a number.
    pub fn size(self) -> usize {
        match self {
            Scalar::I8 | Scalar::U8 => 1,
            Scalar::I16 | Scalar::U16 | Scalar::F16 => 2,
            Scalar::I32 | Scalar::U32 | Scalar::F32 => 4,
            Scalar::I64 | Scalar::U64 | Scalar::F64 => 8,
        }
    }

    /// Returns the letter and the size by which numpy calls the type.
    pub fn numpy_name(self) -> &'static str {
        match self {
            Scalar::I8 => "i1",
            Scalar::U8 => "u1",
            Scalar::I16 => "i2",
            Scalar::U16 => "u2",
            Scalar::I32 => "i4",
            Scalar::U32 => "u4",
            Scalar::I64 => "i8",
            Scalar::U64 => "u8",
            Scalar::F16 => "f2",
            Scalar::F32 => "f4",
            Scalar::F64 => "f8",
        }
    }

    /// Returns whether f32 holds all values.
    pub fn is_single(self) -> bool {
        self.size() <= 2 || self == Scalar::F32
    }

    /// Returns whether the numbers are whole.
    pub fn is_integer(self) -> bool {
        !matches!(self, Scalar::F16 | Scalar::F32 | Scalar::F64)
    }

    /// Returns the number at the start of `bytes`, zero where they are too few; integers beyond
    /// 2⁵³ are rounded.
    pub fn read(self, bytes: &[u8], big_endian: bool) -> f64 {
        fn first<const N: usize>(bytes: &[u8], big_endian: bool) -> [u8; N] {
            let mut first = bytes.first_chunk().copied().unwrap_or([0; N]);
            if big_endian {
                first.reverse();
            }
            first
        }
        match self {
            Scalar::I8 => i8::from_le_bytes(first(bytes, big_endian)).into(),
            Scalar::U8 => u8::from_le_bytes(first(bytes, big_endian)).into(),
            Scalar::I16 => i16::from_le_bytes(first(bytes, big_endian)).into(),
            Scalar::U16 => u16::from_le_bytes(first(bytes, big_endian)).into(),
            Scalar::I32 => i32::from_le_bytes(first(bytes, big_endian)).into(),
            Scalar::U32 => u32::from_le_bytes(first(bytes, big_endian)).into(),
            Scalar::I64 => i64::from_le_bytes(first(bytes, big_endian)) as f64,
            Scalar::U64 => u64::from_le_bytes(first(bytes, big_endian)) as f64,
            Scalar::F16 => half(u16::from_le_bytes(first(bytes, big_endian))),
            Scalar::F32 => f32::from_le_bytes(first(bytes, big_endian)).into(),
            Scalar::F64 => f64::from_le_bytes(first(bytes, big_endian)),
        }
    }

    /// Stores `value` at the start of `bytes`, which has room for it; rounds to whole numbers of
    /// the type's range where the type is an integer.
    pub fn write(self, bytes: &mut [u8], big_endian: bool, value: f64) {
        fn put<const N: usize>(bytes: &mut [u8], mut stored: [u8; N], big_endian: bool) {
            if big_endian {
                stored.reverse();
            }
            bytes[..N].copy_from_slice(&stored);
        }
        let whole = value.round();
        match self {
            Scalar::I8 => put(bytes, (whole as i8).to_le_bytes(), big_endian),
            Scalar::U8 => put(bytes, (whole as u8).to_le_bytes(), big_endian),
            Scalar::I16 => put(bytes, (whole as i16).to_le_bytes(), big_endian),
            Scalar::U16 => put(bytes, (whole as u16).to_le_bytes(), big_endian),
            Scalar::I32 => put(bytes, (whole as i32).to_le_bytes(), big_endian),
            Scalar::U32 => put(bytes, (whole as u32).to_le_bytes(), big_endian),
            Scalar::I64 => put(bytes, (whole as i64).to_le_bytes(), big_endian),
            Scalar::U64 => put(bytes, (whole as u64).to_le_bytes(), big_endian),
            // No format that is written has numbers of two bytes with a fraction.
            Scalar::F16 => {}
            Scalar::F32 => put(bytes, (value as f32).to_le_bytes(), big_endian),
            Scalar::F64 => put(bytes, value.to_le_bytes(), big_endian),
        }
    }
}

/// Returns the value of an IEEE 754 half: one bit of sign, five of exponent, ten of fraction.
fn half(bits: u16) -> f64 {
    let sign = if bits >> 15 == 1 { -1.0 } else { 1.0 };
    let (exponent, fraction) = (i32::from(bits >> 10 & 31), f64::from(bits & 1023));
    sign * match exponent {
        0 => fraction * 2f64.powi(-24),
        31 if fraction == 0.0 => f64::INFINITY,
        31 => f64::NAN,
        _ => (1.0 + fraction / 1024.0) * 2f64.powi(exponent - 15),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_read_and_written_in_both_byte_orders() {
        let all = [Scalar::I8, Scalar::U8, Scalar::I16, Scalar::U16, Scalar::I32, Scalar::U32];
        let wide = [Scalar::I64, Scalar::U64, Scalar::F32, Scalar::F64];
        for scalar in all.into_iter().chain(wide) {
            for big_endian in [false, true] {
                let mut bytes = [0; 8];
                scalar.write(&mut bytes, big_endian, 100.0);
                assert_eq!(scalar.read(&bytes, big_endian), 100.0, "{scalar:?}");
                assert!(scalar.size() == 1 || scalar.read(&bytes, !big_endian) != 100.0);
            }
        }
        assert_eq!(Scalar::F64.read(&[1, 2], false), 0.0);
    }

    #[test]
    fn halves_have_the_values_of_the_standard() {
        // IEEE 754-2008, binary16: one, the least subnormal, the largest, -2, infinity.
        let cases = [(0x3c00, 1.0), (1, 2f64.powi(-24)), (0x7bff, 65504.0), (0xc000, -2.0)];
        assert!(cases.into_iter().all(|(bits, value)| half(bits) == value));
        assert!(half(0x7c00) == f64::INFINITY && half(0x7e00).is_nan());
    }
}
