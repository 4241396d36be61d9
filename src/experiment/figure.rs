//! Figures as SVG and PNG: panels of points seen from one side, or of curves.

use std::path::Path;
use std::sync::Once;

use plotters::coord::Shift;
use plotters::coord::cartesian::Cartesian2d;
use plotters::coord::ranged1d::Ranged;
use plotters::prelude::*;
use plotters::style::{FontStyle, register_font};

use crate::error::{Error, Result};

/// Panels in rows.
#[derive(Debug, Clone)]
pub struct Figure {
    /// Row by row.
    pub panels: Vec<Panel>,
    /// Panels in a row, at least 1.
    pub columns: usize,
    /// Width and height of a panel, pixels.
    pub size: (u32, u32),
}

/// A part of a figure.
#[derive(Debug, Clone)]
pub struct Panel {
    /// Above it.
    pub title: String,
    /// Within it.
    pub content: Content,
}

/// What a panel shows.
#[derive(Debug, Clone)]
pub enum Content {
    /// Sets of points in the plane, at one scale on both axes, the later ones on top.
    Points(Vec<Vec<[f64; 2]>>),
    /// Curves over labelled axes.
    Curves {
        /// Label of the abscissa, with its unit.
        x: String,
        /// Label of the ordinate, with its unit.
        y: String,
        /// Whether both axes are logarithmic: points that are not above zero are left out.
        logarithmic: bool,
        /// Name and points of each.
        curves: Vec<(String, Vec<[f64; 2]>)>,
    },
}

/// Colours that are told apart by most eyes (Okabe and Ito 2008).
const COLOURS: [RGBColor; 8] = [
    RGBColor(0, 114, 178),
    RGBColor(213, 94, 0),
    RGBColor(0, 158, 115),
    RGBColor(204, 121, 167),
    RGBColor(230, 159, 0),
    RGBColor(86, 180, 233),
    RGBColor(0, 0, 0),
    RGBColor(120, 120, 120),
];
const FONT: &str = "sans-serif";

impl Figure {
    /// Writes `stem.svg` and `stem.png`.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn save(&self, stem: &Path) -> Result<()> {
        static FONTS: Once = Once::new();
        // The same letters on every machine, also where there are no fonts.
        FONTS.call_once(|| {
            let _ = register_font(FONT, FontStyle::Normal, epaint_default_fonts::UBUNTU_LIGHT);
        });
        let columns = self.columns.max(1);
        let rows = self.panels.len().div_ceil(columns).max(1);
        let size = (self.size.0 * columns as u32, self.size.1 * rows as u32);
        let (svg, png) = (stem.with_extension("svg"), stem.with_extension("png"));
        let failed = |path: &Path, error: &dyn std::fmt::Display| {
            Error::io(path, std::io::Error::other(error.to_string()))
        };
        let area = SVGBackend::new(&svg, size).into_drawing_area();
        self.draw(&area, rows).map_err(|error| failed(&svg, &error))?;
        let area = BitMapBackend::new(&png, size).into_drawing_area();
        self.draw(&area, rows).map_err(|error| failed(&png, &error))
    }

    fn draw<B: DrawingBackend>(&self, area: &DrawingArea<B, Shift>, rows: usize) -> Drawn<B> {
        area.fill(&WHITE)?;
        for (panel, place) in self.panels.iter().zip(area.split_evenly((rows, self.columns.max(1))))
        {
            match &panel.content {
                Content::Points(sets) => points(&place, &panel.title, sets)?,
                Content::Curves { x, y, logarithmic, curves } => {
                    let labels = Labels { title: &panel.title, x, y };
                    match logarithmic {
                        false => linear(&place, labels, curves)?,
                        true => double_logarithmic(&place, labels, curves)?,
                    }
                }
            }
        }
        area.present()
    }
}

type Drawn<B> = Result<(), DrawingAreaErrorKind<<B as DrawingBackend>::ErrorType>>;

#[derive(Clone, Copy)]
struct Labels<'a> {
    title: &'a str,
    x: &'a str,
    y: &'a str,
}

fn points<B: DrawingBackend>(
    place: &DrawingArea<B, Shift>,
    title: &str,
    sets: &[Vec<[f64; 2]>],
) -> Drawn<B> {
    let (width, height) = place.dim_in_pixel();
    let (low, high) = central(sets.iter().flatten());
    // One scale for both axes: the tighter one.
    let room = (f64::from(width) - 16.0, f64::from(height) - 40.0);
    let scale = ((high[0] - low[0]) / room.0).max((high[1] - low[1]) / room.1) * 1.04;
    let middle = [0, 1].map(|a| (low[a] + high[a]) / 2.0);
    let half = [scale * room.0 / 2.0, scale * room.1 / 2.0];
    let mut chart =
        ChartBuilder::on(place).caption(title, (FONT, 18)).margin(8).build_cartesian_2d(
            middle[0] - half[0]..middle[0] + half[0],
            middle[1] - half[1]..middle[1] + half[1],
        )?;
    for (set, colour) in sets.iter().zip(COLOURS.iter().cycle()) {
        let style = colour.mix(0.6).filled();
        let within = |p: &&[f64; 2]| (0..2).all(|a| (p[a] - middle[a]).abs() <= half[a]);
        let dots = set.iter().filter(within).map(|&[x, y]| Circle::new((x, y), 1, style));
        chart.draw_series(dots)?;
    }
    Ok(())
}

fn linear<B: DrawingBackend>(
    place: &DrawingArea<B, Shift>,
    labels: Labels<'_>,
    curves: &[(String, Vec<[f64; 2]>)],
) -> Drawn<B> {
    let (low, high) = bounds(curves.iter().flat_map(|(_, points)| points));
    let mut chart = builder(place, labels).build_cartesian_2d(
        low[0]..high[0],
        low[1].min(0.0)..high[1] + 0.05 * (high[1] - low[1]),
    )?;
    chart
        .configure_mesh()
        .light_line_style(TRANSPARENT)
        .x_desc(labels.x)
        .y_desc(labels.y)
        .label_style((FONT, 13))
        .draw()?;
    series(&mut chart, curves)
}

fn double_logarithmic<B: DrawingBackend>(
    place: &DrawingArea<B, Shift>,
    labels: Labels<'_>,
    curves: &[(String, Vec<[f64; 2]>)],
) -> Drawn<B> {
    let above = |p: &&[f64; 2]| p[0] > 0.0 && p[1] > 0.0;
    let (low, high) = bounds(curves.iter().flat_map(|(_, points)| points).filter(above));
    let mut chart = builder(place, labels).build_cartesian_2d(
        (low[0]..high[0] * 1.05).log_scale(),
        (low[1] / 1.5..high[1] * 1.5).log_scale(),
    )?;
    chart
        .configure_mesh()
        .light_line_style(TRANSPARENT)
        .x_desc(labels.x)
        .y_desc(labels.y)
        .x_label_formatter(&|x| format!("{x:.0}"))
        .y_label_formatter(&|y| format!("{y:.0e}"))
        .label_style((FONT, 13))
        .draw()?;
    let kept: Vec<_> = curves
        .iter()
        .map(|(name, points)| (name.clone(), points.iter().filter(above).copied().collect()))
        .collect();
    series(&mut chart, &kept)
}

/// Draws curves and the list of their names.
fn series<'a, B, X, Y>(
    chart: &mut ChartContext<'a, B, Cartesian2d<X, Y>>,
    curves: &[(String, Vec<[f64; 2]>)],
) -> Drawn<B>
where
    B: DrawingBackend + 'a,
    X: Ranged<ValueType = f64>,
    Y: Ranged<ValueType = f64>,
{
    for ((name, points), &colour) in curves.iter().zip(COLOURS.iter().cycle()) {
        let line = points.iter().map(|&[x, y]| (x, y));
        chart
            .draw_series(LineSeries::new(line, colour.stroke_width(2)).point_size(2))?
            .label(name)
            .legend(move |(x, y)| PathElement::new([(x, y), (x + 18, y)], colour.stroke_width(2)));
    }
    chart
        .configure_series_labels()
        .position(SeriesLabelPosition::UpperLeft)
        .background_style(WHITE.mix(0.8))
        .label_font((FONT, 13))
        .draw()
}

fn builder<'a, 'b, B: DrawingBackend>(
    place: &'a DrawingArea<B, Shift>,
    labels: Labels<'_>,
) -> ChartBuilder<'a, 'b, B> {
    let mut builder = ChartBuilder::on(place);
    builder.caption(labels.title, (FONT, 18)).margin(8).x_label_area_size(38).y_label_area_size(64);
    builder
}

/// A box about the points that stray ones do not blow up: about the central nine tenths of
/// the coordinates, half as much more on every side, at most to where there are points.
fn central<'a>(points: impl Iterator<Item = &'a [f64; 2]>) -> ([f64; 2], [f64; 2]) {
    let points: Vec<&[f64; 2]> = points.filter(|p| p.iter().all(|x| x.is_finite())).collect();
    let (mut low, mut high) = bounds(points.iter().copied());
    for a in 0..2 {
        let mut along: Vec<f64> = points.iter().map(|p| p[a]).collect();
        if along.is_empty() {
            continue;
        }
        along.sort_by(f64::total_cmp);
        let at = |share: f64| along[(share * (along.len() - 1) as f64) as usize];
        let (first, last) = (at(0.05), at(0.95));
        let more = 0.5 * (last - first);
        if more > 0.0 {
            (low[a], high[a]) = (low[a].max(first - more), high[a].min(last + more));
        }
    }
    (low, high)
}

/// Lowest and highest coordinates; a box of some size where there are no two places.
fn bounds<'a>(points: impl Iterator<Item = &'a [f64; 2]>) -> ([f64; 2], [f64; 2]) {
    let start = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
    let finite = points.filter(|p| p.iter().all(|x| x.is_finite()));
    let (low, high) = finite.fold(start, |(low, high), p| {
        ([0, 1].map(|a| low[a].min(p[a])), [0, 1].map(|a| high[a].max(p[a])))
    });
    if low[0] > high[0] {
        return ([0.0; 2], [1.0; 2]);
    }
    let pad = |a: usize| if high[a] > low[a] { 0.0 } else { low[a].abs().max(1.0) * 1e-3 };
    ([0, 1].map(|a| low[a] - pad(a)), [0, 1].map(|a| high[a] + pad(a)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn both_files_are_written_and_the_same_again() {
        let folder = tempfile::tempdir().unwrap();
        let curve = |k: f64| (1..9).map(|i| [f64::from(i), k * f64::from(i * i)]).collect();
        let curves = vec![("a".to_string(), curve(1.0)), ("b".to_string(), curve(2.0))];
        let content = |logarithmic| Content::Curves {
            x: "points".into(),
            y: "seconds".into(),
            logarithmic,
            curves: curves.clone(),
        };
        let panel = |content| Panel { title: "A panel".into(), content };
        let figure = Figure {
            panels: vec![
                panel(content(false)),
                panel(content(true)),
                panel(Content::Points(vec![curve(1.0), curve(3.0)])),
                panel(Content::Points(vec![])),
            ],
            columns: 2,
            size: (300, 240),
        };
        let saved = |name: &str| {
            let stem = folder.path().join(name);
            figure.save(&stem).unwrap();
            ["svg", "png"].map(|kind| std::fs::read(stem.with_extension(kind)).unwrap())
        };
        let [svg, png] = saved("one");
        assert!(svg.starts_with(b"<svg") && png.starts_with(b"\x89PNG"));
        assert!(String::from_utf8_lossy(&svg).contains("A panel"));
        assert_eq!([svg, png], saved("two"));
    }
}
