//! Descriptors from outside the crate, by public names alone: one that implements the trait, and
//! rows of numbers that clouds carry.

use cfreg::cloud::shape::boulder;
use cfreg::descriptor::{Descriptor, Fpfh, HistogramScale, PreparedCloud};
use cfreg::filter::voxel_grid;
use cfreg::math::{self, eigen};
use cfreg::method::{
    Cf, CfSpectral, Cfk, Consensus, DescriptorDistance, DescriptorRole, FeatureConfig,
    GivenDescriptors, Method, Pipeline, Register, Teaser,
};
use cfreg::normals::Orientation;
use cfreg::search::Neighborhood;
use cfreg::verify::Decision;
use cfreg::{Descriptors, Error, PointCloud, Result, Transform};

/// The shape of the neighbourhood at several sizes: extent along each principal axis, and height of
/// the point over the mean along its normal; 4 values a size, relative to the largest size.
struct PrincipalExtents {
    sizes: Vec<usize>,
}

impl Descriptor for PrincipalExtents {
    fn name(&self) -> &str {
        "principal-extents"
    }

    fn describe(&self, cloud: &PreparedCloud<'_>) -> Result<Descriptors> {
        let place = |j: usize| cloud.points()[j].map(f64::from);
        let mut values = Vec::new();
        for &i in cloud.rows() {
            let square = |j: u32| {
                let off = math::sub(place(j as usize), place(i));
                math::dot(off, off)
            };
            let mut near: Vec<(f64, u32)> =
                cloud.neighbors().indices(i).iter().map(|&j| (square(j), j)).collect();
            near.sort_by(|a, b| a.0.total_cmp(&b.0));
            let radius = near[near.len() - 1].0.sqrt();
            for &size in &self.sizes {
                let near = &near[..size.min(near.len())];
                let share = 1.0 / near.len() as f64;
                let add = |sum, &(_, j): &(f64, u32)| math::add(sum, place(j as usize));
                let mean = math::scaled(near.iter().fold([0.0; 3], add), share);
                let mut covariance = [[0.0; 3]; 3];
                for &(_, j) in near {
                    let d = math::sub(place(j as usize), mean);
                    covariance =
                        [0, 1, 2].map(|k| math::add(covariance[k], math::scaled(d, share * d[k])));
                }
                let (extents, _) = eigen::symmetric(&covariance);
                let normal = cloud.normals()[i].map(f64::from);
                let height = math::dot(normal, math::sub(place(i), mean));
                values.extend(extents.map(|x| (x.max(0.0).sqrt() / radius) as f32));
                values.push((height / radius) as f32);
            }
        }
        Descriptors::new(4 * self.sizes.len(), values)
    }
}

fn pair() -> (PointCloud, PointCloud, Transform) {
    let truth = Transform {
        translation: [2.0, -1.0, 0.5],
        ..Transform::from_rotation_vector([0.4, -1.0, 0.8])
    };
    let target = boulder().sample(1500, 2).unwrap().transformed(&truth).unwrap();
    (boulder().sample(1500, 1).unwrap(), target, truth)
}

fn outward() -> FeatureConfig {
    FeatureConfig { orientation: Orientation::Outward, ..FeatureConfig::default() }
}

fn replacing(features: FeatureConfig) -> FeatureConfig {
    FeatureConfig { given_descriptors: Some(GivenDescriptors::default()), ..features }
}

fn off(found: &cfreg::method::Registration, truth: &Transform) -> f64 {
    found.transform.after(&truth.inverse()).angle().to_degrees()
}

#[test]
fn a_descriptor_of_a_stranger_enters_every_method() {
    let (source, target, truth) = pair();
    let mine: &dyn Descriptor = &PrincipalExtents { sizes: vec![40, 80, 150] };
    let described = |cloud: &PointCloud| outward().attach(cloud, mine).unwrap();
    let (source, target) = (described(&source), described(&target));
    assert_eq!((mine.name(), source.descriptors().unwrap().dim()), ("principal-extents", 12));
    for role in ["replace", "beside", "replace:cosine"] {
        let given = Some(role.parse().unwrap());
        let consensus = Consensus { given_descriptors: given, ..Consensus::default() };
        let found = consensus.register(&source, &target).unwrap();
        assert!(off(&found, &truth) < 3.0, "{role}: {} degrees", off(&found, &truth));
        let verdict = found.verdict.unwrap();
        assert_eq!(verdict.decision, Decision::Accept, "{role}: {:?}", verdict.reasons);
        let features = FeatureConfig { given_descriptors: given, ..outward() };
        let teaser = Teaser { features: features.clone(), ..Teaser::default() };
        let found = teaser.register(&source, &target).unwrap();
        assert!(off(&found, &truth) < 5.0, "{role}: {} degrees", off(&found, &truth));
        let spectral = CfSpectral { features: features.clone(), ..CfSpectral::default() };
        let found = spectral.register(&source, &target).unwrap();
        assert!(off(&found, &truth) < 5.0, "{role}: {} degrees", off(&found, &truth));
        let cf = Cf { features, ..Cf::default() };
        let found = cf.register(&source, &target).unwrap();
        assert!(off(&found, &truth) < 15.0, "{role}: {} degrees", off(&found, &truth));
        let text = serde_json::to_value(&found).unwrap()["config"]["given_descriptors"].clone();
        assert!(text.as_str().unwrap().starts_with(role), "{text}");
    }
}

/// FPFH that is handed in gives the bits of FPFH that the method computes.
#[test]
fn given_fpfh_is_built_in_fpfh() {
    let (source, target, _) = pair();
    let fpfh = Fpfh { histogram: HistogramScale::Pcl };
    let described = |cloud: &PointCloud| outward().attach(cloud, &fpfh).unwrap();
    let (from, onto) = (described(&source), described(&target));
    // The default bandwidth is that of the rows; FPFH's own is a setting here.
    let cf = Cf { features: outward(), beta: Some(100.0.into()), ..Cf::default() };
    let given = Cf { features: replacing(outward()), ..cf.clone() };
    assert_eq!(
        given.register(&from, &onto).unwrap().transform,
        cf.register(&source, &target).unwrap().transform
    );
    let cfk = |cf: &Cf| Cfk { cf: cf.clone(), ..Cfk::default() };
    assert_eq!(
        cfk(&given).register(&from, &onto).unwrap().transform,
        cfk(&cf).register(&source, &target).unwrap().transform
    );
    let teaser = |features| Teaser { features, ..Teaser::default() };
    assert_eq!(
        teaser(replacing(outward())).register(&from, &onto).unwrap().transform,
        teaser(outward()).register(&source, &target).unwrap().transform
    );
}

/// The same for second-order weights, whose defaults are other neighbourhoods and histograms.
#[test]
fn given_fpfh_is_that_of_second_order_weights() {
    let (source, target, _) = pair();
    let features =
        FeatureConfig { orientation: Orientation::Outward, ..CfSpectral::default().features };
    let fpfh = Fpfh { histogram: HistogramScale::Open3d };
    let described = |cloud: &PointCloud| features.attach(cloud, &fpfh).unwrap();
    let (from, onto) = (described(&source), described(&target));
    let spectral = |features| CfSpectral { features, ..CfSpectral::default() };
    let given = spectral(replacing(features.clone()));
    assert_eq!(
        given.register(&from, &onto).unwrap().transform,
        spectral(features.clone()).register(&source, &target).unwrap().transform
    );
    let none = given.register(&from, &target).unwrap_err().to_string();
    assert!(none.contains("the target carries no descriptors"), "{none}");
}

/// The same for consensus, on points that its downsampling keeps one by one: they are at least 1
/// apart, and the diagonal of its voxels is 0.95.
#[test]
fn given_fpfh_is_that_of_consensus() {
    let height = |x: f64, y: f64| {
        4.0 * (0.21 * x).sin() + 3.0 * (0.17 * y + 0.05 * x).cos() + 2.0 * (0.4 * x + 0.3 * y).sin()
    };
    let patch = |columns: std::ops::Range<i32>| {
        let places = columns.flat_map(|x| (0..40).map(move |y| (f64::from(x), f64::from(y))));
        let points: Vec<[f64; 3]> = places.map(|(x, y)| [x, y, height(x, y)]).collect();
        PointCloud::new(&points).unwrap().with_viewpoint([25.0, 20.0, 60.0]).unwrap()
    };
    let truth = Transform {
        translation: [5.0, 3.0, -2.0],
        ..Transform::from_rotation_vector([0.3, -0.5, 0.9])
    };
    let (source, target) = (patch(0..40), patch(10..50).transformed(&truth).unwrap());
    let features = FeatureConfig {
        neighborhood: Neighborhood::Nearest(100),
        normal_neighborhood: Some(Neighborhood::Nearest(20)),
        histogram: HistogramScale::Open3d,
        ..FeatureConfig::default()
    };
    let fpfh = Fpfh { histogram: HistogramScale::Open3d };
    let described = |cloud: &PointCloud| features.attach(cloud, &fpfh).unwrap();
    let own = Consensus { voxel: Some(0.55), ..Consensus::default() };
    let given = Consensus { given_descriptors: Some(GivenDescriptors::default()), ..own.clone() };
    let found = own.register(&source, &target).unwrap();
    assert_eq!(found.points.source.described, source.len());
    assert!(off(&found, &truth) < 0.1);
    let again = given.register(&described(&source), &described(&target)).unwrap();
    assert_eq!(again.transform, found.transform);
    assert_eq!(again.verdict, found.verdict);
}

/// No rigid pose aligns a mirror image, though these rows, the same in a mirror, match all of it.
#[test]
fn a_mirror_image_with_given_descriptors_is_not_accepted() {
    let (source, target, _) = pair();
    let flipped: Vec<[f64; 3]> = source.positions().map(|[x, y, z]| [-x, y, z]).collect();
    let mine = PrincipalExtents { sizes: vec![40, 80, 150] };
    let described = |cloud: &PointCloud| outward().attach(cloud, &mine).unwrap();
    let source = described(&PointCloud::new(&flipped).unwrap());
    let target = described(&target);
    for role in ["replace", "beside"] {
        let given = Some(role.parse().unwrap());
        let consensus = Consensus { given_descriptors: given, ..Consensus::default() };
        let found = consensus.register(&source, &target).unwrap();
        let verdict = found.verdict.as_ref().unwrap();
        assert!(verdict.decision != Decision::Accept, "{role}: {:?}", verdict.reasons);
        assert!(!found.is_usable(), "{role}: {:?}", found.doubts);
    }
}

#[test]
fn rows_follow_their_points() {
    let points = [[0.0, 0.0, 0.0], [0.1, 0.0, 0.0], [5.0, 0.0, 0.0], [5.0, 1e-3, 0.0]];
    let rows = Descriptors::new(2, vec![1.0, 0.0, 3.0, 2.0, 0.0, 4.0, 0.0, 8.0]).unwrap();
    let cloud = PointCloud::new(&points).unwrap().with_descriptors(rows).unwrap();
    let thin = voxel_grid(&cloud, 1.0).unwrap();
    assert_eq!(thin.descriptors().unwrap().as_slice(), [2.0, 1.0, 0.0, 6.0]);
    let heavy = cloud.clone().with_weights(vec![1.0, 3.0, 0.0, 0.0]).unwrap();
    let thin = voxel_grid(&heavy, 1.0).unwrap();
    assert_eq!(thin.descriptors().unwrap().as_slice(), [2.5, 1.5, 0.0, 6.0]);
    assert_eq!(cloud.select(&[2]).descriptors().unwrap().as_slice(), [0.0, 4.0]);
    let moved = cloud.transformed(&Transform::from_rotation_vector([1.0, 0.0, 0.0])).unwrap();
    assert_eq!(moved.descriptors(), cloud.descriptors());
    assert_eq!(PointCloud::from_parts(cloud.parts()).unwrap(), cloud);
}

#[test]
fn rows_that_cannot_be_compared_are_refused() {
    let (source, target, _) = pair();
    let rows = |width| Descriptors::new(width, vec![1.0; 1500 * width]).unwrap();
    let refused = |rows| source.clone().with_descriptors(rows).unwrap_err().to_string();
    assert!(refused(rows(513)).contains("at most 512"));
    assert!(refused(Descriptors::new(1, vec![1.0; 3]).unwrap()).contains("expected 1500, found 3"));
    let mut zero = vec![1.0; 3000];
    zero[34..36].fill(0.0);
    assert!(refused(Descriptors::new(2, zero).unwrap()).contains("row 17"));
    let one = source.clone().with_descriptors(rows(1)).unwrap();
    let two = target.clone().with_descriptors(rows(2)).unwrap();
    let given = Some(GivenDescriptors {
        role: DescriptorRole::Beside,
        distance: DescriptorDistance::Cosine,
    });
    let consensus = Consensus { given_descriptors: given, ..Consensus::default() };
    let features = FeatureConfig { given_descriptors: given, ..FeatureConfig::default() };
    let teaser = Teaser { features, ..Teaser::default() };
    for method in [&consensus as &dyn Register, &teaser] {
        let none = method.register(&one, &target).unwrap_err().to_string();
        assert!(none.contains("the target carries no descriptors"), "{none}");
        let widths = method.register(&one, &two);
        assert!(matches!(widths, Err(Error::Shape { expected: 1, found: 2, .. })), "{widths:?}");
    }
}

/// A verdict on a pose of `cf` comes from a search by the same descriptors; all through settings by
/// name.
#[test]
fn a_pipeline_verifies_by_given_descriptors() {
    let (source, target, truth) = pair();
    let mine = PrincipalExtents { sizes: vec![40, 80, 150] };
    let described = |cloud: &PointCloud| outward().attach(cloud, &mine).unwrap();
    let method: Method = "cf".parse().unwrap();
    let method = method.with([("given_descriptors", "beside".into())]).unwrap();
    let verifier = method.verifier();
    assert_eq!(verifier.given_descriptors.unwrap().role, DescriptorRole::Beside);
    let pipeline = Pipeline::new(method, vec!["gicp".parse().unwrap()]).unwrap();
    let found = pipeline
        .with_verification(verifier)
        .register(&described(&source), &described(&target))
        .unwrap();
    assert!(off(&found, &truth) < 3.0 && found.is_usable(), "{:?}", found.doubts);
    let icp: Method = "icp".parse().unwrap();
    assert!(icp.with([("given_descriptors", "beside".into())]).is_err());
}
