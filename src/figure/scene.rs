//! Panels of points in space, seen from one side.

use plotters::coord::Shift;
use plotters::prelude::*;

use super::points::{EDGE, TITLE, draw_legend};
use super::{Drawn, FONT, Scene};

/// Largest dots, pixels. Chosen by hand.
const THICKEST: f64 = 3.0;

pub(super) fn draw<B: DrawingBackend>(
    place: &DrawingArea<B, Shift>,
    title: &str,
    scene: &Scene,
) -> Drawn<B> {
    let (title_place, rest) = place.split_vertically(if title.is_empty() { 0 } else { TITLE });
    if !title.is_empty() {
        title_place.margin(4, 0, 0, 0).titled(title, (FONT, 18))?;
    }
    let colour = |[r, g, b]: [u8; 3]| RGBColor(r, g, b);
    let named: Vec<(&str, RGBColor)> =
        scene.names.iter().map(|(name, rgb)| (name.as_str(), colour(*rgb))).collect();
    let plot = draw_legend(&rest, &named)?;
    let size = plot.dim_in_pixel();
    let room = [size.0, size.1].map(|pixels| (f64::from(pixels) / 2.0 - EDGE).max(1.0));
    // The shorter side shows the requested extent.
    let scale = scene.reach.max(f64::MIN_POSITIVE) / room[0].min(room[1]);
    let radius = (scene.radius / scale).clamp(1.0, THICKEST).round() as i32;
    for dot in &scene.dots {
        let off = [0, 1].map(|axis| (dot.at[axis] - scene.middle[axis]) / scale);
        if (0..2).all(|axis| off[axis].abs() <= room[axis]) {
            let x = (f64::from(size.0) / 2.0 + off[0]).round() as i32;
            let y = (f64::from(size.1) / 2.0 - off[1]).round() as i32;
            plot.draw(&Circle::new((x, y), radius, colour(dot.colour).filled()))?;
        }
    }
    Ok(())
}
