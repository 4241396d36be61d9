//! Pages with a table: one row a pair or a scheme, the worst first.

use std::path::Path;

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use serde::Serialize;

use super::{Pair, page, words};
use crate::error::{Error, Result};
use crate::experiment::figure::Figure;
use crate::io;

/// A page with a table that can be sorted.
#[derive(Debug, Clone, Default, Serialize)]
pub(super) struct Listing {
    pub(super) title: String,
    /// Sentences above the table.
    pub(super) lines: Vec<String>,
    /// Curves above it, each an SVG of our own, with what it shows.
    pub(super) curves: Vec<(String, String)>,
    pub(super) columns: Vec<&'static str>,
    pub(super) rows: Vec<Line>,
    /// Whether any row has a picture.
    pub(super) pictures: bool,
    pub(super) version: &'static str,
}

/// A row.
#[derive(Debug, Clone, Default, Serialize)]
pub(super) struct Line {
    /// `good`, `unsure` or `bad`.
    pub(super) tone: &'static str,
    pub(super) cells: Vec<Cell>,
    /// The page of the pair, relative to this one.
    pub(super) link: Option<String>,
    /// PNG in base64.
    pub(super) picture: Option<String>,
}

/// What stands in a column, and by what it is sorted where that is a number.
#[derive(Debug, Clone, Default, Serialize)]
pub(super) struct Cell {
    text: String,
    number: Option<f64>,
}

/// Width and height of a row's picture.
const PICTURE: (u32, u32) = (150, 110);
/// Most points of a cloud on a page that is one of many.
const POINTS: usize = 20_000;
/// Where the pages of pairs are, beside that of the list.
const FOLDER: &str = "pairs";

impl Cell {
    pub(super) fn text(text: impl Into<String>) -> Cell {
        Cell { text: text.into(), number: None }
    }

    pub(super) fn number(value: Option<f64>) -> Cell {
        let value = value.filter(|value| value.is_finite());
        Cell { text: value.map_or_else(String::new, words::short), number: value }
    }

    pub(super) fn share(value: Option<f64>) -> Cell {
        let value = value.filter(|value| value.is_finite());
        Cell { text: value.map_or_else(String::new, words::percent), number: value }
    }
}

impl Line {
    /// Writes the page of a pair into `folder`, and links it.
    pub(super) fn open(&mut self, mut pair: Pair<'_>, folder: &Path, number: usize) -> Result<()> {
        pair.points = POINTS;
        let link = format!("{FOLDER}/{number:05}.html");
        let path = folder.join(&link);
        check(&path)?;
        io::write_bytes(&path, pair.html()?.as_bytes())?;
        self.picture = Some(STANDARD.encode(pair.thumbnail(PICTURE)?.png()?));
        self.link = Some(link);
        Ok(())
    }
}

impl Listing {
    /// Adds the curves of a figure.
    pub(super) fn draw(&mut self, figure: &Figure, shows: &str) -> Result<()> {
        self.curves.push((figure.svg()?, shows.into()));
        Ok(())
    }

    /// The page.
    pub(super) fn html(mut self) -> Result<String> {
        self.pictures = self.rows.iter().any(|row| row.picture.is_some());
        self.version = env!("CARGO_PKG_VERSION");
        page::listing(&self)
    }

    /// Writes the page into `folder`, as `index.html`.
    pub(super) fn write(self, folder: &Path) -> Result<()> {
        io::write_bytes(&folder.join("index.html"), self.html()?.as_bytes())
    }
}

/// Makes the folder of a list's pages, unless the table would take the place of another page.
pub(super) fn make(folder: &Path) -> Result<()> {
    check(&folder.join("index.html"))?;
    let pairs = folder.join(FOLDER);
    std::fs::create_dir_all(&pairs).map_err(|error| Error::io(&pairs, error))
}

/// Refuses to write over what is no page of this program.
fn check(path: &Path) -> Result<()> {
    if !path.exists() || page::is_ours(path) {
        return Ok(());
    }
    let rule = "is there and was not written by this program: name another folder";
    Err(Error::config("output", path.display(), rule))
}
