//! Clouds made of bytes, and clouds that are written and read again.

use cfreg::cloud::{Attributes, Channels};
use cfreg::{PointCloud, Transform, io};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::bytes::Bytes;
use super::door;
use super::readers::{heard, sound};

/// Sizes that a cloud of about 1 is scaled to.
const SCALES: [f64; 8] = [1.0, 1.0, 1.0, 1e-3, 1e3, 1e-9, 1e6, 1e12];
/// Places that it is moved to: map coordinates among them.
const OFFSETS: [f64; 6] = [0.0, 0.0, 0.0, 10.0, 5.6e6, 1e12];

/// Points of 2 to 60 places, many of them of shapes that leave a pose undetermined.
pub(super) fn points(bytes: &mut Bytes<'_>) -> Vec<[f64; 3]> {
    let count = 2 + bytes.below(59);
    let shape = bytes.below(14);
    let mut random = ChaCha8Rng::seed_from_u64(bytes.number());
    let mut spread = || -> [f64; 3] { std::array::from_fn(|_| random.random_range(-1.0..1.0)) };
    let unit = |[x, y, z]: [f64; 3]| {
        let length = (x * x + y * y + z * z).sqrt().max(1e-9);
        [x / length, y / length, z / length]
    };
    let place = |i: usize| {
        let [x, y, z] = spread();
        match shape {
            // All in one place, in two, in a few.
            0 => [0.3, -0.2, 0.1],
            1 => [(i % 2) as f64, 0.0, 0.0],
            2 => [(i % 3) as f64, (i % 5) as f64, 0.0],
            // On a line, a plane, a lattice, a circle, a sphere, a cylinder.
            3 => [x, 2.0 * x, -x],
            4 => [x, y, 0.0],
            5 => [i % 4, i / 4 % 4, i / 16].map(|k| k as f64 / 4.0),
            6 => [(i as f64).cos(), (i as f64).sin(), 0.0],
            7 => unit([x, y, z]),
            8 => [(6.0 * x).cos(), (6.0 * x).sin(), y],
            // Two heaps far apart, one point far off, half the points at zero.
            9 => [x * 1e-4 + (i % 2) as f64, y * 1e-4, z * 1e-4],
            10 => [if i == 0 { 1e6 } else { x }, y, z],
            11 => [x, y, z].map(|v| if i.is_multiple_of(2) { 0.0 } else { v }),
            // A surface, as scans have it.
            12 => [x, y, 0.3 * (3.0 * x).sin() * (2.0 * y).cos()],
            _ => [x, y, z],
        }
    };
    let mut points: Vec<[f64; 3]> = (0..count).map(place).collect();
    // Some of them moved anywhere.
    for _ in 0..bytes.below(4) {
        let at = bytes.below(count);
        points[at] = bytes.triple();
    }
    let scale = bytes.pick(&SCALES);
    let offset = bytes.triple();
    let far = bytes.pick(&OFFSETS);
    points.iter_mut().for_each(|p| {
        *p = std::array::from_fn(|axis| scale * p[axis] + far * offset[axis]);
    });
    points
}

/// The points with whatever else clouds have.
pub(super) fn dressed(points: &[[f64; 3]], bytes: &mut Bytes<'_>) -> Option<PointCloud> {
    let has = bytes.byte();
    let mut random = ChaCha8Rng::seed_from_u64(u64::from(bytes.byte()));
    let count = points.len();
    let normals: Vec<[f64; 3]> =
        (0..count).map(|_| std::array::from_fn(|_| random.random_range(-1.0..1.0))).collect();
    let weights: Vec<f64> = match bytes.below(4) {
        0 => (0..count).map(|i| f64::from(u8::from(i % 3 == 0))).collect(),
        1 => (0..count).map(|i| if i == 0 { 1e30 } else { 1e-30 }).collect(),
        _ => (0..count).map(|_| random.random_range(0.0..2.0)).collect(),
    };
    let mut channels = Channels::default();
    if has & 4 != 0 {
        let constant = bytes.flag();
        let mut value = |_| if constant { 0.5 } else { random.random::<f32>() };
        for name in ["intensity", "red"] {
            channels = channels.with(name, (0..count).map(&mut value).collect()).ok()?;
        }
    }
    let attributes = Attributes {
        normals: (has & 1 != 0).then_some(&normals),
        weights: (has & 2 != 0).then_some(&weights),
        channels: (has & 4 != 0).then_some(&channels),
        ..Attributes::default()
    };
    let cloud = heard(PointCloud::with_attributes(points, attributes), None)?;
    if has & 8 == 0 {
        return Some(cloud);
    }
    let viewpoint = match bytes.below(3) {
        0 => [0.0; 3],
        1 if !cloud.is_empty() => cloud.position(0),
        _ => bytes.triple().map(|x| 10.0 * x * cloud.diagonal()),
    };
    heard(cloud.with_viewpoint(viewpoint), None)
}

/// Two clouds: of the second's points some are the first's, moved.
pub(super) fn pair(bytes: &mut Bytes<'_>) -> Option<[PointCloud; 2]> {
    let first = points(bytes);
    let second = if bytes.below(4) == 0 {
        points(bytes)
    } else {
        let turn = bytes.triple().map(|x| std::f64::consts::PI * x);
        let shift = bytes.triple();
        let motion = Transform { translation: shift, ..Transform::from_rotation_vector(turn) };
        let (from, most) = (bytes.below(first.len()), first.len());
        let part = first[from / 2..most].iter();
        let mut second: Vec<[f64; 3]> = part.map(|&p| motion.apply(p)).collect();
        if bytes.flag() {
            second.reverse();
        }
        second
    };
    Some([dressed(&first, bytes)?, dressed(&second, bytes)?])
}

/// A cloud that is written is read again: every format, whatever the cloud has.
pub fn round_trip(data: &[u8]) {
    let mut bytes = Bytes(data);
    // Any numbers at all, or those that make a cloud.
    let wild = bytes.below(3) == 0;
    let points = match wild {
        true => (0..bytes.below(12)).map(|_| std::array::from_fn(|_| bytes.any())).collect(),
        false => points(&mut bytes),
    };
    if points.is_empty() {
        return;
    }
    let Some(cloud) = dressed(&points, &mut bytes) else { return };
    sound(&cloud);
    for name in ["written.ply", "written.pcd", "written.xyz", "written.csv"] {
        let path = door::folder().join(name);
        if let Err(error) = io::write(&path, &cloud) {
            panic!("{name}: {error}");
        }
        // An empty cloud has no lines.
        if cloud.is_empty() {
            continue;
        }
        let back = io::read(&path).unwrap_or_else(|error| panic!("{name}: {error}"));
        sound(&back);
        assert_eq!(back.len(), cloud.len(), "{name}");
        same(&cloud, &back, name);
    }
}

/// The coordinate, if it is within a hundred sizes of zero: there positions are float.
fn near(coordinate: f64, size: f64) -> f64 {
    if coordinate.abs() <= 200.0 * size { coordinate.abs() } else { 0.0 }
}

/// To within the last digits of what a format keeps: float near zero, else double.
fn same(cloud: &PointCloud, back: &PointCloud, name: &str) {
    let size = cloud.diagonal();
    for (i, (a, b)) in cloud.positions().zip(back.positions()).enumerate() {
        for axis in 0..3 {
            let most = 2e-7 * size.max(near(a[axis], size))
                + 4.0 * f64::EPSILON * a[axis].abs()
                + f64::from(f32::MIN_POSITIVE);
            let off = (a[axis] - b[axis]).abs();
            assert!(off <= most, "{name}: point {i}: {a:?} became {b:?}");
        }
    }
    assert_eq!(cloud.normals().is_some(), back.normals().is_some(), "{name}: normals");
    assert_eq!(cloud.weights(), back.weights(), "{name}: weights");
    let close = |(a, b): (&f32, &f32)| (a - b).abs() <= 1e-6 * a.abs();
    for (channel, values) in cloud.channels().iter() {
        let Some(read) = back.channels().get(channel) else {
            panic!("{name}: {channel} is lost, {:?} are there", back.channels());
        };
        assert!(values.iter().zip(read).all(close), "{name}: {channel}");
    }
}
