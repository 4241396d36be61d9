//! What is written is read back, and what cannot be written is said.

use crate::common;

use std::fs;

use cfreg::{Error, PointCloud, Transform, io};
use common::files::{ENCODINGS, read, write_temp_file};
use proptest::collection::vec;
use proptest::prelude::*;
use tempfile::tempdir;

/// Coordinates that f32 holds about the origin: multiples of 1/1024 within ±50.
fn local_points() -> impl Strategy<Value = Vec<[f64; 3]>> {
    vec(prop::array::uniform3(-51200..=51200i32), 0..60)
        .prop_map(|points| points.iter().map(|p| p.map(|x| f64::from(x) / 1024.0)).collect())
}

fn offset() -> impl Strategy<Value = [f64; 3]> {
    prop_oneof![
        Just([0.0; 3]),
        Just([5e5, 5.6e6, 300.0]),
        prop::array::uniform3((-1000000..1000000i32).prop_map(f64::from)),
    ]
}

/// Any clouds: of decimals or of f32, near or far, whole or a part of what they were made of.
fn any_cloud() -> impl Strategy<Value = PointCloud> {
    let places = vec(prop::array::uniform3(-1.0..1.0f64), 1..40);
    let spread = prop::sample::select(&[1e-6, 0.05, 1.0, 9.99, 10.0, 700.0, 3e6, 1e12][..]);
    let far = prop::sample::select(&[0.0, 0.3, 1.0, 55.0, 1e6, 1e12][..]);
    (places, spread, prop::array::uniform3(-1.0..1.0f64), far, 0..3usize, any::<bool>()).prop_map(
        |(places, spread, way, far, digits, part)| {
            let decimal = |x: f64| match digits {
                0 => x,
                1 => (x * 1e3).round() / 1e3,
                _ => f64::from(x as f32),
            };
            let at = |p: [f64; 3]| [0, 1, 2].map(|k| decimal(spread * (p[k] + far * way[k])));
            let cloud = PointCloud::new(&places.iter().map(|&p| at(p)).collect::<Vec<_>>());
            let cloud = cloud.unwrap_or_default();
            // Its origin is then not that of its own box.
            let some: Vec<usize> = (0..cloud.len()).filter(|i| i % 7 == 0).collect();
            if part { cloud.select(&some) } else { cloud }
        },
    )
}

/// The positions that a file has, read without the code under test.
fn stored(path: &std::path::Path, count: usize) -> Vec<[f64; 3]> {
    let content = fs::read(path).unwrap();
    let header = String::from_utf8_lossy(&content);
    if ["ply", "pcd"].iter().any(|binary| path.extension().unwrap() == *binary) {
        let double = header.contains("double") || header.contains("SIZE 8");
        let size = if double { 8 } else { 4 };
        let number = |bytes: &[u8]| match double {
            true => f64::from_le_bytes(bytes.try_into().unwrap()),
            false => f32::from_le_bytes(bytes.try_into().unwrap()).into(),
        };
        let numbers = content[content.len() - 3 * size * count..].chunks(size).map(number);
        return numbers.collect::<Vec<_>>().as_chunks().0.to_vec();
    }
    let row = |line: &str| {
        let mut words = line.split([',', ' ']).map(|word| word.parse().unwrap());
        [(); 3].map(|()| words.next().unwrap())
    };
    header.lines().skip(1).map(row).collect()
}

fn direction() -> impl Strategy<Value = [f64; 3]> {
    prop::array::uniform3(-1.0..1.0f64)
}

fn cloud() -> impl Strategy<Value = PointCloud> {
    (local_points(), offset(), vec(direction(), 60), any::<bool>()).prop_map(
        |(mut points, offset, normals, has_normals)| {
            for point in &mut points {
                *point = [0, 1, 2].map(|axis| point[axis] + offset[axis]);
            }
            match has_normals {
                true => PointCloud::with_normals(&points, &normals[..points.len()]).unwrap(),
                false => PointCloud::new(&points).unwrap(),
            }
        },
    )
}

proptest! {
    #[test]
    fn files_have_every_position_and_clouds_come_back_as_near_as_is_said(cloud in any_cloud()) {
        let positions: Vec<[f64; 3]> = cloud.positions().collect();
        let folder = tempdir().unwrap();
        for extension in ["ply", "pcd", "xyz", "csv"] {
            let path = folder.path().join("cloud").with_extension(extension);
            io::write(&path, &cloud).unwrap();
            // f32 where the origin is zero, in which they are exact.
            let single = cloud.origin() == [0.0; 3];
            let stored = stored(&path, cloud.len());
            for (stored, position) in stored.iter().zip(&positions) {
                let same = |k: usize| match single && extension != "ply" && extension != "pcd" {
                    // As text has the shortest digits of an f32.
                    true => stored[k] as f32 == position[k] as f32,
                    false => stored[k] == position[k],
                };
                prop_assert!((0..3).all(same), "{}: {:?} {:?}", extension, stored, position);
            }
            let back = match io::read(&path) {
                Ok(back) => back,
                // The rest of a cloud may span less than a cloud can.
                Err(Error::Parse { what, .. }) if what.contains("span") => continue,
                Err(error) => panic!("{error}"),
            };
            prop_assert_eq!(back.len(), cloud.len());
            let side = back.bounds().map_or(0.0, |(low, high)| {
                (0..3).map(|k| high[k] - low[k]).fold(0.0, f64::max)
            });
            for (back_at, at) in back.positions().zip(&positions) {
                for k in 0..3 {
                    let exact = single && back.origin() == [0.0; 3];
                    let unit = match single {
                        true => f64::from((at[k] as f32).abs().next_up()) - at[k].abs(),
                        false => at[k].abs().next_up() - at[k].abs(),
                    };
                    let near = 4e-7 * side + unit;
                    let off = (back_at[k] - at[k]).abs();
                    prop_assert!(off <= if exact { 0.0 } else { near }, "{} {} {}", extension, off, near);
                }
            }
        }
    }

    #[test]
    fn clouds_come_back_from_every_format(cloud in cloud()) {
        let folder = tempdir().unwrap();
        for extension in ["ply", "pcd", "xyz", "txt", "csv", "PLY"] {
            let path = folder.path().join("cloud").with_extension(extension);
            io::write(&path, &cloud).unwrap();
            let back = io::read(&path).unwrap();
            prop_assert_eq!(back.origin(), cloud.origin());
            prop_assert_eq!(back.points(), cloud.points());
            prop_assert_eq!(back.normals().is_some(), cloud.normals().is_some());
            // Reading scales normals to unit length again, which moves the last bit.
            for (a, b) in back.normals().iter().zip(cloud.normals()).flat_map(|(a, b)| a.iter().zip(b)) {
                prop_assert!(a.iter().zip(b).all(|(a, b)| (a - b).abs() < 2e-7), "{:?} {:?}", a, b);
            }
        }
        // Nothing is left beside the five (or on some systems six) files.
        prop_assert!(fs::read_dir(folder.path()).unwrap().count() <= 6);
    }

    #[test]
    fn files_of_every_encoding_are_read_exactly(
        points in vec(prop::array::uniform3(prop_oneof![9 => -1e6..1e6f64, 1 => Just(f64::NAN)]), 0..40),
        normals in vec(direction(), 40),
    ) {
        let normals = &normals[..points.len()];
        for encoding in ENCODINGS {
            let name = format!("cloud.{}", encoding.extension());
            let bare = read(&name, encoding.encode(&points, None));
            prop_assert_eq!(bare, PointCloud::new(&points).unwrap(), "{:?}", encoding);
            let full = read(&name, encoding.encode(&points, Some(normals)));
            prop_assert_eq!(full, PointCloud::with_normals(&points, normals).unwrap(), "{:?}", encoding);
        }
    }

    #[test]
    fn poses_come_back_bit_for_bit(vector in direction(), t in prop::array::uniform3(-1e7..1e7f64)) {
        let pose = Transform { translation: t, ..Transform::from_rotation_vector(vector) };
        let folder = tempdir().unwrap();
        let path = folder.path().join("pose.txt");
        io::write_transform(&path, &pose).unwrap();
        prop_assert_eq!(io::read_transform(&path).unwrap(), pose);
    }
}

#[test]
fn a_viewpoint_is_kept_in_pcd_and_zero_is_none() {
    let folder = tempdir().unwrap();
    let path = folder.path().join("a.pcd");
    let cloud = PointCloud::new(&[[1.0, 2.0, 3.0]]).unwrap();
    for (viewpoint, expected) in [([5e5, 0.1, -2.0], Some([5e5, 0.1, -2.0])), ([0.0; 3], None)] {
        io::write(&path, &cloud.clone().with_viewpoint(viewpoint).unwrap()).unwrap();
        assert_eq!(io::read(&path).unwrap().viewpoint(), expected);
    }
}

#[test]
fn only_known_extensions_are_written() {
    let folder = tempdir().unwrap();
    for name in ["a.stl", "a", ".ply"] {
        let error = io::write(folder.path().join(name), &PointCloud::default()).unwrap_err();
        assert!(matches!(error, Error::Config { .. }));
        let text = error.to_string();
        assert!(text.contains(name) && text.contains(".ply, .pcd, "), "{text}");
    }
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0);
}

#[test]
fn what_cannot_be_written_is_an_io_error_and_leaves_nothing() {
    let folder = tempdir().unwrap();
    let taken = folder.path().join("taken.ply");
    fs::create_dir(&taken).unwrap();
    for path in [folder.path().join("no such folder/a.ply"), taken] {
        let error = io::write(&path, &PointCloud::default()).unwrap_err();
        assert!(matches!(error, Error::Io { .. }));
        assert!(error.to_string().contains(path.to_str().unwrap()), "{error}");
    }
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
}

#[cfg(target_os = "linux")]
#[test]
fn a_full_disk_is_an_io_error() {
    let error = io::write_transform("/dev/full", &Transform::IDENTITY).unwrap_err();
    assert!(matches!(error, Error::Io { .. }), "{error}");
}

#[cfg(unix)]
#[test]
fn a_link_is_written_through() {
    let (folder, path) = write_temp_file("a.ply", "old");
    let link = folder.path().join("link.ply");
    std::os::unix::fs::symlink(&path, &link).unwrap();
    io::write(&link, &PointCloud::default()).unwrap();
    assert!(fs::symlink_metadata(&link).unwrap().is_symlink());
    assert!(io::read(&path).unwrap().is_empty());
}
