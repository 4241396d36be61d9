//! Made scenes on which wrong poses fit well: none of them is accepted.
//!
//! Each scene stands for a kind: parts that repeat, symmetric parts, few planes, mirrored and scaled
//! parts, scenes with nothing in common. Scans are samples of a mesh, or views of it from a place.

use cfreg::cloud::Mesh;
use cfreg::math::{self, Vec3};
use cfreg::method::{Consensus, Register};
use cfreg::verify::{Decision, Verdict, pose_error};
use cfreg::{PointCloud, Transform};

/// Triangles of a scene.
#[derive(Default)]
struct Scene {
    vertices: Vec<Vec3>,
    faces: Vec<[u32; 3]>,
}

impl Scene {
    fn quad(&mut self, corners: [Vec3; 4]) -> &mut Self {
        let first = self.vertices.len() as u32;
        self.vertices.extend(corners);
        self.faces.extend([[first, first + 1, first + 2], [first, first + 2, first + 3]]);
        self
    }

    /// A box between two corners, turned about the z axis through its centre.
    fn turned_box(&mut self, low: Vec3, high: Vec3, angle: f64) -> &mut Self {
        let center = math::scaled(math::add(low, high), 0.5);
        let (sine, cosine) = angle.sin_cos();
        let corner = |k: usize| {
            let at: Vec3 = std::array::from_fn(|a| if k >> a & 1 == 0 { low[a] } else { high[a] });
            let [x, y, z] = math::sub(at, center);
            math::add(center, [cosine * x - sine * y, sine * x + cosine * y, z])
        };
        for face in
            [[0, 1, 3, 2], [4, 5, 7, 6], [0, 1, 5, 4], [2, 3, 7, 6], [0, 2, 6, 4], [1, 3, 7, 5]]
        {
            self.quad(face.map(corner));
        }
        self
    }

    fn block(&mut self, low: Vec3, high: Vec3) -> &mut Self {
        self.turned_box(low, high, 0.0)
    }

    /// A room from the origin to `size`: floor, four walls, no ceiling.
    fn room(&mut self, [x, y, z]: Vec3) -> &mut Self {
        let o = 0.0;
        self.quad([[o, o, o], [x, o, o], [x, y, o], [o, y, o]])
            .quad([[o, o, o], [x, o, o], [x, o, z], [o, o, z]])
            .quad([[o, y, o], [x, y, o], [x, y, z], [o, y, z]])
            .quad([[o, o, o], [o, y, o], [o, y, z], [o, o, z]])
            .quad([[x, o, o], [x, y, o], [x, y, z], [x, o, z]])
    }

    /// A surface of revolution about z, of `steps` facets: radius and height along the profile,
    /// the radius changed by a factor for each direction.
    fn revolved(
        &mut self,
        profile: &[[f64; 2]],
        steps: usize,
        factor: impl Fn(usize) -> f64,
    ) -> &mut Self {
        let at = |k: usize, [radius, height]: [f64; 2]| {
            let (sine, cosine) = (std::f64::consts::TAU * k as f64 / steps as f64).sin_cos();
            let radius = radius * factor(k % steps);
            [radius * cosine, radius * sine, height]
        };
        for k in 0..steps {
            for pair in profile.windows(2) {
                self.quad([at(k, pair[0]), at(k + 1, pair[0]), at(k + 1, pair[1]), at(k, pair[1])]);
            }
        }
        self
    }

    fn sample(&self, points: usize, seed: u64) -> PointCloud {
        let Scene { vertices, faces } = self;
        let mesh = Mesh { vertices: vertices.clone(), faces: faces.clone() };
        mesh.sample(points, seed).unwrap()
    }
}

/// Points of a cloud for which a condition holds.
fn part(cloud: &PointCloud, keep: impl Fn(Vec3) -> bool) -> PointCloud {
    let points: Vec<Vec3> = cloud.positions().filter(|&point| keep(point)).collect();
    PointCloud::new(&points).unwrap()
}

/// Registers `source`, moved, onto `target`; returns the verdict, the rotation error in degrees, and
/// the mean displacement of the source relative to its size.
fn register(source: &PointCloud, target: &PointCloud) -> (Verdict, f64) {
    let motion = Transform {
        translation: [3.0, -1.0, 2.0],
        ..Transform::from_rotation_vector([0.9, -1.2, 0.6])
    };
    let moved = source.transformed(&motion).unwrap();
    let found = Consensus::default().register(&moved, target).unwrap();
    let pose = found.transform.after(&motion);
    let off = pose_error(&pose, &Transform::IDENTITY, source.centroid());
    let extent = |axis: usize| {
        let along = || source.positions().map(|point| point[axis]);
        along().fold(f64::MIN, f64::max) - along().fold(f64::MAX, f64::min)
    };
    let size = math::norm([0, 1, 2].map(extent));
    (found.verdict.unwrap(), (off.rotation_deg / 10.0).max(off.translation / (0.05 * size)))
}

/// Asserts that a wrong pose is not accepted: errors are relative to 10 degrees and a twentieth of
/// the size.
fn not_wrongly_accepted(name: &str, (verdict, error): (Verdict, f64)) {
    assert!(
        verdict.decision != Decision::Accept || error < 1.0,
        "{name}: off {error:.2}, {verdict}"
    );
}

fn never_accepted(name: &str, (verdict, error): (Verdict, f64)) {
    assert_ne!(verdict.decision, Decision::Accept, "{name}: off {error:.2}, {verdict}");
}

#[test]
fn bare_rooms_are_not_accepted() {
    let (mut first, mut second) = (Scene::default(), Scene::default());
    first.room([5.0, 4.0, 2.5]);
    second.room([5.6, 3.5, 2.5]);
    never_accepted("two rooms", register(&first.sample(3000, 1), &second.sample(3000, 2)));
    // Itself: a half turn fits as well.
    never_accepted("one room", register(&first.sample(3000, 1), &first.sample(3000, 2)));
}

#[test]
fn repeating_scenes_are_not_accepted_at_another_period() {
    let mut corridor = Scene::default();
    corridor
        .quad([[0.0, 0.0, 0.0], [24.0, 0.0, 0.0], [24.0, 2.0, 0.0], [0.0, 2.0, 0.0]])
        .quad([[0.0, 0.0, 0.0], [24.0, 0.0, 0.0], [24.0, 0.0, 2.5], [0.0, 0.0, 2.5]])
        .quad([[0.0, 2.0, 0.0], [24.0, 2.0, 0.0], [24.0, 2.0, 2.5], [0.0, 2.0, 2.5]]);
    for k in 0..8 {
        let x = 1.0 + 3.0 * f64::from(k);
        corridor.block([x, -0.3, 0.0], [x + 1.0, 0.15, 2.1]);
    }
    let whole = corridor.sample(9000, 1);
    let [from, onto] = [[0.0, 15.0], [9.0, 24.0]]
        .map(|[low, high]| part(&whole, |point| (low..high).contains(&point[0])));
    not_wrongly_accepted("corridor", register(&from, &onto));
    let mut racks = Scene::default();
    racks.quad([[0.0, 0.0, 0.0], [16.0, 0.0, 0.0], [16.0, 10.0, 0.0], [0.0, 10.0, 0.0]]);
    for i in 0..5 {
        for j in 0..4 {
            let (x, y) = (1.0 + 3.0 * f64::from(i), 1.0 + 2.4 * f64::from(j));
            racks.block([x, y, 0.0], [x + 1.5, y + 0.8, 2.0]);
        }
    }
    let whole = racks.sample(9000, 3);
    let [from, onto] = [[0.0, 10.0], [6.0, 16.0]]
        .map(|[low, high]| part(&whole, |point| (low..high).contains(&point[0])));
    not_wrongly_accepted("racks", register(&from, &onto));
    let mut stairs = Scene::default();
    for k in 0..24 {
        let angle = 0.3 * f64::from(k);
        let (sine, cosine) = angle.sin_cos();
        let center = [1.2 * cosine, 1.2 * sine, 0.18 * f64::from(k)];
        let half = [0.6, 0.18, 0.03];
        stairs.turned_box(math::sub(center, half), math::add(center, half), angle);
    }
    stairs.revolved(&[[0.3, -0.2], [0.3, 4.5]], 24, |_| 1.0);
    let whole = stairs.sample(9000, 5);
    let [from, onto] = [[-1.0, 2.8], [1.6, 5.0]]
        .map(|[low, high]| part(&whole, |point| (low..high).contains(&point[2])));
    not_wrongly_accepted("spiral stairs", register(&from, &onto));
}

#[test]
fn symmetric_parts_are_not_accepted() {
    let mut gear = Scene::default();
    let tooth = |k: usize| if k % 4 < 2 { 1.0 } else { 0.85 };
    gear.revolved(&[[0.3, 0.0], [1.0, 0.0], [1.0, 0.3], [0.3, 0.3], [0.3, 0.0]], 48, tooth);
    never_accepted("gear", register(&gear.sample(4000, 1), &gear.sample(4000, 2)));
    let mut brick = Scene::default();
    brick.block([0.0; 3], [2.0, 1.0, 0.6]);
    never_accepted("brick", register(&brick.sample(3000, 1), &brick.sample(3000, 2)));
    // A pedestal, and on it a figure that tells its sides apart: a turned pedestal is wrong.
    let mut statue = Scene::default();
    statue.revolved(&[[1.0, 0.0], [1.0, 0.5], [0.8, 0.6], [0.0, 0.6]], 8, |_| 1.0);
    statue.turned_box([-0.2, -0.15, 0.6], [0.3, 0.1, 1.4], 0.4);
    statue.turned_box([0.1, -0.1, 1.4], [0.5, 0.15, 1.6], 0.9);
    let whole = statue.sample(8000, 1);
    let from = part(&whole, |point| point[0] + 0.3 * point[1] > -0.3);
    let onto = part(&statue.sample(8000, 2), |point| point[1] - 0.2 * point[0] > -0.4);
    not_wrongly_accepted("pedestal", register(&from, &onto));
}

#[test]
fn mirrored_and_scaled_parts_are_not_accepted() {
    let whole = cfreg::cloud::shape::boulder();
    let (source, target) = (whole.sample(4000, 1).unwrap(), whole.sample(4000, 2).unwrap());
    let mirror: Vec<Vec3> = source.positions().map(|[x, y, z]| [-x, y, z]).collect();
    never_accepted("mirrored", register(&PointCloud::new(&mirror).unwrap(), &target));
    let smaller = Transform { scale: 0.95, ..Transform::IDENTITY };
    never_accepted("scaled", register(&source.transformed(&smaller).unwrap(), &target));
}

#[test]
fn two_instances_are_not_accepted() {
    let one = cfreg::cloud::shape::boulder();
    let bin: Vec<Vec3> = [([0.0; 3], [0.0; 3]), ([3.0, 0.3, 0.2], [0.4, 1.0, -0.3])]
        .into_iter()
        .zip(2..)
        .flat_map(|((translation, turn), seed)| {
            let pose = Transform { translation, ..Transform::from_rotation_vector(turn) };
            let placed = one.sample(3000, seed).unwrap().transformed(&pose).unwrap();
            placed.positions().collect::<Vec<_>>()
        })
        .collect();
    let bin = PointCloud::new(&bin).unwrap();
    never_accepted("two instances", register(&one.sample(3000, 1).unwrap(), &bin));
}

#[test]
fn a_room_whose_furniture_moved_is_accepted() {
    let room = |chair: Vec3, seed: u64| {
        let mut scene = Scene::default();
        scene
            .room([5.0, 4.0, 2.5])
            .block([0.0, 0.5, 0.0], [0.6, 2.0, 1.9])
            .block([2.0, 3.3, 0.0], [3.4, 4.0, 0.8])
            .turned_box([1.5, 0.8, 0.7], [3.0, 1.7, 0.75], 0.3)
            .turned_box([4.2, 0.1, 0.0], [4.9, 0.9, 1.2], 0.1)
            .turned_box(chair, math::add(chair, [0.5, 0.5, 0.9]), 0.7);
        scene.sample(8000, seed)
    };
    let (verdict, error) = register(&room([1.0, 2.6, 0.0], 1), &room([3.7, 1.9, 0.0], 2));
    assert_eq!(verdict.decision, Decision::Accept, "{verdict}");
    assert!(error < 0.2, "{error}");
}
