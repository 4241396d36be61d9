//! What is written is read back, and what cannot be written is said.

mod common;

use std::fs;

use cfreg::{Error, PointCloud, Transform, io};
use common::files::{ENCODINGS, file, read};
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
    for name in ["a.las", "a", ".ply"] {
        let error = io::write(folder.path().join(name), &PointCloud::default()).unwrap_err();
        assert!(matches!(error, Error::Config { .. }));
        let text = error.to_string();
        assert!(text.contains(name) && text.contains(".ply, .pcd, .xyz, .txt or .csv"), "{text}");
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
    let (folder, path) = file("a.ply", "old");
    let link = folder.path().join("link.ply");
    std::os::unix::fs::symlink(&path, &link).unwrap();
    io::write(&link, &PointCloud::default()).unwrap();
    assert!(fs::symlink_metadata(&link).unwrap().is_symlink());
    assert!(io::read(&path).unwrap().is_empty());
}
