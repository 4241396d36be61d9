//! Formats of cloud files.

use std::path::Path;

use super::lines::Lines;

/// A format that clouds are read from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Format {
    /// Stanford PLY: ascii, or binary of either byte order.
    Ply,
    /// PCL's PCD: ascii, binary or compressed.
    Pcd,
    /// Rows of numbers: .xyz, .txt, .csv and similar.
    Text,
}

/// Bytes at the start of a file that are searched for its format. Chosen by hand.
const DETECTION_BYTES: usize = 4096;

impl Format {
    /// Detects the format of the file `path` that begins with `content`: by content, else by
    /// extension, else text if there is no zero byte.
    ///
    /// ```
    /// use cfreg::io::Format;
    /// let misnamed = Format::detect("scan.txt".as_ref(), b"ply\nformat ascii 1.0\n");
    /// assert_eq!(misnamed, Some(Format::Ply));
    /// ```
    pub fn detect(path: &Path, content: &[u8]) -> Option<Format> {
        let glance = &content[..content.len().min(DETECTION_BYTES)];
        let textual = (!glance.contains(&0)).then_some(Format::Text);
        Self::from_content(glance).or_else(|| Self::from_extension(path)).or(textual)
    }

    /// Returns the format of the extension of `path`, in any case.
    pub fn from_extension(path: &Path) -> Option<Format> {
        match extension(path).as_str() {
            "ply" => Some(Format::Ply),
            "pcd" => Some(Format::Pcd),
            "xyz" | "xyzn" | "txt" | "csv" | "asc" | "pts" => Some(Format::Text),
            _ => None,
        }
    }

    fn from_content(glance: &[u8]) -> Option<Format> {
        let after = glance.strip_prefix(b"ply").and_then(<[u8]>::first);
        if after.is_some_and(u8::is_ascii_whitespace) {
            return Some(Format::Ply);
        }
        let mut lines = Lines::new(glance, 0, 0).map_while(Result::ok).map(|(_, line)| line);
        let first = lines.find(|line| line.starts_with("# .PCD") || !line.starts_with('#'))?;
        let word = first.split_whitespace().next()?;
        let pcd = first.starts_with('#') || ["VERSION", "FIELDS", "COLUMNS"].contains(&word);
        pcd.then_some(Format::Pcd)
    }
}

/// Returns the extension of `path` in lower case, empty if there is none.
pub(super) fn extension(path: &Path) -> String {
    path.extension().unwrap_or_default().to_string_lossy().to_lowercase()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn content_goes_before_the_extension() {
        let detect = |path: &str, content: &[u8]| Format::detect(path.as_ref(), content);
        assert_eq!(detect("a.pcd", b"ply\r\n"), Some(Format::Ply));
        assert_eq!(detect("a.ply", b"# .PCD v.7\nVERSION .7\n"), Some(Format::Pcd));
        assert_eq!(detect("a", b"# made by hand\nVERSION .7\n"), Some(Format::Pcd));
        assert_eq!(detect("a.PLY", b"plywood"), Some(Format::Ply));
        assert_eq!(detect("a.CSV", b"\0"), Some(Format::Text));
        assert_eq!(detect("a", b"1 2 3\n"), Some(Format::Text));
        assert_eq!(detect("a.png", b"\x89PNG\0"), None);
    }
}
