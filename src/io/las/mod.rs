//! LAS 1.0 to 1.4, and LAZ.

mod apply;
mod fields;
mod header;
mod records;
mod write;

use std::io::{Read, Seek};

pub(super) use self::apply::apply;
use self::header::LasHeader;
pub(super) use self::write::{LasLayout, write};
use super::columns::{ColumnKind, ColumnMap, Vertex, color};
use super::content_error::ContentError;
use super::differences::Differences;
use super::table::PointTable;

/// Most points that are read; of more, one of every two, three, ... is. 64 million points take some
/// 4 GB with their channels. Chosen by hand.
const MAX_POINTS: u64 = 1 << 26;

/// Reads the points. Fields that are 0 at every point are no channels: LAS has no other way to leave
/// them out.
pub(super) fn read<R: Read + Seek + Send + Sync>(
    mut source: R,
) -> Result<PointTable, ContentError> {
    let header = LasHeader::read(&mut source)?;
    let mut fields = fields::standard(header.format);
    fields.extend(fields::extra(&header));
    let names = ["x", "y", "z"].into_iter().chain(fields.iter().map(|field| field.name.as_str()));
    let columns = ColumnMap::from_names(names.map(Some))
        .map_err(ContentError::new)?
        .with_kinds(|name, _| color(name).map_or(ColumnKind::Number, ColumnKind::Text));
    let step = header.count.div_ceil(MAX_POINTS).max(1);
    // The count of a compressed file may lie: tables then grow with the points that are there.
    let most = header.file_size / if header.is_compressed { 8 } else { 20 };
    let room = header.count.div_ceil(step).min(most) as usize;
    let table = PointTable::new(room, &columns);
    let column_room = if header.is_compressed { 0 } else { room };
    let mut table = table.with_column_capacity(column_room).without_zero_columns();
    let mut vertex = Vertex::default();
    records::for_each(source, &header, |number, record| {
        if !number.is_multiple_of(step) {
            return Ok(());
        }
        columns.fill(&mut vertex, |column| match column.checked_sub(3) {
            None => coordinate(&header, record, column),
            Some(at) => fields[at].value(record),
        });
        table.push(&vertex).map_err(|what| ContentError::new(format!("point {number}: {what}")))
    })?;
    Ok(table.with_differences(differences(&header, step)))
}

/// Returns a coordinate of a record.
fn coordinate(header: &LasHeader, record: &[u8], axis: usize) -> f64 {
    let stored = record.get(4 * axis..).and_then(<[u8]>::first_chunk).copied().unwrap_or_default();
    f64::from(i32::from_le_bytes(stored)) * header.scale[axis] + header.offset[axis]
}

fn differences(header: &LasHeader, step: u64) -> Differences {
    let mut differences = Differences::default();
    if step > 1 {
        differences.note(format!(
            "one point of every {step} of {} is read, which memory allows for",
            header.count
        ));
    }
    if header.has_waveforms() {
        differences.leave_out("the wave packets");
    }
    let others = header.vlrs.iter().filter(|vlr| header.user(vlr) != laz::LazVlr::USER_ID);
    let others = others.filter(|vlr| !(vlr.id == 4 && header.user(vlr) == "LASF_Spec"));
    differences.leave_out_all(others.count(), "record of the header (coordinate system and such)");
    differences
}
