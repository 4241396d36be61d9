//! Writing of a cloud as a scan of E57; its viewpoint is the place of the scan's pose.

use std::hash::Hasher;
use std::io::{Read, Seek, Write};

use e57::{
    E57Writer, Extension, IntensityLimits, Quaternion, Record, RecordDataType, RecordName,
    RecordValue, Transform as E57Pose, Translation,
};
use rustc_hash::FxHasher;

use crate::cloud::{ColorDepth, PointCloud};
use crate::io::layout::{FieldData, FieldLayout, is_single};
use crate::math::{self, Vec3};

/// Writes one scan. Normals are those of the extension `nor` of libE57; channels that E57 has no
/// field for are in an extension of this program.
pub(in crate::io) fn write<T: Read + Write + Seek>(
    out: T,
    cloud: &PointCloud,
    layout: &FieldLayout<'_>,
) -> e57::Result<()> {
    let mut writer = E57Writer::new(out, &guid(cloud, 0))?;
    if cloud.normals().is_some() {
        let url = "http://www.libe57.org/E57_NOR_surface_normals.txt";
        writer.register_extension(Extension { namespace: "nor".into(), url: url.into() })?;
    }
    let others = layout.fields.iter().any(|field| record_name(&field.name, cloud).is_none());
    if others {
        let url = "urn:cfreg:channels".to_string();
        writer.register_extension(Extension { namespace: "cfreg".into(), url })?;
    }
    let mut scan = writer.add_pointcloud(&guid(cloud, 1), prototype(cloud, layout))?;
    let place = cloud.viewpoint().unwrap_or_default();
    if cloud.viewpoint().is_some() {
        let [x, y, z] = place;
        let rotation = Quaternion { w: 1.0, x: 0.0, y: 0.0, z: 0.0 };
        scan.set_transform(Some(E57Pose { rotation, translation: Translation { x, y, z } }));
    }
    if let Some(values) = cloud.channels().get("intensity") {
        let (low, high) = values
            .iter()
            .fold((f32::INFINITY, f32::NEG_INFINITY), |(low, high), &x| (low.min(x), high.max(x)));
        scan.set_intensity_limits(Some(IntensityLimits {
            intensity_min: Some(RecordValue::Single(low)),
            intensity_max: Some(RecordValue::Single(high)),
        }));
    }
    for i in 0..cloud.len() {
        scan.add_point(values(cloud, layout, i, place))?;
    }
    scan.finalize()?;
    writer.finalize()
}

/// Returns whether the coordinates are f32: about zero, and not moved to the place of a sensor.
fn has_single(cloud: &PointCloud) -> bool {
    is_single(cloud) && cloud.viewpoint().is_none()
}

/// Returns the field of E57 for a channel; colours are three or none.
fn record_name(name: &str, cloud: &PointCloud) -> Option<RecordName> {
    let is_color = |name: &&str| cloud.channels().color_depth(name).is_some();
    let lower = name.to_ascii_lowercase();
    if lower != "intensity" && !["red", "green", "blue"].iter().all(is_color) {
        return None;
    }
    match lower.as_str() {
        "intensity" => Some(RecordName::Intensity),
        "red" => Some(RecordName::ColorRed),
        "green" => Some(RecordName::ColorGreen),
        "blue" => Some(RecordName::ColorBlue),
        _ => None,
    }
}

fn prototype(cloud: &PointCloud, layout: &FieldLayout<'_>) -> Vec<Record> {
    let single = RecordDataType::Single { min: None, max: None };
    let double = RecordDataType::Double { min: None, max: None };
    let coordinate = if has_single(cloud) { single.clone() } else { double };
    let mut records: Vec<Record> =
        [RecordName::CartesianX, RecordName::CartesianY, RecordName::CartesianZ]
            .map(|name| Record { name, data_type: coordinate.clone() })
            .into();
    if cloud.normals().is_some() {
        records.extend(["normalX", "normalY", "normalZ"].map(|name| Record {
            name: RecordName::Unknown { namespace: "nor".into(), name: name.into() },
            data_type: single.clone(),
        }));
    }
    for field in &layout.fields {
        let unknown =
            || RecordName::Unknown { namespace: "cfreg".into(), name: field.name.clone() };
        let data_type = match field.stored {
            FieldData::Level(depth, _) => {
                RecordDataType::Integer { min: 0, max: depth.max().into() }
            }
            _ => single.clone(),
        };
        let name = record_name(&field.name, cloud).unwrap_or_else(unknown);
        records.push(Record { name, data_type });
    }
    records
}

fn values(cloud: &PointCloud, layout: &FieldLayout<'_>, i: usize, place: Vec3) -> Vec<RecordValue> {
    let mut values: Vec<RecordValue> = match has_single(cloud) {
        true => cloud.points()[i].map(RecordValue::Single).into(),
        false => math::sub(cloud.position(i), place).map(RecordValue::Double).into(),
    };
    if let Some(normals) = cloud.normals() {
        values.extend(normals[i].map(RecordValue::Single));
    }
    values.extend(layout.fields.iter().map(|field| match field.stored {
        FieldData::Level(depth, values) => RecordValue::Integer(depth.level(values[i]).into()),
        FieldData::Float(values) | FieldData::Double(values) => RecordValue::Single(values[i]),
        // Layouts of E57 have no packed fields.
        FieldData::Packed([red, ..], _) => {
            RecordValue::Integer(ColorDepth::Eight.level(red[i]).into())
        }
    }));
    values
}

/// Returns a number of the form of a GUID that depends on the points alone: the same cloud gives
/// the same file.
fn guid(cloud: &PointCloud, part: u64) -> String {
    let hash = |seed: u64| {
        let mut hasher = FxHasher::default();
        hasher.write_u64(seed);
        cloud.points().as_flattened().iter().for_each(|x| hasher.write_u32(x.to_bits()));
        cloud.origin().iter().for_each(|x| hasher.write_u64(x.to_bits()));
        hasher.finish()
    };
    let [a, b] = [hash(2 * part), hash(2 * part + 1)];
    let word = |bits: u64| bits & 0xffff;
    format!(
        "{{{:08x}-{:04x}-{:04x}-{:04x}-{:012x}}}",
        a >> 32,
        word(a >> 16),
        word(a),
        word(b >> 48),
        b & 0xffff_ffff_ffff
    )
}
