//! Check whether an existing output belongs to this run.

use std::path::Path;

use serde_json::Value;

use super::journal::header_difference;
use super::output::ResultsFormat;
use super::run_file::{RUN_HEADER_SUFFIX, with_suffix};
use super::{PairList, Summary, results};
use crate::error::{Error, Result};

/// Summarises an output that has all rows.
///
/// # Errors
/// [`Error::Config`] when it is of another list or of other settings, or when these are unknown;
/// errors of reading it.
pub(super) fn summarize_complete(
    output: &Path,
    format: ResultsFormat,
    list: &PairList,
    header: &Value,
) -> Result<Summary> {
    let refuse = |rule: String| Error::config("resume", output.display(), rule);
    let Some(begun) = format.read_run_header(output)? else {
        let within = format == ResultsFormat::Parquet;
        let place =
            if within { output.to_path_buf() } else { with_suffix(output, RUN_HEADER_SUFFIX) };
        return Err(refuse(format!(
            "nothing tells what it was made with, which {} should: start anew with --overwrite, \
             or name another output",
            place.display()
        )));
    };
    if let Some(rule) = header_difference(&begun, header) {
        return Err(refuse(rule));
    }
    let other = |index: usize| {
        refuse(format!(
            "has another pair {index} than the list: start anew with --overwrite, or name \
             another output"
        ))
    };
    let mut summary = Summary { pairs: list.len(), ..Summary::default() };
    results::for_each_row(output, |row| {
        let index = summary.resumed;
        let same = index < list.len()
            && row.index == index
            && list.pair(index) == [row.source.as_str(), row.target.as_str()];
        if !same {
            return Err(other(index));
        }
        summary.add_row(&row);
        summary.resumed += 1;
        Ok(())
    })?;
    if summary.resumed < list.len() {
        return Err(other(summary.resumed));
    }
    Ok(summary)
}
