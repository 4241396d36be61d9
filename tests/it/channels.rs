//! Channels of clouds: from file to file, and where shape alone says nothing.

use cfreg::method::{Cf, Channel, Consensus, FeatureConfig, Register};
use cfreg::search::Neighborhood;
use cfreg::verify::Decision;
use cfreg::weight::{Bandwidth, Normalization};
use cfreg::{Channels, Error, PointCloud, Transform, filter, io, verify};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Points of a ball, painted in `unit`s; `seed` says which.
fn ball(seed: u64, unit: f32) -> PointCloud {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut points = Vec::new();
    while points.len() < 600 {
        let p = [(); 3].map(|()| rng.random_range(-1.0..1.0f64));
        let length = cfreg::math::norm(p);
        if (0.1..1.0).contains(&length) {
            points.push(p.map(|x| x / length));
        }
    }
    let paint = |f: &dyn Fn(&[f64; 3]) -> f64| points.iter().map(|p| unit * f(p) as f32).collect();
    let channels = Channels::default()
        .with("red", paint(&|p| (1.3 * p[0] + 0.4 * p[1] * p[2]).sin()))
        .and_then(|c| c.with("green", paint(&|p| (1.1 * p[1] - 0.5 * p[0] * p[0]).sin())))
        .and_then(|c| c.with("blue", paint(&|p| p[2] + 0.3 * p[0] * p[1])));
    PointCloud::new(&points).unwrap().with_channels(channels.unwrap()).unwrap()
}

fn cf(channels: &[&str]) -> Cf {
    let describe = FeatureConfig {
        neighborhood: Neighborhood::Nearest(30),
        orientation: cfreg::normals::Orientation::Outward,
        channels: channels.iter().map(|text| text.parse::<Channel>().unwrap()).collect(),
        ..FeatureConfig::default()
    };
    Cf { features: describe, normalization: Normalization::Both, ..Cf::default() }
}

fn off(cf: &Cf, source: &PointCloud, target: &PointCloud, truth: &Transform) -> f64 {
    let found = cf.register(source, target).unwrap();
    verify::pose_error(&found.transform, truth, source.centroid()).rotation_deg
}

#[test]
fn a_painted_ball_is_turned_back_by_its_colours_alone() {
    let truth = Transform::from_rotation_vector([0.9, -1.4, 0.7]);
    let (source, target) = (ball(1, 1.0), ball(2, 1.0).transformed(&truth).unwrap());
    let bare = off(&cf(&[]), &source, &target, &truth);
    assert!(bare > 20.0, "shape alone found it: {bare}");
    let all = ["red", "green:1", "blue"];
    let painted = off(&cf(&all), &source, &target, &truth);
    assert!(painted < 5.0, "{painted}");
    let auto = Cf { beta: Some(Bandwidth::Auto(0.25)), ..cf(&all) };
    let auto = off(&auto, &source, &target, &truth);
    assert!(auto < 5.0, "{auto}");
}

#[test]
fn neither_the_unit_nor_the_order_of_the_clouds_matters() {
    let (source, target) = (ball(1, 1.0), ball(2, 1.0));
    let run = |a: &PointCloud, b: &PointCloud| cf(&["red", "green"]).register(a, b).unwrap();
    let (there, back) = (run(&source, &target), run(&target, &source));
    let turned = there.transform.after(&back.transform).angle().to_degrees();
    assert!(turned < 1e-3, "{turned}");
    let inches = run(&ball(1, 1024.0), &ball(2, 1024.0));
    let off = inches.transform.after(&there.transform.inverse()).angle().to_degrees();
    assert!(off < 1e-3, "{off}");
    let flat = PointCloud::new(&source.positions().collect::<Vec<_>>()).unwrap();
    let same = Channels::default().with("red", vec![0.1; flat.len()]).unwrap();
    let same = flat.with_channels(same).unwrap();
    let with = cf(&["red"]).register(&same, &same).unwrap();
    let without = cf(&[]).register(&same, &same).unwrap();
    assert!(with.transform.after(&without.transform.inverse()).angle() < 1e-5);
}

#[test]
fn a_missing_channel_is_named_with_those_there_are() {
    let (source, target) = (ball(1, 1.0), ball(2, 1.0));
    let message = cf(&["glow"]).register(&source, &target).unwrap_err().to_string();
    let want = "channels = glow: the source has no such channel; it has red, green, blue";
    assert!(message.starts_with(want), "{message}");
    let bare = PointCloud::new(&target.positions().collect::<Vec<_>>()).unwrap();
    let message = cf(&["red"]).register(&source, &bare).unwrap_err().to_string();
    assert!(message.contains("the target has no such channel; it has none"), "{message}");
    for share in ["red:0", "red:-1", "red:nan", "red:1e9"] {
        let found = cf(&[share]).register(&source, &target);
        assert!(matches!(found, Err(Error::Config { field: "channels", .. })), "{share}");
    }
}

#[test]
fn a_value_that_is_no_number_is_named_with_its_point() {
    let rows = |bad: &str| {
        let row = |i: usize| {
            let [x, y] = [i % 5, i / 5].map(|x| x as f64);
            let glow = if i == 7 { bad.into() } else { i.to_string() };
            format!("{x},{y},{},{glow}\n", (x * y).sin())
        };
        // One that drops out, which is a row of the file all the same.
        let all = (0..40).map(row).collect::<String>();
        read("a.csv", format!("x,y,z,Glow\nnan,0,0,nan\n{all}").as_bytes()).unwrap()
    };
    assert!(rows("7").channels().get("glow").is_some_and(|values| values.len() == 40));
    for bad in ["nan", "inf", "1e60", "dark"] {
        let cloud = rows(bad);
        assert!(cloud.channels().is_empty() && cloud.channels().left_out("glow") == Some(8));
        // Still known where the cloud was thinned.
        for cloud in [filter::sample(&cloud, 30, 1), cloud] {
            let message = cf(&["glow"]).register(&cloud, &cloud).unwrap_err().to_string();
            let want = "channels = glow: the source has a value in this channel that is no finite \
                        number, the first at point 8 of its file";
            assert!(message.starts_with(want), "{message}");
        }
    }
}

fn read(name: &str, content: &[u8]) -> Result<PointCloud, Error> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(name);
    std::fs::write(&path, content).unwrap();
    io::read(&path)
}

#[test]
fn what_is_written_is_read() {
    let cloud = filter::sample(&ball(3, 0.5), 40, 1);
    let weights = (0..40).map(|i| f64::from(i % 5) / 4.0).collect();
    let cloud = cloud.with_weights(weights).unwrap();
    let folder = tempfile::tempdir().unwrap();
    for name in ["a.ply", "a.pcd", "a.xyz", "a.csv"] {
        let path = folder.path().join(name);
        io::write(&path, &cloud).unwrap();
        let back = io::read(&path).unwrap();
        assert_eq!(back.weights(), cloud.weights(), "{name}");
        assert_eq!(back.channels(), cloud.channels(), "{name}");
    }
}

#[test]
fn colours_become_shares() {
    let ply = "ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty uchar red\n\
               property float y\nproperty float z\nproperty uchar intensity\n\
               property uchar green\nend_header\n0 255 0 0 7 51\n1 0 0 0 9 0\n";
    let cloud = read("a.ply", ply.as_bytes()).unwrap();
    assert_eq!(cloud.channels().get("red"), Some(&[1.0, 0.0][..]));
    assert_eq!(cloud.channels().get("green"), Some(&[0.2, 0.0][..]));
    assert_eq!(cloud.channels().get("intensity"), Some(&[7.0, 9.0][..]));

    // ff a0 33 00: the bits of a NaN, whose first bit of red a float would lose.
    let bits = 0xff_a0_33_00u32;
    for (kind, ascii) in [("F", false), ("U", false), ("U", true), ("F", true)] {
        let bits = if kind == "F" && ascii { 0x00_a0_33_00 } else { bits };
        let header = format!(
            "VERSION .7\nFIELDS x y z rgb\nSIZE 4 4 4 4\nTYPE F F F {kind}\nCOUNT 1 1 1 1\n\
             WIDTH 1\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS 1\nDATA {}\n",
            if ascii { "ascii" } else { "binary" }
        );
        let body = match (kind, ascii) {
            (_, false) => [&[0; 12][..], &bits.to_le_bytes()].concat(),
            ("U", true) => format!("0 0 0 {bits}\n").into_bytes(),
            _ => format!("0 0 0 {:e}\n", f32::from_bits(bits)).into_bytes(),
        };
        let cloud = read("a.pcd", &[header.as_bytes(), &body].concat()).unwrap();
        let colour = ["red", "green", "blue"].map(|name| cloud.channels().get(name).unwrap()[0]);
        let want = [160.0f32 / 255.0, 0.2, 0.0];
        assert_eq!(colour, want, "{kind} {ascii}");
    }
}

#[test]
fn columns_that_are_no_channel_are_skipped() {
    let csv =
        "x,y,z,label,glow,dim,weight\n0,0,0,car,1,2,0.5\n1,0,0,tree,nan,3,2\nnan,0,0,,1,,-1\n";
    let cloud = read("a.csv", csv.as_bytes()).unwrap();
    assert_eq!(cloud.channels().names().collect::<Vec<_>>(), ["dim"]);
    assert_eq!(cloud.channels().get("dim"), Some(&[2.0, 3.0][..]));
    assert_eq!(cloud.weights(), Some(&[0.5, 2.0][..]));
    assert_eq!((cloud.len(), cloud.dropped()), (2, 1));
    for bad in ["-1", "nan", "heavy", "inf", "1e39"] {
        // Nobody asked for the column.
        let found = read("a.csv", format!("x,y,z,weight\n0,0,0,1\n1,0,0,{bad}\n").as_bytes());
        assert!(found.unwrap().weights().is_none(), "{bad}");
    }
    let zero = read("a.csv", b"x,y,z,weight\n0,0,0,0\n1,0,0,0\n").unwrap();
    assert!(zero.weights().is_none() && zero.len() == 2);
}

/// Points of a cube with sides of 2, painted unlike on every face.
fn cube(seed: u64) -> PointCloud {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let points: Vec<[f64; 3]> = (0..6000)
        .map(|i| {
            let mut p = [(); 3].map(|()| rng.random_range(-1.0..1.0f64));
            p[i % 3] = if i % 2 == 0 { 1.0 } else { -1.0 };
            p
        })
        .collect();
    let paint = |p: &[f64; 3]| (2.0 * p[0] + 0.7).sin() + (1.3 * p[1] - 0.4 * p[2]).cos() * p[2];
    let paint = points.iter().map(|p| paint(p) as f32).collect();
    let channels = Channels::default().with("paint", paint).unwrap();
    PointCloud::new(&points).unwrap().with_channels(channels).unwrap()
}

#[test]
fn consensus_tells_the_sides_of_a_painted_cube_apart() {
    let turn = Transform::from_rotation_vector([0.9, -1.4, 0.7]);
    let truth = Transform { translation: [5.0, 1.0, -2.0], ..turn };
    let (source, target) = (cube(1), cube(2).transformed(&truth).unwrap());
    let run = |channels: Vec<Channel>| {
        let consensus = Consensus { channels, ..Consensus::default() };
        consensus.register(&source, &target).unwrap()
    };
    let painted = run(vec!["paint".parse().unwrap()]);
    let off = truth.after(&painted.transform.inverse()).angle().to_degrees();
    assert!(off < 1.0, "{off}");
    assert_eq!(painted.verdict.unwrap().decision, Decision::Accept);
    assert_eq!(run(Vec::new()).verdict.unwrap().decision, Decision::Ambiguous);
    let glow = Consensus { channels: vec!["glow".parse().unwrap()], ..Consensus::default() };
    let message = glow.register(&source, &target).unwrap_err().to_string();
    assert_eq!(message.split(';').next(), Some("channels = glow: the source has no such channel"));
}
