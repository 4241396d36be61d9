//! Colours stay colours from file to file, and names and what else a format cannot hold are
//! changed or left out, and said.

use crate::common;

use std::path::Path;

use cfreg::{Channels, ColorDepth, PointCloud, Transform, filter, io};
use common::files::{read, write_temp_file};
use proptest::collection::vec;
use proptest::prelude::*;
use tempfile::tempdir;

const RGB: [&str; 3] = ["red", "green", "blue"];

/// A cloud of as many points as there are colours.
fn painted(colors: &[[u16; 3]], alpha: Option<&[u16]>, depth: ColorDepth) -> PointCloud {
    let points: Vec<[f64; 3]> =
        (0..colors.len()).map(|i| [i as f64 / 8.0, (i % 3) as f64, 1.0]).collect();
    let share = |level: u16| (f64::from(level) / f64::from(depth.max())) as f32;
    let mut channels = Channels::default().with("glow", vec![0.5; colors.len()]).unwrap();
    for (axis, name) in RGB.into_iter().enumerate() {
        let values = colors.iter().map(|color| share(color[axis])).collect();
        channels = channels.with_color(name, values, depth).unwrap();
    }
    if let Some(alpha) = alpha {
        let values = alpha.iter().map(|&level| share(level)).collect();
        channels = channels.with_color("alpha", values, depth).unwrap();
    }
    PointCloud::new(&points).unwrap().with_channels(channels).unwrap()
}

/// The cloud after it was written to files of these names and read again, one after the other.
fn through(folder: &Path, cloud: &PointCloud, names: &[&str]) -> PointCloud {
    names.iter().fold(cloud.clone(), |cloud, name| {
        let path = folder.join(name);
        io::write(&path, &cloud).unwrap();
        io::read(&path).unwrap()
    })
}

fn assert_same_colors(back: &PointCloud, cloud: &PointCloud, case: &str) {
    for name in RGB.into_iter().chain(["alpha", "glow"]) {
        let [own, other] = [back, cloud].map(|cloud| cloud.channels().get(name));
        assert_eq!(own, other, "{case}: {name}");
        let [own, other] = [back, cloud].map(|cloud| cloud.channels().color_depth(name));
        assert_eq!(own, other, "{case}: {name}");
    }
}

const WAYS: [&[&str]; 9] = [
    &["a.ply"],
    &["a.pcd"],
    &["a.csv"],
    &["a.xyz"],
    &["a.ply", "b.pcd", "c.csv", "d.ply"],
    &["a.csv", "b.pcd", "c.ply", "d.csv"],
    &["a.pcd", "b.csv", "c.pcd"],
    &["a.ply", "b.csv", "c.ply"],
    &["a.txt", "b.ply", "c.pcd", "d.txt"],
];

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn colours_of_8_bits_come_back_from_every_format(
        colors in vec(prop::array::uniform3(0..256u16), 1..20),
        alpha in vec(0..256u16, 20),
        has_alpha in any::<bool>(),
    ) {
        let alpha = has_alpha.then_some(&alpha[..colors.len()]);
        let cloud = painted(&colors, alpha, ColorDepth::Eight);
        let folder = tempdir().unwrap();
        for way in WAYS {
            assert_same_colors(&through(folder.path(), &cloud, way), &cloud, &format!("{way:?}"));
        }
    }

    #[test]
    fn colours_of_16_bits_come_back_where_there_is_room(
        colors in vec(prop::array::uniform3(0..=65535u16), 1..20),
    ) {
        let cloud = painted(&colors, None, ColorDepth::Sixteen);
        let folder = tempdir().unwrap();
        assert_same_colors(&through(folder.path(), &cloud, &["a.ply"]), &cloud, "PLY");
        let says = |name: &str| io::differences(folder.path().join(name), &cloud).unwrap();
        prop_assert!(says("a.ply").is_empty());
        // Numbers that 8 bits hold would be taken for 8 bits.
        let text = through(folder.path(), &cloud, &["a.csv"]);
        let dark = colors.iter().flatten().all(|&level| level < 256);
        prop_assert_eq!(says("a.csv").is_empty(), !dark);
        let depth = (!dark).then_some(ColorDepth::Sixteen);
        prop_assert_eq!(text.channels().color_depth("red"), depth);
        for name in RGB {
            prop_assert_eq!(text.channels().get(name), cloud.channels().get(name));
        }
        let packed = through(folder.path(), &cloud, &["a.pcd"]);
        prop_assert!(says("a.pcd").to_string().contains("red is rounded from 16 to 8 bits"));
        for name in RGB {
            prop_assert_eq!(packed.channels().color_depth(name), Some(ColorDepth::Eight));
            let both = [&packed, &cloud].map(|cloud| cloud.channels().get(name).unwrap());
            prop_assert!(both[0].iter().zip(both[1]).all(|(a, b)| (a - b).abs() < 0.00197));
        }
    }
}

#[test]
fn ply_and_pcd_have_colours_as_other_programs_do() {
    let ply = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\n\
               property float z\nproperty uchar red\nproperty uchar green\nproperty uchar blue\n\
               property uchar alpha\nend_header\n0 0 0 255 128 0 9\n3 0 0 1 2 3 255\n0 3 0 0 0 0 0\n";
    let cloud = read("a.ply", ply);
    let folder = tempdir().unwrap();
    let written = |name: &str, cloud: &PointCloud| {
        io::write(folder.path().join(name), cloud).unwrap();
        std::fs::read(folder.path().join(name)).unwrap()
    };
    let bytes = written("a.ply", &cloud);
    let header = "property uchar red\nproperty uchar green\nproperty uchar blue\nproperty uchar alpha\nend_header\n";
    assert!(String::from_utf8_lossy(&bytes).contains(header));
    assert_eq!(bytes[bytes.len() - 48..][12..16], [255, 128, 0, 9]);
    let bytes = written("a.pcd", &cloud);
    let text = String::from_utf8_lossy(&bytes);
    assert!(
        text.contains("FIELDS x y z rgba\nSIZE 4 4 4 4\nTYPE F F F U\nCOUNT 1 1 1 1\n"),
        "{text}"
    );
    assert_eq!(bytes[bytes.len() - 48..][12..16], [0, 128, 255, 9]);
    assert!(String::from_utf8(written("a.csv", &cloud)).unwrap().contains("255,128,0,9\n"));
    // Without opacity they are bits of a float.
    let opaque = read("a.ply", ply.replace("uchar alpha", "uchar beta"));
    let bytes = written("a.pcd", &opaque);
    let text = String::from_utf8_lossy(&bytes);
    assert!(text.contains("FIELDS x y z rgb beta\nSIZE 4 4 4 4 4\nTYPE F F F F F\n"), "{text}");
    assert_eq!(bytes[bytes.len() - 60..][12..16], [0, 128, 255, 0]);
    // Floats that were no colours stay floats.
    let floats = read("a.csv", "x,y,z,red,green,blue\n0,0,0,0.5,1.0,0\n1,0,0,255,1,1\n");
    assert_eq!(floats.channels().color_depth("red"), None);
    let bytes = written("a.ply", &floats);
    assert!(String::from_utf8_lossy(&bytes).contains("property float red\n"));
    let bytes = written("a.pcd", &floats);
    assert!(String::from_utf8_lossy(&bytes).contains("FIELDS x y z red green blue\n"));
    assert_eq!(read("a.pcd", bytes).channels(), floats.channels());
}

#[test]
fn colours_stay_colours_when_points_are_moved_chosen_and_averaged() {
    let cloud = painted(&[[255, 0, 10], [0, 1, 20], [7, 8, 9]], None, ColorDepth::Eight);
    let moved = cloud.transformed(&Transform::from_rotation_vector([0.3, 0.1, 0.0])).unwrap();
    assert_same_colors(&moved, &cloud, "moved");
    assert_eq!(cloud.select(&[2]).channels().color_depth("red"), Some(ColorDepth::Eight));
    let mean = filter::voxel_grid(&cloud, 100.0).unwrap();
    assert_eq!(mean.channels().color_depth("blue"), Some(ColorDepth::Eight));
    let folder = tempdir().unwrap();
    let back = through(folder.path(), &mean, &["a.ply"]);
    // 262 / 3, 9 / 3 and 39 / 3 of 255.
    let levels = RGB.map(|name| (back.channels().get(name).unwrap()[0] * 255.0).round());
    assert_eq!(levels, [87.0, 3.0, 13.0]);
}

#[test]
fn a_number_called_rgb_stays_a_number() {
    let (_folder, path) =
        write_temp_file("rgb.csv", "x,y,z,rgb,RGBA\n1,2,3,0.5,1\n5,6,7,0.25,2\n0,1,0,1,3\n");
    let cloud = io::read(path).unwrap();
    let folder = tempdir().unwrap();
    for way in [&["a.pcd"][..], &["a.ply", "b.pcd", "c.csv"]] {
        let back = through(folder.path(), &cloud, way);
        assert_eq!(back.channels(), cloud.channels(), "{way:?}");
    }
    assert!(io::differences("a.pcd", &cloud).unwrap().is_empty());
    // Beside colours that are called so.
    let both = cloud.channels().clone();
    let both = RGB
        .into_iter()
        .fold(both, |both, name| both.with_color(name, vec![0.2; 3], ColorDepth::Eight).unwrap());
    let cloud = cloud.with_channels(both).unwrap();
    let differences = io::differences("a.pcd", &cloud).unwrap().to_string();
    assert_eq!(differences, "changed: rgb is called rgb_2");
    let back = through(folder.path(), &cloud, &["a.pcd"]);
    assert_eq!(back.channels().get("rgb_2"), cloud.channels().get("rgb"));
    assert_eq!(back.channels().get("rgba"), cloud.channels().get("rgba"));
    assert_eq!(back.channels().color_depth("red"), Some(ColorDepth::Eight));
}

#[test]
fn names_that_a_format_cannot_hold_are_changed_and_said() {
    let (_folder, path) = write_temp_file(
        "odd.txt",
        "# x,y,z,a.b,a_b,1st,größe,_,GPS Time,,A B,x 2\n0,0,0,1,2,3,4,5,6,7,8,9\n",
    );
    let (cloud, differences) = io::read_with_differences(path).unwrap();
    let own: Vec<&str> = cloud.channels().names().collect();
    let expected = ["a.b", "a_b", "1st", "größe", "_", "GPS_Time", "A_B_2", "x_2"];
    assert_eq!(own, expected);
    assert_eq!(differences.left_out, ["1 column without a name"]);
    assert_eq!(
        differences.changed,
        ["GPS Time is called GPS_Time", "A B is called A_B_2", "x 2 is called x_2"]
    );
    let folder = tempdir().unwrap();
    for (name, changed) in [
        ("a.ply", &["a.b is called a_b_3", "1st is called _1st", "größe is called gr_e"][..]),
        ("a.pcd", &["größe is called gr_e", "_ is called column"]),
        ("a.csv", &["1st is called _1st"]),
        ("a.xyz", &[]),
    ] {
        let path = folder.path().join(name);
        io::write(&path, &cloud).unwrap();
        assert_eq!(io::differences(&path, &cloud).unwrap().changed, changed, "{name}");
        let (back, differences) = io::read_with_differences(&path).unwrap();
        assert!(differences.is_empty(), "{name}: {differences}");
        let values = |cloud: &PointCloud| -> Vec<f32> {
            cloud.channels().iter().map(|(_, values)| values[0]).collect()
        };
        assert_eq!(values(&back), values(&cloud), "{name}");
        // Once changed, it is held.
        assert!(io::differences(&path, &back).unwrap().is_empty(), "{name}");
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(200))]

    #[test]
    fn whatever_channels_are_called_they_come_back(
        names in vec("[a-cA-C0-9._é-]{1,4}|rgba?|red|alpha|list|end_header|comment|ply", 1..8),
        colors in any::<u8>(),
    ) {
        let mut channels = Channels::default();
        for (k, name) in names.iter().enumerate() {
            let values = vec![k as f32 / 255.0; 2];
            let depth = if k % 2 == 0 { ColorDepth::Eight } else { ColorDepth::Sixteen };
            let more = match colors & (1 << k) {
                0 => channels.clone().with(name, values),
                _ => channels.clone().with_color(name, values.clone(), depth)
                    .or_else(|_| channels.clone().with(name, values)),
            };
            channels = more.unwrap_or(channels);
        }
        let cloud = PointCloud::new(&[[0.0; 3], [1.0, 2.0, 3.0]]).unwrap();
        let cloud = cloud.with_channels(channels).unwrap();
        let folder = tempdir().unwrap();
        for extension in ["ply", "pcd", "csv", "txt"] {
            let path = folder.path().join("cloud").with_extension(extension);
            io::write(&path, &cloud).unwrap();
            let (back, differences) = io::read_with_differences(&path).unwrap();
            prop_assert!(differences.is_empty(), "{}: {}", extension, differences);
            prop_assert_eq!(back.channels().names().len(), cloud.channels().names().len());
            let again = io::differences(&path, &back).unwrap();
            prop_assert!(again.is_empty(), "{}: {}", extension, again);
        }
    }
}

#[test]
fn what_a_cloud_does_not_have_of_a_file_is_said() {
    let said = |name: &str, content: &str| {
        let (_folder, path) = write_temp_file(name, content);
        io::read_with_differences(path).unwrap().1.to_string()
    };
    let ply = "ply\nformat ascii 1.0\ncomment a\nobj_info b\nelement camera 1\nproperty int k\n\
               element vertex 3\nproperty float x\nproperty float y\nproperty float z\n\
               property float nx\nproperty float sun\nproperty list uchar int view\n\
               element face 2\nproperty list uchar int vertex_indices\nelement edge 0\nend_header\n\
               7\n0 0 0 1 nan 0\n1 0 0 1 1 1 5\n0 1 0 1 1 0\n3 0 1 2\n3 0 1 2\n";
    let want = "left out: 1 camera, 2 faces, the list view, 2 comments, nx, which is a part of a \
                normal, sun (no finite number at point 0)";
    assert_eq!(said("a.ply", ply), want);
    let pcd = "# .PCD v.7\n# by hand\nVERSION .7\nFIELDS x y z fpfh _\nSIZE 4 4 4 4 4\n\
               TYPE F F F F F\nCOUNT 1 1 1 2 3\nWIDTH 2\nHEIGHT 2\nVIEWPOINT 0 0 1 0 1 0 0\nPOINTS 4\n\
               DATA ascii\n0 0 0 1 2 0 0 0\n1 0 0 1 2 0 0 0\n0 1 0 1 2 0 0 0\n1 1 0 1 2 0 0 0\n";
    let want = "left out: 1 comment, fpfh (2 values a point), the grid of 2 columns and 2 rows, \
                the orientation of VIEWPOINT";
    assert_eq!(said("a.pcd", pcd), want);
    let csv = "// a\nx,y,z,label,time\n0,0,0,car,1600000000.25 # here\n1,0,0,tree,1600000099\n";
    let want = "left out: 2 comments, label (no finite number at point 0); changed: time is \
                rounded by up to 2.9e1";
    assert_eq!(said("a.csv", csv), want);
    assert_eq!(said("a.xyz", "1 2 3 4\n"), "left out: column 4, which has no name");
    assert_eq!(said("a.xyz", "1 2 3 4 5\n"), "left out: columns 4 to 5, which have no names");
    assert_eq!(said("a.xyzn", "1 2 3 0 0 1\n"), "");
    assert_eq!(said("a.xyz", "# x y z a\n1 2 3 0.1\n4 5 6 0.2\n"), "");
    let seen = PointCloud::new(&[[1.0; 3]]).unwrap().with_viewpoint([0.0, 1.5, 0.0]).unwrap();
    let differences = io::differences("a.ply", &seen).unwrap().to_string();
    assert!(differences.starts_with("left out: the viewpoint, which only PCD and E57 keep"));
    assert!(differences.ends_with("--orientation 0,1.5,0)"), "{differences}");
    assert!(io::differences("a.pcd", &seen).unwrap().is_empty());
    assert!(io::differences("a.stl", &seen).is_err());
}

#[test]
fn more_channels_than_are_read_are_not_written() {
    let channels = (0..48_000)
        .try_fold(Channels::default(), |channels, k| channels.with(&format!("c{k}"), vec![0.5]));
    let cloud = PointCloud::new(&[[1.0, 2.0, 3.0]]).unwrap().with_channels(channels.unwrap());
    let cloud = cloud.unwrap();
    let folder = tempdir().unwrap();
    for name in ["a.pcd", "a.csv", "a.xyz"] {
        let back = through(folder.path(), &cloud, &[name]);
        assert_eq!(back.channels(), cloud.channels(), "{name}");
    }
    let error = io::write(folder.path().join("a.ply"), &cloud).unwrap_err().to_string();
    assert!(error.starts_with("channels = 48000: are more than a header"), "{error}");
    assert!(!folder.path().join("a.ply").exists());
    let few = (0..40_000)
        .try_fold(Channels::default(), |channels, k| channels.with(&format!("c{k}"), vec![0.5]));
    let few = cloud.with_channels(few.unwrap()).unwrap();
    assert_eq!(through(folder.path(), &few, &["a.ply"]).channels(), few.channels());
}
