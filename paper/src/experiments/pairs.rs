//! The pairs of Tables I and II as files, for programs outside this crate.
//!
//! There is a folder for each test, shape and motion, under the interpretation `Fitting`, and a
//! file for each array, as read by `numpy.load`: `source` and `target` (trials, points, 3), the
//! positions; `truth` (trials, 4, 4), source into the target's frame; `viewpoints` (trials, 2, 3),
//! the viewpoints of source and target. All are f64, which represents every position exactly.

use std::path::Path;

use super::cell::{self, Contender, ExperimentCell, Interpretation, Test};
use super::{ExperimentOptions, record};
use crate::Model;
use crate::files;
use crate::protocol::Trial;
use cfreg::cloud::PointCloud;
use cfreg::error::{Error, Result};

/// Writes the pairs that [`run`](super::run) gives its contenders with these options; returns a
/// line for each missing model.
///
/// # Errors
/// [`Error::Io`] for missing scans or a folder that cannot be written, those of the readers.
pub fn write(options: &ExperimentOptions, folder: &Path) -> Result<Vec<String>> {
    let wanted = |cell: &ExperimentCell| {
        cell.reading == Interpretation::Fitting
            && cell.test != Test::Sensitivity
            && options.only.is_none_or(|part| part.includes(cell))
            // The pairs do not depend on who registers them.
            && cell.contender == Contender::Cf
    };
    let (trials, ..) = super::sizes(options.smoke);
    let cells: Vec<ExperimentCell> = cell::cells(trials, 0, 0).into_iter().filter(wanted).collect();
    let (sources, left_out) = super::load(options, &cells)?;
    for cell in &cells {
        if let Some(source) = sources.get(&cell.model()) {
            write_cell(cell, &source.model, &folder.join(cell.trials_name()))?;
        }
    }
    Ok(left_out)
}

fn write_cell(cell: &ExperimentCell, model: &Model, folder: &Path) -> Result<()> {
    std::fs::create_dir_all(folder).map_err(|error| Error::io(folder, error))?;
    let trials: Vec<Trial> =
        (0..cell.trials).map(|number| record::trial(cell, model, number)).collect::<Result<_>>()?;
    let array = |name: &str, shape: [usize; 2], values: Vec<f64>| {
        let bytes = npy([trials.len(), shape[0], shape[1]], &values);
        files::write_bytes(&folder.join(name).with_extension("npy"), &bytes)
    };
    let clouds = |name: &str, side: fn(&Trial) -> &PointCloud| {
        // The same number in every trial: a protocol adds the same number to the same number.
        let count = trials.first().map_or(0, |trial| side(trial).len());
        array(name, [count, 3], trials.iter().flat_map(|t| side(t).positions()).flatten().collect())
    };
    clouds("source", |trial| &trial.source)?;
    clouds("target", |trial| &trial.target)?;
    let truths = trials.iter().flat_map(|trial| trial.truth.matrix());
    array("truth", [4, 4], truths.flatten().collect())?;
    let seen = |cloud: &PointCloud| cloud.viewpoint().unwrap_or(cloud.frame_origin());
    let viewpoints = trials.iter().flat_map(|t| [&t.source, &t.target]).flat_map(seen);
    array("viewpoints", [2, 3], viewpoints.collect())
}

/// Encodes an array in row-major order as NumPy's format 1.0
/// (<https://numpy.org/doc/stable/reference/generated/numpy.lib.format.html>).
fn npy(shape: [usize; 3], values: &[f64]) -> Vec<u8> {
    let [a, b, c] = shape;
    let mut header =
        format!("{{'descr': '<f8', 'fortran_order': False, 'shape': ({a}, {b}, {c}), }}");
    // The header is a multiple of 64 bytes long and ends in a line feed.
    let before = MAGIC.len() + 2;
    let blanks = (before + header.len() + 1).next_multiple_of(64) - before - header.len() - 1;
    header.extend(std::iter::repeat_n(' ', blanks));
    header.push('\n');
    let mut bytes = [MAGIC, &(header.len() as u16).to_le_bytes(), header.as_bytes()].concat();
    bytes.extend(values.iter().flat_map(|value| value.to_le_bytes()));
    bytes
}

const MAGIC: &[u8] = b"\x93NUMPY\x01\x00";

#[cfg(test)]
mod tests {
    use super::super::cell::Shape;
    use super::*;
    use crate::Motion;
    use cfreg::cloud::shape::boulder;

    /// Reads the shape, as it is written, and the values.
    fn read(path: &Path) -> (String, Vec<f64>) {
        let bytes = std::fs::read(path).unwrap();
        assert_eq!(bytes[..8], *b"\x93NUMPY\x01\x00");
        let end = 10 + usize::from(u16::from_le_bytes([bytes[8], bytes[9]]));
        let header = std::str::from_utf8(&bytes[10..end]).unwrap();
        assert!(end % 64 == 0 && header.ends_with('\n'), "{header:?}");
        let shape = header.split(['(', ')']).nth(1).unwrap().to_string();
        let value = |chunk: &[u8]| f64::from_le_bytes(chunk.try_into().unwrap());
        (shape, bytes[end..].chunks_exact(8).map(value).collect())
    }

    #[test]
    fn files_hold_what_contenders_are_given() {
        let cell = ExperimentCell {
            test: Test::Robustness,
            reading: Interpretation::Fitting,
            shape: Shape::Bunny,
            motion: Motion::Large,
            contender: Contender::Cf,
            noise: 0,
            trials: 3,
            variation: None,
        };
        let (model, folder) = (boulder().into(), tempfile::tempdir().unwrap());
        write_cell(&cell, &model, folder.path()).unwrap();
        let [source, target, truth, viewpoints] = ["source", "target", "truth", "viewpoints"]
            .map(|name| read(&folder.path().join(name).with_extension("npy")));
        let shapes = [&source.0, &target.0, &truth.0, &viewpoints.0];
        assert_eq!(shapes, ["3, 500, 3", "3, 600, 3", "3, 4, 4", "3, 2, 3"]);
        for number in 0..3 {
            let trial = record::trial(&cell, &model, number).unwrap();
            let part = |values: &(String, Vec<f64>)| {
                let each = values.1.len() / 3;
                values.1[number * each..][..each].to_vec()
            };
            // Bit for bit: the numbers of the file give the same cloud.
            for (values, cloud) in [(&source, &trial.source), (&target, &trial.target)] {
                let places: Vec<[f64; 3]> = part(values).as_chunks().0.to_vec();
                assert_eq!(places, cloud.positions().collect::<Vec<_>>());
                assert_eq!(PointCloud::new(&places).unwrap().points(), cloud.points());
            }
            assert_eq!(part(&truth), trial.truth.matrix().concat());
            assert_eq!(part(&viewpoints)[..3], [0.0; 3]);
            assert_eq!(part(&viewpoints)[3..], trial.target.viewpoint().unwrap());
        }
    }
}
