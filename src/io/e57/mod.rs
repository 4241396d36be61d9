//! E57 (ASTM E2807): scans with their poses.

mod apply;
mod columns;
mod write;

use std::io::{BufReader, Read, Seek, SeekFrom};

use e57::{E57Reader, PointCloud as Scan, RecordValue};

pub(super) use self::apply::apply;
use self::columns::{ScanColumns, names_of};
pub(super) use self::write::write;
use super::apply::to_rotation;
use super::columns::{ColumnMap, Vertex};
use super::content_error::{ContentError, truncate_message};
use super::differences::Differences;
use super::guard::guard;
use super::scalar::Scalar;
use super::scans::{ScanChoice, ScanList};
use super::table::PointTable;
use crate::cloud::Transform;
use crate::math::{self, Vec3};

/// Points that a byte may hold at most: points that differ take more than a bit each. Chosen by
/// hand.
const MAX_POINTS_PER_BYTE: u64 = 16;
/// Bytes of the header of the file.
const HEADER: usize = 48;

/// Reads the chosen scans, each moved by its pose; the place of the sensor is the translation of
/// the pose, unless that is 0, which writers have where it is not known.
pub(super) fn read<R: Read + Seek>(
    source: R,
    choice: &ScanChoice,
) -> Result<PointTable, ContentError> {
    let mut source = BufReader::with_capacity(1 << 18, source);
    let size = check_header(&mut source)?;
    let mut reader = run(|| E57Reader::new(source))?;
    let scans = reader.pointclouds();
    let mut list = ScanList::new(choice);
    let chosen: Vec<&Scan> = scans.iter().filter(|scan| list.next(scan.name.as_deref())).collect();
    list.check()?;
    check_counts(&chosen, size)?;
    let (names, kinds) = names_of(&chosen)?;
    let columns = ColumnMap::from_names(names.iter().map(|name| Some(name.as_str())))
        .map_err(|what| ContentError::new(format!("in the fields of the points, {what}")))?
        .with_kinds(|_, column| kinds[column]);
    let total: u64 = chosen.iter().map(|scan| scan.records).sum();
    let mut table = PointTable::new(total.min(size / 8) as usize, &columns).with_column_capacity(0);
    let (mut places, mut invalid) = (Vec::new(), 0);
    for scan in &chosen {
        let pose = pose(scan)?;
        places.extend(pose.map(|pose| pose.translation).filter(|place| *place != [0.0; 3]));
        let fields = ScanColumns::new(scan, &names, &kinds);
        invalid += read_scan(&mut reader, scan, &fields, pose, &columns, &mut table)?;
    }
    let mut differences = differences(&reader, invalid);
    list.note_places(places.len(), &mut differences);
    let place = (chosen.len() == 1).then(|| places.first().copied()).flatten();
    Ok(table.with_viewpoint(place).with_differences(differences))
}

/// Adds the points of a scan, and returns how many values were marked as invalid.
fn read_scan<R: Read + Seek>(
    reader: &mut E57Reader<R>,
    scan: &Scan,
    fields: &ScanColumns,
    pose: Option<Transform>,
    columns: &ColumnMap,
    table: &mut PointTable,
) -> Result<usize, ContentError> {
    let mut points = run(|| reader.pointcloud_raw(scan))?;
    let (mut vertex, mut invalid, mut index) = (Vertex::default(), 0, 0u64);
    while let Some(values) = guard(|| points.next()).map_err(damaged)? {
        let values: Vec<RecordValue> = values.map_err(|error| damaged(error.to_string()))?;
        if fields.is_missing(&values) {
            table.skip_no_return();
        } else {
            columns.fill(&mut vertex, |column| fields.value(&values, column));
            fields.finish(&mut vertex);
            invalid += fields.clear_invalid(&values, &mut vertex);
            if let Some(pose) = &pose {
                vertex.place = pose.apply(vertex.place);
                vertex.normal = pose.rotate(vertex.normal);
            }
            let pushed = table.push(&vertex);
            pushed.map_err(|what| ContentError::new(format!("point {index}: {what}")))?;
        }
        index += 1;
    }
    Ok(invalid)
}

/// Checks the sizes in the header of the file before memory is taken for them, and returns the size
/// of the file.
fn check_header<R: Read + Seek>(source: &mut R) -> Result<u64, ContentError> {
    let refuse = |error: std::io::Error| ContentError::new(format!("cannot be read: {error}"));
    let size = source.seek(SeekFrom::End(0)).map_err(refuse)?;
    source.seek(SeekFrom::Start(0)).map_err(refuse)?;
    let mut header = [0; HEADER];
    source.read_exact(&mut header).map_err(refuse)?;
    source.seek(SeekFrom::Start(0)).map_err(refuse)?;
    let [length, xml, xml_size] =
        [16, 24, 32].map(|at| Scalar::U64.read(&header[at..], false) as u64);
    if xml.saturating_add(xml_size) > size || length > size {
        let what = format!(
            "the header claims {length} bytes, of which {xml_size} from byte {xml} on describe the \
             scans, and the file has {size}: it was cut short, fetch it again"
        );
        return Err(ContentError::byte(16, what));
    }
    Ok(size)
}

/// Refuses counts of points that the file cannot hold.
fn check_counts(scans: &[&Scan], size: u64) -> Result<(), ContentError> {
    let total = scans.iter().fold(0u64, |sum, scan| sum.saturating_add(scan.records));
    if total <= size.saturating_mul(MAX_POINTS_PER_BYTE) {
        return Ok(());
    }
    let what = format!("the scans claim {total} points, more than {size} bytes can hold");
    Err(ContentError::new(what))
}

/// Returns the pose of a scan, if it has one.
fn pose(scan: &Scan) -> Result<Option<Transform>, ContentError> {
    let Some(found) = &scan.transform else { return Ok(None) };
    let (q, t) = (&found.rotation, &found.translation);
    let translation: Vec3 = [t.x, t.y, t.z];
    let norm = [q.w, q.x, q.y, q.z].iter().map(|x| x * x).sum::<f64>().sqrt();
    if !(norm > 0.0 && norm.is_finite() && math::norm(translation).is_finite()) {
        let name = scan.name.as_deref().unwrap_or("without a name");
        let what = format!("the pose of the scan {} is no pose", truncate_message(name));
        return Err(ContentError::new(what));
    }
    let quaternion = [q.w, q.x, q.y, q.z].map(|x| x / norm);
    Ok(Some(Transform::rigid(to_rotation(quaternion), translation)))
}

/// Runs work of the crate `e57`.
fn run<T>(work: impl FnOnce() -> e57::Result<T>) -> Result<T, ContentError> {
    guard(work).map_err(damaged)?.map_err(|error| damaged(error.to_string()))
}

fn damaged(what: String) -> ContentError {
    let what = truncate_message(&what);
    ContentError::new(format!("is damaged or was cut short: {what}; fetch it again"))
}

fn differences<R: Read + Seek>(reader: &E57Reader<R>, invalid: usize) -> Differences {
    let mut differences = Differences::default();
    differences.leave_out_all(reader.images().len(), "image");
    if invalid > 0 {
        differences
            .change(format!("{invalid} colours or intensities that are marked invalid are 0"));
    }
    differences
}
