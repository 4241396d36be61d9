//! The paper's models, from a folder of scans.

use std::path::{Path, PathBuf};

use super::cell::{Reading, Shape};
use crate::cloud::Mesh;
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

/// The whole surface of `shape`, reconstructed from all of its scans, at its real size in
/// metres; `None` where `folder`, flat or a folder a data set, has it not.
///
/// # Errors
/// Those of [`io::read_mesh`].
pub fn object(folder: &Path, shape: Shape) -> Result<Option<Mesh>> {
    // The Armadillo's mesh is 151 units high, its scans 0.275 m.
    let (name, unit) = match shape {
        Shape::Bunny => ("bun_zipper.ply", 1.0),
        Shape::Dragon => ("dragon_vrip_res2.ply", 1.0),
        Shape::Armadillo => ("armadillo.ply", 0.275 / 151.0),
    };
    let places = [folder.join(name), folder.join("stanford_meshes").join(name)];
    let Some(path) = places.into_iter().find(|path| path.is_file()) else { return Ok(None) };
    let mut mesh = io::read_mesh(&path)?;
    mesh.vertices.iter_mut().flatten().for_each(|x| *x *= unit);
    Ok(Some(mesh))
}
