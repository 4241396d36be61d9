//! Pages with a table: one row per pair or scheme, the worst first.

use std::path::Path;

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use serde::Serialize;

use super::{PairReport, page, text};
use crate::error::{Error, Result};
use crate::figure::Figure;
use crate::io;

/// A page with a sortable table.
#[derive(Debug, Clone, Default, Serialize)]
pub struct TablePage {
    /// Title of the page.
    pub title: String,
    /// Sentences above the table.
    pub lines: Vec<String>,
    /// Curves above the table, each an SVG made here, with its description.
    pub curves: Vec<(String, String)>,
    /// Names of the columns.
    pub columns: Vec<&'static str>,
    /// The rows, in their order.
    pub rows: Vec<TableRow>,
    /// Whether any row has a picture.
    pub pictures: bool,
    /// Version of the crate; filled in.
    pub version: &'static str,
}

/// A row of the table.
#[derive(Debug, Clone, Default, Serialize)]
pub struct TableRow {
    /// `good`, `unsure` or `bad`.
    pub tone: &'static str,
    /// One cell per column.
    pub cells: Vec<TableCell>,
    /// The page of the pair, relative to this one.
    pub link: Option<String>,
    /// PNG in base64.
    pub picture: Option<String>,
}

/// The text of a cell, and its sort key if that is a number.
#[derive(Debug, Clone, Default, Serialize)]
pub struct TableCell {
    text: String,
    number: Option<f64>,
}

/// Width and height of a row's picture. Chosen by hand.
const PREVIEW_SIZE: (u32, u32) = (150, 110);
/// Most points of a cloud on one of many pages. Chosen by hand.
const MAX_POINTS: usize = 20_000;
/// Folder of the pages of pairs, beside the page of the list.
const PAIR_FOLDER: &str = "pairs";

impl TableCell {
    /// Creates a text cell.
    pub fn text(text: impl Into<String>) -> TableCell {
        TableCell { text: text.into(), number: None }
    }

    /// Creates a number cell; empty without a number.
    pub fn number(value: Option<f64>) -> TableCell {
        let value = value.filter(|value| value.is_finite());
        TableCell { text: value.map_or_else(String::new, text::format_number), number: value }
    }

    /// Creates a percentage cell from a share; empty without a number.
    pub fn percent(value: Option<f64>) -> TableCell {
        let value = value.filter(|value| value.is_finite());
        TableCell { text: value.map_or_else(String::new, text::format_percent), number: value }
    }
}

impl TableRow {
    /// Writes the page of a pair into `folder`, and links it.
    pub(super) fn add_pair_page(
        &mut self,
        mut pair: PairReport<'_>,
        folder: &Path,
        number: usize,
    ) -> Result<()> {
        pair.points = MAX_POINTS;
        let link = format!("{PAIR_FOLDER}/{number:05}.html");
        let path = folder.join(&link);
        check_overwrite(&path)?;
        io::write_bytes(&path, pair.html()?.as_bytes())?;
        self.picture = Some(STANDARD.encode(pair.thumbnail(PREVIEW_SIZE)?.png()?));
        self.link = Some(link);
        Ok(())
    }
}

impl TablePage {
    /// Adds the curves of a figure.
    ///
    /// # Errors
    /// Those of [`Figure::svg`].
    pub fn add_figure(&mut self, figure: &Figure, shows: &str) -> Result<()> {
        self.curves.push((figure.svg()?, shows.into()));
        Ok(())
    }

    /// Renders the page.
    ///
    /// # Errors
    /// [`Error::Io`] if rendering fails.
    pub fn html(mut self) -> Result<String> {
        self.pictures = self.rows.iter().any(|row| row.picture.is_some());
        self.version = env!("CARGO_PKG_VERSION");
        page::render_table(&self)
    }

    /// Writes the page into `folder`, as `index.html`.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn write(self, folder: &Path) -> Result<()> {
        io::write_bytes(&folder.join("index.html"), self.html()?.as_bytes())
    }
}

/// Creates the folder of a list's pages, unless the table would replace another page.
pub(super) fn create_folders(folder: &Path) -> Result<()> {
    check_overwrite(&folder.join("index.html"))?;
    let pairs = folder.join(PAIR_FOLDER);
    std::fs::create_dir_all(&pairs).map_err(|error| Error::io(&pairs, error))
}

/// Refuses to overwrite a file that is no page of this program.
fn check_overwrite(path: &Path) -> Result<()> {
    if !path.exists() || page::is_report_page(path) {
        return Ok(());
    }
    let rule = "is there and was not written by this program: name another folder";
    Err(Error::config("output", path.display(), rule))
}
