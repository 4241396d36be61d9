//! Files in every encoding, made without the code under test.

use std::fmt::Write;
use std::fs;
use std::io::Cursor;
use std::path::{Path, PathBuf};

use cfreg::{PointCloud, io};
use pcd_rs::{DataKind, DynRecord, DynWriter, Field, Schema, ValueKind, WriterInit};
use tempfile::{TempDir, tempdir};

type Point = [f64; 3];

/// Every encoding that can be read.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Encoding {
    PlyAscii,
    PlyLittleEndian,
    PlyBigEndian,
    PcdAscii,
    PcdBinary,
    PcdCompressed,
    Spaces,
    Csv,
}

pub const ENCODINGS: [Encoding; 8] = [
    Encoding::PlyAscii,
    Encoding::PlyLittleEndian,
    Encoding::PlyBigEndian,
    Encoding::PcdAscii,
    Encoding::PcdBinary,
    Encoding::PcdCompressed,
    Encoding::Spaces,
    Encoding::Csv,
];

impl Encoding {
    pub fn extension(self) -> &'static str {
        match self {
            Encoding::PlyAscii | Encoding::PlyLittleEndian | Encoding::PlyBigEndian => "ply",
            Encoding::PcdAscii | Encoding::PcdBinary | Encoding::PcdCompressed => "pcd",
            Encoding::Spaces => "xyz",
            Encoding::Csv => "csv",
        }
    }

    /// A file with these points, in f64 throughout.
    pub fn encode(self, points: &[Point], normals: Option<&[Point]>) -> Vec<u8> {
        let rows: Vec<Vec<f64>> = (0..points.len())
            .map(|i| points[i].iter().chain(normals.iter().flat_map(|n| &n[i])).copied().collect())
            .collect();
        let names = if normals.is_some() {
            &["x", "y", "z", "nx", "ny", "nz"][..]
        } else {
            &["x", "y", "z"][..]
        };
        match self {
            Encoding::PlyAscii => {
                [ply("ascii", names, rows.len()), text(&rows, " ")].concat().into()
            }
            Encoding::PlyLittleEndian => {
                let header = ply("binary_little_endian", names, rows.len());
                [header.into(), bytes(&rows, f64::to_le_bytes)].concat()
            }
            Encoding::PlyBigEndian => {
                let header = ply("binary_big_endian", names, rows.len());
                [header.into(), bytes(&rows, f64::to_be_bytes)].concat()
            }
            Encoding::PcdAscii => pcd(DataKind::Ascii, names, &rows),
            Encoding::PcdBinary => pcd(DataKind::Binary, names, &rows),
            Encoding::PcdCompressed => pcd(DataKind::BinaryCompressed, names, &rows),
            Encoding::Spaces => [names.join(" "), text(&rows, " ")].join("\n").into(),
            Encoding::Csv => [names.join(","), text(&rows, ",")].join("\n").into(),
        }
    }
}

fn ply(format: &str, names: &[&str], count: usize) -> String {
    let mut header = format!("ply\nformat {format} 1.0\ncomment a test\nelement vertex {count}\n");
    for name in names {
        writeln!(header, "property double {name}").unwrap();
    }
    header + "end_header\n"
}

fn text(rows: &[Vec<f64>], separator: &str) -> String {
    let line = |row: &Vec<f64>| row.iter().map(f64::to_string).collect::<Vec<_>>().join(separator);
    rows.iter().map(|row| line(row) + "\n").collect()
}

fn bytes(rows: &[Vec<f64>], to_bytes: fn(f64) -> [u8; 8]) -> Vec<u8> {
    rows.iter().flatten().flat_map(|&value| to_bytes(value)).collect()
}

fn pcd(data_kind: DataKind, names: &[&str], rows: &[Vec<f64>]) -> Vec<u8> {
    let pcl_name = |name: &str| match name.strip_prefix('n') {
        Some(axis) => format!("normal_{axis}"),
        None => name.to_owned(),
    };
    let schema: Schema = names.iter().map(|name| (pcl_name(name), ValueKind::F64, 1)).collect();
    let init = WriterInit {
        width: rows.len() as u64,
        height: 1,
        viewpoint: Default::default(),
        data_kind,
        schema: Some(schema),
        version: None,
    };
    let mut file = Vec::new();
    let mut writer: DynWriter<_> = init.build_from_writer(Cursor::new(&mut file)).unwrap();
    for row in rows {
        let fields = row.iter().map(|&value| Field::F64(vec![value])).collect();
        writer.push(&DynRecord(fields)).unwrap();
    }
    writer.finish().unwrap();
    file
}

/// A file of this content in a folder that goes with the returned guard.
pub fn write_temp_file(name: &str, content: impl AsRef<[u8]>) -> (TempDir, PathBuf) {
    let folder = tempdir().unwrap();
    let path = folder.path().join(name);
    fs::write(&path, content).unwrap();
    (folder, path)
}

/// The cloud that a file of this content is.
pub fn read(name: &str, content: impl AsRef<[u8]>) -> PointCloud {
    let (_folder, path) = write_temp_file(name, content);
    io::read(path).unwrap()
}

/// An NPY file, as `numpy.save` writes it.
pub fn npy(folder: &Path, name: &str, descr: &str, shape: &str, data: &[u8]) {
    let header = format!("{{'descr': '{descr}', 'fortran_order': False, 'shape': {shape}, }}");
    let header = format!("{header:<117}\n");
    let length = (header.len() as u16).to_le_bytes();
    let content = [b"\x93NUMPY\x01\x00", &length[..], header.as_bytes(), data].concat();
    fs::write(folder.join(name), content).unwrap();
}
