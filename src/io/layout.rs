//! The layout of an output file: coordinates, then the other fields of the points, as each format
//! stores them.

use std::io::{self, Write};

use super::columns::{COLORS, color};
use super::differences::{Differences, truncate_name};
use super::names::{UniqueNames, sanitize_name};
use crate::cloud::{Channels, ColorDepth, PointCloud};

/// The fields other than positions and normals that are written for a cloud.
#[derive(Default)]
pub(super) struct FieldLayout<'a> {
    pub fields: Vec<Field<'a>>,
    /// Differences between the fields and the cloud's data.
    pub differences: Differences,
}

/// A field other than positions and normals.
pub(super) struct Field<'a> {
    pub name: String,
    pub stored: FieldData<'a>,
}

/// The storage of a field's values.
#[derive(Clone, Copy)]
pub(super) enum FieldData<'a> {
    Float(&'a [f32]),
    /// As f64, because a float of that name would be read as something else.
    Double(&'a [f32]),
    /// A colour, from 0 to 1, as a whole number.
    Level(ColorDepth, &'a [f32]),
    /// Red, green and blue in one byte each of a number, and opacity if present.
    Packed([&'a [f32]; 3], Option<&'a [f32]>),
}

/// Returns whether the coordinates of `cloud` are f32, so that f32 output loses nothing.
pub(super) fn is_single(cloud: &PointCloud) -> bool {
    cloud.origin() == [0.0; 3]
}

impl<'a> FieldLayout<'a> {
    /// Creates the layout of named fields, as in PLY, NPY and E57: colours in one byte or two each;
    /// names are letters, digits, _ and -.
    pub fn named(cloud: &'a PointCloud) -> Self {
        let stored = |name: &str, values| match cloud.channels().color_depth(name) {
            Some(depth) => FieldData::Level(depth, values),
            None => FieldData::Float(values),
        };
        let spell = |name: &str| {
            let name = sanitize_name(name, |c| c.is_ascii_alphanumeric() || matches!(c, '_' | '-'));
            let fits = name.starts_with(|c: char| c.is_ascii_alphabetic() || c == '_');
            if fits { name } else { format!("_{name}") }
        };
        FieldLayout::new(cloud, &[], spell, stored)
    }

    /// Creates the layout of PLY and NPY, which have no viewpoint.
    pub fn without_viewpoint(cloud: &'a PointCloud) -> Self {
        let mut layout = FieldLayout::named(cloud);
        layout.leave_out_viewpoint(cloud);
        layout
    }

    /// Creates the layout of PTS: intensity, and red, green and blue as whole numbers up to 255.
    pub fn pts(cloud: &'a PointCloud) -> Self {
        let mut layout = FieldLayout::text(cloud, false);
        let whole = integer_color_depth(cloud.channels()) == Some(ColorDepth::Eight);
        let fields = std::mem::take(&mut layout.fields);
        let mut place = [None, None, None, None];
        for field in fields {
            let lower = field.name.to_ascii_lowercase();
            let slot = ["intensity", "red", "green", "blue"].iter().position(|name| *name == lower);
            match slot.filter(|slot| *slot == 0 || whole) {
                Some(slot) => place[slot] = Some(field),
                None => layout.differences.leave_out(truncate_name(&field.name)),
            }
        }
        layout.fields = place.into_iter().flatten().collect();
        if cloud.normals().is_some() {
            layout.differences.leave_out("the normals");
        }
        layout
    }

    /// Creates the layout of PCD: colours packed into one number; names are ASCII without spaces,
    /// but not _.
    pub fn pcd(cloud: &'a PointCloud) -> Self {
        let channels = cloud.channels();
        let of_color = |name| channels.color_depth(name).and_then(|_| channels.get(name));
        let colors = || Some([of_color("red")?, of_color("green")?, of_color("blue")?]);
        let packed = colors().map(|colors| FieldData::Packed(colors, of_color("alpha")));
        // No other field may have its name.
        let (taken, is_packed): (&[&str], _) = match packed {
            Some(FieldData::Packed(_, Some(_))) => (&["rgba"], [true; 4]),
            Some(_) => (&["rgb"], [true, true, true, false]),
            None => (&[], [false; 4]),
        };
        let spell = |name: &str| {
            let fits = |c: char| c.is_ascii_alphanumeric() || matches!(c, '_' | '-' | '.');
            let name = sanitize_name(name, fits);
            if name.is_empty() || name == "_" { "column".into() } else { name }
        };
        let stored = |_: &str, values| FieldData::Float(values);
        let mut layout = FieldLayout::new(cloud, taken, spell, stored);
        for field in &mut layout.fields {
            // PCD readers take four bytes of that name as colours.
            if let ("rgb" | "rgba", FieldData::Float(values)) =
                (field.name.to_ascii_lowercase().as_str(), field.stored)
            {
                field.stored = FieldData::Double(values);
            }
        }
        let is_packed = |name: &str| color(name).is_some_and(|color| is_packed[color]);
        let first = layout.fields.iter().position(|field| is_packed(&field.name));
        layout.fields.retain(|field| !is_packed(&field.name));
        for name in COLORS {
            match channels.color_depth(name) {
                Some(ColorDepth::Sixteen) if is_packed(name) => {
                    layout.differences.change(format!("{name} is rounded from 16 to 8 bits"));
                }
                Some(_) if !is_packed(name) => layout.note_color_as_number(name),
                _ => {}
            }
        }
        if let Some(stored) = packed {
            let field = Field { name: taken[0].into(), stored };
            layout.fields.insert(first.unwrap_or(0), field);
        }
        if cloud.viewpoint() == Some([0.0; 3]) {
            let what = "the viewpoint at 0 0 0, which PCD has where none is known (register with \
                        --viewpoints origin)";
            layout.differences.leave_out(what);
        }
        layout
    }

    /// Creates the layout of text: whole numbers for colours if they are recognised by them; in a
    /// header line of names alone (`bare`), no name begins with a digit.
    pub fn text(cloud: &'a PointCloud, bare: bool) -> Self {
        let whole = integer_color_depth(cloud.channels());
        let stored = |name: &str, values| match cloud.channels().color_depth(name) {
            Some(depth) if Some(depth) == whole => FieldData::Level(depth, values),
            _ => FieldData::Float(values),
        };
        let spell = |name: &str| match name.starts_with(|c: char| c.is_ascii_digit()) {
            true if bare => format!("_{name}"),
            _ => name.into(),
        };
        let mut layout = FieldLayout::new(cloud, &[], spell, stored);
        for name in cloud.channels().names() {
            let depth = cloud.channels().color_depth(name);
            if depth.is_some() && depth != whole {
                layout.note_color_as_number(name);
            }
        }
        layout.leave_out_viewpoint(cloud);
        layout
    }

    /// Creates the layout of weights, then channels. The names come from `spell`; none is `taken`.
    fn new(
        cloud: &'a PointCloud,
        taken: &[&str],
        spell: impl Fn(&str) -> String,
        stored: impl Fn(&str, &'a [f32]) -> FieldData<'a>,
    ) -> Self {
        let mut layout = FieldLayout::default();
        if let Some(weights) = cloud.weights() {
            layout.fields.push(Field { name: "weight".into(), stored: FieldData::Float(weights) });
        }
        let mut names = UniqueNames::default();
        for name in Channels::RESERVED_NAMES.iter().chain(taken) {
            names.make_unique((*name).into());
        }
        // Unchanged names go first: changed names avoid them.
        let name = |name| {
            let name = spell(name);
            if Channels::is_name(&name) { name } else { format!("_{name}") }
        };
        let spelled: Vec<String> = cloud.channels().names().map(name).collect();
        let mut own: Vec<Option<String>> = (cloud.channels().names().zip(&spelled))
            .map(|(name, spelled)| (name == spelled).then(|| names.make_unique(spelled.clone())))
            .collect();
        for (own, spelled) in own.iter_mut().zip(spelled) {
            own.get_or_insert_with(|| names.make_unique(spelled));
        }
        for ((name, values), own) in cloud.channels().iter().zip(own.into_iter().flatten()) {
            if own != name {
                layout.differences.rename(name, &own);
            }
            layout.fields.push(Field { name: own, stored: stored(name, values) });
        }
        layout
    }

    /// Records that a colour is written as a number.
    fn note_color_as_number(&mut self, name: &str) {
        self.differences
            .change(format!("{} is a number from 0 to 1, no colour", truncate_name(name)));
    }

    fn leave_out_viewpoint(&mut self, cloud: &PointCloud) {
        if let Some([x, y, z]) = cloud.viewpoint() {
            self.differences.leave_out(format!(
                "the viewpoint, which only PCD and E57 keep (register with --orientation {x},{y},{z})"
            ));
        }
    }
}

/// Returns the depth of red, green and blue, if whole numbers in text are read back at that depth.
fn integer_color_depth(channels: &Channels) -> Option<ColorDepth> {
    let depth = channels.color_depth("red")?;
    let rest = ["green", "blue"].map(|name| channels.color_depth(name));
    let names = &COLORS[..3];
    let mut values = names.iter().filter_map(|name| channels.get(name)).flatten();
    // 16-bit colours that use only 8 bits would be read as 8-bit.
    let used = depth == ColorDepth::Eight || values.any(|&value| depth.level(value) > 255);
    (rest == [Some(depth); 2] && used).then_some(depth)
}

impl Field<'_> {
    /// Writes the value at point `i`, little endian.
    pub fn write_binary(&self, out: &mut dyn Write, i: usize) -> io::Result<()> {
        match self.stored {
            FieldData::Float(values) => out.write_all(&values[i].to_le_bytes()),
            FieldData::Double(values) => out.write_all(&f64::from(values[i]).to_le_bytes()),
            FieldData::Level(ColorDepth::Eight, values) => {
                out.write_all(&[ColorDepth::Eight.level(values[i]) as u8])
            }
            FieldData::Level(depth, values) => out.write_all(&depth.level(values[i]).to_le_bytes()),
            FieldData::Packed([red, green, blue], alpha) => {
                let byte = |values: &[f32]| ColorDepth::Eight.level(values[i]) as u8;
                // Bits of opacity would make some floats NaN.
                out.write_all(&[byte(blue), byte(green), byte(red), alpha.map_or(0, byte)])
            }
        }
    }

    /// Writes the value at point `i` as text.
    pub fn write_text(&self, out: &mut dyn Write, i: usize) -> io::Result<()> {
        match self.stored {
            FieldData::Level(depth, values) => write!(out, "{}", depth.level(values[i])),
            FieldData::Float(values) | FieldData::Double(values) => write!(out, "{:?}", values[i]),
            // Text layouts have no packed fields.
            FieldData::Packed([red, ..], _) => write!(out, "{:?}", red[i]),
        }
    }
}

/// Writes the rows in binary, little endian: x, y, z as f32 if [`is_single`], else f64; then the
/// normal, as f32, if the cloud has normals, and the fields.
pub(super) fn write_binary(
    out: &mut dyn Write,
    cloud: &PointCloud,
    layout: &FieldLayout<'_>,
) -> io::Result<()> {
    let single = is_single(cloud);
    for (i, (point, position)) in cloud.points().iter().zip(cloud.positions()).enumerate() {
        if single {
            write_floats(out, point)?;
        } else {
            position.iter().try_for_each(|x| out.write_all(&x.to_le_bytes()))?;
        }
        if let Some(normals) = cloud.normals() {
            write_floats(out, &normals[i])?;
        }
        layout.fields.iter().try_for_each(|field| field.write_binary(out, i))?;
    }
    Ok(())
}

fn write_floats(out: &mut dyn Write, values: &[f32; 3]) -> io::Result<()> {
    values.iter().try_for_each(|x| out.write_all(&x.to_le_bytes()))
}
