//! Panels of curves over labelled axes, with a legend.

use plotters::coord::{CoordTranslate, Shift};
use plotters::element::DashedPathElement;
use plotters::prelude::*;

use super::axis::Axis;
use super::{Axes, COLOURS, Curve, Drawn, FONT, text};

/// Most pixels of the legend's width; longer names are cut. Chosen by hand.
const WIDEST: u32 = 240;
/// Length of a legend entry's piece of curve, and height of its line, pixels. Chosen by hand.
const PIECE: i32 = 26;
const LINE: i32 = 18;
const GUIDE: RGBColor = RGBColor(150, 150, 150);

/// Draws the panel `title` with axis labels.
pub(super) fn draw<B: DrawingBackend>(
    place: &DrawingArea<B, Shift>,
    title: &str,
    labels: [&str; 2],
    axes: Axes,
    curves: &[Curve],
) -> Drawn<B> {
    let logarithmic = match axes {
        Axes::Linear => [false, false],
        Axes::LogarithmicY => [false, true],
        Axes::Logarithmic => [true, true],
    };
    let all =
        |a: usize| curves.iter().flat_map(move |curve| curve.points.iter().map(move |p| p[a]));
    let bands = curves.iter().flat_map(|curve| curve.band.as_flattened());
    let x = Axis::over(all(0), logarithmic[0], false);
    let y = Axis::over(all(1).chain(bands.copied()), logarithmic[1], true);

    let mut list = 0;
    for curve in curves.iter().filter(|curve| !curve.name.is_empty()) {
        list = list.max(place.estimate_text_size(&curve.name, &text())?.0 + PIECE as u32 + 16);
    }
    let width = place.dim_in_pixel().0;
    let (plot, names) = place.split_horizontally(width.saturating_sub(list.min(WIDEST)));
    let mut chart = ChartBuilder::on(&plot)
        .caption(title, (FONT, 18))
        .margin(8)
        .margin_left(16)
        .margin_right(12)
        .x_label_area_size(42)
        .y_label_area_size(68)
        .build_cartesian_2d(x, y)?;
    chart
        .configure_mesh()
        .light_line_style(TRANSPARENT)
        .bold_line_style(BLACK.mix(0.12))
        .x_desc(labels[0])
        .y_desc(labels[1])
        .label_style((FONT, 13))
        .axis_desc_style((FONT, 14))
        .draw()?;

    for (k, curve) in with_color_index(curves) {
        draw_curve(chart.plotting_area(), [x, y], curve, k)?;
    }
    draw_legend(&names, place.dim_in_pixel().1 as i32, curves)
}

/// Draws the band, the line and the marks of the `k`-th curve, where the axes can show them.
fn draw_curve<B: DrawingBackend>(
    area: &DrawingArea<B, Cartesian2d<Axis, Axis>>,
    [x, y]: [Axis; 2],
    curve: &Curve,
    k: usize,
) -> Drawn<B> {
    if curve.band.len() == curve.points.len() {
        let ends = curve.points.iter().zip(&curve.band).filter(|(p, _)| x.can_show(p[0]));
        let low = ends.clone().map(|(p, band)| (p[0], band[0]));
        let high = ends.rev().map(|(p, band)| (p[0], band[1]));
        let outline: Vec<_> = low.chain(high).collect();
        area.draw(&Polygon::new(outline, colour(curve, k).mix(0.15)))?;
    }
    let shown = |p: &&[f64; 2]| x.can_show(p[0]) && y.can_show(p[1]);
    let path: Vec<_> = curve.points.iter().filter(shown).map(|&[x, y]| (x, y)).collect();
    stroke(area, curve, k, path.clone())?;
    if !curve.guide {
        path.into_iter().try_for_each(|at| mark(area, at, k))?;
    }
    Ok(())
}

/// Draws the names of the curves in the middle of `height`.
fn draw_legend<B: DrawingBackend>(
    names: &DrawingArea<B, Shift>,
    height: i32,
    curves: &[Curve],
) -> Drawn<B> {
    let top = (height - LINE * curves.len() as i32).max(2 * LINE) / 2;
    let named = with_color_index(curves).filter(|(_, curve)| !curve.name.is_empty());
    for (row, (k, curve)) in named.enumerate() {
        let at = top + LINE * row as i32;
        stroke(names, curve, k, vec![(0, at), (PIECE, at)])?;
        if !curve.guide {
            mark(names, (PIECE / 2, at), k)?;
        }
        names.draw(&Text::new(curve.name.as_str(), (PIECE + 8, at), text()))?;
    }
    Ok(())
}

/// Numbers the curves that have a colour.
fn with_color_index(curves: &[Curve]) -> impl Iterator<Item = (usize, &Curve)> {
    curves.iter().scan(0, |next, curve| {
        let k = *next;
        *next += usize::from(!curve.guide);
        Some((k, curve))
    })
}

fn colour(curve: &Curve, k: usize) -> RGBColor {
    if curve.guide { GUIDE } else { COLOURS[k % COLOURS.len()] }
}

/// Draws a line, dashed and thin for a guide.
fn stroke<B: DrawingBackend, C: CoordTranslate>(
    area: &DrawingArea<B, C>,
    curve: &Curve,
    k: usize,
    path: Vec<C::From>,
) -> Drawn<B>
where
    C::From: Clone + 'static,
{
    let colour = colour(curve, k);
    if curve.guide {
        return area.draw(&DashedPathElement::new(path, 6, 4, colour.stroke_width(1)));
    }
    area.draw(&PathElement::new(path, colour.stroke_width(2)))
}

/// Draws the marker of the `k`-th curve. The number of shapes has no common divisor with the number
/// of colours, so that no shape repeats in a colour before all combinations are used.
fn mark<B: DrawingBackend, C: CoordTranslate>(
    area: &DrawingArea<B, C>,
    at: C::From,
    k: usize,
) -> Drawn<B>
where
    C::From: Clone + 'static,
{
    let colour = COLOURS[k % COLOURS.len()];
    match k % 5 {
        0 => area.draw(&Circle::new(at, 4, colour.filled())),
        1 => {
            area.draw(&(EmptyElement::at(at) + Rectangle::new([(-3, -3), (4, 4)], colour.filled())))
        }
        2 => area.draw(&TriangleMarker::new(at, 6, colour.filled())),
        3 => area.draw(&Cross::new(at, 4, colour.stroke_width(2))),
        _ => area.draw(&Circle::new(at, 4, colour.stroke_width(2))),
    }
}
