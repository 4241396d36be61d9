//! Panels of points in the plane.

use plotters::coord::Shift;
use plotters::drawing::DrawingAreaErrorKind;
use plotters::prelude::*;

use super::{COLOURS, Dots, Drawn, FONT, text};

/// Height of the title, pixels. Chosen by hand.
pub(super) const TITLE: u32 = 34;
/// Height of the legend, pixels. Chosen by hand.
const NAMES: u32 = 24;
pub(super) const EDGE: f64 = 8.0;

pub(super) fn draw<B: DrawingBackend>(
    place: &DrawingArea<B, Shift>,
    title: &str,
    sets: &[Dots],
) -> Drawn<B> {
    let (title_place, rest) = place.split_vertically(TITLE);
    title_place.margin(4, 0, 0, 0).titled(title, (FONT, 18))?;
    let named: Vec<(&str, RGBColor)> =
        sets.iter().zip(COLOURS.iter().cycle()).map(|(set, &c)| (set.name.as_str(), c)).collect();
    let plot = draw_legend(&rest, &named)?;
    let size = plot.dim_in_pixel();
    let (low, high) = robust_center(sets.iter().flat_map(|set| &set.points));
    // One scale for both axes: the tighter one.
    let room = [size.0, size.1].map(|pixels| (f64::from(pixels) - 2.0 * EDGE).max(1.0));
    let scale = (0..2).map(|a| (high[a] - low[a]) / room[a]).fold(0.0, f64::max) * 1.04;
    let middle = [0, 1].map(|a| (low[a] + high[a]) / 2.0);
    let centre = [size.0, size.1].map(|pixels| f64::from(pixels) / 2.0);
    for (set, colour) in sets.iter().zip(COLOURS.iter().cycle()) {
        let style = colour.mix(0.6).filled();
        for &[x, y] in &set.points {
            let at = [(x - middle[0]) / scale, (middle[1] - y) / scale];
            if (0..2).all(|a| at[a].abs() <= room[a] / 2.0) {
                let [x, y] = [0, 1].map(|a| (centre[a] + at[a]).round() as i32);
                plot.draw(&Circle::new((x, y), 1, style))?;
            }
        }
    }
    Ok(())
}

/// Draws a legend of the names that are not empty in one line at the bottom; returns the area
/// above.
pub(super) fn draw_legend<B: DrawingBackend>(
    place: &DrawingArea<B, Shift>,
    named: &[(&str, RGBColor)],
) -> Result<DrawingArea<B, Shift>, DrawingAreaErrorKind<B::ErrorType>> {
    const DOT: i32 = 12;
    const GAP: i32 = 18;
    let named: Vec<_> = named.iter().filter(|(name, _)| !name.is_empty()).collect();
    if named.is_empty() {
        return Ok(place.clone());
    }
    let above = place.dim_in_pixel().1.saturating_sub(NAMES);
    let (plot, place) = place.split_vertically(above);
    let mut widths = Vec::new();
    for (name, _) in &named {
        widths.push(DOT + place.estimate_text_size(name, &text())?.0 as i32);
    }
    let all = widths.iter().sum::<i32>() + GAP * (widths.len() as i32 - 1);
    let (width, height) = place.dim_in_pixel();
    let mut x = (width as i32 - all) / 2;
    for ((name, colour), width) in named.into_iter().zip(widths) {
        let middle = height as i32 / 2;
        place.draw(&Circle::new((x + 3, middle), 4, colour.filled()))?;
        place.draw(&Text::new(*name, (x + DOT, middle), text()))?;
        x += width + GAP;
    }
    Ok(plot)
}

/// Returns a bounding box that is robust to outliers: the central nine tenths of the coordinates,
/// enlarged by half on every side, at most to the extreme points.
fn robust_center<'a>(points: impl Iterator<Item = &'a [f64; 2]>) -> ([f64; 2], [f64; 2]) {
    let points: Vec<&[f64; 2]> = points.filter(|p| p.iter().all(|x| x.is_finite())).collect();
    let (mut low, mut high) = ([0.0; 2], [1.0; 2]);
    for a in 0..2 {
        let mut along: Vec<f64> = points.iter().map(|p| p[a]).collect();
        if along.is_empty() {
            continue;
        }
        along.sort_by(f64::total_cmp);
        let at = |share: f64| along[(share * (along.len() - 1) as f64) as usize];
        (low[a], high[a]) = (at(0.0), at(1.0));
        let (first, last) = (at(0.05), at(0.95));
        let more = 0.5 * (last - first);
        if more > 0.0 {
            (low[a], high[a]) = (low[a].max(first - more), high[a].min(last + more));
        }
        if low[a] == high[a] {
            let some = low[a].abs().max(1.0) * 1e-3;
            (low[a], high[a]) = (low[a] - some, high[a] + some);
        }
    }
    (low, high)
}
