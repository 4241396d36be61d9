//! Formats of other programs: each is read as its writers mean it, refused with words where it is
//! broken, and written so that it is read back.

use crate::common;

use std::path::Path;

use cfreg::cloud::{Channels, ColorDepth};
use cfreg::{Error, PointCloud, Transform, io};
use common::files::{read, write_temp_file};
use tempfile::tempdir;

fn positions(cloud: &PointCloud) -> Vec<[f64; 3]> {
    cloud.positions().collect()
}

const TWO: [[f64; 3]; 2] = [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]];

/// A header of numpy's first format.
fn npy(header: &str, data: &[u8]) -> Vec<u8> {
    let length = (header.len() as u16).to_le_bytes();
    [b"\x93NUMPY\x01\0", &length[..], header.as_bytes(), data].concat()
}

fn floats(values: impl IntoIterator<Item = f64>) -> Vec<u8> {
    values.into_iter().flat_map(|x| (x as f32).to_le_bytes()).collect()
}

#[test]
fn each_format_gives_its_points() {
    let plain = TWO.as_flattened().iter().copied();
    let kitti: Vec<f64> = TWO.iter().flat_map(|p| [p[0], p[1], p[2], 0.5]).collect();
    let columns: Vec<f64> = (0..3).flat_map(|axis| TWO.map(|p| p[axis])).collect();
    let header = |descr: &str, fortran: &str, shape: &str| {
        format!("{{'descr': {descr}, 'fortran_order': {fortran}, 'shape': {shape}, }}\n")
    };
    let records = "[('rgb', '|u1', (3,)), ('x', '<f4'), ('y', '<f4'), ('z', '<f4')]";
    let record = |p: [f64; 3]| [vec![9, 9, 9], floats(p)].concat();
    let mut stl = vec![b' '; 80];
    stl.extend(1u32.to_le_bytes());
    stl.extend(floats([0.0, 0.0, 1.0].into_iter().chain(plain.clone()).chain([4.0, 5.0, 6.0])));
    stl.extend([0, 0]);
    let cases: Vec<(&str, Vec<u8>)> = vec![
        ("a.obj", b"# by hand\no thing\nv 1 2 3\nv 4 5 6 1 0 0\nf 1 2 -1\n".into()),
        ("a.off", b"OFF # made\n2 1 0\n1 2 3\n4 5 6\n2 0 1\n".into()),
        ("a.off", b"COFF 2 0 0\n1 2 3 255 0 0 255\n4 5 6 0 0 255 255\n".into()),
        ("a.stl", stl),
        ("a.stl", b"solid a\nfacet normal 0 0 1\nouter loop\nvertex 1 2 3\nvertex 4 5 6\nvertex 4 5 6\nendloop\nendfacet\nendsolid\n".into()),
        ("a.ptx", b"1\n3\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n1 0 0 0\n0 1 0 0\n0 0 1 0\n1 1 1 1\n0 1 2 0.5\n0 0 0 0.5\n3 4 5 0.5\n".into()),
        ("a.pts", b"1\n1 2 3 -1200 128 100 90\n1\n4 5 6 -1200 128 100 90\n".into()),
        ("a.bin", floats(kitti.clone())),
        ("a.npy", npy(&header("'<f4'", "False", "(2, 3)"), &floats(plain.clone()))),
        ("a.npy", npy(&header("'<f4'", "True", "(2, 3)"), &floats(columns))),
        ("a.npy", npy(&header("'>f8'", "False", "(1, 2, 3)"), &plain.clone().flat_map(f64::to_be_bytes).collect::<Vec<u8>>())),
        ("a.npy", npy(&header(records, "False", "(2,)"), &[record(TWO[0]), record(TWO[1])].concat())),
        ("a.csv", b"Easting [m],Northing [m],Height [m]\n1,2,3\n4,5,6\n".into()),
        ("a.csv", b"sep=;\n\"Points:0\";\"Points:1\";\"Points:2\"\n1,0;2,0;3,0\n4;5;6\n".into()),
        ("a.csv", b"x;y;z;Intensit\xe4t\n1;2;3;4\n4;5;6;7\n".into()),
        ("a.txt", b"% x y z\n1 2 3\n4 5 6\n".into()),
        ("a.csv", "\u{feff}x,y,z\n1,2,3\n,,\n4,5,6\n".encode_utf16().flat_map(u16::to_le_bytes).collect()),
    ];
    for (index, (name, content)) in cases.into_iter().enumerate() {
        let cloud = read(name, &content);
        assert_eq!(positions(&cloud), TWO, "case {index}, {name}");
    }
    let scan = read("a.bin", floats(kitti));
    assert_eq!(scan.channels().get("intensity"), Some(&[0.5, 0.5][..]));
    let shaded = read("a.pts", "2\n1 2 3 7 255 0 0\n4 5 6 7 0 0 255\n");
    assert_eq!(shaded.channels().color_depth("red"), Some(ColorDepth::Eight));
    assert_eq!(shaded.channels().get("intensity"), Some(&[7.0, 7.0][..]));
}

#[test]
fn scans_have_their_sensors() {
    let scan = "1\n2\n10 20 30\n1 0 0\n0 1 0\n0 0 1\n0 1 0 0\n-1 0 0 0\n0 0 1 0\n10 20 30 1\n\
                1 0 0 0.5\n0 0 0 0.5\n";
    let (_folder, path) = write_temp_file("a.ptx", scan);
    let cloud = io::read(&path).unwrap();
    assert_eq!(positions(&cloud), [[10.0, 21.0, 30.0]]);
    assert_eq!((cloud.viewpoint(), cloud.no_returns()), (Some([10.0, 20.0, 30.0]), 1));
    let (_folder, path) = write_temp_file("b.ptx", scan.repeat(2));
    let (both, differences) = io::read_with_differences(&path).unwrap();
    assert_eq!((both.len(), both.viewpoint()), (2, None));
    assert!(differences.to_string().contains("2 scans"), "{differences}");
    let second = io::read(format!("{}#2", path.display())).unwrap();
    assert_eq!((second.len(), second.viewpoint()), (1, Some([10.0, 20.0, 30.0])));
    let none = io::read(format!("{}#3", path.display())).unwrap_err().to_string();
    assert!(none.contains("no scan is 3") && none.contains("has 2"), "{none}");
}

/// A cloud with all that a cloud may have, far from zero.
fn full(offset: [f64; 3]) -> PointCloud {
    let points: Vec<[f64; 3]> = (0..40)
        .map(|i| {
            let t = f64::from(i);
            [offset[0] + 0.25 * t, offset[1] + (t * 0.7).sin(), offset[2] + (t * 0.3).cos()]
        })
        .collect();
    let shade = |k: usize| (0..40).map(|i| ((i * k) % 256) as f32 / 255.0).collect::<Vec<f32>>();
    let mut channels = Channels::default();
    for (k, name) in [(3, "red"), (5, "green"), (7, "blue")] {
        channels = channels.with_color(name, shade(k), ColorDepth::Eight).unwrap();
    }
    let channels = channels.with("intensity", (0..40).map(|i| i as f32).collect()).unwrap();
    let channels = channels.with("glow", (0..40).map(|i| i as f32 / 7.0).collect()).unwrap();
    let normals = vec![[0.0, 0.6, 0.8]; 40];
    PointCloud::with_normals(&points, &normals).unwrap().with_channels(channels).unwrap()
}

#[cfg(feature = "cli")]
#[test]
fn what_is_written_is_read_back() {
    let folder = tempdir().unwrap();
    for offset in [[0.0; 3], [4.5e5, 5.4e6, 300.0]] {
        let cloud = full(offset).with_viewpoint([offset[0] + 1.0, offset[1], offset[2]]).unwrap();
        for name in ["a.las", "a.laz", "a.e57", "a.npy", "a.pts", "a.ply", "a.pcd", "a.csv"] {
            let path = folder.path().join(name);
            io::write(&path, &cloud).unwrap();
            let back = io::read(&path).unwrap();
            assert_eq!(back.len(), cloud.len(), "{name}");
            for (own, other) in back.positions().zip(cloud.positions()) {
                let off = (0..3).map(|k| (own[k] - other[k]).abs()).fold(0.0, f64::max);
                assert!(off < 2e-6, "{name}: {own:?} {other:?}");
            }
            for channel in ["red", "intensity"] {
                let [own, other] = [&back, &cloud].map(|cloud| cloud.channels().get(channel));
                let (own, other) = (own.unwrap(), other.unwrap());
                let same = own.iter().zip(other).all(|(a, b)| (a - b).abs() < 1e-6);
                assert!(same, "{name} {channel}: {own:?}");
                assert_eq!(back.channels().color_depth(channel).is_some(), channel == "red");
            }
            if name != "a.pts" {
                assert!(back.channels().get("glow").is_some(), "{name}");
                assert!((back.normals().unwrap()[3][1] - 0.6).abs() < 1e-6, "{name}");
            }
            let keeps_viewpoint = ["a.e57", "a.pcd"].contains(&name);
            assert_eq!(back.viewpoint().is_some(), keeps_viewpoint, "{name}");
            let said = io::differences(&path, &cloud).unwrap().to_string();
            assert_eq!(said.contains("viewpoint"), !keeps_viewpoint, "{name}: {said}");
        }
    }
}

fn refusal(name: &str, content: &[u8]) -> String {
    let (_folder, path) = write_temp_file(name, content);
    match io::read(&path) {
        Err(error @ Error::Parse { .. }) => error.to_string(),
        other => panic!("{name}: {other:?}"),
    }
}

#[test]
fn refusals_name_the_format_and_the_place() {
    let cases: [(&str, &[u8], &[&str]); 16] = [
        ("a.las", b"LASF", &["LAS: ", "byte 0", "227 bytes"]),
        ("a.e57", b"ASTM-E57", &["E57: "]),
        ("a.ptx", b"2\n2\n0 0 0\n", &["PTX: ", "line 3", "cut short"]),
        ("a.obj", b"v 1 2 3\nf 1 2 9\n", &["OBJ: ", "line 2", "\"2\"", "of 1"]),
        ("a.off", b"OFF\n9000000000 1 0\n1 2 3\n", &["OFF: ", "line 2", "9000000000"]),
        ("a.stl", b"solid a\nvertex 1 2\n", &["STL: ", "line 2", "vertex x y z"]),
        ("a.npy", b"\x93NUMPY\x01\0\xff\xff", &["NPY: ", "byte 0", "cut short"]),
        ("a.npz", b"PK\x03\x04", &["NPZ: ", "directory"]),
        ("a.bin", b"123", &["KITTI .bin: ", "multiple of 16", "NPY"]),
        ("a.bag", b"#ROSBAG V2.0\n\0", &["ROS bag", "rosbags"]),
        ("a.rcp", b"\0\0", &["ReCap", "E57"]),
        ("a.dat", b"\x01\0\x02", &["no format", "LAZ"]),
        ("a.csv", b"lat,lon,alt\n1,2,3\n", &["text: ", "line 1", "lat, lon, alt"]),
        ("a.txt", b"0,9375, 2,2289, 0,8964\n", &["line 1", "decimal points", "semicolons"]),
        ("a.csv", b"x,y,z\n0,93,2,22,0,89\n", &["line 2", "6 cells", "3 names"]),
        ("a.txt", b"1,5 2.5 3\n", &["line 1", "decimal points in some places"]),
    ];
    for (name, content, parts) in cases {
        let said = refusal(name, content);
        assert!(parts.iter().all(|part| said.contains(part)), "{parts:?}: {said}");
    }
}

#[test]
fn only_columns_that_are_asked_for_stop_a_file() {
    let header = "ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\n\
                  property float z\nproperty float weight\nproperty float glow\nproperty int64 id\n\
                  property float glow\nend_header\n";
    for bad in ["-1", "nan", "0"] {
        let content = format!("{header}1 2 3 {bad} 5 7 8\n4 5 6 {bad} 5 7 8\n");
        let (_folder, path) = write_temp_file("a.ply", content.replace('\n', "\r"));
        let (cloud, differences) = io::read_with_differences(path).unwrap();
        assert_eq!((positions(&cloud), cloud.weights()), (TWO.to_vec(), None), "{bad}");
        assert_eq!(cloud.channels().get("glow"), Some(&[5.0, 5.0][..]));
        assert!(cloud.channels().get("id").is_some());
        let said = differences.to_string();
        assert!(said.contains("weight is left out") && said.contains("the second glow"), "{said}");
    }
}

#[test]
fn the_small_inputs_are_read_as_their_readme_says() {
    let Some(data) = common::shared_data() else { return };
    let folder = data.join("../cases/formats");
    let Ok(files) = std::fs::read_dir(&folder) else { return };
    for file in files {
        let path = file.unwrap().path();
        let name = path.file_name().unwrap().to_string_lossy().into_owned();
        let refused = match name.as_str() {
            "txt_decimal_comma_commaspace.txt" => Some("decimal points"),
            "ply_3dgs_compressed.ply" => Some("SuperSplat"),
            "pcd_xtreme1_ext.pcd" => Some("Xtreme1"),
            _ => None,
        };
        match (io::read(&path), refused) {
            (Ok(cloud), None) => {
                let rows = cloud.len() + cloud.dropped() + cloud.no_returns();
                assert!((300..=400).contains(&rows), "{name}: {rows}");
            }
            (Err(error), Some(word)) => assert!(error.to_string().contains(word), "{error}"),
            (found, _) => panic!("{name}: {found:?}"),
        }
    }
    let moved = io::read(Path::new(&folder).join("ptx.ptx")).unwrap();
    assert!(moved.viewpoint() == Some([10.0, 20.0, 30.0]) && moved.no_returns() > 0);
}

/// Moves a file, and returns what it then holds.
fn applied(name: &str, content: &[u8], transform: &Transform) -> (Vec<u8>, PointCloud, String) {
    let (folder, path) = write_temp_file(name, content);
    let output = folder.path().join(format!("moved-{name}"));
    let moved = io::apply(&path, transform, &output).unwrap();
    let content = std::fs::read(&output).unwrap();
    (content, io::read(&output).unwrap(), moved.differences.to_string())
}

#[test]
fn files_that_move_keep_all_else() {
    let turn =
        Transform::rigid([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]], [10.0, 0.0, 0.5]);
    let moved = TWO.map(|p| turn.apply(p));
    let ply = "ply\nformat ascii 1.0\ncomment kept\nelement vertex 2\nproperty uchar red\n\
               property float x\nproperty float y\nproperty float z\nproperty list uchar int views\n\
               property float nx\nproperty float ny\nproperty float nz\nelement face 1\n\
               property list uchar int vertex_indices\nend_header\n\
               7 1 2 3 2 5 5 0 1 0\n8 4 5 6 0 0 1 0\n3 0 1 0\n";
    let (text, cloud, _) = applied("a.ply", ply.as_bytes(), &turn);
    let text = String::from_utf8(text).unwrap();
    assert_eq!(positions(&cloud), moved);
    assert_eq!(cloud.normals().unwrap()[0], [-1.0, 0.0, 0.0]);
    assert!(text.contains("comment kept") && text.ends_with("3 0 1 0\n"), "{text}");
    assert!(text.contains("7 8.000000 1.000000 3.500000 2 5 5 -1.000000"), "{text}");

    let csv = "# made by hand\nid;x;y;z;note\n a;1,0;2,0;3,00;ü\n b;4;5;6;last # seen\n";
    let (text, cloud, _) = applied("a.csv", csv.as_bytes(), &turn);
    let text = String::from_utf8(text).unwrap();
    assert_eq!(positions(&cloud), moved);
    assert!(
        text.starts_with("# made by hand\nid;x;y;z;note\n a;8,000000;1,000000;3,500000;ü"),
        "{text}"
    );
    assert!(text.contains("b;5,000000;4,000000;6,500000;"), "{text}");
    assert!(text.ends_with("last # seen\n"), "{text}");

    let obj = "v 1 2 3\nvt 0 0\nv 4 5 6\nvn 0 1 0\nf 1 2 1\n";
    let (text, cloud, _) = applied("a.obj", obj.as_bytes(), &turn);
    assert_eq!(positions(&cloud), moved);
    assert!(
        String::from_utf8(text).unwrap().ends_with("vn -1.000000 0.000000 0.000000\nf 1 2 1\n")
    );

    let ptx = "1\n2\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n1 2 3 0.5\n4 5 6 0.5\n";
    let (text, cloud, _) = applied("a.ptx", ptx.as_bytes(), &turn);
    assert_eq!((positions(&cloud), cloud.viewpoint()), (moved.to_vec(), Some([10.0, 0.0, 0.5])));
    assert!(String::from_utf8(text).unwrap().ends_with("1 2 3 0.5\n4 5 6 0.5\n"));
}

#[cfg(feature = "cli")]
#[test]
fn binary_files_move_and_come_back() {
    let cloud = full([0.0; 3]);
    let turn = Transform::from_rotation_vector([0.3, -0.5, 1.1]);
    let turn = Transform { translation: [4.5e5, 5.4e6, 300.0], ..turn };
    let folder = tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    for name in ["a.ply", "a.pcd", "a.npy", "a.las", "a.laz", "a.e57", "a.ply.gz"] {
        let plain = name.trim_end_matches(".gz");
        io::write(at(plain), &cloud).unwrap();
        let moved = at(&format!("moved-{name}"));
        let first = io::apply(at(plain), &turn, &moved).unwrap();
        assert_eq!(first.points, 40, "{name}");
        let expected = cloud.transformed(&turn).unwrap();
        let found = io::read(&moved).unwrap();
        for (own, other) in found.positions().zip(expected.positions()) {
            let off = (0..3).map(|k| (own[k] - other[k]).abs()).fold(0.0, f64::max);
            assert!(off < 1e-5, "{name}: {own:?} {other:?}: {}", first.differences);
        }
        let [own, other] = [&found, &expected].map(|cloud| cloud.normals().unwrap()[7]);
        assert!((0..3).all(|k| (own[k] - other[k]).abs() < 1e-5), "{name}: {own:?} {other:?}");
        assert_eq!(found.channels().get("glow"), cloud.channels().get("glow"), "{name}");
        io::apply(&moved, &turn.inverse(), at(plain)).unwrap();
        let back = io::read(at(plain)).unwrap();
        for (own, other) in back.positions().zip(cloud.positions()) {
            let off = (0..3).map(|k| (own[k] - other[k]).abs()).fold(0.0, f64::max);
            assert!(off < 1e-5, "{name}: {own:?} {other:?}");
        }
    }
    let scaled = Transform { scale: 2.0, ..turn };
    let said = io::apply(at("a.e57"), &scaled, at("b.e57")).unwrap_err().to_string();
    assert!(said.contains("scale 2"), "{said}");
    io::apply(at("a.e57"), &scaled, at("b.las")).unwrap();
}

#[cfg(feature = "cli")]
#[test]
fn damaged_binary_files_are_refused() {
    let folder = tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    for name in ["a.las", "a.laz", "a.e57"] {
        io::write(at(name), &full([0.0; 3])).unwrap();
        let content = std::fs::read(at(name)).unwrap();
        for end in [10, 100, 300, content.len() / 2, content.len() - 1] {
            std::fs::write(at(name), &content[..end.min(content.len())]).unwrap();
            let found = io::read(at(name));
            assert!(found.is_err() || end == content.len() - 1, "{name} {end}");
        }
        // Counts that lie: of LAS in its header, of E57 in its description.
        let mut lying = content.clone();
        lying[107..111].copy_from_slice(&u32::MAX.to_le_bytes());
        std::fs::write(at(name), &lying).unwrap();
        assert!(io::read(at(name)).is_err() || name == "a.e57", "{name}");
    }
}

/// Files that laspy 2.7 and pye57 0.4 wrote, of the points (cos 0.7 i, sin 1.1 i, 0.25 (i mod 5) - 0.3).
#[cfg(feature = "cli")]
#[test]
fn files_of_laspy_and_pye57_are_read() {
    let seeds = Path::new(env!("CARGO_MANIFEST_DIR")).join("fuzz/seeds");
    for (name, step) in
        [("las/a.las", 1e-4), ("las/a.laz", 1e-4), ("las/b.laz", 1e-4), ("e57/a.e57", 1e-9)]
    {
        let cloud = io::read(seeds.join(name)).unwrap();
        let shift = if name == "e57/a.e57" { [1.0, 2.0, 3.0] } else { [0.0; 3] };
        assert_eq!(cloud.len(), 8, "{name}");
        for (i, own) in cloud.positions().enumerate() {
            let t = i as f64;
            let place = [(0.7 * t).cos(), (1.1 * t).sin(), 0.25 * (i % 5) as f64 - 0.3];
            let off = (0..3).map(|k| (own[k] - place[k] - shift[k]).abs()).fold(0.0, f64::max);
            assert!(off < 0.51 * step + 3e-7, "{name}: {i}: {own:?} {place:?}");
        }
        let channel = |name: &str| cloud.channels().get(name).unwrap();
        if name.starts_with("las") {
            assert_eq!(channel("intensity")[3], 30.0, "{name}");
            assert_eq!(channel("gps_time")[3], 4.5, "{name}");
            assert_eq!(channel("glow")[3], 1.0, "{name}");
            assert_eq!(cloud.channels().color_depth("red").is_some(), name != "las/b.laz");
        } else {
            assert_eq!((channel("intensity")[2], cloud.viewpoint()), (0.25, Some([1.0, 2.0, 3.0])));
            assert_eq!(channel("red")[5], 5.0 / 255.0);
            let named = io::read(seeds.join("e57/a.e57#first")).unwrap();
            assert_eq!(named.len(), 8);
        }
    }
}
