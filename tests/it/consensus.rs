//! Consensus: what it finds, what it says of it, and what it makes of odd clouds.

use crate::common;

use cfreg::benchmark::{self, Settings, SuccessCriterion, list};
use cfreg::cloud::ViewpointSource;
use cfreg::cloud::shape::boulder;
use cfreg::math::{self, Vec3};
use cfreg::method::{Consensus, Icp, Method, Metric, Pipeline, Refine, Register, Registration};
use cfreg::verify::{Decision, Warning};
use cfreg::{Error, PointCloud, Transform, io, par};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

fn register(source: &PointCloud, target: &PointCloud) -> Registration {
    Consensus::default().register(source, target).unwrap()
}

fn decision(found: &Registration) -> Decision {
    found.verdict.as_ref().unwrap().decision
}

/// Two samples of the boulder, the second one moved; and how.
fn samples(points: usize) -> (PointCloud, PointCloud, Transform) {
    let turn = Transform::from_rotation_vector([0.9, -1.4, 0.7]);
    let truth = Transform { translation: [3.0, -1.0, 8.0], ..turn };
    let [source, target] = [1, 2].map(|seed| boulder().sample(points, seed).unwrap());
    (source, target.transformed(&truth).unwrap(), truth)
}

fn degrees(a: &Transform, b: &Transform) -> f64 {
    let turned = math::mat_mul(&a.rotation, &math::transpose(&b.rotation));
    Transform::rigid(turned, [0.0; 3]).angle().to_degrees()
}

fn random(
    points: usize,
    seed: u64,
    mut place: impl FnMut(&mut dyn FnMut() -> f64) -> Vec3,
) -> PointCloud {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut uniform = || 2.0 * rng.random::<f64>() - 1.0;
    let points: Vec<Vec3> = (0..points).map(|_| place(&mut uniform)).collect();
    PointCloud::new(&points).unwrap()
}

/// A box, its surface sampled evenly.
fn cuboid(sides: Vec3, points: usize, seed: u64) -> PointCloud {
    let areas = [sides[1] * sides[2], sides[2] * sides[0], sides[0] * sides[1]];
    let whole: f64 = areas.iter().sum();
    random(points, seed, |uniform| {
        let mut at = [uniform(), uniform(), uniform()];
        let drawn = 0.5 * (uniform() + 1.0) * whole;
        let axis = if drawn < areas[0] {
            0
        } else if drawn < areas[0] + areas[1] {
            1
        } else {
            2
        };
        at[axis] = at[axis].signum();
        [0, 1, 2].map(|k| 0.5 * sides[k] * at[k])
    })
}

#[test]
fn real_scans_that_overlap_in_part_are_registered_and_others_refused() {
    let Some(data) = common::shared_data() else { return };
    let pairs = list::read(&data.join("pairs.csv"), &data).unwrap();
    let wanted = |overlap: f64| overlap >= 0.3;
    let pairs: Vec<_> =
        pairs.into_iter().filter(|pair| pair.overlap.is_some_and(wanted)).step_by(25).collect();
    let methods = ["consensus".to_string()];
    for (viewpoints, least) in [(ViewpointSource::Origin, 1.0), (ViewpointSource::None, 0.92)] {
        let settings = Settings { viewpoints, ..Settings::default() };
        let rows = benchmark::run(&pairs, &methods, settings, None, |_, _| ()).unwrap();
        let right = rows.iter().filter(|row| row.right).count();
        println!("{viewpoints:?}: {right} of {} right", rows.len());
        assert!(rows.len() > 12 && right as f64 >= least * rows.len() as f64, "{rows:#?}");
        assert!(rows.iter().all(|row| row.right || !row.accepted), "{rows:#?}");
        let accepted = rows.iter().filter(|row| row.accepted).count();
        assert!(accepted as f64 >= 0.8 * right as f64, "{accepted} of {right} accepted");
    }
    let unrelated = concat!(env!("CARGO_MANIFEST_DIR"), "/data/unrelated.csv");
    let pairs = list::read(unrelated.as_ref(), &data).unwrap();
    let pairs: Vec<_> = pairs.into_iter().step_by(24).collect();
    let rows = benchmark::run(&pairs, &methods, Settings::default(), None, |_, _| ()).unwrap();
    assert!(rows.len() > 15 && rows.iter().all(|row| !row.right && !row.accepted), "{rows:#?}");
}

/// What their scanner did not reach lies at its limit, alike about every place where it stood.
#[test]
fn terrestrial_scans_are_registered_however_they_are_moved() {
    let Some(data) = common::shared_data() else { return };
    let mut pairs = list::read(&data.join("pairs.csv"), &data).unwrap();
    pairs.retain(|pair| pair.dataset == "tls_3dtk");
    assert_eq!(pairs.len(), 3);
    // Unoptimised, fewer motions.
    for seed in 0..if cfg!(debug_assertions) { 2 } else { 4 } {
        let settings = Settings { viewpoints: ViewpointSource::None, seed, ..Settings::default() };
        let methods = ["consensus".to_string()];
        let rows = benchmark::run(&pairs, &methods, settings, None, |_, _| ()).unwrap();
        assert!(rows.iter().all(|row| row.right), "{seed}: {rows:#?}");
        // Of fewer points the robot that carried it is what is seen best: it is everywhere.
        let few = Settings { points: 20_000, ..settings };
        let rows = benchmark::run(&pairs, &methods, few, None, |_, _| ()).unwrap();
        assert!(rows.iter().all(|row| row.right || !row.accepted), "{seed}: {rows:#?}");
        assert!(rows.iter().filter(|row| row.accepted).count() >= 1, "{seed}: {rows:#?}");
    }
}

#[test]
fn threads_change_no_bit() {
    let (source, target, _) = samples(3000);
    let by = |threads| Consensus { threads, ..Consensus::default() }.register(&source, &target);
    let one = by(1).unwrap();
    for threads in [2, 3, 0] {
        let other = by(threads).unwrap();
        assert_eq!((one.transform, &one.verdict), (other.transform, &other.verdict));
        assert_eq!(one.moments, other.moments);
    }
    let within = par::with_threads(3, || register(&source, &target)).unwrap();
    assert_eq!(within.transform, one.transform);
}

#[test]
fn the_unit_and_a_map_offset_do_not_matter() {
    let (source, target, truth) = samples(3000);
    let one = register(&source, &target);
    assert!(degrees(&one.transform, &truth) < 0.3);
    let scaled = |cloud: &PointCloud, unit: f64, offset: Vec3| {
        let place = |p: Vec3| math::add(math::scaled(p, unit), offset);
        PointCloud::new(&cloud.positions().map(place).collect::<Vec<_>>()).unwrap()
    };
    // A cloud keeps its points about a round number, so that even powers of two round a little.
    let of = |unit| register(&scaled(&source, unit, [0.0; 3]), &scaled(&target, unit, [0.0; 3]));
    let probability = |found: &Registration| found.verdict.as_ref().unwrap().probability;
    let large = of(1024.0);
    assert!(degrees(&large.transform, &one.transform) < 1e-5);
    // The margin is over the best wrong pose, and rounding may lead the search to another one.
    assert!((probability(&large) - probability(&one)).abs() < 1e-3);
    // Others may move a point into another cube.
    assert!(degrees(&of(1000.0).transform, &one.transform) < 0.05);
    let utm = [500_000.0, 5_600_000.0, 100.0];
    let far = register(&scaled(&source, 1.0, utm), &scaled(&target, 1.0, utm));
    assert!(degrees(&far.transform, &one.transform) < 0.05);
    let error = math::sub(far.transform.apply(math::add(source.centroid(), utm)), utm);
    let error = math::norm(math::sub(error, truth.apply(source.centroid())));
    assert!(error < 0.02, "{error}");
}

#[test]
fn halves_that_share_nothing_are_rejected() {
    let whole = boulder().sample(6000, 3).unwrap();
    let half = |sign: f64| {
        let of = |&i: &usize| sign * whole.position(i)[0] > 0.15;
        whole.select(&(0..whole.len()).filter(of).collect::<Vec<_>>())
    };
    let found = register(&half(1.0), &half(-1.0));
    assert_eq!(decision(&found), Decision::Reject, "{:?}", found.verdict);
    assert!(
        !found.trusted
            && found.doubts.iter().any(|doubt| doubt.to_string().contains("overlap too little"))
    );
}

#[test]
fn symmetric_shapes_are_not_accepted() {
    let sphere = |seed| {
        random(3000, seed, |uniform| {
            let at = loop {
                let at = [uniform(), uniform(), uniform()];
                if (0.1..1.0).contains(&math::norm(at)) {
                    break at;
                }
            };
            math::normalized(at)
        })
    };
    let found = register(&sphere(1), &sphere(2));
    assert_ne!(decision(&found), Decision::Accept, "{:?}", found.verdict);
    // Half turns of a box fit as well as none.
    let found = register(&cuboid([3.0, 2.0, 1.0], 4000, 1), &cuboid([3.0, 2.0, 1.0], 4000, 2));
    assert_ne!(decision(&found), Decision::Accept, "{:?}", found.verdict);
}

#[test]
fn odd_clouds_have_a_defined_result() {
    let cloud = |points: &[Vec3]| PointCloud::new(points).unwrap();
    let (good, _, _) = samples(1500);
    let line: Vec<Vec3> = (0..300).map(|i| [f64::from(i), 2.0 * f64::from(i), 1.0]).collect();
    let few = |points: &[Vec3], needed: &str| {
        for pair in [(&cloud(points), &good), (&good, &cloud(points))] {
            let error = Consensus::default().register(pair.0, pair.1).unwrap_err();
            assert!(error.to_string().contains(needed), "{error}");
        }
    };
    few(&[], "0 usable points");
    few(&line[..2], "2 usable points");
    few(&[[f64::NAN; 3]; 9], "0 usable points");
    let same = cloud(&[[1.0, 2.0, 3.0]; 100]);
    let error = Consensus::default().register(&same, &same).unwrap_err();
    assert!(matches!(error, Error::Degenerate { .. }), "{error}");
    let line = cloud(&line);
    let error = Consensus::default().register(&line, &line).unwrap_err();
    assert!(matches!(error, Error::Degenerate { .. }), "{error}");
    // A plane slides on itself.
    let plane = |seed| random(2000, seed, |uniform| [uniform(), uniform(), 0.0]);
    match Consensus::default().register(&plane(1), &plane(2)) {
        Ok(found) => assert_ne!(decision(&found), Decision::Accept),
        Err(error) => assert!(matches!(error, Error::NoWeight { .. } | Error::Degenerate { .. })),
    }
    // A point in a thousand that lies far away, and duplicates, cost nothing.
    let (source, target, truth) = samples(2000);
    let mut points: Vec<Vec3> = source.positions().collect();
    points.extend([[40.0, 2.0, 1.0], [-30.0, 50.0, 0.0], [f64::NAN, 0.0, 0.0]]);
    points.extend_from_within(..500);
    let found = register(&cloud(&points), &target);
    assert!(degrees(&found.transform, &truth) < 1.0 && found.trusted, "{:?}", found.doubts);
    assert_eq!(found.points.source.dropped, 1);
}

#[test]
fn a_length_too_long_is_named() {
    let (source, target, _) = samples(500);
    let coarse = Consensus { voxel: Some(100.0), ..Consensus::default() };
    let error = coarse.register(&source, &target).unwrap_err().to_string();
    assert!(error.contains("thinned to 1e2"), "{error}");
}

#[test]
fn a_viewpoint_that_is_wrong_does_no_harm() {
    let Some(data) = common::shared_data() else { return };
    let read = |name: &str| io::read(data.join("stanford_bunny").join(name)).unwrap();
    let (source, target) = (read("bun000.ply"), read("bun045.ply"));
    let plain = register(&source, &target);
    // In the middle of the bunny: half the normals are turned, and much would hide the rest.
    let misled = source.clone().with_viewpoint(source.centroid()).unwrap();
    let found = register(&misled, &target);
    assert!(degrees(&found.transform, &plain.transform) < 2.0);
    assert!((degrees(&plain.transform, &Transform::IDENTITY) - 34.3).abs() < 1.0);
}

#[test]
fn a_refinement_that_stays_with_the_pose_stays_accepted() {
    let Some(data) = common::shared_data() else { return };
    let read = |name: &str| {
        let cloud = io::read(data.join("stanford_bunny").join(name)).unwrap();
        cfreg::filter::sample(&cloud, 5000, 1)
    };
    // They overlap by two fifths: less than the agreement that gicp wants.
    let (source, target) = (read("bun000.ply"), read("bun090.ply"));
    let first = register(&source, &target);
    assert_eq!(decision(&first), Decision::Accept);
    let kept =
        benchmark::parse_method("consensus+gicp").unwrap().register(&source, &target).unwrap();
    let verdict = kept.verdict.as_ref().unwrap();
    assert!(kept.trusted && verdict.decision == Decision::Accept, "{:?}", kept.doubts);
    // It is its own.
    assert!(
        verdict.reasons.iter().any(|reason| reason.contains("refinement on the surfaces")),
        "{verdict}"
    );
    // Its pairs were bounded by the length of the first.
    let (Some(Method::Consensus(consensus)), Some(Method::Icp(icp))) =
        (first.method.parse(), kept.method.parse())
    else {
        panic!()
    };
    assert_eq!(icp.max_distance.unwrap(), 2.0 * consensus.voxel.unwrap());
    let alone = Refine::refine(&icp, &source, &target, &first.transform).unwrap();
    assert_eq!(alone.transform, kept.transform);
    assert!(!alone.trusted && alone.verdict.is_none(), "{:?}", alone.evaluation);
    let pairs = list::read(&data.join("pairs.csv"), &data).unwrap();
    let truth =
        pairs.iter().find(|pair| pair.target.ends_with("bun090.ply")).unwrap().truth.unwrap();
    assert!(degrees(&kept.transform, &truth) < 0.5, "{}", degrees(&kept.transform, &truth));
    // Pairs of any length draw it away: then it is dropped, and a reason says so.
    let icp = Icp { max_distance: Some(1e3), ..icp.clone() };
    let first = Method::Consensus(Consensus::default());
    let drawn =
        Pipeline::new(first, vec![Method::Icp(Icp { metric: Metric::Plane, ..icp })]).unwrap();
    let drawn = drawn.register(&source, &target).unwrap();
    assert!(degrees(&drawn.transform, &truth) < 2.0);
    let verdict = drawn.verdict.as_ref().unwrap();
    assert!(verdict.decision == Decision::Accept && drawn.trusted, "{:?}", drawn.doubts);
    assert!(verdict.reasons.iter().any(|reason| reason.contains("was dropped")), "{verdict}");
}

#[test]
fn a_stray_point_makes_no_pose_another() {
    let (source, target, truth) = samples(2000);
    let stray = |cloud: &PointCloud| {
        let points: Vec<Vec3> = cloud.positions().chain([[2e4, 1e4, -3e4]]).collect();
        PointCloud::new(&points).unwrap()
    };
    // As long as without it, which would be all there is.
    let clean: Consensus = register(&source, &target).method.parse().unwrap();
    let found = clean.register(&stray(&source), &stray(&target)).unwrap();
    assert_eq!(decision(&found), Decision::Accept, "{:?}", found.verdict);
    assert!(degrees(&found.transform, &truth) < 2.0);
}

#[test]
fn clouds_that_differ_in_scale_have_no_rigid_pose() {
    let (source, target, truth) = samples(4000);
    for scale in [0.92, 0.95, 1.05, 1.08] {
        let grow = Transform { scale, ..Transform::IDENTITY };
        let grown = source.transformed(&grow).unwrap();
        let found = register(&grown, &target);
        assert!(
            !found.trusted
                && found.doubts.iter().any(|doubt| matches!(doubt, Warning::ScaleMismatch { .. }))
        );
        let verdict = found.verdict.unwrap();
        assert_eq!(verdict.decision, Decision::Ambiguous, "{scale}: {verdict}");
        assert!((verdict.other_scale.unwrap() * scale - 1.0).abs() < 0.01, "{scale}: {verdict}");
        // Whoever says so, too; and the right one is right.
        let judge = |scale: f64| {
            let pose = truth.after(&Transform { scale, ..Transform::IDENTITY });
            Consensus::default().verify(&grown, &target, &pose).unwrap().decision
        };
        assert_ne!(judge(1.0), Decision::Accept);
        assert_eq!(judge(1.0 / scale), Decision::Accept);
    }
}

#[test]
fn any_pose_is_judged_whoever_found_it() {
    let (source, target, truth) = samples(2000);
    let judge = |source: &PointCloud, pose: &Transform| {
        Consensus::default().verify(source, &target, pose).unwrap()
    };
    // Its own answer as it judges that itself.
    let found = register(&source, &target);
    let own = judge(&source, &found.transform);
    let first = found.verdict.unwrap();
    assert_eq!(own.decision, Decision::Accept);
    assert!((own.probability - first.probability).abs() < 1e-3, "{own} {first}");
    // The truth; off by less than a length; of another size.
    assert_eq!(judge(&source, &truth).decision, Decision::Accept);
    let length = found.method.parse::<Consensus>().unwrap().voxel.unwrap();
    let shifted = |by: f64| {
        let shift = Transform { translation: [by * length, 0.0, 0.0], ..Transform::IDENTITY };
        judge(&source, &shift.after(&truth))
    };
    assert_eq!(shifted(0.5).decision, Decision::Accept);
    // It would settle on the right one, but is not that.
    let off = shifted(2.0);
    assert_eq!(off.decision, Decision::Reject, "{off}");
    assert!(
        off.reasons.last().unwrap().starts_with("refinement on the surfaces moves the pose by 0."),
        "{off}"
    );
    let half = Transform { scale: 0.5, ..Transform::IDENTITY };
    let double = Transform { scale: 2.0, ..Transform::IDENTITY };
    let small = source.transformed(&half).unwrap();
    assert_eq!(judge(&small, &truth.after(&double)).decision, Decision::Accept);
    // Wrong ones, beside which the right one is named.
    for wrong in [Transform::IDENTITY, Transform { translation: [9e9; 3], ..truth }] {
        let verdict = judge(&source, &wrong);
        let other = verdict.runner_up.unwrap();
        assert!(verdict.decision == Decision::Reject && other.probability > 0.9);
        assert!(degrees(&other.transform, &truth) < 1.0);
        let scaled = judge(&small, &wrong.after(&double));
        assert_eq!(scaled.decision, Decision::Reject);
        let other = scaled.runner_up.unwrap().transform;
        assert!(other.scale == 2.0 && degrees(&other, &truth) < 1.0);
    }
}

#[test]
fn it_is_a_method_by_name_and_starts_refinements() {
    let method: Method = "consensus".parse().unwrap();
    assert_eq!(method, Method::Consensus(Consensus::default()));
    assert!(method.as_refinement().is_none());
    let set = method.with([("voxel", 0.1.into()), ("seeds", 50.into())]).unwrap();
    assert_eq!(
        set,
        Method::Consensus(Consensus { voxel: Some(0.1), seeds: 50, ..Consensus::default() })
    );
    let (source, target, truth) = samples(1500);
    let chain = benchmark::parse_method("consensus+gicp").unwrap();
    let refined = chain.register(&source, &target).unwrap();
    assert!(degrees(&refined.transform, &truth) < 1.0);
    let first = refined.refined_from.unwrap();
    assert_eq!((&*first.method.name, decision(&first)), ("consensus", Decision::Accept));
    assert_eq!(SuccessCriterion::for_size(source.diagonal()), SuccessCriterion::Indoor);
}
