//! The paper's models, from a folder of scans.

use std::path::{Path, PathBuf};

use super::cell::{Reading, Shape};
use crate::error::{Error, Result};
use crate::experiment::Model;
use crate::io;

/// A model, and the file it came from.
#[derive(Debug, Clone)]
pub struct Source {
    /// What is sampled.
    pub model: Model,
    /// Its file.
    pub path: PathBuf,
    /// What stands in for the paper's own, and how; empty where nothing does.
    pub remark: &'static str,
}

/// Names of a shape's files, the paper's first, and the folder they have in a mirror.
fn files(shape: Shape) -> (&'static str, &'static [&'static str]) {
    match shape {
        Shape::Bunny => ("stanford_bunny", &["bun000.ply"]),
        Shape::Dragon => ("stanford_dragon_stand", &["dragonStandRight_0.ply"]),
        Shape::Armadillo => (
            "stanford_armadillo_simulated",
            &["ArmadilloStand_180.ply", "armadilloVirtual_180.ply"],
        ),
    }
}

/// The model of `shape` as `reading` samples it, from `folder`: flat, as `data/fetch.py`
/// fills one, or a folder a data set.
///
/// # Errors
/// [`Error::Io`] when no such file is there, those of [`io::read`] and [`io::read_mesh`].
pub fn load(folder: &Path, shape: Shape, reading: Reading) -> Result<Source> {
    let (set, names) = files(shape);
    let places = names.iter().flat_map(|name| [folder.join(name), folder.join(set).join(name)]);
    let Some(path) = places.clone().find(|path| path.is_file()) else {
        let path = places.into_iter().next().unwrap_or_else(|| folder.to_path_buf());
        let missing = std::io::Error::new(
            std::io::ErrorKind::NotFound,
            "no such scan; `python3 data/fetch.py` fetches it into data/scans, --data names another \
             folder",
        );
        return Err(Error::io(path, missing));
    };
    let simulated = path.file_name().is_some_and(|name| name == "armadilloVirtual_180.ply");
    let remark = match (simulated, reading) {
        (false, _) => "",
        (true, Reading::Points) => "a simulated scan of the mesh stands in for ArmadilloStand_180",
        (true, _) => {
            "the points of a simulated scan of the mesh, which has no range grid to sample by area, \
             stand in for ArmadilloStand_180"
        }
    };
    let by_points = simulated || reading == Reading::Points;
    let model = match by_points {
        true => Model::from(io::read(&path)?),
        false => Model::from(io::read_mesh(&path)?),
    };
    Ok(Source { model, path, remark })
}
