//! Formats of cloud files.

use std::fmt;
use std::path::Path;

use super::lines::Lines;
use super::text::BYTE_ORDER_MARK;

/// A format that clouds are read from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Format {
    /// Stanford PLY: ascii, or binary of either byte order; also Gaussian splats.
    Ply,
    /// PCL's PCD: ascii, binary or compressed.
    Pcd,
    /// LAS 1.0 to 1.4, and LAZ.
    Las,
    /// ASTM E2807.
    E57,
    /// Leica's PTX: scans with their poses.
    Ptx,
    /// Leica's PTS: blocks of rows with intensity and colours.
    Pts,
    /// Wavefront OBJ.
    Obj,
    /// STL: ascii or binary.
    Stl,
    /// Object File Format.
    Off,
    /// An array of numpy.
    Npy,
    /// Arrays of numpy in a zip archive.
    Npz,
    /// x, y, z and intensity as f32, without a header, as in KITTI (or five f32 in `.pcd.bin`, as
    /// in nuScenes).
    Bin,
    /// Rows of numbers: .xyz, .txt, .csv and similar.
    Text,
}

/// Bytes at the start of a file that are searched for its format. Chosen by hand.
pub(super) const DETECTION_BYTES: usize = 4096;

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
            "las" | "laz" => Some(Format::Las),
            "e57" => Some(Format::E57),
            "ptx" => Some(Format::Ptx),
            "pts" => Some(Format::Pts),
            "obj" => Some(Format::Obj),
            "stl" => Some(Format::Stl),
            "off" => Some(Format::Off),
            "npy" => Some(Format::Npy),
            "npz" => Some(Format::Npz),
            "bin" => Some(Format::Bin),
            "xyz" | "xyzn" | "txt" | "csv" | "asc" => Some(Format::Text),
            _ => None,
        }
    }

    /// Returns the format that the first bytes say.
    pub(super) fn from_content(glance: &[u8]) -> Option<Format> {
        let glance = &glance[..glance.len().min(DETECTION_BYTES)];
        let glance = glance.strip_prefix(BYTE_ORDER_MARK).unwrap_or(glance);
        let after = glance.strip_prefix(b"ply").and_then(<[u8]>::first);
        if after.is_some_and(u8::is_ascii_whitespace) {
            return Some(Format::Ply);
        }
        let magic: [(&[u8], Format); 4] = [
            (b"LASF", Format::Las),
            (b"ASTM-E57", Format::E57),
            (b"\x93NUMPY", Format::Npy),
            (b"PK\x03\x04", Format::Npz),
        ];
        if let Some((_, format)) = magic.iter().find(|(start, _)| glance.starts_with(start)) {
            return Some(*format);
        }
        let mut lines = Lines::new(glance, 0, 0).map_while(Result::ok).map(|(_, line)| line);
        let first = lines.find(|line| line.starts_with("# .PCD") || !line.starts_with('#'))?;
        let word = first.split_whitespace().next()?;
        let off = word.trim_start_matches(['S', 'T', 'C', 'N', '4', 'n']);
        match word {
            _ if first.starts_with('#') => Some(Format::Pcd),
            "VERSION" | "FIELDS" | "COLUMNS" => Some(Format::Pcd),
            "solid" if !glance.contains(&0) => Some(Format::Stl),
            "v" | "vn" | "vt" | "mtllib" | "usemtl" => Some(Format::Obj),
            _ if off == "OFF" && word.len() <= 7 => Some(Format::Off),
            _ => None,
        }
    }
}

/// The name as messages have it.
impl fmt::Display for Format {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Format::Ply => "PLY",
            Format::Pcd => "PCD",
            Format::Las => "LAS",
            Format::E57 => "E57",
            Format::Ptx => "PTX",
            Format::Pts => "PTS",
            Format::Obj => "OBJ",
            Format::Stl => "STL",
            Format::Off => "OFF",
            Format::Npy => "NPY",
            Format::Npz => "NPZ",
            Format::Bin => "KITTI .bin",
            Format::Text => "text",
        })
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
        assert_eq!(detect("a.xyz", b"LASF\0"), Some(Format::Las));
        assert_eq!(detect("a.txt", b"# made\nCOFF\n3 1 0\n"), Some(Format::Off));
        assert_eq!(detect("a.stl", b"solid by a program that writes binary\0"), Some(Format::Stl));
        assert_eq!(detect("a.txt", b"# made\nv 1 2 3\n"), Some(Format::Obj));
    }
}
