//! Figures as SVG and PNG: panels of points seen from one side, or of curves.

mod axis;
mod curves;
mod points;

use std::path::Path;
use std::sync::Once;

use plotters::coord::Shift;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};
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
    Points(Vec<Dots>),
    /// Curves over labelled axes.
    Curves {
        /// Label of the abscissa, with its unit.
        x: String,
        /// Label of the ordinate, with its unit.
        y: String,
        /// How values are laid out.
        axes: Axes,
        /// The later ones on top.
        curves: Vec<Curve>,
    },
}

/// Points of one colour.
#[derive(Debug, Clone, Default)]
pub struct Dots {
    /// Shown below the panel; not if it is empty.
    pub name: String,
    /// Coordinates, to the right and upwards.
    pub points: Vec<[f64; 2]>,
}

/// How values are laid out along axes. What is not above zero is left out of a logarithmic
/// one, and a band that reaches there goes to its end.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Axes {
    /// Both linearly, the ordinate from zero.
    #[default]
    Linear,
    /// The ordinate by logarithm.
    LogarithmicY,
    /// Both by logarithm.
    Logarithmic,
}

/// A line with a marker at every point.
#[derive(Debug, Clone, Default)]
pub struct Curve {
    /// Shown beside the panel; not if it is empty.
    pub name: String,
    /// Abscissa and ordinate, in the order in which they are joined.
    pub points: Vec<[f64; 2]>,
    /// Lowest and highest ordinate at each point, shaded; not if it is empty.
    pub band: Vec<[f64; 2]>,
    /// Whether it is only there for comparison: dashed, grey, without markers.
    pub guide: bool,
}

/// Colours that are told apart by most eyes (Okabe and Ito 2008), a grey and a violet.
const COLOURS: [RGBColor; 9] = [
    RGBColor(0, 114, 178),
    RGBColor(213, 94, 0),
    RGBColor(0, 158, 115),
    RGBColor(204, 121, 167),
    RGBColor(230, 159, 0),
    RGBColor(86, 180, 233),
    RGBColor(0, 0, 0),
    RGBColor(120, 120, 120),
    RGBColor(110, 50, 160),
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
                Content::Points(sets) => points::draw(&place, &panel.title, sets)?,
                Content::Curves { x, y, axes, curves } => {
                    curves::draw(&place, &panel.title, [x, y], *axes, curves)?;
                }
            }
        }
        area.present()
    }
}

type Drawn<B> = Result<(), DrawingAreaErrorKind<<B as DrawingBackend>::ErrorType>>;

/// Small letters, their middle line at a place.
fn text() -> TextStyle<'static> {
    (FONT, 13).into_font().color(&BLACK).pos(Pos::new(HPos::Left, VPos::Center))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn figure() -> Figure {
        let points = |k: f64| (1..9).map(|i| [f64::from(i), k * f64::from(i * i)]).collect();
        let curve = |k: u32| {
            let points: Vec<[f64; 2]> = points(f64::from(k + 1));
            let band = points.iter().map(|p| [p[1] - 6.0, p[1] * 1.2]).collect();
            let band = if k == 1 { band } else { Vec::new() };
            Curve { name: format!("curve {k}"), points, band, guide: k == 9 }
        };
        let content = |axes| {
            let (x, y) = ("points".into(), "seconds".into());
            Content::Curves { x, y, axes, curves: (0..10).map(curve).collect() }
        };
        let dots = |name: &str, k| Dots { name: name.into(), points: points(k) };
        let contents = [
            content(Axes::Linear),
            content(Axes::LogarithmicY),
            content(Axes::Logarithmic),
            Content::Curves { x: "".into(), y: "".into(), axes: Axes::Linear, curves: vec![] },
            Content::Points(vec![dots("target", 1.0), dots("source", 3.0)]),
            Content::Points(vec![]),
        ];
        let panel = |content| Panel { title: "A panel".into(), content };
        Figure { panels: contents.map(panel).into(), columns: 2, size: (480, 340) }
    }

    #[test]
    fn both_files_are_written_and_the_same_again() {
        let folder = tempfile::tempdir().unwrap();
        let saved = |name: &str| {
            let stem = folder.path().join(name);
            figure().save(&stem).unwrap();
            ["svg", "png"].map(|kind| std::fs::read(stem.with_extension(kind)).unwrap())
        };
        let [svg, png] = saved("one");
        assert!(svg.starts_with(b"<svg") && png.starts_with(b"\x89PNG"));
        let words = String::from_utf8_lossy(&svg).into_owned();
        for word in ["A panel", "curve 8", "curve 9", "seconds", "target"] {
            assert!(words.contains(word), "{word}");
        }
        // Names of the three panels of curves, none where there is nothing to name.
        assert_eq!(words.matches("curve 0").count(), 3);
        assert_eq!([svg, png], saved("two"));
    }
}
