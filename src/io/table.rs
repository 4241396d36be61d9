//! The content of a file: rows of numbers, from which a cloud is made.
//!
//! Dropped rows take no memory, and numbers as much as in the cloud, so that the total is at most a
//! few times the size of the file.

use super::columns::{
    COLORS, ColumnKind, ColumnMap, ExtraColumn, Vertex, color, not_a_number_message,
};
use super::differences::{Differences, truncate_name};
use crate::cloud::{Channels, ColorDepth, PointCloud, find_too_large, normalize_normal};
use crate::error::Result;
use crate::math::Vec3;

/// The content of a file.
#[derive(Debug)]
pub(super) struct PointTable {
    places: TablePositions,
    normals: Option<Vec<[f32; 3]>>,
    columns: Vec<TableColumn>,
    viewpoint: Option<Vec3>,
    /// Rows that were added, including dropped ones.
    rows: usize,
    /// Rows that the format marks as measurements without a return, which are not among these.
    no_returns: usize,
    /// Keeps rows that are not finite, because other elements refer to rows by number.
    keeps_non_finite: bool,
    /// Leaves out columns that are 0 in all rows.
    drops_zeros: bool,
    /// Colours in text that are not all whole numbers, one bit each.
    decimal: u8,
    differences: Differences,
}

/// Coordinates, in the precision of the file.
#[derive(Debug)]
enum TablePositions {
    Single(Vec<[f32; 3]>),
    Double(Vec<Vec3>),
}

/// A column other than positions and normals.
#[derive(Debug)]
struct TableColumn {
    name: String,
    kind: ColumnKind,
    numbers: Vec<f32>,
    /// Rows so far while all are 0, which take no memory.
    zeros: usize,
    /// Packed colours, instead of numbers.
    bits: Vec<u32>,
    /// Expected number of values.
    capacity: usize,
    /// The first kept row without a finite number.
    bad: Option<usize>,
    range: [f64; 2],
    /// Largest rounding error against the file.
    error: f64,
}

impl PointTable {
    /// Creates an empty table of these columns with room for `capacity` rows.
    pub fn new(capacity: usize, columns: &ColumnMap) -> Self {
        let normals = columns.has_normals().then(|| Vec::with_capacity(capacity));
        PointTable {
            places: TablePositions::Double(Vec::with_capacity(capacity)),
            normals,
            columns: columns
                .extras()
                .iter()
                .map(|extra| TableColumn::new(extra, capacity))
                .collect(),
            viewpoint: None,
            rows: 0,
            no_returns: 0,
            keeps_non_finite: false,
            drops_zeros: false,
            decimal: 0,
            differences: columns.differences().clone(),
        }
    }

    /// Creates the same table for coordinates that are exact in f32.
    pub fn single_precision(capacity: usize, columns: &ColumnMap) -> Self {
        let mut table = PointTable::new(0, columns).with_column_capacity(capacity);
        table.places = TablePositions::Single(Vec::with_capacity(capacity));
        table.normals.iter_mut().for_each(|normals| normals.reserve_exact(capacity));
        table
    }

    /// Sets the room to `capacity` numbers in each column other than positions and normals,
    /// allocated with its first number.
    pub fn with_column_capacity(mut self, capacity: usize) -> Self {
        self.columns.iter_mut().for_each(|column| column.capacity = capacity);
        self
    }

    /// Returns the peak bytes per point of these columns while the cloud is made.
    pub fn point_size(columns: &ColumnMap, is_single: bool) -> usize {
        let place = if is_single { 12 } else { 24 };
        let normal = if columns.has_normals() { 12 } else { 0 };
        let extra = |extra: &ExtraColumn| match extra.kind {
            ColumnKind::Packed { alpha } | ColumnKind::PackedFloat { alpha } => {
                16 + 4 * usize::from(alpha)
            }
            // A second copy in f64.
            _ if extra.name == "weight" => 12,
            _ => 4,
        };
        place + 12 + normal + columns.extras().iter().map(extra).sum::<usize>()
    }

    /// Makes the table leave out columns that are 0 in all rows, without a word.
    #[cfg(feature = "formats")]
    pub fn without_zero_columns(self) -> Self {
        PointTable { drops_zeros: true, ..self }
    }

    /// Makes the table keep rows that are not finite.
    pub fn keep_non_finite(self) -> Self {
        PointTable { keeps_non_finite: true, ..self }
    }

    /// Sets the viewpoint.
    pub fn with_viewpoint(self, viewpoint: Option<Vec3>) -> Self {
        PointTable { viewpoint, ..self }
    }

    /// Puts the `differences` of the other parts of the file before those of the table.
    pub fn with_differences(self, differences: Differences) -> Self {
        PointTable { differences: differences.merge(self.differences), ..self }
    }

    /// Adds a row. The error names a coordinate that is too large to compute with.
    pub fn push(&mut self, vertex: &Vertex) -> std::result::Result<(), String> {
        let row = self.rows;
        self.rows += 1;
        let finite = vertex.place.iter().all(|x| x.is_finite());
        if finite && let Some(value) = find_too_large(vertex.place) {
            let axis = ["x", "y", "z"][vertex.place.iter().position(|&x| x == value).unwrap_or(0)];
            return Err(format!(
                "{axis} is {value:e}: coordinates within 1e75 of zero can be computed with; look \
                 for stray points, or for another column"
            ));
        }
        if !finite && !self.keeps_non_finite {
            return Ok(());
        }
        match &mut self.places {
            TablePositions::Single(places) => places.push(vertex.place.map(|x| x as f32)),
            TablePositions::Double(places) => places.push(vertex.place),
        }
        if let Some(normals) = &mut self.normals {
            normals.push(normalize_normal(vertex.normal));
        }
        for (column, &value) in self.columns.iter_mut().zip(&vertex.extras) {
            column.push(value, row);
        }
        self.decimal |= vertex.decimal;
        Ok(())
    }

    /// Counts a row that the format marks as a measurement without a return.
    pub fn skip_no_return(&mut self) {
        self.no_returns += 1;
    }

    /// Returns the number of rows that were added.
    pub fn len(&self) -> usize {
        self.rows
    }

    /// Returns the positions alone.
    pub fn into_points(self) -> Vec<Vec3> {
        match self.places {
            TablePositions::Single(places) => {
                places.iter().map(|place| place.map(f64::from)).collect()
            }
            TablePositions::Double(places) => places,
        }
    }

    /// Makes the cloud of these rows: a column called weight has the weights of the points, others
    /// are channels. A column with a number that f32 does not hold at a kept point is left out,
    /// because the user may not need it, and recorded in the differences.
    pub fn into_cloud(mut self) -> Result<(PointCloud, Differences)> {
        let depth = self.text_depth();
        let mut differences = std::mem::take(&mut self.differences);
        let mut channels = Channels::default();
        let mut weights = None;
        let is_color = |column: &TableColumn| matches!(column.kind, ColumnKind::Text(_));
        let has_color = self.columns.iter().any(|column| is_color(column) && column.zeros == 0);
        for mut column in std::mem::take(&mut self.columns) {
            // A colour may lack one of its parts everywhere.
            if column.zeros > 0 && self.drops_zeros && !(has_color && is_color(&column)) {
                continue;
            }
            column.store_zeros();
            if let ColumnKind::Text(bit) = column.kind
                && self.decimal & (1 << bit) != 0
            {
                column.kind = ColumnKind::Number;
            }
            if column.name == "weight" {
                weights = Some(column.numbers);
            } else {
                channels = column.into_channels(channels, depth, &mut differences)?;
            }
        }
        // Frees the memory of the positions before anything else is allocated.
        let cloud = match self.places {
            TablePositions::Single(places) => PointCloud::from_f32(&places),
            TablePositions::Double(places) => PointCloud::new(&places),
        }?;
        let dropped = self.rows - cloud.len();
        let cloud = cloud.with_read(self.normals, channels, dropped)?;
        let mut cloud = cloud.with_no_returns(self.no_returns);
        if let Some(weights) = weights {
            cloud = with_valid_weights(cloud, weights, &mut differences)?;
        }
        if let Some(viewpoint) = self.viewpoint {
            cloud = cloud.with_viewpoint(viewpoint)?;
        }
        Ok((cloud, differences))
    }

    /// Returns the colour depth in text: the columns red, green and blue must have only whole
    /// numbers up to 255, or up to 65535.
    fn text_depth(&self) -> Option<ColorDepth> {
        let most = |bit: usize| {
            let mut named =
                self.columns.iter().filter(|column| column.kind == ColumnKind::Text(bit));
            let column = named.find(|column| column.name.eq_ignore_ascii_case(COLORS[bit]))?;
            let whole = self.decimal & (1 << bit) == 0 && column.bad.is_none();
            whole.then(|| column.range[1].max(0.0))
        };
        let most = most(0)?.max(most(1)?).max(most(2)?);
        let depths = [ColorDepth::Eight, ColorDepth::Sixteen].into_iter();
        depths.into_iter().find(|depth| most <= f64::from(depth.max()))
    }
}

/// Adds weights; those that are none are left out, because nobody may have asked for them.
fn with_valid_weights(
    cloud: PointCloud,
    weights: Vec<f32>,
    differences: &mut Differences,
) -> Result<PointCloud> {
    let bad = weights.iter().position(|weight| !weight.is_finite() || *weight < 0.0);
    let reason = match bad {
        Some(row) => format!("it is {} at point {row}, and weights are 0 or more", weights[row]),
        None if !weights.is_empty() && weights.iter().all(|&weight| weight == 0.0) => {
            "all are 0, which would leave no point".into()
        }
        None => return cloud.with_weights(weights.into_iter().map(f64::from).collect()),
    };
    differences.note(format!("the column weight is left out: {reason}"));
    Ok(cloud)
}

impl TableColumn {
    fn new(extra: &ExtraColumn, capacity: usize) -> Self {
        TableColumn {
            name: extra.name.clone(),
            kind: extra.kind,
            numbers: Vec::new(),
            zeros: 0,
            bits: Vec::new(),
            capacity,
            bad: None,
            range: [f64::INFINITY, f64::NEG_INFINITY],
            error: 0.0,
        }
    }

    fn push(&mut self, value: f64, row: usize) {
        let number = value as f32;
        let is_weight = self.name == "weight";
        if self.bad.is_some() {
            return;
        }
        if !number.is_finite() && !is_weight {
            self.bad = Some(row);
            (self.numbers, self.bits, self.zeros) = Default::default();
            return;
        }
        let is_plain = matches!(self.kind, ColumnKind::Number | ColumnKind::Text(_));
        if is_plain && number == 0.0 && number.is_sign_positive() && self.numbers.is_empty() {
            self.zeros += 1;
            return;
        }
        self.store_zeros();
        if self.capacity > 0 {
            match self.kind {
                ColumnKind::Packed { .. } | ColumnKind::PackedFloat { .. } => {
                    self.bits.reserve_exact(self.capacity);
                }
                _ => self.numbers.reserve_exact(self.capacity),
            }
            self.capacity = 0;
        }
        match self.kind {
            ColumnKind::PackedFloat { .. } => self.bits.push(number.to_bits()),
            ColumnKind::Packed { .. } => self.bits.push(value as i64 as u32),
            ColumnKind::Color(depth) => self.numbers.push((value / f64::from(depth.max())) as f32),
            ColumnKind::Number | ColumnKind::Text(_) | ColumnKind::Share => {
                self.range = [self.range[0].min(value), self.range[1].max(value)];
                self.error = self.error.max((value - f64::from(number)).abs());
                self.numbers.push(number);
            }
        }
    }

    /// Stores the zeros that took no memory so far.
    fn store_zeros(&mut self) {
        let zeros = std::mem::take(&mut self.zeros);
        if zeros > 0 {
            self.numbers.reserve_exact(std::mem::take(&mut self.capacity).max(zeros));
            self.numbers.resize(zeros, 0.0);
            self.range = [0.0, 0.0];
        }
    }

    /// Adds the channels of the column: three or four for packed colours.
    fn into_channels(
        self,
        channels: Channels,
        text_depth: Option<ColorDepth>,
        differences: &mut Differences,
    ) -> Result<Channels> {
        if let Some(row) = self.bad {
            differences.leave_out(not_a_number_message(&self.name, row));
        }
        let alpha = match (self.kind, self.bad) {
            (ColumnKind::Packed { alpha } | ColumnKind::PackedFloat { alpha }, None) => alpha,
            (ColumnKind::Packed { .. } | ColumnKind::PackedFloat { .. }, Some(row)) => {
                return Ok(COLORS.iter().fold(channels, |all, color| all.without(color, row)));
            }
            (_, Some(row)) => return Ok(channels.without(&self.name, row)),
            (_, None) => return self.into_channel(channels, text_depth, differences),
        };
        let bytes = &[("red", 16), ("green", 8), ("blue", 0), ("alpha", 24)];
        let bytes = &bytes[..3 + usize::from(alpha)];
        if bytes.iter().any(|(name, _)| channels.get(name).is_some()) {
            differences.leave_out(format!("{}, beside other colours", truncate_name(&self.name)));
            return Ok(channels);
        }
        bytes.iter().try_fold(channels, |channels, &(name, shift)| {
            let share = |&bits: &u32| (f64::from((bits >> shift) & 255) / 255.0) as f32;
            channels.with_color(name, self.bits.iter().map(share).collect(), ColorDepth::Eight)
        })
    }

    fn into_channel(
        mut self,
        channels: Channels,
        text_depth: Option<ColorDepth>,
        differences: &mut Differences,
    ) -> Result<Channels> {
        if channels.get(&self.name).is_some() {
            differences.leave_out(format!("{}, which is there twice", truncate_name(&self.name)));
            return Ok(channels);
        }
        self.numbers.shrink_to_fit();
        // Relative to the range of the column's numbers: chosen by hand.
        if self.error > 1e-5 * (self.range[1] - self.range[0]) && self.range[1] > self.range[0] {
            let by = self.error;
            differences
                .change(format!("{} is rounded by up to {by:.1e}", truncate_name(&self.name)));
        }
        let depth = match self.kind {
            ColumnKind::Color(depth) => Some(depth),
            ColumnKind::Share if color(&self.name).is_some() => {
                let is_share = self.range[0] >= 0.0 && self.range[1] <= 1.0;
                is_share.then_some(ColorDepth::Eight)
            }
            ColumnKind::Text(_) if color(&self.name).is_some() => {
                let depth = text_depth.filter(|depth| self.range[1] <= f64::from(depth.max()));
                if let Some(depth) = depth {
                    let whole = f64::from(depth.max());
                    self.numbers.iter_mut().for_each(|x| *x = (f64::from(*x) / whole) as f32);
                }
                depth
            }
            _ => None,
        };
        match depth {
            Some(depth) => channels.with_color(&self.name, self.numbers, depth),
            None => channels.with(&self.name, self.numbers),
        }
    }
}
