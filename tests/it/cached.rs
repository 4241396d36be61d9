//! Clouds of many pairs: what is kept beside them changes no bit of an answer.

use cfreg::cloud::shape::boulder;
use cfreg::method::{Cache, Cached, Method, Pipeline, Register, Registration, Timings};
use cfreg::{PointCloud, Transform};
use serde_json::{Value, json};

/// Samples of one shape with a channel, turned; the last with weights, some of them 0.
fn clouds() -> Vec<PointCloud> {
    let cloud = |seed: u64| {
        let turn = Transform::from_rotation_vector([0.1 * seed as f64, 0.2, 0.0]);
        let cloud = boulder().sample(400 + 20 * seed as usize, seed).unwrap();
        let red = cloud.positions().map(|p| (p[2] + seed as f64) as f32).collect();
        let channels = cloud.channels().clone().with("red", red).unwrap();
        let cloud = cloud.with_channels(channels).unwrap().transformed(&turn).unwrap();
        match seed {
            3 => {
                let weights = (0..cloud.len()).map(|i| (i % 7) as f64).collect();
                cloud.with_weights(weights).unwrap()
            }
            _ => cloud,
        }
    };
    (0..4).map(cloud).collect()
}

fn chain(name: &str, settings: &[(&'static str, Value)], refine: &str) -> Pipeline {
    let method: Method = name.parse().unwrap();
    let method = method.with(settings.iter().cloned()).unwrap();
    Pipeline::new(method, refine.split_terminator('+').map(|name| name.parse().unwrap()).collect())
        .unwrap()
}

/// Without its times, or what the error says.
fn told(found: cfreg::Result<Registration>) -> Result<Registration, String> {
    let mut found = found.map_err(|error| error.to_string())?;
    found.time_s = Timings::default();
    found.refined_from = found.refined_from.map(|before| Box::new(told(Ok(*before)).unwrap()));
    Ok(found)
}

#[test]
fn answers_are_the_same_bits() {
    let clouds = clouds();
    let channels = ("channels", json!(["red:0.5"]));
    let missing = ("channels", json!(["blue"]));
    let chains = [
        chain("consensus", &[], "gicp"),
        chain("consensus", &[("voxel", 0.1.into()), channels.clone()], "plane-icp"),
        chain("cf", &[("neighbors", 30.into())], "icp"),
        chain("cf", &[("neighbors", 30.into()), channels.clone()], ""),
        chain("cf", &[missing], ""),
        chain("cf-spectral", &[("voxel", 0.1.into()), channels], ""),
        chain("cf-spectral", &[("neighbors", 30.into())], "icp"),
        chain("cfk", &[("neighbors", 30.into())], "kc"),
        chain("teaser", &[("neighbors", 30.into())], ""),
        chain("icp", &[("weights", json!("cauchy"))], ""),
    ];
    for chain in &chains {
        let caches: Vec<Cache> = clouds.iter().map(|_| Cache::default()).collect();
        let cached = |i: usize| Cached { cloud: &clouds[i], cache: Some(&caches[i]) };
        // Each as source and as target, with itself, and again.
        for (i, j) in [(0, 1), (2, 1), (1, 2), (3, 1), (1, 3), (1, 1), (0, 1)] {
            let plain = told(chain.register(&clouds[i], &clouds[j]));
            let kept = told(chain.register_cached(cached(i), cached(j)));
            assert!(plain == kept, "{chain:?} {i} {j}");
        }
        let held = caches[1].bytes();
        assert_eq!(held > 0, told(chain.register(&clouds[0], &clouds[1])).is_ok(), "{chain:?}");
        // Nothing is made once more.
        told(chain.register_cached(cached(0), cached(1))).ok();
        assert_eq!(caches[1].bytes(), held, "{chain:?}");
    }
}

#[test]
fn what_is_kept_is_not_made_again() {
    let clouds = clouds();
    for chain in [chain("cf", &[], ""), chain("teaser", &[], "")] {
        let caches: Vec<Cache> = clouds.iter().map(|_| Cache::default()).collect();
        let stages = |i: usize, j: usize| {
            let cached = |i: usize| Cached { cloud: &clouds[i], cache: Some(&caches[i]) };
            let found = chain.register_cached(cached(i), cached(j)).unwrap();
            found.time_s.0.into_iter().map(|(stage, _)| stage).collect::<Vec<_>>()
        };
        let describes =
            |stages: &[std::borrow::Cow<str>]| stages.iter().any(|stage| stage == "normals");
        assert!(describes(&stages(0, 1)) && describes(&stages(2, 1)), "{chain:?}");
        assert!(!describes(&stages(0, 1)) && !describes(&stages(1, 2)), "{chain:?}");
    }
}
