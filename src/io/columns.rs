//! The meaning of each column of a file.

use super::content_error::{ContentError, quote_start};
use super::differences::{Differences, truncate_name};
use super::lines::number;
use super::names::{UniqueNames, channel_name};
use crate::cloud::{Channels, ColorDepth};

/// The numbers of a row: x, y, z, the normal, then all other numbers in the order of their columns.
#[derive(Debug, Clone, Default)]
pub(super) struct Vertex {
    pub(super) place: [f64; 3],
    pub(super) normal: [f64; 3],
    pub(super) extras: Vec<f64>,
    /// [`COLORS`] that are not written as a whole number, one bit each.
    pub(super) decimal: u8,
}

impl Vertex {
    fn set_slot(&mut self, slot: usize, value: f64) {
        match slot.checked_sub(3) {
            None => self.place[slot] = value,
            Some(axis) => self.normal[axis] = value,
        }
    }

    /// Clears the previous row.
    fn clear(&mut self) {
        self.extras.clear();
        self.decimal = 0;
    }
}

/// The colour columns, in the order of the bits.
pub(super) const COLORS: [&str; 4] = Channels::COLORS;

/// Returns the index in [`COLORS`] of this name, in any case.
pub(super) fn color(name: &str) -> Option<usize> {
    COLORS.iter().position(|color| color.eq_ignore_ascii_case(name))
}

/// The kind of numbers in a column other than positions and normals.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum ColumnKind {
    /// Plain numbers.
    Number,
    /// Text in a column named as one of [`COLORS`]: whole numbers may be colours, others are
    /// numbers.
    Text(usize),
    /// Numbers in a column named as one of [`COLORS`], which are colours if all are from 0 to 1.
    Share,
    /// Whole numbers, the largest of which means 1.
    Color(ColorDepth),
    /// Colour bits in a whole number: blue in the lowest byte, then green and red, then opacity if
    /// there is `alpha`.
    Packed { alpha: bool },
    /// Colour bits, in the same order, in the bits of a float.
    PackedFloat { alpha: bool },
}

/// A column other than positions and normals.
#[derive(Debug, Clone)]
pub(super) struct ExtraColumn {
    /// Name of its channel, or `weight`.
    pub(super) name: String,
    column: usize,
    pub(super) kind: ColumnKind,
}

/// Column names of each slot of a [`Vertex`], in any case.
const SLOTS: [[&str; 2]; 6] = [
    ["x", "x"],
    ["y", "y"],
    ["z", "z"],
    ["nx", "normal_x"],
    ["ny", "normal_y"],
    ["nz", "normal_z"],
];

/// Returns the slot of a [`Vertex`] that a column called `name` fills.
pub(super) fn slot(name: &str) -> Option<usize> {
    SLOTS.iter().position(|names| names.iter().any(|slot| slot.eq_ignore_ascii_case(name)))
}

/// Names that stand for x, y and z where no column has that name: of maps, of ParaView, and of
/// tables of poses. In lower case, without unit and without a word for coordinate.
const ALIASES: [&[&str]; 6] = [
    &["easting", "east", "points:0", "points_0", "pos_x", "position_x", "coord_x", "x_coord", "px"],
    &[
        "northing",
        "north",
        "points:1",
        "points_1",
        "pos_y",
        "position_y",
        "coord_y",
        "y_coord",
        "py",
    ],
    &[
        "height",
        "elevation",
        "altitude",
        "elev",
        "alt",
        "up",
        "points:2",
        "points_2",
        "pos_z",
        "position_z",
        "coord_z",
        "z_coord",
        "pz",
    ],
    &["normals:0", "normals_0", "normalx", "norm_x"],
    &["normals:1", "normals_1", "normaly", "norm_y"],
    &["normals:2", "normals_2", "normalz", "norm_z"],
];

/// Returns the name of a column without what others add to it: a unit in brackets (`X [m]`),
/// `coord.` or `coordinate`, in lower case.
fn bare_name(name: &str) -> String {
    let lower = name.trim().to_lowercase();
    let start = lower.split(['[', '(']).next().unwrap_or_default().trim();
    let start = ["coordinate ", "coord. ", "coord "]
        .iter()
        .find_map(|word| start.strip_prefix(word))
        .unwrap_or(start);
    let start = [" coordinate", " coord", "-coordinate"]
        .iter()
        .find_map(|word| start.strip_suffix(word))
        .unwrap_or(start);
    start.trim().into()
}

/// Returns the slot that a column fills by another name than its plain one.
fn slot_by_alias(name: &str) -> Option<usize> {
    let bare = bare_name(name);
    slot(&bare).or_else(|| ALIASES.iter().position(|names| names.contains(&bare.as_str())))
}

/// Finds the column of each slot: plain names first, then aliases of the slots that have none.
fn find_slots(
    names: &[Option<&str>],
    differences: &mut Differences,
) -> Result<[Option<usize>; 6], String> {
    let mut slots = [None; 6];
    for (column, name) in names.iter().enumerate() {
        let Some(slot) = name.and_then(slot) else { continue };
        if slots[slot].replace(column).is_some() {
            return Err(format!("{} is there twice: rename one of them", SLOTS[slot][0]));
        }
    }
    let plain = slots;
    for (column, name) in names.iter().enumerate() {
        let Some(name) = name else { continue };
        let Some(slot) = slot_by_alias(name).filter(|&slot| plain[slot].is_none()) else {
            continue;
        };
        if let Some(earlier) = slots[slot].replace(column) {
            let earlier = truncate_name(names[earlier].unwrap_or_default());
            let (own, name) = (SLOTS[slot][0], truncate_name(name));
            return Err(format!("{own} may be {earlier} or {name}: call one of them {own}"));
        }
        differences.rename(name, SLOTS[slot][0]);
    }
    Ok(slots)
}

/// Formats the message for a slot without a column, with the names that were found.
fn missing_message(slot: usize, names: &[Option<&str>]) -> String {
    const MAX_LISTED: usize = 12;
    const MAX_BYTES: usize = 300;
    let found: Vec<String> = names.iter().flatten().map(|name| truncate_name(name)).collect();
    let mut bytes = 0;
    let fits = |name: &&String| {
        bytes += name.len() + 2;
        bytes <= MAX_BYTES
    };
    let shown = found.iter().take(MAX_LISTED).take_while(fits).count();
    let listed = match found.len() {
        0 => "none".into(),
        count if count > shown => {
            format!("{} and {} more", found[..shown].join(", "), count - shown)
        }
        _ => found.join(", "),
    };
    format!(
        "there is no {}, expected x, y and z (or Easting, Northing, Height); the names are: {listed}",
        SLOTS[slot][0]
    )
}

/// The use of a column.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Use {
    Slot(usize),
    /// An extra column.
    Extra(usize),
}

/// The columns that hold the numbers of a [`Vertex`].
#[derive(Debug, Clone, Default)]
pub(super) struct ColumnMap {
    /// Columns and their uses, ascending.
    uses: Vec<(usize, Use)>,
    extras: Vec<ExtraColumn>,
    has_normals: bool,
    differences: Differences,
}

impl ColumnMap {
    /// Creates the map for x, y, z, then the normal if there is one.
    pub fn plain(has_normals: bool) -> ColumnMap {
        let slots = if has_normals { 6 } else { 3 };
        let uses = (0..slots).map(|slot| (slot, Use::Slot(slot))).collect();
        ColumnMap { uses, has_normals, ..ColumnMap::default() }
    }

    /// Finds the columns by their names; a normal counts when all three of its columns are present.
    /// The names of surveyors and other programs stand for a slot ([`slot_by_alias`]) if no column has
    /// its plain name. Other columns are extras, each under a unique channel
    /// name; columns called `None` have no single number. The error names a missing or a repeated
    /// column.
    pub fn from_names<'a>(
        names: impl Iterator<Item = Option<&'a str>>,
    ) -> Result<ColumnMap, String> {
        let names: Vec<Option<&str>> = names.collect();
        let mut columns = ColumnMap::default();
        let slots = find_slots(&names, &mut columns.differences)?;
        let mut taken = UniqueNames::default();
        for (column, name) in names.iter().enumerate() {
            let Some(name) = name else { continue };
            if let Some(slot) = slots.iter().position(|own| *own == Some(column)) {
                columns.uses.push((column, Use::Slot(slot)));
                continue;
            }
            let is_weight = name.eq_ignore_ascii_case("weight");
            let wanted = if is_weight { "weight".into() } else { channel_name(name, column) };
            let own = taken.make_unique(wanted);
            if own != *name && !(is_weight && own == "weight") {
                columns.differences.rename(name, &own);
            }
            columns.uses.push((column, Use::Extra(columns.extras.len())));
            columns.extras.push(ExtraColumn { name: own, column, kind: ColumnKind::Number });
        }
        if let Some(missing) = (0..3).find(|&slot| slots[slot].is_none()) {
            return Err(missing_message(missing, &names));
        }
        columns.has_normals = !slots.contains(&None);
        if !columns.has_normals {
            columns.uses.retain(|(_, use_)| !matches!(use_, Use::Slot(3..)));
            for slot in (3..6).filter(|&slot| slots[slot].is_some()) {
                let name = SLOTS[slot][0];
                columns.differences.leave_out(format!("{name}, which is a part of a normal"));
            }
        }
        Ok(columns)
    }

    /// Returns whether `column` is a coordinate or a part of a normal.
    pub fn fills_slot(&self, column: usize) -> bool {
        let at = self.uses.binary_search_by_key(&column, |&(own, _)| own);
        at.is_ok_and(|at| matches!(self.uses[at].1, Use::Slot(_)))
    }

    /// Sets the kind of each extra column to `kind` of its name and column.
    pub fn with_kinds(mut self, kind: impl Fn(&str, usize) -> ColumnKind) -> ColumnMap {
        for extra in &mut self.extras {
            extra.kind = kind(&extra.name, extra.column);
        }
        self
    }

    /// Returns the columns other than positions and normals.
    pub fn extras(&self) -> &[ExtraColumn] {
        &self.extras
    }

    /// Returns whether rows have a normal.
    pub fn has_normals(&self) -> bool {
        self.has_normals
    }

    /// Returns the differences between the channel names and the column names.
    pub fn differences(&self) -> &Differences {
        &self.differences
    }

    /// Moves each column to `place` of it, which keeps their order.
    pub fn with_moved_columns(mut self, place: impl Fn(usize) -> usize) -> ColumnMap {
        self.uses.iter_mut().for_each(|(column, _)| *column = place(*column));
        self.extras.iter_mut().for_each(|extra| extra.column = place(extra.column));
        self
    }

    /// Returns the column of each coordinate and part of a normal.
    pub fn slot_columns(&self) -> [Option<usize>; 6] {
        std::array::from_fn(|slot| {
            let own = self.uses.iter().find(|(_, own)| *own == Use::Slot(slot));
            own.map(|(column, _)| *column)
        })
    }

    /// Returns the three columns of positions.
    pub fn position_columns(&self) -> [usize; 3] {
        let place = |slot| self.uses.iter().find(|(_, own)| *own == Use::Slot(slot));
        [0, 1, 2].map(|slot| place(slot).map_or(0, |&(column, _)| column))
    }

    /// Fills `vertex` with `value` of each column.
    pub fn fill(&self, vertex: &mut Vertex, value: impl Fn(usize) -> f64) {
        vertex.clear();
        for &(column, own) in &self.uses {
            match own {
                Use::Slot(slot) => vertex.set_slot(slot, value(column)),
                Use::Extra(_) => vertex.extras.push(value(column)),
            }
        }
    }

    /// Fills `vertex` with the numbers in the words of `line`. Positions and normals must be
    /// numbers; any other word that is no number becomes NaN.
    pub fn parse<'a>(
        &self,
        vertex: &mut Vertex,
        words: impl Iterator<Item = &'a str> + Clone,
        line: usize,
    ) -> Result<(), ContentError> {
        self.parse_with(vertex, words, line, number)
    }

    /// Fills `vertex` as [`parse`](Self::parse), with the numbers that `number` finds in words.
    pub fn parse_with<'a>(
        &self,
        vertex: &mut Vertex,
        words: impl Iterator<Item = &'a str> + Clone,
        line: usize,
        number: impl Fn(&str) -> Option<f64>,
    ) -> Result<(), ContentError> {
        vertex.clear();
        let (mut rest, mut next) = (words.clone(), 0);
        for &(column, own) in &self.uses {
            let word = rest.nth(column - next);
            next = column + 1;
            let value = word.and_then(&number);
            match (own, value) {
                (Use::Slot(slot), Some(value)) => vertex.set_slot(slot, value),
                (Use::Slot(slot), None) => {
                    let name = SLOTS[slot][0];
                    let what = match word {
                        Some(word) => format!("{name} is {}, not a number", quote_start(word)),
                        None => format!(
                            "the line has {} columns, {name} is expected in column {next}",
                            words.count()
                        ),
                    };
                    return Err(ContentError::line(line, what));
                }
                (Use::Extra(extra), value) => {
                    if let ColumnKind::Text(color) = self.extras[extra].kind
                        && !word.is_some_and(|word| word.bytes().all(|c| c.is_ascii_digit()))
                    {
                        vertex.decimal |= 1 << color;
                    }
                    vertex.extras.push(value.unwrap_or(f64::NAN));
                }
            }
        }
        Ok(())
    }

    /// Records `count` columns without a name as left out.
    pub fn without_unnamed(mut self, count: usize) -> ColumnMap {
        match count {
            0 => {}
            1 => self.differences.leave_out("1 column without a name"),
            _ => self.differences.leave_out(format!("{count} columns without a name")),
        }
        self
    }

    /// Records the columns without a name, up to `width`, as left out.
    pub fn without_names(mut self, width: usize) -> ColumnMap {
        let named = self.uses.len();
        match width.saturating_sub(named) {
            0 => {}
            1 => self.differences.leave_out(format!("column {width}, which has no name")),
            _ => self
                .differences
                .leave_out(format!("columns {} to {width}, which have no names", named + 1)),
        }
        self
    }
}

/// Formats the message for a column whose value in `row`, from 0, is not finite in f32.
pub(super) fn not_a_number_message(name: &str, row: usize) -> String {
    format!("{} (no finite number at point {row})", truncate_name(name))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn named(names: &str) -> Result<ColumnMap, String> {
        ColumnMap::from_names(names.split(',').map(Some))
    }

    #[test]
    fn columns_are_found_by_name() {
        let columns = named("i,Z,Y,X,normal_x,NY,nz").unwrap();
        assert_eq!(columns.position_columns(), [3, 2, 1]);
        let mut vertex = Vertex::default();
        columns.fill(&mut vertex, |column| column as f64);
        assert_eq!((vertex.place, vertex.normal), ([3.0, 2.0, 1.0], [4.0, 5.0, 6.0]));
        assert_eq!(vertex.extras, [0.0]);
        let half = named("x,y,z,nx").unwrap();
        assert!(!half.has_normals() && half.differences().to_string().contains("nx"));
        assert!(named("x,y,X,z").unwrap_err().contains("x is"));
        assert!(named("x,y").unwrap_err().contains("no z"));
        // Letters of four bytes, too, leave the message short.
        let wide = ["\u{1f4a0}".repeat(50).as_str(); 12].join(",");
        let said = named(&wide).unwrap_err();
        assert!(said.len() < 500 && said.ends_with("and 11 more"), "{said}");
    }

    #[test]
    fn names_that_no_channel_has_are_changed_and_noted() {
        let columns = named("x,y,z,a b,,A_b,Weight,WEIGHT,glow").unwrap();
        let own: Vec<&str> = columns.extras().iter().map(|extra| extra.name.as_str()).collect();
        assert_eq!(own, ["a_b", "column_5", "A_b_2", "weight", "weight_2", "glow"]);
        let noted = columns.differences().to_string();
        let want = "changed: a b is called a_b, a column without a name is called column_5, \
                    A_b is called A_b_2, WEIGHT is called weight_2";
        assert_eq!(noted, want);
    }

    #[test]
    fn whole_numbers_are_told_from_others() {
        let columns = named("red,x,y,z,alpha,glow")
            .unwrap()
            .with_kinds(|name, _| color(name).map_or(ColumnKind::Number, ColumnKind::Text));
        let mut vertex = Vertex::default();
        for (line, decimal) in [("7 1 2 3 9 0.5", 0), ("7. 1 2 3 9 1", 1), ("7 1 2 3 -9 1", 8)] {
            columns.parse(&mut vertex, line.split(' '), 1).unwrap();
            assert_eq!((vertex.decimal, vertex.extras.len()), (decimal, 3), "{line}");
        }
    }
}
