//! Normals and descriptors, each by itself, must follow the cloud: its motion, its unit,
//! the order of its points, a map offset, and nothing else.

use crate::common;

use cfreg::cloud::shape::boulder;
use cfreg::descriptor::{HistogramScale, fpfh};
use cfreg::math::{self, Vec3};
use cfreg::normals::{self, Normals, Orientation};
use cfreg::search::{Neighborhood, Neighbors};
use cfreg::{Descriptors, PointCloud, Transform, par};
use proptest::prelude::*;

const K: usize = 40;

/// A cloud seen from the middle of its shape.
fn cloud(seed: u64) -> PointCloud {
    boulder().sample(400, seed).unwrap().with_viewpoint([0.05, 0.0, 0.1]).unwrap()
}

fn described(cloud: &PointCloud, neighborhood: Neighborhood) -> (Normals, Descriptors) {
    let neighbors = Neighbors::find(cloud.points(), neighborhood).unwrap();
    let normals = normals::estimate(cloud, &neighbors, Orientation::Viewpoint).unwrap();
    let descriptors =
        fpfh(cloud.points(), &normals.vectors, &neighbors, HistogramScale::Pcl).unwrap();
    (normals, descriptors)
}

/// Median and greatest L1 distance between the rows of two sets of descriptors.
fn l1(a: &Descriptors, b: &Descriptors) -> (f32, f32) {
    let row = |(x, y): (&[f32], &[f32])| x.iter().zip(y).map(|(x, y)| (x - y).abs()).sum();
    let mut apart: Vec<f32> = a.rows().zip(b.rows()).map(row).collect();
    apart.sort_by(f32::total_cmp);
    (apart[apart.len() / 2], apart[apart.len() - 1])
}

fn motion() -> impl Strategy<Value = Transform> {
    let vector = proptest::array::uniform3(-3.0..3.0f64);
    let shift = proptest::array::uniform3(-20.0..20.0f64);
    (vector, shift).prop_map(|(vector, translation)| Transform {
        translation,
        ..Transform::from_rotation_vector(vector)
    })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(16))]

    // f32 coordinates of a moved cloud differ in their last bits: normals by rounding, and
    // a few of a point's 40 pairs may fall into the next bin.
    #[test]
    fn normals_turn_and_descriptors_stay_under_a_rigid_motion(
        motion in motion(), seed in 0..50u64,
    ) {
        let still = cloud(seed);
        let moved = still.transformed(&motion).unwrap();
        let (normals, descriptors) = described(&still, Neighborhood::Nearest(K));
        let (moved_normals, moved_descriptors) = described(&moved, Neighborhood::Nearest(K));
        // Rounding decides between equally far last neighbours, and turns the normal where two
        // variances are nearly equal: that is seldom.
        let mut unclear = 0;
        for (before, after) in normals.vectors.iter().zip(&moved_normals.vectors) {
            let want = motion.rotate(before.map(f64::from));
            let apart = math::norm(math::cross(want, after.map(f64::from)));
            let same_side = math::dot(want, after.map(f64::from)) > 0.0;
            unclear += usize::from(apart >= 2e-3 || !same_side);
        }
        prop_assert!(unclear <= normals.vectors.len() / 100, "{unclear}");
        let bent = normals.curvature.iter().zip(&moved_normals.curvature);
        let unclear = bent.filter(|(before, after)| (*before - *after).abs() >= 1e-5).count();
        prop_assert!(unclear <= normals.vectors.len() / 100, "{unclear}");
        let (median, greatest) = l1(&descriptors, &moved_descriptors);
        prop_assert!(median < 0.05 && greatest < 25.0, "{median} {greatest}");
    }

    #[test]
    fn the_unit_changes_no_bit(exponent in -20..21i32, seed in 0..50u64) {
        let unit = 2f64.powi(exponent);
        let one = cloud(seed);
        let scaled: Vec<Vec3> = one.positions().map(|p| math::scaled(p, unit)).collect();
        let other = PointCloud::new(&scaled).unwrap();
        let other = other.with_viewpoint(math::scaled(one.viewpoint().unwrap(), unit)).unwrap();
        let (normals, descriptors) = described(&one, Neighborhood::Nearest(K));
        let (scaled_normals, scaled_descriptors) = described(&other, Neighborhood::Nearest(K));
        prop_assert_eq!(normals.vectors, scaled_normals.vectors);
        prop_assert_eq!(descriptors, scaled_descriptors);
        // A radius is a length: it scales along.
        let radius = 0.3;
        let (_, by_radius) = described(&one, Neighborhood::Radius(radius));
        let (_, by_scaled) = described(&other, Neighborhood::Radius(radius * unit));
        prop_assert_eq!(by_radius, by_scaled);
    }

    #[test]
    fn the_order_of_points_goes_along(seed in 0..50u64, turn in 1..399usize) {
        let one = cloud(seed);
        let order: Vec<usize> = (0..one.len()).map(|i| (i * 7 + turn) % one.len()).collect();
        let other = one.select(&order);
        let (normals, descriptors) = described(&one, Neighborhood::Nearest(K));
        let (other_normals, other_descriptors) = described(&other, Neighborhood::Nearest(K));
        // Sums run in the order of the indices: the last bits may differ.
        for (i, &from) in order.iter().enumerate() {
            let (want, found) = (normals.vectors[from], other_normals.vectors[i]);
            for axis in 0..3 {
                prop_assert!((want[axis] - found[axis]).abs() < 1e-5);
            }
        }
        let (median, greatest) = l1(&descriptors.select(&order), &other_descriptors);
        prop_assert!(median < 1e-3 && greatest < 10.0, "{median} {greatest}");
    }
}

#[test]
fn a_map_offset_changes_no_bit() {
    let one = cloud(3);
    let snapped: Vec<Vec3> =
        one.positions().map(|p| p.map(|x| (x * 65536.0).round() / 65536.0)).collect();
    let offset = [5e5, 5.6e6, 0.0];
    let far: Vec<Vec3> = snapped.iter().map(|&p| math::add(p, offset)).collect();
    let (near, far) = (PointCloud::new(&snapped).unwrap(), PointCloud::new(&far).unwrap());
    let (normals, descriptors) = described(&near, Neighborhood::Nearest(K));
    let (far_normals, far_descriptors) = described(&far, Neighborhood::Nearest(K));
    assert_eq!(normals, far_normals);
    assert_eq!(descriptors, far_descriptors);
}

#[test]
fn reruns_and_threads_change_no_bit() {
    let cloud = cloud(9);
    for neighborhood in [Neighborhood::Nearest(K), Neighborhood::Radius(0.3)] {
        let first = described(&cloud, neighborhood);
        for threads in [1, 2, 3, 7] {
            let again = par::with_threads(threads, || described(&cloud, neighborhood)).unwrap();
            assert_eq!(first, again, "{threads} threads");
        }
    }
}

#[test]
fn real_scans_follow_their_motion() {
    let Some(data) = common::shared_data() else { return };
    for file in ["stanford_bunny/bun000.ply", "kitti00/000000.ply"] {
        let scan = cfreg::io::read(data.join(file)).unwrap();
        let scan = cfreg::filter::sample(&scan, 2000, 0).with_viewpoint([0.0; 3]).unwrap();
        let motion = Transform {
            translation: [0.3, -0.1, 0.2],
            ..Transform::from_rotation_vector([1.0, -2.0, 0.5])
        };
        let (_, descriptors) = described(&scan, Neighborhood::Nearest(150));
        let moved = scan.transformed(&motion).unwrap();
        let (_, moved) = described(&moved, Neighborhood::Nearest(150));
        let (median, _) = l1(&descriptors, &moved);
        assert!(median < 0.05, "{file}: {median}");
    }
}
