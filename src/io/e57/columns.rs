//! The fields of the points of an E57 scan, and the columns that they fill.

use e57::{ColorLimits, PointCloud as Scan, RecordDataType, RecordName, RecordValue};

use crate::cloud::ColorDepth;
use crate::io::columns::{ColumnKind, Vertex, color};
use crate::io::content_error::ContentError;
use crate::math::Vec3;

/// Returns the name of the column of a field; `None` for marks of what is invalid.
fn column_name(name: &RecordName) -> Option<String> {
    Some(match name {
        RecordName::CartesianX | RecordName::SphericalRange => "x".into(),
        RecordName::CartesianY | RecordName::SphericalAzimuth => "y".into(),
        RecordName::CartesianZ | RecordName::SphericalElevation => "z".into(),
        RecordName::Intensity => "intensity".into(),
        RecordName::ColorRed => "red".into(),
        RecordName::ColorGreen => "green".into(),
        RecordName::ColorBlue => "blue".into(),
        RecordName::RowIndex => "row_index".into(),
        RecordName::ColumnIndex => "column_index".into(),
        RecordName::ReturnCount => "return_count".into(),
        RecordName::ReturnIndex => "return_index".into(),
        RecordName::TimeStamp => "time_stamp".into(),
        RecordName::Unknown { name, .. } => match name.as_str() {
            "normalX" => "nx".into(),
            "normalY" => "ny".into(),
            "normalZ" => "nz".into(),
            _ => name.clone(),
        },
        _ => return None,
    })
}

/// Returns the columns of all these scans, x, y and z first, and their kinds.
pub(super) fn names_of(scans: &[&Scan]) -> Result<(Vec<String>, Vec<ColumnKind>), ContentError> {
    let mut names: Vec<String> = ["x", "y", "z"].map(String::from).into();
    for scan in scans {
        if !scan.has_cartesian() && !scan.has_spherical() {
            let name = scan.name.as_deref().unwrap_or("without a name");
            let what = format!("the scan {name} has neither cartesian nor spherical coordinates");
            return Err(ContentError::new(what));
        }
        for record in &scan.prototype {
            let name = column_name(&record.name).filter(|name| !names.contains(name));
            names.extend(name);
        }
    }
    let wide = |scan: &&Scan| color_range(scan, 0).is_some_and(|[low, high]| high - low > 255.0);
    let depth = if scans.iter().any(wide) { ColorDepth::Sixteen } else { ColorDepth::Eight };
    let kind = |name: &String| match color(name) {
        Some(_) => ColumnKind::Color(depth),
        None => ColumnKind::Number,
    };
    let kinds = names.iter().map(kind).collect();
    Ok((names, kinds))
}

/// The fields of a scan, by column.
pub(super) struct ScanColumns {
    /// Field, scale and offset of each column; no field where the scan lacks it.
    fields: Vec<Option<(usize, f64, f64)>>,
    /// Whether the coordinates are range, azimuth and elevation.
    is_spherical: bool,
    /// Fields that mark the coordinates, the colour and the intensity as invalid.
    marks: [Option<usize>; 3],
    /// Columns of the colours and of the intensity among the extra ones.
    colors: Vec<usize>,
    intensity: Option<usize>,
}

impl ScanColumns {
    /// Finds the fields of a scan for these columns.
    pub fn new(scan: &Scan, names: &[String], kinds: &[ColumnKind]) -> ScanColumns {
        let is_spherical = !scan.has_cartesian();
        let position = |name: &RecordName| scan.prototype.iter().position(|own| own.name == *name);
        let is_used = |name: &RecordName| {
            let spherical = matches!(
                name,
                RecordName::SphericalRange
                    | RecordName::SphericalAzimuth
                    | RecordName::SphericalElevation
            );
            !spherical || is_spherical
        };
        let field = |(column, name): (usize, &String)| {
            let of_column = |own: &e57::Record| {
                is_used(&own.name) && column_name(&own.name).as_ref() == Some(name)
            };
            let place = scan.prototype.iter().position(of_column)?;
            let (mut scale, mut offset) = match scan.prototype[place].data_type {
                RecordDataType::ScaledInteger { scale, offset, .. } => (scale, offset),
                _ => (1.0, 0.0),
            };
            if let (ColumnKind::Color(depth), Some(color)) = (kinds[column], color(name))
                && let Some([low, high]) =
                    color_range(scan, color).filter(|range| range[1] > range[0])
            {
                let share = f64::from(depth.max()) / (high - low);
                (scale, offset) = (scale * share, (offset - low) * share);
            }
            Some((place, scale, offset))
        };
        let mark = if is_spherical {
            RecordName::SphericalInvalidState
        } else {
            RecordName::CartesianInvalidState
        };
        let extra = |name: &str| {
            names[3..].iter().filter(|own| !is_normal(own)).position(|own| own == name)
        };
        ScanColumns {
            fields: names.iter().enumerate().map(field).collect(),
            is_spherical,
            marks: [mark, RecordName::IsColorInvalid, RecordName::IsIntensityInvalid]
                .map(|name| position(&name)),
            colors: ["red", "green", "blue"].into_iter().filter_map(extra).collect(),
            intensity: extra("intensity"),
        }
    }

    /// Returns whether the point marks a measurement without a return.
    pub fn is_missing(&self, values: &[RecordValue]) -> bool {
        self.marks[0].is_some_and(|mark| number(&values[mark]) != 0.0)
    }

    /// Returns the value of a column, NaN where the scan lacks it.
    pub fn value(&self, values: &[RecordValue], column: usize) -> f64 {
        match self.fields[column] {
            Some((place, scale, offset)) => number(&values[place]) * scale + offset,
            None => f64::NAN,
        }
    }

    /// Turns spherical coordinates into positions.
    pub fn finish(&self, vertex: &mut Vertex) {
        if self.is_spherical {
            vertex.place = from_spherical(vertex.place);
        }
    }

    /// Sets colours and intensities that are marked invalid to 0, and returns how many are.
    pub fn clear_invalid(&self, values: &[RecordValue], vertex: &mut Vertex) -> usize {
        let is_marked = |mark: Option<usize>| mark.is_some_and(|mark| number(&values[mark]) != 0.0);
        let mut cleared = 0;
        if is_marked(self.marks[1]) {
            self.colors.iter().for_each(|&column| vertex.extras[column] = 0.0);
            cleared += 1;
        }
        if let Some(column) = self.intensity.filter(|_| is_marked(self.marks[2])) {
            vertex.extras[column] = 0.0;
            cleared += 1;
        }
        cleared
    }
}

fn is_normal(name: &str) -> bool {
    ["nx", "ny", "nz"].contains(&name)
}

/// Returns the position of a range, an azimuth and an elevation in radians.
fn from_spherical([range, azimuth, elevation]: Vec3) -> Vec3 {
    let level = range * elevation.cos();
    [level * azimuth.cos(), level * azimuth.sin(), range * elevation.sin()]
}

fn number(value: &RecordValue) -> f64 {
    match *value {
        RecordValue::Single(value) => value.into(),
        RecordValue::Double(value) => value,
        RecordValue::ScaledInteger(value) | RecordValue::Integer(value) => value as f64,
    }
}

/// Returns the least and the greatest value of a colour: those that the scan states, else those of
/// the type of its field.
fn color_range(scan: &Scan, color: usize) -> Option<[f64; 2]> {
    let stated = |limits: &ColorLimits| -> Option<[f64; 2]> {
        let [low, high] = match color {
            0 => [&limits.red_min, &limits.red_max],
            1 => [&limits.green_min, &limits.green_max],
            _ => [&limits.blue_min, &limits.blue_max],
        };
        Some([number(low.as_ref()?), number(high.as_ref()?)])
    };
    let name = [RecordName::ColorRed, RecordName::ColorGreen, RecordName::ColorBlue];
    let record = scan.prototype.iter().find(|own| Some(&own.name) == name.get(color));
    let of_type = || match record?.data_type {
        RecordDataType::Integer { min, max } => Some([min as f64, max as f64]),
        RecordDataType::Single { .. } | RecordDataType::Double { .. } => Some([0.0, 1.0]),
        RecordDataType::ScaledInteger { .. } => None,
    };
    scan.color_limits.as_ref().and_then(stated).or_else(of_type)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spherical_coordinates_have_their_place() {
        let quarter = std::f64::consts::FRAC_PI_2;
        for (given, place) in [
            ([2.0, 0.0, 0.0], [2.0, 0.0, 0.0]),
            ([2.0, quarter, 0.0], [0.0, 2.0, 0.0]),
            ([2.0, 1.0, quarter], [0.0, 0.0, 2.0]),
        ] {
            let found = from_spherical(given);
            assert!((0..3).all(|k| (found[k] - place[k]).abs() < 1e-15), "{found:?}");
        }
    }
}
