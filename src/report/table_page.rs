//! Pages with a table: one row a pair or a scheme, the worst first.

use std::path::Path;

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use serde::Serialize;

use super::{PairReport, page, text};
use crate::error::{Error, Result};
use crate::figure::Figure;
use crate::io;

/// A page with a table that can be sorted.
#[derive(Debug, Clone, Default, Serialize)]
pub struct TablePage {
    /// Title of the page.
    pub title: String,
    /// Sentences above the table.
    pub lines: Vec<String>,
    /// Curves above it, each an SVG of our own, with what it shows.
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

/// A row.
#[derive(Debug, Clone, Default, Serialize)]
pub struct TableRow {
    /// `good`, `unsure` or `bad`.
    pub tone: &'static str,
    /// One a column.
    pub cells: Vec<TableCell>,
    /// The page of the pair, relative to this one.
    pub link: Option<String>,
    /// PNG in base64.
    pub picture: Option<String>,
}

/// What stands in a column, and by what it is sorted where that is a number.
#[derive(Debug, Clone, Default, Serialize)]
pub struct TableCell {
    text: String,
    number: Option<f64>,
}

/// Width and height of a row's picture.
const PREVIEW_SIZE: (u32, u32) = (150, 110);
/// Most points of a cloud on a page that is one of many.
const MAX_POINTS: usize = 20_000;
/// Where the pages of pairs are, beside that of the list.
const PAIR_FOLDER: &str = "pairs";

impl TableCell {
    /// Words.
    pub fn text(text: impl Into<String>) -> TableCell {
        TableCell { text: text.into(), number: None }
    }

    /// A number; empty where there is none.
    pub fn number(value: Option<f64>) -> TableCell {
        let value = value.filter(|value| value.is_finite());
        TableCell { text: value.map_or_else(String::new, text::format_number), number: value }
    }

    /// A share as percent; empty where there is none.
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

    /// The page.
    ///
    /// # Errors
    /// [`Error::Io`] where the page cannot be made.
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

/// Makes the folder of a list's pages, unless the table would take the place of another page.
pub(super) fn create_folders(folder: &Path) -> Result<()> {
    check_overwrite(&folder.join("index.html"))?;
    let pairs = folder.join(PAIR_FOLDER);
    std::fs::create_dir_all(&pairs).map_err(|error| Error::io(&pairs, error))
}

/// Refuses to write over what is no page of this program.
fn check_overwrite(path: &Path) -> Result<()> {
    if !path.exists() || page::is_report_page(path) {
        return Ok(());
    }
    let rule = "is there and was not written by this program: name another folder";
    Err(Error::config("output", path.display(), rule))
}
