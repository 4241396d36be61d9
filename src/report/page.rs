//! Pages from templates. Content from files is escaped as text: in HTML by the templates' own
//! rules, in scripts as JSON without `<`.

use std::fs::File;
use std::io::Read as _;
use std::path::Path;

use minijinja::value::Serde;
use minijinja::{AutoEscape, Environment, Value, context};
use serde::Serialize;

use crate::error::{Error, Result};

const PAIR_TEMPLATE: &str = include_str!("page/pair.html");
const STYLE: &str = include_str!("page/style.css");
/// In order of dependency.
const SCRIPTS: [&str; 12] = [
    include_str!("page/copy.js"),
    include_str!("page/algebra.js"),
    include_str!("page/data.js"),
    include_str!("page/webgl.js"),
    include_str!("page/clouds.js"),
    include_str!("page/lines.js"),
    include_str!("page/arrows.js"),
    include_str!("page/camera.js"),
    include_str!("page/gestures.js"),
    include_str!("page/view.js"),
    include_str!("page/heat.js"),
    include_str!("page/main.js"),
];
const TABLE_TEMPLATE: &str = include_str!("page/list.html");
const TABLE_STYLE: &str = include_str!("page/list.css");
const TABLE_SCRIPT: &str = include_str!("page/list.js");

/// Renders the page of a pair.
pub(super) fn render_pair(text: &impl Serialize, view: &impl Serialize) -> Result<String> {
    render(
        "pair.html",
        PAIR_TEMPLATE,
        context! {
            page => Value::from(Serde(text)),
            view => Value::from(Serde(view)),
            style => Value::from_safe_string(STYLE.into()),
            scripts => Value::from_safe_string(SCRIPTS.join("\n")),
        },
    )
}

/// Renders the page of a list.
pub(super) fn render_table(page: &impl Serialize) -> Result<String> {
    render(
        "list.html",
        TABLE_TEMPLATE,
        context! {
            page => Value::from(Serde(page)),
            style => Value::from_safe_string([STYLE, TABLE_STYLE].join("\n")),
            scripts => Value::from_safe_string(TABLE_SCRIPT.into()),
        },
    )
}

/// Returns whether a file is a page of this program: both templates begin with a mark.
pub fn is_report_page(path: &Path) -> bool {
    let mut start = Vec::new();
    let read = File::open(path).and_then(|file| file.take(1024).read_to_end(&mut start));
    read.is_ok() && String::from_utf8_lossy(&start).contains(GENERATOR_TAG)
}

const GENERATOR_TAG: &str = "<meta name=\"generator\" content=\"cfreg\">";

fn render(name: &'static str, template: &'static str, values: Value) -> Result<String> {
    let mut pages = Environment::new();
    pages.set_auto_escape_callback(|_| AutoEscape::Html);
    let made = pages
        .add_template(name, template)
        .and_then(|()| pages.get_template(name))
        .and_then(|page| page.render(values));
    made.map_err(|error| Error::io(name, std::io::Error::other(format!("{error:#}"))))
}
