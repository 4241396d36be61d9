//! No file makes the reader panic or take memory it has no ground for, and what is
//! wrong with it is said with the file and the place.

use crate::common;

use std::fs;

use cfreg::{Error, io};
use common::files::{ENCODINGS, write_temp_file};
use proptest::collection::vec;
use proptest::prelude::*;
use tempfile::tempdir;

/// Asserts that the file is a [`Error::Parse`] whose text has its name and `parts`.
fn assert_refused(name: &str, content: &[u8], parts: &[&str]) {
    let folder = tempdir().unwrap();
    let path = folder.path().join(name);
    fs::write(&path, content).unwrap();
    let error = match io::read(&path) {
        Err(error @ Error::Parse { .. }) => error.to_string(),
        other => panic!("{parts:?}: {other:?}"),
    };
    for part in parts.iter().chain([&name]) {
        assert!(error.contains(part), "{part:?} is not in: {error}");
    }
}

const XYZ: &str = "property float x\nproperty float y\nproperty float z\n";

fn ply(format: &str, elements: &str, body: &[u8]) -> Vec<u8> {
    let header = format!("ply\nformat {format} 1.0\n{elements}end_header\n");
    [header.as_bytes(), body].concat()
}

fn vertices(count: &str) -> String {
    format!("element vertex {count}\n{XYZ}")
}

#[test]
fn ply_headers() {
    let cases: [(&str, &str, &[&str]); 13] = [
        ("ascii", &vertices("-5"), &["line 3", "element vertex -5", "0 or more"]),
        ("ascii", &vertices("99999999999999999999"), &["line 3", "99999999999999999999"]),
        ("ascii", "element vertex 1\nproperty quaternion x\n", &["line 4", "quaternion"]),
        ("ascii", "element vertex 1\nproperty list float x\n", &["line 4", "list float x"]),
        ("ascii", "property float x\n", &["line 3", "after an element"]),
        ("ascii", "element face 0\nproperty int x\n", &["no element vertex"]),
        ("ascii", "element vertex 1\nproperty float x\n", &["no y"]),
        ("ascii", "element vertex 0\n", &["no x"]),
        (
            "ascii",
            "element vertex 1\nproperty float x\nproperty float y\nproperty list uchar float z\n",
            &["no z"],
        ),
        ("ascii", &(vertices("1") + &vertices("2")), &["line 7", "repeats", "element vertex 2"]),
        ("middle_endian", &vertices("1"), &["line 2", "middle_endian"]),
        ("ascii", "wat\n", &["line 3", "wat"]),
        (
            "ascii",
            &("element vertex 1\n".to_owned() + &"comment more\n".repeat(100_000)),
            &["no end_header", "1048576"],
        ),
    ];
    for (format, elements, parts) in cases {
        assert_refused("a.ply", &ply(format, elements, b"1 2 3\n"), parts);
    }
    assert_refused("a.ply", b"plywood", &["line 1", "plywood"]);
    assert_refused("a.ply", b"ply\nformat ascii 1.0\n", &["no end_header"]);
    assert_refused("a.ply", b"ply\nelement vertex 0\nend_header\n", &["format"]);
}

#[test]
fn ply_bodies() {
    let ascii = |count: &str, body: &str| ply("ascii", &vertices(count), body.as_bytes());
    assert_refused(
        "a.ply",
        &ascii("1000000000000", "1 2 3\n"),
        &["line 8", "1000000000000", "6 bytes"],
    );
    assert_refused("a.ply", &ascii("3", "1.25 2.25 3.25\n4 5 6\n"), &["line 9", "vertex 2 of 3"]);
    assert_refused("a.ply", &ascii("2", "1 2 3\n4 5     \n"), &["line 9", "before property z"]);
    assert_refused("a.ply", &ascii("2", "1 2 3\n4 five 6\n"), &["line 9", "y is \"five\""]);
    assert_refused("a.ply", &[&ascii("1", "")[..], b"1 \xff 3\n"].concat(), &["byte 102", "UTF-8"]);

    let floats = |count: usize| [0; 4].repeat(count);
    for format in ["binary_little_endian", "binary_big_endian"] {
        let binary = |count: &str, body: &[u8]| ply(format, &vertices(count), body);
        let start = binary("1000000000000", &[]).len().to_string();
        let parts = ["1000000000000", "36 bytes", "enough for 3", &format!("byte {start}")];
        assert_refused("a.ply", &binary("1000000000000", &floats(9)), &parts);
        assert_refused("a.ply", &binary("4", &floats(11)), &["claims 4 vertex", "enough for 3"]);
        let max = u64::MAX.to_string();
        assert_refused("a.ply", &binary(&max, &floats(3)), &[&max, "12 bytes"]);
    }
    let list = vertices("2") + "property list int char w\n";
    let listed = |length: i32| {
        let row = [floats(3), length.to_le_bytes().into()].concat();
        ply("binary_little_endian", &list, &row.repeat(2))
    };
    assert_refused("a.ply", &listed(2_000_000_000), &["byte 140", "vertex 0 of 2"]);
    assert_refused("a.ply", &listed(-1), &["byte 140", "vertex 0", "negative"]);
    let float_list = vertices("1") + "property list float int w\n";
    assert_refused("a.ply", &ply("binary_big_endian", &float_list, &floats(4)), &["integer"]);

    let faces = "element face 9000000000\nproperty list uchar int i\n".to_owned() + &vertices("1");
    assert_refused("a.ply", &ply("ascii", &faces, b"0\n"), &["9000000000 face", "2 bytes"]);
    assert_refused(
        "a.ply",
        &ply("binary_big_endian", &faces, b"0\n"),
        &["9000000000 face", "2 bytes"],
    );
    let faces = faces.replace("9000000000", "1");
    assert_refused("a.ply", &ply("ascii", &faces, b"3 1 2\n1 2 3\n"), &["line 10", "property i"]);
    assert_refused("a.ply", &ply("ascii", &faces, b"-3 1 2\n1 2 3\n"), &["line 10", "\"-3\""]);
}

/// A PCD header with one entry replaced, or left out when `with` is empty.
#[test]
fn ply_meshes() {
    let three = vertices("3");
    let face = |rest: &str| format!("{three}element face {rest}");
    let list = "1\nproperty list uchar int vertex_indices\n";
    let points = "0 0 0\n1 0 0\n0 nan 0\n";
    let grid = |infos: &str, places: &str| {
        format!("{infos}{three}element range_grid 4\nproperty list uchar int {places}\n")
    };
    let (columns, rows) = ("obj_info num_cols 2\n", "obj_info num_rows 2\n");
    let cases: [(String, &str, &[&str]); 11] = [
        (three.clone(), "", &["no surface"]),
        (grid(columns, "vertex_indices"), "", &["no obj_info num_rows"]),
        (
            grid(&(columns.to_string() + "obj_info num_rows 3\n"), "vertex_indices"),
            "",
            &["4 places", "3 rows"],
        ),
        (
            grid(&(columns.to_string() + rows), "vertex_indices"),
            "1 0\n1 1\n0\n1 3\n",
            &["range_grid 3 names vertex 3"],
        ),
        (face("1\n"), "", &["no list vertex_indices"]),
        (face("1\nproperty list uchar int others\n"), "3 0 1 2\n", &["no list vertex_indices"]),
        (face(list), "3 0 1 3\n", &["face 0 names vertex 3 of 3"]),
        (face(list), "3 0 1 -1\n", &["face 0 names vertex -1 of 3"]),
        (face(list), "3 0 1 2\n", &["corner 2", "not finite"]),
        (face(list), "4000000000 0 1 2\n", &["line 13", "ends before property vertex_indices"]),
        (face("999999999\nproperty list uchar int vertex_indices\n"), "3 0 1 2\n", &["claims"]),
    ];
    for (elements, body, parts) in cases {
        let folder = tempdir().unwrap();
        let path = folder.path().join("mesh.ply");
        fs::write(&path, ply("ascii", &elements, (points.to_string() + body).as_bytes())).unwrap();
        let error = match io::read_mesh(&path) {
            Err(error @ Error::Parse { .. }) => error.to_string(),
            other => panic!("{parts:?}: {other:?}"),
        };
        assert!(parts.iter().all(|part| error.contains(part)), "{parts:?}: {error}");
    }
    let folder = tempdir().unwrap();
    let path = folder.path().join("cloud.xyz");
    fs::write(&path, "0 0 0\n").unwrap();
    assert!(io::read_mesh(&path).unwrap_err().to_string().contains("is not PLY"));
}

fn pcd(entry: &str, with: &str, data: &str, body: &[u8]) -> Vec<u8> {
    let entries =
        ["VERSION .7", "FIELDS x y z", "SIZE 4 4 4", "TYPE F F F", "COUNT 1 1 1", "WIDTH 2"];
    let entries = entries.into_iter().chain(["HEIGHT 1", "VIEWPOINT 0 0 0 1 0 0 0", "POINTS 2"]);
    let mut header = String::new();
    for line in entries {
        let line = if line.starts_with(entry) { with } else { line };
        header += line;
        header += if line.is_empty() { "" } else { "\n" };
    }
    [format!("{header}DATA {data}\n").as_bytes(), body].concat()
}

#[test]
fn pcd_headers() {
    let cases: [(&str, &str, &[&str]); 22] = [
        ("VERSION", "VERSION 9", &["line 1", "\"9\""]),
        ("FIELDS", "FIELDS x y w", &["line 2", "no z"]),
        ("FIELDS", "FIELDS x x z", &["\"x\"", "more than once"]),
        ("FIELDS", "FIELDS x X z", &["line 2", "x is there twice"]),
        ("FIELDS", "", &["FIELDS"]),
        ("SIZE", "SIZE 4 4", &["line 3", "SIZE"]),
        ("SIZE", "SIZE 4 4 3", &["F", "size 3"]),
        ("SIZE", "SIZE 4 -4 4", &["line 3", "\"-4\""]),
        ("TYPE", "TYPE F F Q", &["line 4", "\"Q\""]),
        ("COUNT", "COUNT 1 1 3", &["line 2", "no z"]),
        ("COUNT", "COUNT 1 1 99999999999999999999", &["line 5", "99999999999999999999"]),
        ("WIDTH", "WIDTH -2", &["line 6", "WIDTH", "\"-2\""]),
        ("WIDTH", "WIDTH 3", &["line 9", "POINTS is 2", "WIDTH is 3", "HEIGHT is 1"]),
        ("HEIGHT", "HEIGHT 18446744073709551615", &["line 9", "18446744073709551615"]),
        ("HEIGHT", "", &["HEIGHT"]),
        ("VIEWPOINT", "VIEWPOINT 0 0", &["line 8", "VIEWPOINT"]),
        ("VIEWPOINT", "VIEWPOINT nan 0 0 1 0 0 0", &["line 8", "\"nan\""]),
        ("POINTS", "POINTS two", &["line 9", "\"two\""]),
        ("POINTS", "POINTS 2 2", &["line 9", "POINTS"]),
        ("POINTS", "POINTS 2\nPOINTS 2", &["line 10", "line 9"]),
        ("POINTS", "", &["POINTS"]),
        ("POINTS", "POINTS 2\nDATA zip", &["line 10", "DATA"]),
    ];
    for (entry, with, parts) in cases {
        assert_refused("a.pcd", &pcd(entry, with, "ascii", b"1 2 3\n4 5 6\n"), parts);
    }
    assert_refused("a.pcd", b"VERSION .7\n", &["no DATA"]);
    assert_refused("a.pcd", "# .PCD\n".repeat(200_000).as_bytes(), &["no DATA", "1048576"]);
}

#[test]
fn pcd_bodies() {
    let plain = |data: &str, body: &[u8]| pcd("-", "", data, body);
    let huge = |data: &str, body: &[u8]| {
        let file = String::from_utf8(plain(data, body)).unwrap();
        let file = file.replace("WIDTH 2", "WIDTH 1000000000000");
        file.replace("POINTS 2", "POINTS 1000000000000").into_bytes()
    };
    assert_refused("a.pcd", &plain("ascii", b"1.25 2.25 3.25\n"), &["line 11", "point 1 of 2"]);
    assert_refused("a.pcd", &plain("ascii", b"1 2 3\n4 5   \n"), &["line 12", "2 columns", "z"]);
    assert_refused("a.pcd", &plain("ascii", b"1 2 3\n4 ? 6\n"), &["line 12", "y is \"?\""]);
    assert_refused("a.pcd", &huge("ascii", b"1 2 3\n"), &["line 11", "1000000000000", "6 bytes"]);
    assert_refused("a.pcd", &plain("binary", &[0; 23]), &["2 points", "23 bytes", "enough for 1"]);
    assert_refused("a.pcd", &huge("binary", &[0; 24]), &["byte", "1000000000000", "24 bytes"]);
    let wide = pcd("COUNT", "COUNT 1 1 1 18446744073709551615", "binary", &[0; 24]);
    let wide = [("x y z", "x y z w"), ("4 4 4", "4 4 4 4"), ("F F F", "F F F F")]
        .iter()
        .fold(wide, |file, (from, to)| String::from_utf8(file).unwrap().replace(from, to).into());
    assert_refused("a.pcd", &wide, &["18446744073709551615", "24 bytes"]);

    let packed = |packed: u32, unpacked: u32, body: &[u8]| {
        let sizes = [packed.to_le_bytes(), unpacked.to_le_bytes()].concat();
        plain("binary_compressed", &[&sizes, body].concat())
    };
    let literal = [&[23][..], &[0; 24]].concat();
    assert_refused("a.pcd", &plain("binary_compressed", &[0; 7]), &["byte", "sizes"]);
    assert_refused("a.pcd", &packed(4_000_000_000, 24, &literal), &["4000000000", "25 are left"]);
    assert_refused("a.pcd", &packed(25, 4_000_000_000, &literal), &["4000000000", "2 points"]);
    let half = [&[11][..], &[0; 12]].concat();
    assert_refused("a.pcd", &packed(13, 12, &half), &["12 bytes", "2 points"]);
    assert_refused("a.pcd", &packed(0, 0, &[]), &["0 bytes", "2 points"]);
    assert_refused("a.pcd", &packed(0, 24, &[]), &["cannot unpack"]);
    assert_refused("a.pcd", &packed(25, 24, &[255; 25]), &["byte", "back reference"]);
    assert_refused("a.pcd", &packed(24, 24, &literal), &["byte", "literal run"]);
}

#[test]
fn text_files() {
    let cases: [(&str, &[u8], &[&str]); 12] = [
        ("a.xyz", b"1 2 3\n\n4 5\n", &["line 3", "2 columns", "z is expected in column 3"]),
        ("a.xyz", b"1 2 3\n4 five 6\n", &["line 2", "y is \"five\""]),
        ("a.xyz", b"x y z\n1 2 3\nx y z\n", &["line 3", "x is \"x\""]),
        ("a.xyzn", b"1 2 3 0 0\n", &["line 1", "nz is expected in column 6"]),
        ("a.csv", b"lon,lat,up\n1,2,3\n", &["line 1", "no x"]),
        ("a.csv", b"x,y,z,X\n1,2,3,4\n", &["line 1", "x is there twice"]),
        ("a.txt", b"x 2 3\n", &["line 1", "x is \"x\""]),
        ("a.pts", b"-3\n1 2 3\n", &["line 1", "\"-3\""]),
        ("a.txt", b"1 2 3\n1 \xff 3\n", &["line 2", "y is \"\u{ff}\""]),
        ("a.txt", b"0 0 0\n1e74 0 0\n", &["span 1e74", "stray"]),
        ("a.txt", b"", &["is empty"]),
        ("a.dat", b"\x01\0\x02", &["in no format that is read"]),
    ];
    for (name, content, parts) in cases {
        assert_refused(name, content, parts);
    }
    for name in ["empty.ply", "empty.pcd", "empty"] {
        assert_refused(name, b"", &["is empty"]);
    }
    let long = "w".repeat(10_000);
    let folder = tempdir().unwrap();
    let path = folder.path().join("long.xyz");
    let header = pcd("TYPE", &format!("TYPE F F {long}"), "ascii", b"1 2 3\n4 5 6\n");
    for content in [format!("1 2 {long}\n").into_bytes(), header] {
        fs::write(&path, content).unwrap();
        assert!(io::read(&path).unwrap_err().to_string().len() < 400);
    }
}

#[test]
fn coordinates_too_large_to_compute_with() {
    let huge = [[0.0, 1.0, 2.0], [f64::NAN, 1e308, 0.0], [1.0, 2.0, -1e308]];
    for encoding in ENCODINGS {
        let name = format!("a.{}", encoding.extension());
        let content = encoding.encode(&huge, None);
        let text = String::from_utf8_lossy(&content).into_owned();
        let place = match text.split_once("end_header\n").or(text.split_once("DATA ascii\n")) {
            Some((header, rest)) if rest.is_ascii() => {
                format!("line {}", header.lines().count() + 4)
            }
            None if name != "a.pcd" => "line 4".into(),
            _ => "byte".into(),
        };
        let both = ["z is -1e308", "1e75", place.as_str()];
        assert_refused(&name, &content, &both);
        let one = encoding.encode(&[[1e308, 0.0, 0.0]], None);
        assert_refused(&name, &one, &["x is 1e308"]);
        // A row that is left out anyway may have any.
        let (_folder, path) = write_temp_file(&name, encoding.encode(&huge[..2], None));
        assert_eq!(io::read(path).unwrap().dropped(), 1);
    }
    let viewpoint = pcd("VIEWPOINT", "VIEWPOINT 0 1e76 0 1 0 0 0", "ascii", b"1 2 3\n4 5 6\n");
    assert_refused("a.pcd", &viewpoint, &["line 8", "VIEWPOINT has 1e76"]);
    let mesh = vertices("3") + "element face 1\nproperty list uchar int vertex_indices\n";
    let (_folder, path) =
        write_temp_file("mesh.ply", ply("ascii", &mesh, b"0 0 0\n1 0 0\n0 1e90 0\n3 0 1 2\n"));
    let error = io::read_mesh(path).unwrap_err().to_string();
    assert!(error.contains("line 12") && error.contains("y is 1e90"), "{error}");
}

#[cfg(unix)]
#[test]
fn pipes_are_read_up_to_a_limit() {
    use std::io::Write;
    let folder = tempdir().unwrap();
    let path = folder.path().join("pipe.xyz");
    assert!(std::process::Command::new("mkfifo").arg(&path).status().unwrap().success());
    let written = |line: &'static [u8], times: usize| {
        let path = path.clone();
        std::thread::spawn(move || {
            let mut pipe = fs::OpenOptions::new().write(true).open(path).unwrap();
            let lines = line.repeat((1 << 20) / line.len());
            // Who reads may have seen enough.
            (0..times).take_while(|_| pipe.write_all(&lines).is_ok()).count()
        })
    };
    let writer = written(b"1 2 3\n4 5 6\n", 1);
    let cloud = io::read(&path).unwrap();
    writer.join().unwrap();
    assert_eq!(cloud.len(), (1 << 20) / 12 * 2);
    // One that has no end.
    let writer = written(b"1 2 3\n", usize::MAX);
    let error = io::read(&path).unwrap_err().to_string();
    assert!(error.contains("268435456 bytes") && error.contains("pipe.xyz"), "{error}");
    assert!(writer.join().unwrap() >= 255);
}

#[test]
fn pose_files() {
    let cases: [(&str, &[&str]); 10] = [
        ("1 0 0 0\n0 1 0 0\n0 0 1\n0 0 0 1\n", &["line 3", "3 numbers, expected 4"]),
        ("1 0 0 0\n0 1 0 0\n0 0 1 0\n", &["3 rows, expected 4"]),
        ("1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n0 0 0 1\n", &["line 5", "fifth"]),
        ("1 0 0 0\n0 1 a 0\n0 0 1 0\n0 0 0 1\n", &["line 2", "\"a\""]),
        ("2 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n", &["rotation"]),
        ("nan 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n", &["finite"]),
        ("[[1, 0, 0, 0],\n[0, 1, 0 0]]", &["line 2", "JSON"]),
        ("[[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0]]", &["4 rows of 4"]),
        ("{\"pose\": 1}", &["\"transform\""]),
        ("", &["is empty"]),
    ];
    let folder = tempdir().unwrap();
    let path = folder.path().join("pose.txt");
    fs::write(&path, "1 ".repeat(3 << 20)).unwrap();
    assert!(io::read_transform(&path).unwrap_err().to_string().contains("a pose is short"));
    for (content, parts) in cases {
        fs::write(&path, content).unwrap();
        let error = match io::read_transform(&path) {
            Err(error @ Error::Parse { .. }) => error.to_string(),
            other => panic!("{content}: {other:?}"),
        };
        for part in parts.iter().chain([&"pose.txt"]) {
            assert!(error.contains(part), "{part:?} is not in: {error}");
        }
    }
}

#[test]
fn what_is_no_file_is_an_io_error() {
    let folder = tempdir().unwrap();
    let missing = folder.path().join("missing.ply");
    for (path, part) in [(folder.path(), "is a directory"), (&missing, "missing.ply")] {
        for error in [io::read(path).unwrap_err(), io::read_transform(path).unwrap_err()] {
            assert!(matches!(error, Error::Io { .. }));
            let text = error.to_string();
            assert!(text.contains(part) && text.contains(path.to_str().unwrap()), "{text}");
        }
    }
    #[cfg(unix)]
    assert!(matches!(io::read("/dev/zero"), Err(Error::Io { .. })));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(1000))]

    #[test]
    fn damaged_files_never_panic(
        encoding in prop::sample::select(&ENCODINGS[..]),
        points in vec(prop::array::uniform3(-1e3..1e3f64), 0..12),
        with_normals in any::<bool>(),
        flips in vec((any::<prop::sample::Index>(), any::<u8>()), 0..6),
        keep in prop_oneof![Just(None), any::<prop::sample::Index>().prop_map(Some)],
    ) {
        let mut file = encoding.encode(&points, with_normals.then_some(&points[..]));
        for (at, byte) in flips {
            let at = at.index(file.len());
            file[at] = byte;
        }
        if let Some(keep) = keep {
            file.truncate(keep.index(file.len()));
        }
        let folder = tempdir().unwrap();
        let path = folder.path().join("damaged").with_extension(encoding.extension());
        fs::write(&path, &file).unwrap();
        match io::read(&path) {
            Ok(cloud) => prop_assert!(cloud.len() + cloud.dropped() <= file.len()),
            Err(error) => prop_assert!(error.to_string().len() < 1000),
        }
        let _ = (io::read_transform(&path), io::read_mesh(&path));
    }

    #[test]
    fn any_bytes_never_panic(
        start in prop::sample::select(&["", "ply\n", "VERSION .7\n", "[", "{", "x y z\n"][..]),
        rest in vec(any::<u8>(), 0..200),
        extension in prop::sample::select(&["ply", "pcd", "xyz", "xyzn", "bin"][..]),
    ) {
        let folder = tempdir().unwrap();
        let path = folder.path().join("noise").with_extension(extension);
        fs::write(&path, [start.as_bytes(), &rest].concat()).unwrap();
        let _ = io::read(&path);
        let _ = (io::read_transform(&path), io::read_mesh(&path));
    }
}
