//! Files that others wrote: whatever is in them, reading ends with an answer or with words.

use std::path::Path;

use cfreg::batch::{PairList, Row, RowGraph, ScanPositions, radius_pairs, results};
use cfreg::benchmark::{ExternalPoses, list as listed};
use cfreg::pose_graph::Tangent;
use cfreg::report::SavedResult;
use cfreg::{Error, PointCloud, Transform, io};

use super::door;
use super::memory::bounded;

/// Bytes beside ten times the file that a reader of clouds may hold: a buffer of 64 KiB, names and
/// words.
const BUFFERS: usize = 128 << 10;
/// The same of PLY: the parser makes room for up to 65,536 entries of a list that claims to be long.
const LISTS: usize = BUFFERS + (65_536 << 3);
/// The same of tables and documents.
const TABLES: usize = 128 << 10;
/// The same of rows of results.
const ROWS: usize = 256 << 10;
/// Bytes for each byte of them: one of seven takes a kilobyte, and twice that while the list grows.
const ROW: usize = 400;
/// The same of Parquet: a page is unpacked at once.
const PAGES: usize = 4 << 20;
/// Most letters of a message.
const WORDS: usize = 1000;

/// PLY: clouds, and meshes.
pub fn ply(data: &[u8]) {
    cloud("input.ply", data, LISTS);
    let path = door::file("input.ply", data);
    if let Some(mesh) = heard(bounded(data.len(), LISTS, || io::read_mesh(&path)), Some(&path)) {
        let count = mesh.vertices.len();
        assert!(mesh.faces.as_flattened().iter().all(|&corner| (corner as usize) < count));
        assert!(mesh.faces.len() <= data.len());
    }
}

/// PCD: ascii, binary and compressed.
pub fn pcd(data: &[u8]) {
    cloud("input.pcd", data, BUFFERS);
}

/// Rows of numbers, under names that change how they are read.
pub fn text(data: &[u8]) {
    const NAMES: [&str; 6] =
        ["input.xyz", "input.xyzn", "input.csv", "input.pts", "input.txt", "input"];
    // A line of names, at most 1 MiB long, takes up to 200 times its size: a letter is a column.
    let longest = data.split(|&byte| byte == b'\n').map(<[u8]>::len).max().unwrap_or(0);
    cloud(NAMES[data.len() % NAMES.len()], data, BUFFERS + 250 * longest);
}

/// LAS and LAZ. The crate `laz` makes its models of the fields before it reads: some megabytes.
pub fn las(data: &[u8]) {
    cloud("input.laz", data, 32 << 20);
}

/// E57: the description is parsed into a tree, and a page has up to a megabyte.
pub fn e57(data: &[u8]) {
    cloud("input.e57", data, (4 << 20) + 100 * data.len());
}

/// Arrays of numpy, alone and in archives, and rows of f32 without a header: clouds, and tables of
/// numbers, descriptors and correspondences.
pub fn arrays(data: &[u8]) {
    const NAMES: [&str; 3] = ["input.npy", "input.npz", "input.bin"];
    cloud(NAMES[data.len() % NAMES.len()], data, 64 << 20);
    let path = door::file("input.npy", data);
    let table = heard(bounded(data.len(), 64 << 20, || io::read_array(&path)), Some(&path));
    if let Some(table) = table {
        let [rows, columns] = table.shape();
        assert!(columns > 0 && rows * columns <= data.len(), "more numbers than bytes");
        assert_eq!(table.values().len(), rows * columns);
    }
    if let Some(rows) = heard(io::read_descriptors(&path), Some(&path)) {
        assert!(rows.as_slice().iter().all(|x| x.is_finite()), "a descriptor is not finite");
    }
    if let Some((pairs, scores)) = heard(io::read_correspondences(&path), Some(&path)) {
        assert!(scores.is_none_or(|scores| scores.len() == pairs.len()));
    }
}

/// OBJ, OFF and STL: clouds, and meshes.
pub fn meshes(data: &[u8]) {
    const NAMES: [&str; 3] = ["input.obj", "input.off", "input.stl"];
    let name = NAMES[data.len() % NAMES.len()];
    cloud(name, data, BUFFERS + 40 * data.len());
    let path = door::file(name, data);
    let read = bounded(data.len(), BUFFERS + 40 * data.len(), || io::read_mesh(&path));
    if let Some(mesh) = heard(read, Some(&path)) {
        let count = mesh.vertices.len();
        assert!(mesh.faces.as_flattened().iter().all(|&corner| (corner as usize) < count));
    }
}

/// PTX: scans with headers.
pub fn ptx(data: &[u8]) {
    cloud("input.ptx", data, BUFFERS);
}

/// Gzip of anything: unpacked up to 64 MiB and more.
pub fn gzip(data: &[u8]) {
    cloud("input.ply.gz", data, 1 << 30);
}

/// Any file, moved within its format: what is read before is read again, as many points.
pub fn apply(data: &[u8]) {
    const NAMES: [&str; 8] = [
        "input.ply",
        "input.pcd",
        "input.xyz",
        "input.ptx",
        "input.obj",
        "input.stl",
        "input.npy",
        "input.laz",
    ];
    let name = NAMES[data.len() % NAMES.len()];
    let path = door::file(name, data);
    let moved = path.with_file_name(format!("moved-{name}"));
    let turn = Transform::from_rotation_vector([0.1, -0.2, 0.3]);
    let done = heard(io::apply(&path, &turn, &moved), Some(&path));
    if let (Some(_), Ok(before)) = (done, io::read(&path)) {
        match io::read(&moved) {
            Ok(after) => assert_eq!(before.len(), after.len(), "{name}"),
            // Turned coordinates may span more than those that were read.
            Err(Error::Parse { .. }) => {}
            Err(error) => panic!("{name}: {error}"),
        }
    }
    let _ = std::fs::remove_file(&moved);
}

fn cloud(name: &str, data: &[u8], beside: usize) {
    let path = door::file(name, data);
    if let Some(cloud) = heard(bounded(data.len(), beside, || io::read(&path)), Some(&path)) {
        // A compressed point may take less than a byte.
        let most = 16 * data.len() + if name.ends_with(".gz") { 64 << 20 } else { 0 };
        assert!(cloud.len() + cloud.dropped() <= most, "more points than bytes");
        sound(&cloud);
    }
}

/// Asserts that all of a cloud is finite, and one value a point.
pub(super) fn sound(cloud: &PointCloud) {
    let finite = |numbers: &[f64]| numbers.iter().all(|x| x.is_finite());
    assert!(cloud.positions().all(|p| finite(&p)), "a position is not finite");
    let places = [Some(cloud.origin()), Some(cloud.frame_origin()), cloud.viewpoint()];
    assert!(places.iter().flatten().all(|p| finite(p)), "{places:?}");
    if let Some(normals) = cloud.normals() {
        assert_eq!(normals.len(), cloud.len());
        for normal in normals {
            let square: f32 = normal.iter().map(|x| x * x).sum();
            assert!(square == 0.0 || (square - 1.0).abs() < 1e-5, "{normal:?} is no unit normal");
        }
    }
    if let Some(weights) = cloud.weights() {
        assert_eq!(weights.len(), cloud.len());
        assert!(weights.iter().all(|w| w.is_finite() && *w >= 0.0), "a weight is none");
    }
    for (name, values) in cloud.channels().iter() {
        assert_eq!(values.len(), cloud.len(), "{name}");
        assert!(values.iter().all(|x| x.is_finite()), "{name} is not finite");
    }
}

/// The value that was read; `None` after an error that has words, not too many, and the name of its file.
pub(super) fn heard<T>(read: Result<T, Error>, path: Option<&Path>) -> Option<T> {
    match read {
        Ok(read) => Some(read),
        Err(error) => {
            let said = error.to_string();
            assert!(!said.is_empty() && said.len() < WORDS, "{} letters: {said}", said.len());
            if let Some(name) = path.and_then(Path::file_name) {
                assert!(said.contains(&*name.to_string_lossy()), "{name:?} is not in: {said}");
            }
            None
        }
    }
}

/// ExternalPoses: four rows of four, JSON, and what `register --json` prints.
pub fn pose(data: &[u8]) {
    let path = door::file("pose.txt", data);
    let Some(pose) = heard(bounded(data.len(), TABLES, || io::read_transform(&path)), Some(&path))
    else {
        return;
    };
    // As far as `Transform::from_matrix` lets matrices of few digits be off.
    rigid(&pose, 2e-3);
    let again = door::folder().join("again.txt");
    io::write_transform(&again, &pose).expect("a pose that was read can be written");
    let back = io::read_transform(&again).expect("a pose that was written can be read");
    assert_eq!(back.translation, pose.translation);
    let entries = |pose: &Transform| pose.matrix().as_flattened().to_vec();
    let (before, after) = (entries(&pose), entries(&back));
    let off = before.iter().zip(&after).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    assert!(off <= 1e-14 * pose.scale.max(1.0), "{off:e}: {before:?} {after:?}");
}

/// Asserts that a pose is finite, its rotation one to within `tolerance`, its scale above 0.
pub(super) fn rigid(pose: &Transform, tolerance: f64) {
    let all = pose.matrix();
    assert!(all.as_flattened().iter().all(|x| x.is_finite()), "{all:?}");
    assert!(pose.scale > 0.0, "scale {}", pose.scale);
    let r = pose.rotation;
    let cofactor = |i: usize| {
        let (j, k) = ((i + 1) % 3, (i + 2) % 3);
        r[0][i] * (r[1][j] * r[2][k] - r[1][k] * r[2][j])
    };
    let determinant: f64 = (0..3).map(cofactor).sum();
    assert!((determinant - 1.0).abs() <= tolerance, "det R = {determinant}: {r:?}");
    for i in 0..3 {
        for j in 0..3 {
            let product: f64 = (0..3).map(|k| r[k][i] * r[k][j]).sum();
            let expected = f64::from(u8::from(i == j));
            assert!((product - expected).abs() <= tolerance, "RᵀR is not 1: {r:?}");
        }
    }
}

/// Lists of pairs and of places, as CSV.
pub fn list(data: &[u8]) {
    let path = door::file("list.csv", data);
    let read = bounded(data.len(), TABLES, || PairList::read(&path, Path::new("clouds")));
    if let Some(list) = heard(read, Some(&path)) {
        pairs(&list, data.len());
        let again = door::folder().join("written.csv");
        list.write(&again).expect("a list can be written");
        let back = PairList::read(&again, list.folder()).expect("what was written is a list");
        assert_eq!(back, list);
    }
    let read = bounded(data.len(), TABLES, || ScanPositions::read(&path));
    if let Some(places) = heard(read, Some(&path)) {
        let ScanPositions { names, positions: places } = places;
        assert!(names.len() == places.len() && names.iter().all(|name| !name.is_empty()));
        let pairs = radius_pairs(&places, 1.0).expect("places that were read are finite");
        assert!(pairs.iter().all(|[a, b]| b < a && *a < places.len()));
    }
}

/// That a list has pairs, and both names of each.
fn pairs(list: &PairList, bytes: usize) {
    assert!(!list.is_empty() && list.len() <= bytes);
    for index in 0..list.len() {
        assert!(list.pair(index).iter().all(|name| !name.is_empty()));
    }
}

/// Lists and results as Parquet.
pub fn parquet(data: &[u8]) {
    let path = door::file("input.parquet", data);
    let read = bounded(data.len(), PAGES, || PairList::read(&path, Path::new("clouds")));
    if let Some(list) = heard(read, Some(&path)) {
        // Rows that are alike take no bytes.
        pairs(&list, usize::MAX);
    }
    if let Some(rows) = heard(bounded(data.len(), PAGES, || results::read(&path)), Some(&path)) {
        graph(&rows);
    }
}

/// Results of `batch`: JSON Lines where an object begins, else CSV.
pub fn rows(data: &[u8]) {
    let json = data.trim_ascii_start().first() == Some(&b'{');
    let path = door::file(if json { "rows.jsonl" } else { "rows.csv" }, data);
    let read =
        heard(bounded(data.len(), ROWS + ROW * data.len(), || results::read(&path)), Some(&path));
    if let Some(text) = std::str::from_utf8(data).ok().filter(|_| json) {
        let parsed = heard(results::parse(text), None);
        assert_eq!(parsed, read, "a text is read otherwise than a file");
    }
    if let Some(rows) = read {
        graph(&rows);
    }
}

/// That a graph of poses has numbers only.
fn graph(rows: &[Row]) {
    let Some(found) = heard(RowGraph::new(rows), None) else { return };
    let graph = found.graph;
    assert!(graph.edge_count() + found.not_accepted + found.skipped <= rows.len());
    for tangent in [Tangent::Quaternion, Tangent::RotationVector] {
        let text = graph.g2o(tangent);
        for word in text.split_whitespace().filter(|word| !word.contains(':')) {
            let number: f64 = word.parse().expect("a graph has numbers");
            assert!(number.is_finite(), "{text}");
        }
    }
}

/// What `cfreg register --json` prints, read for a report.
pub fn report(data: &[u8]) {
    let path = door::file("result.json", data);
    let Some(kept) = heard(bounded(data.len(), TABLES, || SavedResult::read(&path)), Some(&path))
    else {
        return;
    };
    heard(kept.files(), None);
    let _ = (kept.thinning().validate(), kept.viewpoints());
    let corners = |x: f64| [[x, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [x, 1.0, 2.0]];
    let [source, target] = [1.0, 2.0].map(|x| PointCloud::new(&corners(x)).expect("a cloud"));
    if let Some(pair) = heard(kept.pair(&source, &target), None) {
        // A page takes a thousand times longer than reading.
        let drawn = data.iter().fold(0u32, |sum, &byte| sum.wrapping_mul(31) + u32::from(byte));
        if drawn.is_multiple_of(64)
            && let Some(page) = heard(pair.html(), None)
        {
            assert!(page.trim_end().ends_with("</html>"));
        }
    }
}

/// Lists of pairs with their poses: `gt.log`, CSV, and poses that others found.
pub fn benchmark(data: &[u8]) {
    let (log, csv) = (door::file("gt.log", data), door::file("pairs.csv", data));
    for path in [log, csv] {
        let read = bounded(data.len(), TABLES, || listed::read(&path, Path::new("clouds")));
        let Some(pairs) = heard(read, Some(&path)) else { continue };
        assert!(!pairs.is_empty() && pairs.len() <= data.len());
        for pair in &pairs {
            pair.truth.iter().for_each(|pose| rigid(pose, 2e-3));
            assert!(pair.unit > 0.0);
        }
        let poses = ExternalPoses::read(&path, Path::new("clouds"), &pairs);
        if let Some(poses) = heard(poses, Some(&path)) {
            let _ = poses.missing(&pairs);
        }
    }
}
