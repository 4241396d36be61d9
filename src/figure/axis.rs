//! Axes: the position of a value along an axis, and the labelled values.

use std::ops::Range;

use plotters::coord::ranged1d::{KeyPointHint, NoDefaultFormatting, Ranged, ValueFormatter};

/// An axis, linear or logarithmic (base 10): the position of a value is the value or its logarithm.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Axis {
    logarithmic: bool,
    /// Positions of its ends.
    low: f64,
    high: f64,
}

/// Margin beyond the values at either end, as a share of the axis. Chosen by hand.
const MARGIN: f64 = 0.03;
/// Approximate number of labels on an axis. Chosen by hand.
const TARGET_LABELS: f64 = 7.0;

impl Axis {
    /// Creates an axis over all of `values` that it can show; a linear axis that is `grounded`
    /// includes zero.
    pub(super) fn over(
        values: impl Iterator<Item = f64>,
        logarithmic: bool,
        grounded: bool,
    ) -> Self {
        let (mut low, mut high) = values
            .filter_map(|value| place(value, logarithmic))
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), x| (l.min(x), h.max(x)));
        let grounded = grounded && !logarithmic;
        if grounded && low <= high {
            (low, high) = (low.min(0.0), high.max(0.0));
        }
        if low == high {
            let some = 0.5 * low.abs().max(1e-3);
            (low, high) = (low - some, high + some);
        } else if low > high {
            (low, high) = (0.0, 1.0);
        }
        let more = MARGIN * (high - low);
        let bottom = if grounded && low == 0.0 { low } else { low - more };
        Axis { logarithmic, low: bottom, high: high + more }
    }

    /// Returns whether `value` has a position on the axis.
    pub(super) fn can_show(&self, value: f64) -> bool {
        place(value, self.logarithmic).is_some()
    }

    /// Returns the value at `place`.
    fn value(&self, place: f64) -> f64 {
        if self.logarithmic { 10f64.powf(place) } else { place }
    }

    /// Returns the positions of the labels.
    fn ticks(&self) -> Vec<f64> {
        let span = self.high - self.low;
        if self.logarithmic && span < TARGET_LABELS {
            // 1, 2, 5 in every decade, 1 and 3, or 1 alone, as space allows.
            let within: &[f64] = match span {
                span if span < 2.9 => &[1.0, 2.0, 5.0],
                span if span < 4.5 => &[1.0, 3.0],
                _ => &[1.0],
            };
            let decades = self.low.floor() as i32..=self.high.floor() as i32;
            let all = decades.flat_map(|d| within.iter().map(move |m| f64::from(d) + m.log10()));
            return all.filter(|place| (self.low..=self.high).contains(place)).collect();
        }
        let mut step = self.step();
        if self.logarithmic {
            step = step.ceil();
        }
        let first = (self.low / step).ceil() as i64;
        let last = (self.high / step).floor() as i64;
        (first..=last).map(|k| k as f64 * step).collect()
    }

    /// Returns the label at a position of [`ticks`](Self::ticks).
    fn label(&self, place: f64) -> String {
        // The logarithm of a power of ten may be a little below its integer.
        let power = if self.logarithmic { place + 1e-9 } else { self.step().log10() + 1e-9 };
        number(self.value(place), power.floor() as i32)
    }

    /// Returns the step between evenly spaced labels.
    fn step(&self) -> f64 {
        round_step((self.high - self.low) / TARGET_LABELS)
    }
}

impl Ranged for Axis {
    type FormatOption = NoDefaultFormatting;
    type ValueType = f64;

    /// Values without a position, or beyond an end, are drawn at the end: zero at the lower end of
    /// a logarithmic axis.
    fn map(&self, value: &f64, limit: (i32, i32)) -> i32 {
        let place = place(*value, self.logarithmic).unwrap_or(self.low);
        let share = (place.clamp(self.low, self.high) - self.low) / (self.high - self.low);
        limit.0 + (share * f64::from(limit.1 - limit.0)).round() as i32
    }

    fn key_points<Hint: KeyPointHint>(&self, _: Hint) -> Vec<f64> {
        self.ticks().into_iter().map(|place| self.value(place)).collect()
    }

    fn range(&self) -> Range<f64> {
        self.value(self.low)..self.value(self.high)
    }
}

impl ValueFormatter<f64> for Axis {
    fn format_ext(&self, value: &f64) -> String {
        place(*value, self.logarithmic).map_or_else(String::new, |place| self.label(place))
    }
}

/// Returns the position of `value`; `None` if it has none.
fn place(value: f64, logarithmic: bool) -> Option<f64> {
    let place = if logarithmic { value.log10() } else { value };
    place.is_finite().then_some(place)
}

/// Rounds up to the next of 1, 2, 5, 10, … times a power of ten.
fn round_step(step: f64) -> f64 {
    let power = 10f64.powf(step.log10().floor());
    let times = [1.0, 2.0, 5.0].into_iter().find(|m| m * power >= step * (1.0 - 1e-9));
    times.unwrap_or(10.0) * power
}

/// Formats `value` up to the digit of 10^`power`.
fn number(value: f64, power: i32) -> String {
    match power {
        // Adding zero turns -0 into 0.
        -4..0 => format!("{:.*}", power.unsigned_abs() as usize, value + 0.0),
        0..5 => format!("{:.0}", value + 0.0),
        _ if value == 0.0 => "0".into(),
        _ => {
            let digits = value.abs().log10().floor() as i32 - power;
            format!("{value:.*e}", digits.max(0) as usize)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn labels(values: &[f64], logarithmic: bool) -> Vec<String> {
        let axis = Axis::over(values.iter().copied(), logarithmic, true);
        axis.ticks().into_iter().map(|place| axis.label(place)).collect()
    }

    #[test]
    fn labels_are_plain_and_round() {
        assert_eq!(labels(&[0.001, 0.021], false), ["0.000", "0.005", "0.010", "0.015", "0.020"]);
        assert_eq!(labels(&[-31.0, 90.0], false), ["-20", "0", "20", "40", "60", "80"]);
        assert_eq!(labels(&[2e8], false), ["0", "5e7", "1.0e8", "1.5e8", "2.0e8"]);
        assert_eq!(labels(&[500.0, 2e3], true), ["500", "1000", "2000"]);
        assert_eq!(labels(&[0.0, -1.0, 0.02, 200.0], true).join(" "), "0.03 0.1 0.3 1 3 10 30 100");
        assert_eq!(labels(&[1e-9, 1e7], true), ["1e-5", "1", "1e5"]);
    }

    #[test]
    fn any_values_make_an_axis() {
        let odd: [&[f64]; 5] = [&[], &[f64::NAN], &[0.0], &[-3.0, -3.0], &[1e300, f64::INFINITY]];
        for (values, logarithmic) in odd.iter().flat_map(|values| [(values, false), (values, true)])
        {
            let axis = Axis::over(values.iter().copied(), logarithmic, false);
            assert!(axis.high > axis.low && axis.ticks().len() < 50, "{values:?}: {axis:?}");
            assert!((0..=100).contains(&axis.map(&0.0, (0, 100))));
        }
    }
}
