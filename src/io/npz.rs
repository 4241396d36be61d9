//! Arrays of numpy in a zip archive: `.npz`.

use std::borrow::Cow;

use super::content_error::{ContentError, max_memory};
use super::differences::{Differences, truncate_name};
use super::npy::{self, Array, Beside};
use super::scans::ScanChoice;
use super::table::PointTable;

/// A member of the archive.
struct Member<'a> {
    name: String,
    method: u16,
    packed: &'a [u8],
    size: usize,
}

/// Reads the positions of a cloud: the array of the chosen name, else the one that has a name such
/// as `points` or `xyz`, else the only array of three columns or more. Arrays of as many rows are
/// its normals, colours and channels by their names.
pub(super) fn parse(content: &[u8], choice: &ScanChoice) -> Result<PointTable, ContentError> {
    let members = members(content)?;
    let limit = max_memory(content.len());
    let mut unpacked: Vec<(String, Cow<'_, [u8]>)> = Vec::new();
    let mut total = 0usize;
    for member in &members {
        total = total.saturating_add(member.size);
        if total > limit {
            let what =
                format!("the arrays unpack to more than {limit} bytes: save one alone as NPY");
            return Err(ContentError::new(what));
        }
        unpacked.push((member.name.clone(), unpack(member)?));
    }
    let mut arrays = Vec::new();
    for (name, bytes) in &unpacked {
        let array = Array::parse(bytes).map_err(|fault| fault.within(&truncate_name(name)))?;
        arrays.push((name.as_str(), array));
    }
    let positions = positions(&arrays, choice)?;
    let (_, array) = &arrays[positions];
    let (rows, width) = array.rows()?;
    if width == 0 {
        return npy::parse(&unpacked[positions].1);
    }
    let (mut beside, mut differences): (Vec<Beside<'_>>, _) = (Vec::new(), Differences::default());
    for (name, other) in arrays.iter().filter(|(name, _)| *name != arrays[positions].0) {
        match (&other.shape[..], npy::triple(name)) {
            _ if other.fields.len() != 1 || other.fields[0].name.is_some() => {
                differences.leave_out(format!("the array {}", truncate_name(name)));
            }
            ([count, 3], Some(three)) if *count == rows && three[0] != "x" => {
                beside.extend(three.iter().enumerate().map(|(k, own)| (own.to_string(), other, k)));
            }
            ([count] | [count, 1], _) if *count == rows => {
                beside.push((name.to_string(), other, 0));
            }
            _ => differences.leave_out(format!("the array {}", truncate_name(name))),
        }
    }
    Ok(npy::plain(array, rows, width, &beside)?.with_differences(differences))
}

/// Returns the index of the array that holds the positions.
fn positions(arrays: &[(&str, Array<'_>)], choice: &ScanChoice) -> Result<usize, ContentError> {
    let of_name = |own: &str| arrays.iter().position(|(name, _)| *name == own);
    let found = match choice {
        ScanChoice::One(own) => of_name(own),
        ScanChoice::All => {
            let is_named = |(name, _): &(&str, Array<'_>)| {
                npy::triple(name).is_some_and(|three| three[0] == "x")
            };
            let fitting: Vec<usize> =
                (0..arrays.len()).filter(|&at| arrays[at].1.rows().is_ok()).collect();
            let named = fitting.iter().copied().find(|&at| is_named(&arrays[at]));
            named.or_else(|| (fitting.len() == 1).then(|| fitting[0]))
        }
    };
    found.ok_or_else(|| {
        let names =
            arrays.iter().map(|(name, array)| format!("{} {:?}", truncate_name(name), array.shape));
        let names: Vec<String> = names.take(12).collect();
        ContentError::new(format!(
            "none of the arrays is the one with the positions, points (N, 3); pick one by \
             FILE.npz#NAME: {}",
            names.join(", ")
        ))
    })
}

fn unpack<'a>(member: &Member<'a>) -> Result<Cow<'a, [u8]>, ContentError> {
    let name = truncate_name(&member.name);
    match member.method {
        0 => Ok(Cow::Borrowed(member.packed)),
        8 => inflate(member.packed, member.size)
            .map(Cow::Owned)
            .map_err(|what| ContentError::new(format!("the array {name} {what}"))),
        other => {
            let what = format!("the array {name} is packed by method {other}: use numpy.savez");
            Err(ContentError::new(what))
        }
    }
}

#[cfg(feature = "formats")]
fn inflate(packed: &[u8], size: usize) -> Result<Vec<u8>, String> {
    use std::io::Read;
    let mut bytes = Vec::new();
    let mut unpacking = flate2::read::DeflateDecoder::new(packed).take(size as u64 + 1);
    let read = unpacking.read_to_end(&mut bytes);
    match read {
        Ok(read) if read == size => Ok(bytes),
        Ok(read) => Err(format!("unpacks to {read} bytes or more, and {size} are claimed")),
        Err(error) => Err(format!("cannot be unpacked: {error}")),
    }
}

#[cfg(not(feature = "formats"))]
fn inflate(_packed: &[u8], _size: usize) -> Result<Vec<u8>, String> {
    Err("is compressed, which this build does not unpack (feature formats): use numpy.savez".into())
}

/// Lists the arrays by the central directory at the end of the archive (PKWARE's APPNOTE, 4.3).
fn members(content: &[u8]) -> Result<Vec<Member<'_>>, ContentError> {
    let refuse = |at: usize, what: &str| ContentError::byte(at, format!("the archive {what}"));
    let number = |at: usize, bytes: usize| -> Option<usize> {
        let bytes = content.get(at..at.checked_add(bytes)?)?;
        Some(bytes.iter().rev().fold(0, |all, &byte| all << 8 | usize::from(byte)))
    };
    // The end record has 22 bytes, and a comment of up to 65,535.
    let first = content.len().saturating_sub(22 + 65_535);
    let end = (first..=content.len().saturating_sub(22))
        .rev()
        .find(|&at| content[at..].starts_with(b"PK\x05\x06"));
    let end = end.ok_or_else(|| refuse(content.len(), "has no directory: it was cut short"))?;
    let parts = || Some((number(end + 10, 2)?, number(end + 16, 4)?));
    let (count, mut at) = parts().ok_or_else(|| refuse(end, "has no directory"))?;
    let mut members = Vec::new();
    for _ in 0..count {
        let entry = || {
            let fields = [10, 20, 24, 28, 30, 32, 42];
            let sizes = [2, 4, 4, 2, 2, 2, 4];
            let mut values = [0; 7];
            for (value, (field, size)) in values.iter_mut().zip(fields.into_iter().zip(sizes)) {
                *value = number(at + field, size)?;
            }
            let [method, packed, size, name, extra, comment, local] = values;
            let own = content.get(at + 46..at + 46 + name)?;
            // The local header has lengths of its own.
            let data = local + 30 + number(local + 26, 2)? + number(local + 28, 2)?;
            let packed = content.get(data..data.checked_add(packed)?)?;
            let text = String::from_utf8_lossy(own);
            let name_of_array = text.strip_suffix(".npy").unwrap_or(&text).to_string();
            let member = Member { name: name_of_array, method: method as u16, packed, size };
            Some((member, 46 + name + extra + comment))
        };
        let found = content.get(at..).is_some_and(|rest| rest.starts_with(b"PK\x01\x02"));
        let (member, size) = found
            .then(entry)
            .flatten()
            .ok_or_else(|| refuse(at, "is damaged, or has more than 4 GB"))?;
        let is_stored = member.method != 0 || member.size == member.packed.len();
        if !is_stored {
            return Err(refuse(at, "has an array whose two sizes differ"));
        }
        at += size;
        members.push(member);
    }
    if members.is_empty() {
        return Err(refuse(end, "is empty"));
    }
    Ok(members)
}
