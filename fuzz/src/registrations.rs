//! Registration of small clouds, most of them hard or hopeless: an answer is one in every respect.

use cfreg::Error;
use cfreg::benchmark;
use cfreg::method::{Consensus, Method, Register, Registration};
use cfreg::verify::{Decision, Verdict};
use serde_json::{Value, json};

use super::bytes::Bytes;
use super::clouds::pair;
use super::readers::{heard, rigid};

/// Chains beside the methods that have a name.
const CHAINS: [&str; 6] = [
    "cf+icp",
    "consensus+icp",
    "consensus+plane-icp+gicp",
    "cf-multiscale+gicp",
    "cfk+kc+cpd",
    "teaser+dare",
];

/// Settings that are laid on a method that has them, two at most.
fn setting(bytes: &mut Bytes<'_>) -> Option<(&'static str, Value)> {
    Some(match bytes.below(24) {
        0 => ("scale", json!("symmetric")),
        1 => ("prior", json!({ "direction": [[0.0, 0.0, 1.0], [0.0, 0.0, 1.0]] })),
        2 => ("prior", json!({ "rotation": { "vector": bytes.triple(), "within_deg": 20.0 } })),
        3 => ("channels", json!(["intensity", "red:0.5"])),
        4 => ("normalize", json!("both")),
        5 => ("normalize", json!("sinkhorn:5")),
        6 => ("weights", json!(bytes.pick(&["cauchy", "tukey", "uniform", "student-t:3"]))),
        7 => ("beta", json!("auto")),
        8 => ("neighbors", json!(1 + bytes.below(40))),
        9 => ("voxel", json!(bytes.pick(&[1e-6, 0.01, 0.1, 1.0, 100.0]))),
        10 => ("max_distance", json!(bytes.pick(&[1e-6, 0.1, 10.0]))),
        11 => ("sigma", json!(bytes.pick(&[1e-6, 0.1, 10.0]))),
        12 => ("keep", json!(bytes.pick(&[0.1, 0.5, 0.9]))),
        13 => ("solver", json!(bytes.pick(&["walker", "horn-matrix", "horn-quaternion"]))),
        14 => ("orientation", json!("outward")),
        15 => ("noise_bound", json!(bytes.pick(&[1e-6, 0.05, 10.0]))),
        _ => return None,
    })
}

/// A method, by its name, in which these threads work.
fn method(name: &str, settings: &[(&'static str, Value)], threads: usize) -> Option<impl Register> {
    let mut parts = name.split('+').map(|name| {
        let mut method: Method = name.parse().expect("a method of the catalogue");
        for (name, value) in settings {
            // Not every method has every setting.
            method = method.clone().with([(*name, value.clone())]).unwrap_or(method);
        }
        method.with([("threads", threads.into())])
    });
    let first = heard(parts.next()?, None)?;
    let rest = heard(parts.collect(), None)?;
    let chain = heard(cfreg::method::Pipeline::new(first, rest), None)?;
    let judge = chain.first().verifier();
    Some(chain.with_verification(judge))
}

/// Registers two clouds of 2 to 60 points by any method, twice by one thread and once by two.
pub fn registration(data: &[u8]) {
    let mut bytes = Bytes(data);
    let chosen = bytes.below(Method::NAMES.len() + CHAINS.len());
    let name = *Method::NAMES.iter().chain(&CHAINS).nth(chosen).expect("within both");
    assert!(heard(benchmark::parse_method(name), None).is_some(), "{name}");
    let settings: Vec<_> = (0..2).filter_map(|_| setting(&mut bytes)).collect();
    let judged = bytes.below(8) == 0;
    let Some([source, target]) = pair(&mut bytes) else { return };
    let run = |threads: usize| {
        let method = method(name, &settings, threads)?;
        Some(method.register(&source, &target))
    };
    let (Some(once), Some(again), Some(by_two)) = (run(1), run(1), run(2)) else { return };
    let context = format!("{name} {settings:?}, {} and {} points", source.len(), target.len());
    if let Ok(found) = &once {
        answer(found, &context);
        // A pose that is trusted was verified on the surfaces.
        assert!(!found.trusted || found.verdict.is_some(), "{context}: {:?}", found.doubts);
        if judged {
            let verdict = Consensus::default().verify(&source, &target, &found.transform);
            if let Some(verdict) = heard(verdict, None) {
                probable(&verdict, &context);
            }
        }
    }
    let told = told(once);
    assert_eq!(told, self::told(again), "twice the same of {context}");
    assert_eq!(told, self::told(by_two), "one thread and two of {context}");
}

/// All that an answer promises.
fn answer(found: &Registration, context: &str) {
    rigid(&found.transform, 1e-9);
    assert_eq!(found.trusted, found.doubts.is_empty(), "{context}: {:?}", found.doubts);
    if let (true, Some(verdict)) = (found.trusted, &found.verdict) {
        assert_eq!(verdict.decision, Decision::Accept, "{context}: trusted");
    }
    if let Some(verdict) = &found.verdict {
        probable(verdict, context);
    }
    let evaluation = &found.evaluation;
    for share in [evaluation.fitness, evaluation.target_fitness] {
        assert!((0.0..=1.0).contains(&share), "{context}: {evaluation:?}");
    }
    assert!(found.weighted_rms.is_finite(), "{context}: {}", found.weighted_rms);
    assert!(found.singular_values.iter().all(|x| x.is_finite()), "{context}");
    assert!(found.effective_connections.is_finite(), "{context}");
    for doubt in &found.doubts {
        let said = doubt.to_string();
        assert!(!said.is_empty() && !said.contains("NaN"), "{context}: {said}");
    }
    if let Some(before) = &found.refined_from {
        answer(before, context);
    }
}

fn probable(verdict: &Verdict, context: &str) {
    let Verdict { probability, overlap, .. } = verdict;
    assert!((0.0..=1.0).contains(probability), "{context}: probability {probability}");
    assert!((0.0..=1.0).contains(overlap), "{context}: overlap {overlap}");
    if let Some(other) = &verdict.runner_up {
        rigid(&other.transform, 1e-9);
        assert!((0.0..=1.0).contains(&other.probability), "{context}: {other:?}");
    }
    if let Some(covariance) = &verdict.covariance {
        let entries = covariance.matrix.as_flattened();
        assert!(entries.iter().all(|x| x.is_finite()), "{context}: {covariance:?}");
    }
    let reasons = &verdict.reasons;
    assert!(reasons.iter().all(|words| !words.contains("NaN")), "{context}: {reasons:?}");
}

/// The answer as JSON, less times and threads; the error in words.
fn told(found: Result<Registration, Error>) -> String {
    match found {
        Ok(found) => {
            let mut value = serde_json::to_value(&found).expect("an answer is JSON");
            timeless(&mut value);
            value.to_string()
        }
        Err(error) => {
            let said = error.to_string();
            heard::<()>(Err(error), None);
            said
        }
    }
}

fn timeless(value: &mut Value) {
    match value {
        Value::Object(fields) => {
            fields.remove("time_s");
            fields.remove("threads");
            fields.values_mut().for_each(timeless);
        }
        Value::Array(all) => all.iter_mut().for_each(timeless),
        _ => {}
    }
}
