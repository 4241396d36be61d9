//! Figures as SVG and PNG: panels of points seen from one side, or of curves.

mod axis;
mod curves;
mod points;
mod scene;

use std::path::Path;
use std::sync::Once;

use plotters::coord::Shift;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};
use plotters::style::{FontStyle, register_font};

use crate::error::{Error, Result};
use crate::io;

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
    /// Title above the panel.
    pub title: String,
    /// Content of the panel.
    pub content: Content,
}

/// The content of a panel.
#[derive(Debug, Clone)]
pub enum Content {
    /// Sets of points in the plane, at one scale on both axes, the later ones on top.
    Points(Vec<Dots>),
    /// Points in space seen from one side, at one scale on both axes.
    Scene(Scene),
    /// Curves over labelled axes.
    Curves {
        /// Label of the abscissa, with its unit.
        x: String,
        /// Label of the ordinate, with its unit.
        y: String,
        /// Scales of the axes.
        axes: Axes,
        /// Curves, the later ones on top.
        curves: Vec<Curve>,
    },
}

/// Points of one colour.
#[derive(Debug, Clone, Default)]
pub struct Dots {
    /// Legend text below the panel; not shown if empty.
    pub name: String,
    /// Coordinates, to the right and upwards.
    pub points: Vec<[f64; 2]>,
}

/// Points that occlude each other.
#[derive(Debug, Clone, Default)]
pub struct Scene {
    /// Legend text below the panel, with its colour.
    pub names: Vec<(String, [u8; 3])>,
    /// Curves, the later ones on top.
    pub dots: Vec<Dot>,
    /// Centre of the panel.
    pub middle: [f64; 2],
    /// Least extent on every side of the centre, in the unit of the dots.
    pub reach: f64,
    /// Radius of a dot, in the unit of the dots; at least a pixel.
    pub radius: f64,
}

/// A point of a scene.
#[derive(Debug, Clone, Copy)]
pub struct Dot {
    /// Position to the right and upwards.
    pub at: [f64; 2],
    /// Red, green, blue.
    pub colour: [u8; 3],
}

/// Scales of the axes. A logarithmic axis omits values that are not above zero, and a band that
/// reaches such values extends to its end.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Axes {
    /// Both linear, the ordinate from zero.
    #[default]
    Linear,
    /// The ordinate logarithmic.
    LogarithmicY,
    /// Both logarithmic.
    Logarithmic,
}

/// A line with a marker at every point.
#[derive(Debug, Clone, Default)]
pub struct Curve {
    /// Legend text beside the panel; not shown if empty.
    pub name: String,
    /// Abscissa and ordinate, in the order of the line.
    pub points: Vec<[f64; 2]>,
    /// Lowest and highest ordinate at each point, shaded; not shown if empty.
    pub band: Vec<[f64; 2]>,
    /// Whether it is a reference only: dashed, grey, without markers.
    pub guide: bool,
}

/// Colours that most people can distinguish (Okabe and Ito 2008), a grey and a violet.
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
        let (svg, png) = (stem.with_extension("svg"), stem.with_extension("png"));
        io::write_bytes(&svg, self.svg()?.as_bytes())?;
        io::write_bytes(&png, &self.png()?)
    }

    /// Renders the figure as SVG text.
    ///
    /// # Errors
    /// [`Error::Io`] if drawing fails.
    pub fn svg(&self) -> Result<String> {
        let mut text = String::new();
        let area = SVGBackend::with_string(&mut text, self.pixels()).into_drawing_area();
        self.draw(&area).map_err(|error| failed(&error))?;
        drop(area);
        Ok(text)
    }

    /// Renders the figure as PNG bytes.
    ///
    /// # Errors
    /// [`Error::Io`] if drawing fails.
    pub fn png(&self) -> Result<Vec<u8>> {
        let (width, height) = self.pixels();
        let mut pixels = vec![0; 3 * width as usize * height as usize];
        let area = BitMapBackend::with_buffer(&mut pixels, (width, height)).into_drawing_area();
        self.draw(&area).map_err(|error| failed(&error))?;
        drop(area);
        let mut bytes = Vec::new();
        let mut encoder = png::Encoder::new(&mut bytes, width, height);
        encoder.set_color(png::ColorType::Rgb);
        encoder.set_depth(png::BitDepth::Eight);
        let written = encoder.write_header().and_then(|mut file| file.write_image_data(&pixels));
        written.map_err(|error| failed(&error))?;
        Ok(bytes)
    }

    fn rows(&self) -> usize {
        self.panels.len().div_ceil(self.columns.max(1)).max(1)
    }

    /// Returns width and height of the whole figure.
    fn pixels(&self) -> (u32, u32) {
        (self.size.0 * self.columns.max(1) as u32, self.size.1 * self.rows() as u32)
    }

    fn draw<B: DrawingBackend>(&self, area: &DrawingArea<B, Shift>) -> Drawn<B> {
        static FONTS: Once = Once::new();
        // The same font on every machine, also without installed fonts.
        FONTS.call_once(|| {
            let _ = register_font(FONT, FontStyle::Normal, epaint_default_fonts::UBUNTU_LIGHT);
        });
        area.fill(&WHITE)?;
        let places = area.split_evenly((self.rows(), self.columns.max(1)));
        for (panel, place) in self.panels.iter().zip(places) {
            match &panel.content {
                Content::Points(sets) => points::draw(&place, &panel.title, sets)?,
                Content::Scene(scene) => scene::draw(&place, &panel.title, scene)?,
                Content::Curves { x, y, axes, curves } => {
                    curves::draw(&place, &panel.title, [x, y], *axes, curves)?;
                }
            }
        }
        area.present()
    }
}

fn failed(error: &dyn std::fmt::Display) -> Error {
    Error::io("a figure", std::io::Error::other(error.to_string()))
}

type Drawn<B> = Result<(), DrawingAreaErrorKind<<B as DrawingBackend>::ErrorType>>;

/// Returns the style of small text, vertically centred at its position.
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
            Content::Scene(Scene {
                names: vec![("in space".into(), [0, 114, 178])],
                dots: vec![Dot { at: [0.5, 0.5], colour: [213, 94, 0] }],
                reach: 1.0,
                ..Scene::default()
            }),
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
        for word in ["A panel", "curve 8", "curve 9", "seconds", "target", "in space"] {
            assert!(words.contains(word), "{word}");
        }
        // Legends of the three panels of curves; other panels have none.
        assert_eq!(words.matches("curve 0").count(), 3);
        assert_eq!([svg, png], saved("two"));
    }
}
