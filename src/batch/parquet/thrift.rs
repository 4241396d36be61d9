//! Thrift's compact protocol, the encoding of Parquet footers and page headers. It is read from the
//! bytes present, so that no length is trusted and nothing is reserved.

/// A message that says how the bytes are broken.
pub(super) type Result<T> = std::result::Result<T, String>;

/// Most levels of nested structs. Those of Parquet are six deep.
const MAX_DEPTH: usize = 24;

/// The type of a value.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum ThriftType {
    Flag(bool),
    Byte,
    Integer,
    Double,
    Binary,
    List,
    Map,
    Struct,
    Uuid,
}

/// Bytes, and the read position.
pub(super) struct Thrift<'a> {
    bytes: &'a [u8],
    at: usize,
    depth: usize,
}

impl<'a> Thrift<'a> {
    pub(super) fn new(bytes: &'a [u8]) -> Thrift<'a> {
        Thrift { bytes, at: 0, depth: 0 }
    }

    /// Returns the number of bytes read.
    pub(super) fn position(&self) -> usize {
        self.at
    }

    fn bytes(&mut self, count: u64) -> Result<&'a [u8]> {
        let left = &self.bytes[self.at..];
        let count = usize::try_from(count).ok().filter(|&count| count <= left.len());
        let count = count.ok_or("it ends too early")?;
        self.at += count;
        Ok(&left[..count])
    }

    fn byte(&mut self) -> Result<u8> {
        Ok(self.bytes(1)?[0])
    }

    /// Reads an unsigned integer.
    pub(super) fn varint(&mut self) -> Result<u64> {
        let mut value = 0;
        for shift in (0..64).step_by(7) {
            let byte = self.byte()?;
            value |= u64::from(byte & 0x7f) << shift;
            if byte < 0x80 {
                return Ok(value);
            }
        }
        Err("it has a number of more than 64 bits".into())
    }

    /// Reads a signed integer.
    pub(super) fn integer(&mut self) -> Result<i64> {
        let value = self.varint()?;
        Ok((value >> 1) as i64 ^ -((value & 1) as i64))
    }

    /// Reads a text or other bytes.
    pub(super) fn binary(&mut self) -> Result<&'a [u8]> {
        let count = self.varint()?;
        self.bytes(count)
    }

    /// Calls `take` for each element of a list; `take` must read it.
    pub(super) fn list(
        &mut self,
        mut take: impl FnMut(&mut Self, ThriftType) -> Result<()>,
    ) -> Result<()> {
        let head = self.byte()?;
        let count = if head >> 4 == 15 { self.varint()? } else { u64::from(head >> 4) };
        // Each element has at least one byte.
        if count > (self.bytes.len() - self.at) as u64 {
            return Err(format!("it claims a list of {count}, for which there are no bytes"));
        }
        let kind = element(head & 15)?;
        (0..count).try_for_each(|_| take(self, kind))
    }

    /// Calls `take` for each field of a struct, by its number; a field for which it returns `false`
    /// is skipped.
    pub(super) fn fields(
        &mut self,
        mut take: impl FnMut(&mut Self, i64, ThriftType) -> Result<bool>,
    ) -> Result<()> {
        if self.depth == MAX_DEPTH {
            return Err("its structs are nested too deeply".into());
        }
        self.depth += 1;
        let mut number = 0;
        loop {
            let head = self.byte()?;
            if head == 0 {
                self.depth -= 1;
                return Ok(());
            }
            number = if head >> 4 == 0 { self.integer()? } else { number + i64::from(head >> 4) };
            let kind = match head & 15 {
                1 => ThriftType::Flag(true),
                2 => ThriftType::Flag(false),
                other => element(other)?,
            };
            if !(1..=i64::from(i16::MAX)).contains(&number) {
                return Err(format!("it has a field {number}"));
            }
            // Flags are in the header of their field.
            if !take(self, number, kind)? && !matches!(kind, ThriftType::Flag(_)) {
                self.skip(kind)?;
            }
        }
    }

    /// Skips an element of a list, or a field that is not a flag.
    pub(super) fn skip(&mut self, kind: ThriftType) -> Result<()> {
        match kind {
            ThriftType::Flag(_) | ThriftType::Byte => self.byte().map(drop),
            ThriftType::Integer => self.varint().map(drop),
            ThriftType::Double => self.bytes(8).map(drop),
            ThriftType::Uuid => self.bytes(16).map(drop),
            ThriftType::Binary => self.binary().map(drop),
            ThriftType::Struct => self.fields(|_, _, _| Ok(false)),
            ThriftType::List => self.nested(|this| this.list(|this, kind| this.skip(kind))),
            ThriftType::Map => self.nested(|this| {
                let count = this.varint()?;
                if count == 0 {
                    return Ok(());
                }
                let kinds = this.byte()?;
                let [key, value] = [element(kinds >> 4)?, element(kinds & 15)?];
                (0..count).try_for_each(|_| {
                    this.skip(key)?;
                    this.skip(value)
                })
            }),
        }
    }

    fn nested(&mut self, read: impl FnOnce(&mut Self) -> Result<()>) -> Result<()> {
        if self.depth == MAX_DEPTH {
            return Err("its lists are nested too deeply".into());
        }
        self.depth += 1;
        read(self)?;
        self.depth -= 1;
        Ok(())
    }
}

fn element(code: u8) -> Result<ThriftType> {
    Ok(match code {
        1 | 2 => ThriftType::Flag(true),
        3 => ThriftType::Byte,
        4..=6 => ThriftType::Integer,
        7 => ThriftType::Double,
        8 => ThriftType::Binary,
        9 | 10 => ThriftType::List,
        11 => ThriftType::Map,
        12 => ThriftType::Struct,
        13 => ThriftType::Uuid,
        _ => return Err(format!("it has a value of the unknown kind {code}")),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fields_are_read_and_others_skipped() {
        // 1: i32 -3, 2: list of two texts, 7: true, 8: struct with a binary, end.
        let bytes = [0x15, 5, 0x19, 0x28, 1, b'a', 0, 0x51, 0x1c, 0x18, 2, b'x', b'y', 0, 0, 9];
        let mut thrift = Thrift::new(&bytes);
        let (mut number, mut flag) = (0, false);
        let read = thrift.fields(|thrift, field, kind| match (field, kind) {
            (1, ThriftType::Integer) => {
                number = thrift.integer()?;
                Ok(true)
            }
            (7, ThriftType::Flag(value)) => {
                flag = value;
                Ok(true)
            }
            _ => Ok(false),
        });
        assert_eq!((read, number, flag, thrift.position()), (Ok(()), -3, true, 15));
    }

    #[test]
    fn claims_without_bytes_are_refused() {
        let read = |bytes: &[u8]| Thrift::new(bytes).fields(|_, _, _| Ok(false));
        for bytes in [
            &[0x19, 0xf8, 0xff, 0xff, 0xff, 0x0f, 0][..],
            &[0x18, 0xff, 0xff, 0xff, 0x0f, 0],
            &[0x16, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0],
            &[0x1e, 0],
            &[0x15],
            &[],
        ] {
            assert!(read(bytes).is_err(), "{bytes:?}");
        }
        // Nested structs, and lists, for a megabyte.
        assert!(read(&[0x1c; 1 << 20]).unwrap_err().contains("deep"));
        assert!(read(&[&[0x19][..], &[0x19; 1 << 20]].concat()).unwrap_err().contains("deep"));
    }
}
