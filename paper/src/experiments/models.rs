//! The paper's models, from a folder of scans.

use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use super::cell::{Interpretation, Shape};
use crate::Model;
use cfreg::cloud::Mesh;
use cfreg::error::{Error, Result};
use cfreg::io;

/// A model, and the file it came from.
#[derive(Debug, Clone)]
pub struct Source {
    /// The sampled model.
    pub model: Model,
    /// Its file.
    pub path: PathBuf,
    /// The replacement of the paper's own file, and how it was made; empty for the paper's own
    /// file.
    pub remark: String,
    /// Digest of the model ([`Model::digest`]).
    pub digest: String,
}

/// Content of a file, and the model made from it.
#[derive(Clone, Copy)]
enum Form {
    /// A scan of the paper: its range grid or its points.
    Scan,
    /// Points of a simulated scan.
    Simulated,
    /// The whole Armadillo, seen from one side.
    Armadillo,
}

/// File names of the Armadillo's mesh.
const ARMADILLO: [&str; 2] = ["armadillo.ply", "Armadillo.ply"];

/// Returns a shape's files, the paper's first: the folder of each in a mirror, and its name.
fn files(shape: Shape, reading: Interpretation) -> &'static [(&'static str, &'static str, Form)] {
    const SCAN: (&str, &str, Form) = ("stanford_armadillo", "ArmadilloStand_180.ply", Form::Scan);
    match (shape, reading) {
        (Shape::Bunny, _) => &[("stanford_bunny", "bun000.ply", Form::Scan)],
        (Shape::Dragon, _) => &[("stanford_dragon_stand", "dragonStandRight_0.ply", Form::Scan)],
        (Shape::Armadillo, Interpretation::Points) => {
            &[SCAN, ("stanford_armadillo_simulated", "armadilloVirtual_180.ply", Form::Simulated)]
        }
        (Shape::Armadillo, _) => &[
            SCAN,
            ("stanford_meshes", ARMADILLO[0], Form::Armadillo),
            ("stanford_meshes", ARMADILLO[1], Form::Armadillo),
        ],
    }
}

/// How a shape's files are had.
fn download_hint(shape: Shape, reading: Interpretation) -> &'static str {
    match (shape, reading) {
        (Shape::Bunny, _) => {
            "no such scan; `python3 data/fetch.py bun000` fetches it into data/scans, --data names \
             another folder"
        }
        (Shape::Dragon, _) => {
            "no such scan; `python3 data/fetch.py dragonStandRight_0` fetches it into data/scans, \
             --data names another folder"
        }
        (Shape::Armadillo, Interpretation::Points) => {
            "no such scan, nor armadilloVirtual_180.ply, a scan simulated from the mesh; put either \
             beside the others"
        }
        (Shape::Armadillo, _) => {
            "no such scan, nor the mesh armadillo.ply, which stands in for it: unpack \
             http://graphics.stanford.edu/pub/3Dscanrep/armadillo/Armadillo.ply.gz beside the others"
        }
    }
}

/// Loads the model of `shape` for the interpretation `reading`, from `folder`: flat, as filled by
/// `data/fetch.py`, or a folder per data set.
///
/// # Errors
/// [`Error::Io`] when the file is missing ([`is_missing`]), the errors of [`io::read`] and
/// [`io::read_mesh`].
pub fn load(folder: &Path, shape: Shape, reading: Interpretation) -> Result<Source> {
    load_first(folder, files(shape, reading), reading, 0, download_hint(shape, reading))
}

/// Returns the part of the Armadillo's mesh that is visible to a sensor at `degrees` about the
/// upright axis, by area; 0 is its front.
///
/// # Errors
/// As for [`load`].
pub fn armadillo(folder: &Path, degrees: u32) -> Result<Source> {
    let (shape, reading) = (Shape::Armadillo, Interpretation::Fitting);
    let meshes = &files(shape, reading)[1..];
    load_first(folder, meshes, reading, degrees, download_hint(shape, reading))
}

/// The first of `files` that is there.
fn load_first(
    folder: &Path,
    files: &[(&str, &str, Form)],
    reading: Interpretation,
    degrees: u32,
    advice: &str,
) -> Result<Source> {
    let places = files.iter().flat_map(|&(set, name, form)| {
        [folder.join(name), folder.join(set).join(name)].map(|path| (path, form))
    });
    let Some((path, form)) = places.clone().find(|(path, _)| path.is_file()) else {
        let path = places.map(|(path, _)| path).next().unwrap_or_else(|| folder.to_path_buf());
        let missing = std::io::Error::new(ErrorKind::NotFound, advice);
        return Err(Error::io(path, missing));
    };
    let (model, remark) = match form {
        Form::Scan if reading == Interpretation::Points => {
            (Model::from(io::read(&path)?), String::new())
        }
        Form::Scan => (Model::from(io::read_mesh(&path)?), String::new()),
        Form::Simulated => (
            Model::from(io::read(&path)?),
            "the points of a scan simulated from the mesh stand in for ArmadilloStand_180".into(),
        ),
        Form::Armadillo => (
            Model::from(visible_side(io::read_mesh(&path)?, degrees)?),
            format!(
                "what a sensor at {}° sees of the mesh, by area, stands in for ArmadilloStand_180",
                (180 + degrees) % 360
            ),
        ),
    };
    Ok(Source { digest: model.digest(), model, path, remark })
}

/// Loads the whole surface of `shape`, reconstructed from all of its scans, at its real size in
/// metres; `None` if `folder`, flat or a folder per data set, does not contain it.
///
/// # Errors
/// The errors of [`io::read_mesh`].
pub fn object(folder: &Path, shape: Shape) -> Result<Option<Mesh>> {
    let (names, unit): (&[&str], f64) = match shape {
        Shape::Bunny => (&["bun_zipper.ply"], 1.0),
        Shape::Dragon => (&["dragon_vrip_res2.ply"], 1.0),
        Shape::Armadillo => (&ARMADILLO, UNIT),
    };
    let places = names
        .iter()
        .flat_map(|name| [folder.join(name), folder.join("stanford_meshes").join(name)]);
    let Some(path) = places.into_iter().find(|path| path.is_file()) else { return Ok(None) };
    let mut mesh = io::read_mesh(&path)?;
    mesh.vertices.iter_mut().flatten().for_each(|x| *x *= unit);
    Ok(Some(mesh))
}

/// Returns whether `error` means that a scan is missing.
pub fn is_missing(error: &Error) -> bool {
    matches!(error, Error::Io { source, .. } if source.kind() == ErrorKind::NotFound)
}

/// A line for people: which shape is missing, and how to get it.
pub fn missing_model_note(shape: Shape, error: &Error) -> String {
    format!("{shape} left out: {error}")
}

/// Metres per unit of Stanford's Armadillo: 151 units are the height of the statue without its
/// stand, 0.254.
const UNIT: f64 = 0.00168;

/// Returns the position of the distant sensor of [`armadillo`], in the frame of the visible part.
pub(super) fn sensor(degrees: u32) -> [f64; 3] {
    const FAR: f64 = 20.0;
    let (sin, cos) = f64::from(degrees).to_radians().sin_cos();
    [FAR * sin, 0.0, FAR * cos]
}

/// What a sensor far off sees of the Armadillo. In metres, about the middle of the bounding
/// box, turned so that the front, 180° by the scans' convention and −z of the mesh's frame,
/// is towards z.
fn visible_side(mut mesh: Mesh, degrees: u32) -> Result<Mesh> {
    let along = |axis: usize| mesh.vertices.iter().map(move |vertex| vertex[axis]);
    let middle = [0, 1, 2].map(|axis| {
        let (low, high) = (
            along(axis).fold(f64::INFINITY, f64::min),
            along(axis).fold(f64::NEG_INFINITY, f64::max),
        );
        (low + high) / 2.0
    });
    for vertex in &mut mesh.vertices {
        let turned = [-UNIT, UNIT, -UNIT];
        *vertex = [0, 1, 2].map(|axis| turned[axis] * (vertex[axis] - middle[axis]));
    }
    let seen = mesh.visible_faces(sensor(degrees))?;
    mesh.select_faces(&seen)
}
