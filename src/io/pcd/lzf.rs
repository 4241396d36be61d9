//! LZF, the compression of PCD. The decoder of pcd-rs is private and makes two copies.

/// Most bytes that one byte unpacks to: 264 bytes are encoded in 3.
pub(super) const EXPANSION: u64 = 88;

/// Unpacks `packed` to `size` bytes; the error describes its first fault.
pub(super) fn decompress(packed: &[u8], size: usize) -> Result<Vec<u8>, String> {
    let mut bytes = Vec::with_capacity(size);
    let mut rest = packed;
    while let Some((&first, after)) = rest.split_first() {
        if first < 32 {
            // A literal run of one byte more than the count.
            let run = after.split_at_checked(usize::from(first) + 1);
            let (run, after) = run.ok_or("a literal run is longer than the data")?;
            bytes.extend_from_slice(run);
            rest = after;
        } else {
            // A back reference: the length in three bits, or one byte more; then the offset.
            let ends = "a back reference is cut off";
            let (length, after) = match usize::from(first >> 5) {
                7 => {
                    let (&more, after) = after.split_first().ok_or(ends)?;
                    (7 + usize::from(more), after)
                }
                length => (length, after),
            };
            let (&low, after) = after.split_first().ok_or(ends)?;
            let back = (usize::from(first & 31) << 8) + usize::from(low) + 1;
            let start = bytes.len().checked_sub(back);
            let start = start.ok_or("a back reference goes before the start")?;
            if bytes.len() + length + 2 > size {
                return Err(format!("there are more than {size} bytes"));
            }
            // The reference may overlap its own output.
            (start..start + length + 2).for_each(|at| bytes.push(bytes[at]));
            rest = after;
        }
        if bytes.len() > size {
            return Err(format!("there are more than {size} bytes"));
        }
    }
    match bytes.len() == size {
        true => Ok(bytes),
        false => Err(format!("there are {} bytes instead of {size}", bytes.len())),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn runs_and_references_are_unpacked() {
        let packed = [2, b'a', b'b', b'c', 0x20, 2, 0xe0, 1, 0];
        assert_eq!(decompress(&packed, 16).unwrap(), b"abcabccccccccccc"[..16].to_vec());
        for (packed, size, cause) in [
            (&[5, 1][..], 6, "literal run"),
            (&[0x20], 3, "cut off"),
            (&[0xe0, 1], 10, "cut off"),
            (&[0x20, 0], 3, "before the start"),
            (&[1, 7, 7], 1, "more than 1"),
            (&[0, 7, 0x20, 0], 3, "more than 3"),
            (&[0, 7], 2, "1 bytes instead of 2"),
            (&[], 1, "0 bytes instead of 1"),
        ] {
            let error = decompress(packed, size).unwrap_err();
            assert!(error.contains(cause), "{error}");
        }
    }

    #[test]
    fn three_bytes_become_264_at_most() {
        let packed = [&[0, 7][..], &[0xff, 0xff, 0].repeat(10)].concat();
        assert!(decompress(&packed, 2641).is_err(), "there is nothing so far back");
        let packed = [&[0, 7][..], &[0xe0, 0xff, 0].repeat(10)].concat();
        assert_eq!(decompress(&packed, 2641).unwrap(), [7; 2641]);
        assert!(2641 <= packed.len() as u64 * EXPANSION);
    }
}
