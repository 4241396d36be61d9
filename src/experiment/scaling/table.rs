//! Runs as CSV, between a line with all that they depend on and one that says how many.

use std::path::Path;

use serde::Serialize;

use super::{Limit, MOTION, Motion, Options, READING, Reading, Run, SEED, Shape};
use crate::error::{Error, Result};
use crate::io;
use crate::method::Method;

/// All that runs depend on but the machine: the first line of the file.
#[derive(Serialize)]
struct Settings<'a> {
    shape: Shape,
    reading: Reading,
    motion: Motion,
    seed: u64,
    sizes: &'a [usize],
    limit: Limit,
    memory: bool,
    version: &'static str,
    methods: &'a [Method],
}

/// The settings as JSON; `memory` tells whether it is measured.
pub(super) fn settings(options: &Options, methods: &[Method], memory: bool) -> String {
    let settings = Settings {
        shape: Shape::Bunny,
        reading: READING,
        motion: MOTION,
        seed: SEED,
        sizes: &options.sizes,
        limit: options.limit,
        memory,
        version: env!("CARGO_PKG_VERSION"),
        methods,
    };
    // Plain structs of numbers and words: JSON has them all.
    serde_json::to_string(&settings).unwrap_or_default()
}

const REMARK: &str = "# Seconds are of one machine and one day: another run has others, and may \
                      stop at other sizes.";

/// # Errors
/// [`Error::Io`].
pub(super) fn write(runs: &[Run], settings: &str, path: &Path) -> Result<()> {
    let unwritten =
        |error: &dyn std::fmt::Display| Error::io(path, std::io::Error::other(error.to_string()));
    let mut table = csv::Writer::from_writer(Vec::new());
    for run in runs {
        table.serialize(run).map_err(|error| unwritten(&error))?;
    }
    let rows = table.into_inner().map_err(|error| unwritten(&error))?;
    let head = format!("# {settings}\n{REMARK}\n");
    io::write_bytes(path, &[head.as_bytes(), &rows, end(runs).as_bytes()].concat())
}

/// What [`write`] wrote, if it is there, whole and of these very settings.
pub(super) fn read(path: &Path, settings: &str) -> Option<Vec<Run>> {
    let text = std::fs::read_to_string(path).ok()?;
    let (first, rows) = text.split_once('\n')?;
    if first.strip_prefix("# ")? != settings {
        return None;
    }
    let mut reader = csv::ReaderBuilder::new().comment(Some(b'#')).from_reader(rows.as_bytes());
    let runs: Vec<Run> = reader.deserialize().collect::<Result<_, _>>().ok()?;
    rows.ends_with(&end(&runs)).then_some(runs)
}

fn end(runs: &[Run]) -> String {
    format!("# {} runs\n", runs.len())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn runs_come_back_whole_or_not_at_all() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("scaling.csv");
        let run = |points: usize, bytes, error: &str| Run {
            method: "kc".into(),
            points,
            seconds: 0.125 * points as f64,
            bytes,
            iterations: 7,
            rotation_deg: error.is_empty().then_some(0.1 + 0.2),
            trusted: error.is_empty(),
            stages: "moments 1.00e-1; evaluate 2.00e-2".into(),
            error: error.into(),
        };
        let runs = [run(10, Some(1 << 40), ""), run(20, None, "no \"pose\", why")];
        write(&runs, "{\"a\":1}", &path).unwrap();
        assert_eq!(read(&path, "{\"a\":1}").as_deref(), Some(&runs[..]));
        assert_eq!(read(&path, "{\"a\":2}"), None);
        // Cut short, between rows and within one.
        let text = std::fs::read_to_string(&path).unwrap();
        for end in [text.rfind('#').unwrap(), text.len() - 30, text.len() - 1] {
            std::fs::write(&path, &text[..end]).unwrap();
            assert_eq!(read(&path, "{\"a\":1}"), None, "{end}");
        }
    }
}
