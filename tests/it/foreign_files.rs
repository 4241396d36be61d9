//! What others wrote is read right: PLY, PCD and text of every kind, and real scans.

use crate::common;

use std::fs;
use std::path::Path;

use cfreg::{PointCloud, Transform, io};
use common::files::{ENCODINGS, read, write_temp_file};

fn positions(cloud: &PointCloud) -> Vec<[f64; 3]> {
    cloud.positions().collect()
}

#[test]
fn ply_elements_lists_and_extra_properties_are_skipped() {
    let header = |format: &str| {
        format!(
            "ply\r\nformat {format} 1.0\nobj_info num_cols 512\ncomment caf\u{e9}\n\
             element nothing 1000000000\n\
             element camera 2\nproperty list uchar short roi\nproperty float x\n\
             element vertex 2\nproperty uchar red\nproperty list int8 double w\nproperty int16 z\n\
             property uint y\nproperty float32 x\nproperty float nx\n\
             element face 7\nproperty list uchar int vertex_indices\nend_header\n"
        )
    };
    let expected = [[0.5, 7.0, -3.0], [-2.0, 8.0, 4.0]];

    let ascii = "3 1 2 3 9.5\n0 9.5\n\n255 1 0.5 -3 7 .5 1\n0 0 4 8 -2. 1\nand so on";
    let cloud = read("a.ply", header("ascii") + ascii);
    assert_eq!(positions(&cloud), expected);
    assert!(cloud.normals().is_none());

    let mut binary = header("binary_big_endian").into_bytes();
    binary.extend([3, 0, 1, 0, 2, 0, 3]);
    binary.extend(9.5f32.to_be_bytes());
    binary.push(0);
    binary.extend(9.5f32.to_be_bytes());
    for ([x, y, z], weights) in expected.iter().zip([&[0.5f64][..], &[]]) {
        binary.extend([255, weights.len() as u8]);
        binary.extend(weights.iter().flat_map(|w| w.to_be_bytes()));
        binary.extend((*z as i16).to_be_bytes());
        binary.extend((*y as u32).to_be_bytes());
        binary.extend((*x as f32).to_be_bytes());
        binary.extend(1f32.to_be_bytes());
    }
    binary.extend(b"and so on");
    assert_eq!(positions(&read("a.ply", binary)), expected);
}

#[test]
fn faces_become_triangles_in_every_encoding() {
    let header = |format: &str| {
        format!(
            "ply\nformat {format} 1.0\nelement sensor 1\nproperty list uchar int beams\n\
             element vertex 5\nproperty float x\nproperty float y\nproperty float z\n\
             element face 3\nproperty uchar quality\nproperty list uchar int vertex_indices\n\
             end_header\n"
        )
    };
    let points = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0], [0.5; 3]];
    let faces: [&[i32]; 3] = [&[0, 1, 2, 3], &[0, 1, 4], &[2, 3]];
    let ascii = "2 7 7\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n.5 .5 .5\n9 4 0 1 2 3\n9 3 0 1 4\n9 2 2 3\n";
    let mut files = vec![(header("ascii") + ascii).into_bytes()];
    for big in [false, true] {
        let number = |x: i32| if big { x.to_be_bytes() } else { x.to_le_bytes() };
        let float = |x: f32| if big { x.to_be_bytes() } else { x.to_le_bytes() };
        let name = if big { "binary_big_endian" } else { "binary_little_endian" };
        let mut file = header(name).into_bytes();
        file.push(2);
        [7, 7].iter().for_each(|&beam| file.extend(number(beam)));
        points.as_flattened().iter().for_each(|&x| file.extend(float(x)));
        for face in faces {
            file.extend([9, face.len() as u8]);
            face.iter().for_each(|&corner| file.extend(number(corner)));
        }
        files.push(file);
    }
    for content in files {
        let (_folder, path) = write_temp_file("mesh.ply", content);
        let mesh = io::read_mesh(path).unwrap();
        assert_eq!(mesh.vertices, points.map(|p| p.map(f64::from)));
        assert_eq!(mesh.faces, [[0, 1, 2], [0, 2, 3], [0, 1, 4]]);
    }
}

#[test]
fn a_range_grid_becomes_triangles_where_something_was_seen() {
    // 3 columns, 2 rows; nothing was seen at the second place of the second row.
    let content = "ply\nformat ascii 1.0\nobj_info num_cols 3\nobj_info num_rows 2\n\
                   element vertex 5\nproperty float x\nproperty float y\nproperty float z\n\
                   element range_grid 6\nproperty list uchar int vertex_indices\nend_header\n\
                   0 0 0\n1 0 0\n2 0 0\n0 1 0\n2 1 0\n1 0\n1 1\n1 2\n1 3\n0\n1 4\n";
    let (_folder, path) = write_temp_file("grid.ply", content);
    assert_eq!(io::read_mesh(path).unwrap().faces, [[0, 1, 3], [1, 2, 4]]);
    let Some(data) = common::shared_data() else { return };
    let mesh = io::read_mesh(data.join("stanford_bunny/bun000.ply")).unwrap();
    // A grid of n points has nearly 2n triangles.
    assert!((70_000..80_512).contains(&mesh.faces.len()), "{}", mesh.faces.len());
}

#[test]
fn ascii_keeps_digits_that_a_float_would_lose() {
    let ply = "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\n\
               property float z\nend_header\n5600000.25 1 2\n";
    let pcd = "VERSION .7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nWIDTH 1\nHEIGHT 1\nPOINTS 1\n\
               DATA ascii\n5600000.25 1 2\n";
    assert_eq!(read("a.ply", ply).position(0), [5600000.25, 1.0, 2.0]);
    assert_eq!(read("a.pcd", pcd).position(0), [5600000.25, 1.0, 2.0]);
}

#[test]
fn ply_drops_what_is_not_finite() {
    let ply = "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\n\
               property float z\nend_header\nnan nan nan\n1 2 3\n-inf 0 0\n-nan(ind) 0 0\n";
    let cloud = read("a.ply", ply);
    assert_eq!((positions(&cloud), cloud.dropped()), (vec![[1.0, 2.0, 3.0]], 3));
}

#[test]
fn organised_pcd_with_padding_and_arrays_is_read() {
    let header = "# made elsewhere\nVERSION 0.7\nFIELDS intensity _ y fpfh x z _\n\
                  SIZE 1 1 8 4 4 2 4\nTYPE U U F F F I F\nCOUNT 1 3 1 2 1 1 1\nWIDTH 2\nHEIGHT 2\n\
                  VIEWPOINT 1 2 3 1 0 0 0\nPOINTS 4\n";
    let xs = [0.5f32, f32::NAN, 1.5, f32::NAN];
    let mut ascii = format!("{header}DATA ascii\n");
    let mut binary = format!("{header}DATA binary\n").into_bytes();
    for x in xs {
        ascii += &format!("7 0 0 0 5600000.25 1 2 {x} -3 0\n");
        binary.extend([7, 0, 0, 0]);
        binary.extend(5600000.25f64.to_le_bytes());
        binary.extend([1f32, 2.0, x].iter().flat_map(|v| v.to_le_bytes()));
        binary.extend((-3i16).to_le_bytes());
        binary.extend([0; 4]);
    }
    for cloud in [read("a.pcd", ascii), read("a.pcd", binary)] {
        assert_eq!(positions(&cloud), [[0.5, 5600000.25, -3.0], [1.5, 5600000.25, -3.0]]);
        assert_eq!((cloud.dropped(), cloud.viewpoint()), (2, Some([1.0, 2.0, 3.0])));
    }
}

#[test]
fn old_pcd_versions_are_read() {
    for version in ["0.5", ".6"] {
        let pcd = format!(
            "VERSION {version}\nCOLUMNS x y z\nSIZE 4 4 4\nTYPE F F F\nWIDTH 1\nHEIGHT 1\n\
             POINTS 1\nDATA ascii\n1 2 3"
        );
        assert_eq!(positions(&read("a.pcd", pcd)), [[1.0, 2.0, 3.0]]);
    }
}

#[test]
fn text_of_every_kind_is_read() {
    let cases = [
        ("spaces", "a.xyz", "1 2 3\n4 5 6"),
        ("tabs and old line ends", "a.asc", "1\t2\t3\r4\t5\t6\r"),
        ("semicolons", "a.txt", "1; 2; 3\r\n4;5;6\r\n"),
        ("no extension", "scan", "1 2 3\n4 5 6\n"),
        ("more columns", "a.csv", "1,2,3,255,0,0\n4,5,6,0,0,255\n"),
        ("a byte order mark", "a.csv", "\u{feff}1,2,3\n4,5,6\n"),
        ("comments", "a.txt", "# hand made\n1 2 3 # first\n// then\n4 5 6 // last\n"),
        ("a count", "a.pts", "2\n1 2 3 0.5 9 9 9\n4 5 6 0.5 9 9 9\n"),
        ("names", "a.csv", "\"Time\",\"Z\",\"Y\",\"X\"\n0,3,2,1\n0,6,5,4\n"),
        ("names in a comment", "a.xyz", "//Z Y X\n3 2 1\n6 5 4\n"),
        ("a comment that speaks of x", "a.xyz", "# x forward y left z up\n1 2 3\n4 5 6\n"),
    ];
    for (case, name, content) in cases {
        let cloud = read(name, content);
        assert_eq!(positions(&cloud), [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]], "{case}");
        assert!(cloud.normals().is_none(), "{case}");
    }
}

#[test]
fn text_has_normals_where_it_says_so() {
    let cases = [
        ("a.xyzn", "1 2 3 0 0 2\n"),
        ("a.csv", "nx,ny,nz,x,y,z\n0,0,2,1,2,3\n"),
        ("a.txt", "x y z Normal_X Normal_Y Normal_Z i\n1 2 3 0 0 2 7\n"),
        ("a.asc", "//X Y Z Nx Ny Nz\n1 2 3 0 0 2\n"),
    ];
    for (name, content) in cases {
        let cloud = read(name, content);
        assert_eq!(positions(&cloud), [[1.0, 2.0, 3.0]], "{content}");
        assert_eq!(cloud.normals(), Some(&[[0.0, 0.0, 1.0]][..]), "{content}");
    }
}

#[test]
fn text_drops_what_is_not_finite() {
    let cloud = read("a.xyz", "1 2 3\nnan inf 0\n2 3 1.#QNAN\n");
    assert_eq!((positions(&cloud), cloud.dropped()), (vec![[1.0, 2.0, 3.0]], 2));
}

#[test]
fn a_file_without_points_is_an_empty_cloud() {
    for encoding in ENCODINGS {
        let cloud = read(&format!("a.{}", encoding.extension()), encoding.encode(&[], None));
        assert!(cloud.is_empty() && cloud.normals().is_none(), "{encoding:?}");
    }
    assert!(read("a.txt", "# nothing yet\n").is_empty());
}

#[test]
fn poses_are_read_from_text_and_json() {
    let pose =
        Transform::rigid([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]], [1.0, 2.0, 3.5]);
    let rows = "[[0, -1, 0, 1], [1, 0, 0, 2], [0, 0, 1, 3.5], [0, 0, 0, 1]]";
    let named = format!("{{\"transform\": {rows}, \"inliers\": 3}}");
    let json = serde_json::to_string(&pose).unwrap();
    let plain = "# target from source\n0 -1 0 1\n1 0 0 2\n\n0 0 1 3.5\n0 0 0 1\n";
    let commas = "0, -1, 0, 1\n1,0,0,2\n0,0,1,3.5\n0,0,0,1";
    for content in [rows, &named, &json, plain, commas] {
        let (_folder, path) = write_temp_file("pose", content);
        assert_eq!(io::read_transform(path).unwrap(), pose, "{content}");
    }
}

#[test]
fn known_scans_have_their_known_counts() {
    let Some(data) = common::shared_data() else { return };
    let counts = [
        ("stanford_bunny/bun000.ply", 40256),
        ("stanford_bunny/bun045.ply", 40097),
        ("stanford_dragon_stand/dragonStandRight_120.ply", 34436),
        ("stanford_meshes/bun_zipper.ply", 35947),
        ("stanford_meshes/dragon_vrip_res2.ply", 100250),
        ("lidar_small_gicp/source.ply", 69792),
        ("kitti00/000094.ply", 37415),
        ("tls_3dtk/scan001.ply", 81360),
    ];
    for (name, count) in counts {
        let cloud = io::read(data.join(name)).unwrap();
        assert_eq!((cloud.len(), cloud.dropped()), (count, 0), "{name}");
    }
}

#[test]
fn real_meshes_have_their_published_faces() {
    let Some(data) = common::shared_data() else { return };
    for (name, faces) in [("bun_zipper.ply", 69_451), ("dragon_vrip_res2.ply", 202_520)] {
        let mesh = io::read_mesh(data.join("stanford_meshes").join(name)).unwrap();
        assert_eq!(mesh.faces.len(), faces, "{name}");
        assert!(mesh.sample(500, 0).unwrap().len() == 500);
    }
}

#[test]
fn every_real_scan_is_read() {
    let Some(data) = common::shared_data() else { return };
    let mut read = 0;
    let mut folders = vec![data];
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
            } else if path.extension().is_some_and(|extension| extension == "ply") {
                let cloud = io::read(&path).unwrap();
                assert_eq!(cloud.len() + cloud.dropped(), claimed(&path), "{}", path.display());
                read += 1;
            }
        }
    }
    assert!(read > 0);
}

/// The count that a PLY header claims, found by plain search.
fn claimed(path: &Path) -> usize {
    let content = fs::read(path).unwrap();
    let header = String::from_utf8_lossy(&content[..content.len().min(2000)]).into_owned();
    let count = header.split("element vertex ").nth(1).unwrap();
    count.split_whitespace().next().unwrap().parse().unwrap()
}
