//! Writing of clouds as LAS 1.2 and LAZ.

use std::io::{Seek, SeekFrom, Write};

use laz::LazVlrBuilder;

use super::fields::{self, DESCRIPTOR, LasField, Place};
use super::header::{POINT_SIZES, VLR_HEADER, at};
use super::records::{LazPacker, laz_record};
use crate::cloud::{ColorDepth, PointCloud};
use crate::io::apply::{Output, WriteFault};
use crate::io::content_error::ContentError;
use crate::io::differences::Differences;
use crate::io::scalar::Scalar;
use crate::math::{self, Vec3};

/// Bytes of the header of version 1.2.
const HEADER: usize = 227;
/// Most letters of the name of a field of extra bytes.
const MAX_NAME: usize = 32;

/// How the data of a cloud are stored.
pub(in crate::io) struct LasLayout<'a> {
    format: u8,
    scale: f64,
    offset: Vec3,
    columns: Vec<LasColumn<'a>>,
    extra: Vec<LasField>,
    pub differences: Differences,
}

/// A field, and the values that it takes.
struct LasColumn<'a> {
    field: LasField,
    values: &'a [f32],
    factor: f64,
}

impl<'a> LasLayout<'a> {
    /// Creates the layout: point format 0 to 3 by what the cloud has; channels that are whole numbers
    /// of the range of a field of their name go there, others into extra bytes as f32.
    pub fn new(cloud: &'a PointCloud) -> LasLayout<'a> {
        let channels = cloud.channels();
        let of_color = |name: &&str| channels.color_depth(name).is_some();
        let has_color = ["red", "green", "blue"].iter().all(of_color);
        let has_time = channels.get("gps_time").is_some();
        let format = u8::from(has_time) + 2 * u8::from(has_color);
        let mut layout = LasLayout {
            format,
            scale: scale(cloud),
            offset: cloud.origin(),
            columns: Vec::new(),
            extra: Vec::new(),
            differences: Differences::default(),
        };
        if !cloud.is_empty() {
            layout.differences.change(rounding_text(layout.scale));
        }
        let standard = fields::standard(format);
        for (name, values) in channels.iter() {
            let field = standard.iter().find(|field| field.name.eq_ignore_ascii_case(name));
            let depth = channels.color_depth(name);
            match (field, depth) {
                (Some(field), Some(depth)) if matches!(field.at, 20 | 22 | 24 | 28 | 30 | 32) => {
                    if depth == ColorDepth::Eight {
                        layout
                            .differences
                            .change(format!("{name} has 16 bits, as LAS has colours"));
                    }
                    layout.columns.push(LasColumn {
                        field: field.clone(),
                        values,
                        factor: 65535.0,
                    });
                }
                (Some(field), None) if fits(field, values) => {
                    layout.columns.push(LasColumn { field: field.clone(), values, factor: 1.0 });
                }
                _ => layout.push_extra(name, values, field.is_some()),
            }
        }
        if let Some(weights) = cloud.weights() {
            layout.push_extra("weight", weights, false);
        }
        if cloud.normals().is_some() {
            ["nx", "ny", "nz"].into_iter().for_each(|name| layout.push_extra(name, &[], false));
        }
        if cloud.viewpoint().is_some() {
            layout.differences.leave_out("the viewpoint, which LAS has no place for");
        }
        layout
    }

    /// Adds a field of extra bytes; `is_taken` says that LAS has a field of that name.
    fn push_extra(&mut self, name: &str, values: &'a [f32], is_taken: bool) {
        let mut own = if is_taken { format!("{name}_float") } else { name.to_string() };
        while own.len() > MAX_NAME {
            own.pop();
        }
        if own != name {
            self.differences.rename(name, &own);
        }
        let at = POINT_SIZES[usize::from(self.format)] + 4 * self.extra.len();
        let place = Place::Number(Scalar::F32);
        let field = LasField { name: own, at, place, scale: 1.0, offset: 0.0 };
        self.extra.push(field.clone());
        if !values.is_empty() {
            self.columns.push(LasColumn { field, values, factor: 1.0 });
        }
    }

    /// Returns the bytes of a point.
    fn record_size(&self) -> usize {
        POINT_SIZES[usize::from(self.format)] + 4 * self.extra.len()
    }

    /// Fills the record of point `i`.
    fn fill(&self, cloud: &PointCloud, i: usize, record: &mut [u8]) {
        record.fill(0);
        let place = math::sub(cloud.position(i), self.offset);
        for axis in 0..3 {
            Scalar::I32.write(&mut record[4 * axis..], false, place[axis] / self.scale);
        }
        // The first of one return.
        record[14] = 0b0000_1001;
        for column in &self.columns {
            let value = f64::from(column.values[i]) * column.factor;
            column.field.store(record, value);
        }
        if let Some(normals) = cloud.normals() {
            let fields = self.extra.iter().rev().take(3).rev();
            for (field, value) in fields.zip(normals[i]) {
                field.store(record, value.into());
            }
        }
    }

    /// Returns the header with its records; `bounds` are those of the stored points.
    fn head(&self, count: u32, [low, high]: [Vec3; 2], laz: Option<&[u8]>) -> Vec<u8> {
        let mut head = vec![0; HEADER];
        head[..4].copy_from_slice(b"LASF");
        head[24..26].copy_from_slice(&[1, 2]);
        head[26..31].copy_from_slice(b"OTHER");
        head[58..63].copy_from_slice(b"cfreg");
        head[at::HEADER_SIZE..at::POINTS].copy_from_slice(&(HEADER as u16).to_le_bytes());
        head[at::FORMAT] = self.format | if laz.is_some() { 0x80 } else { 0 };
        let size = (self.record_size() as u16).to_le_bytes();
        head[at::RECORD_SIZE..at::LEGACY_COUNT].copy_from_slice(&size);
        head[at::LEGACY_COUNT..111].copy_from_slice(&count.to_le_bytes());
        head[111..115].copy_from_slice(&count.to_le_bytes());
        for axis in 0..3 {
            Scalar::F64.write(&mut head[at::SCALE + 8 * axis..], false, self.scale);
            Scalar::F64.write(&mut head[at::OFFSET + 8 * axis..], false, self.offset[axis]);
            Scalar::F64.write(&mut head[at::BOUNDS + 16 * axis..], false, high[axis]);
            Scalar::F64.write(&mut head[at::BOUNDS + 16 * axis + 8..], false, low[axis]);
        }
        let mut records = u32::from(laz.is_some());
        if !self.extra.is_empty() {
            head.extend(self.descriptors());
            records += 1;
        }
        head.extend_from_slice(laz.unwrap_or_default());
        head[at::VLR_COUNT..at::FORMAT].copy_from_slice(&records.to_le_bytes());
        let points = (head.len() as u32).to_le_bytes();
        head[at::POINTS..at::VLR_COUNT].copy_from_slice(&points);
        head
    }

    /// Returns the record that describes the extra bytes.
    fn descriptors(&self) -> Vec<u8> {
        let mut record = vec![0; VLR_HEADER];
        record[2..11].copy_from_slice(b"LASF_Spec");
        record[18..20].copy_from_slice(&4u16.to_le_bytes());
        let length = (DESCRIPTOR * self.extra.len()) as u16;
        record[20..22].copy_from_slice(&length.to_le_bytes());
        for field in &self.extra {
            let start = record.len();
            record.resize(start + DESCRIPTOR, 0);
            record[start + 2] = 9;
            record[start + 4..start + 4 + field.name.len()].copy_from_slice(field.name.as_bytes());
        }
        record
    }
}

/// Says how far coordinates are rounded by a scale.
pub(super) fn rounding_text(scale: f64) -> String {
    let text = format!("{:.9}", 1000.0 * scale / 2.0);
    let millimetres = text.trim_end_matches('0').trim_end_matches('.');
    format!(
        "coordinates are multiples of {scale}, rounded by up to half of it ({millimetres} mm where \
         the unit is the metre)"
    )
}

/// Returns a power of ten that is fine enough for f32 and coarse enough for whole numbers of 32
/// bits: the extent has 9 digits.
fn scale(cloud: &PointCloud) -> f64 {
    let far = cloud.points().iter().flatten().fold(0.0, |far: f64, x| far.max(f64::from(x.abs())));
    let exponent = if far > 0.0 { (far / 2e9).log10().ceil() as i32 } else { -3 };
    match exponent {
        0.. => 10f64.powi(exponent),
        // A negative power is less exact than the quotient.
        _ => 1.0 / 10f64.powi(-exponent),
    }
}

/// Returns whether a field stores all values unchanged.
fn fits(field: &LasField, values: &[f32]) -> bool {
    let mut record = [0; 64];
    values.iter().all(|&value| {
        field.store(&mut record, value.into());
        (field.value(&record) - f64::from(value)).abs() <= 1e-6 * f64::from(value.abs())
    })
}

/// Most points of version 1.2, and most fields of extra bytes that a record describes.
const MAX_COUNT: usize = u32::MAX as usize;
const MAX_EXTRA: usize = u16::MAX as usize / DESCRIPTOR;

/// Writes a cloud as LAZ or as LAS.
pub(in crate::io) fn write(
    out: &mut Output<'_>,
    cloud: &PointCloud,
    layout: &LasLayout<'_>,
    is_laz: bool,
) -> Result<(), WriteFault> {
    if cloud.len() > MAX_COUNT || layout.extra.len() > MAX_EXTRA {
        let (count, extra) = (cloud.len(), layout.extra.len());
        let what = format!(
            "{count} points with {extra} channels, and LAS has up to {MAX_COUNT} and {MAX_EXTRA}"
        );
        return Err(ContentError::new(what).into());
    }
    let extra = 4 * layout.extra.len();
    let vlr = LazVlrBuilder::default().with_point_format(layout.format, extra as u16);
    let vlr = vlr.map_err(|error| ContentError::new(error.to_string()))?.build();
    let packed = is_laz.then(|| laz_record(&vlr)).transpose()?;
    let count = cloud.len() as u32;
    let head = layout.head(count, [[0.0; 3]; 2], packed.as_deref());
    out.write_all(&head)?;
    let mut record = vec![0; layout.record_size()];
    let (mut low, mut high) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
    let mut each = |write: &mut dyn FnMut(&[u8]) -> std::io::Result<()>| {
        (0..cloud.len()).try_for_each(|i| {
            layout.fill(cloud, i, &mut record);
            for axis in 0..3 {
                let stored = Scalar::I32.read(&record[4 * axis..], false);
                let value = stored * layout.scale + layout.offset[axis];
                (low[axis], high[axis]) = (low[axis].min(value), high[axis].max(value));
            }
            write(&record)
        })
    };
    if is_laz {
        let mut packer = LazPacker::new(&mut *out, vlr)?;
        each(&mut |record| packer.push(record))?;
        packer.finish()?;
    } else {
        each(&mut |record| out.write_all(record))?;
    }
    if cloud.is_empty() {
        (low, high) = ([0.0; 3], [0.0; 3]);
    }
    out.seek(SeekFrom::Start(0))?;
    out.write_all(&layout.head(count, [low, high], packed.as_deref()))?;
    out.seek(SeekFrom::End(0))?;
    Ok(())
}
