//! Settings and names, as words and as JSON.

use std::fmt::Display;
use std::str::FromStr;

use cfreg::benchmark;
use cfreg::cloud::{Channels, ViewpointSource};
use cfreg::descriptor::HistogramScale;
use cfreg::method::{Channel, Method};
use cfreg::pose::{Prior, ScaleEstimate, Solver};
use cfreg::weight::{Bandwidth, Composite, Normalization, WeightKernel, WeightScheme};
use serde_json::Value;

/// Methods, kernels and priors as JSON; `NAME VALUE` lines, as `--set` has them; names.
pub fn settings(data: &[u8]) {
    if let Ok(method) = serde_json::from_slice::<Method>(data) {
        checked(&method);
    }
    if let Ok(composite) = serde_json::from_slice::<Composite>(data) {
        kernel(&composite);
    }
    if let Ok(prior) = serde_json::from_slice::<Prior>(data) {
        heard(prior.validate());
    }
    let Ok(text) = std::str::from_utf8(data) else { return };
    let name = Method::NAMES[text.len() % Method::NAMES.len()];
    let mut method: Method = name.parse().expect("a method has its name");
    for line in text.lines().take(8) {
        let (name, word) = line.split_once([' ', '=']).unwrap_or((line, ""));
        let value = serde_json::from_str(word).unwrap_or_else(|_| Value::from(word));
        if let Some(set) = heard(method.clone().with([(name, value)])) {
            checked(&set);
            method = set;
        }
    }
    let text = text.trim_end_matches('\n');
    names(text);
}

/// The value that was found; `None` after an error that has words. It says again what a person typed, however
/// long that is.
fn heard<T>(found: cfreg::Result<T>) -> Option<T> {
    found.map_err(|error| assert!(!error.to_string().is_empty())).ok()
}

/// That a method's ranges can be checked, and that one that is in them comes back from JSON.
fn checked(method: &Method) {
    if heard(method.validate()).is_none() {
        return;
    }
    let text = serde_json::to_string(method).expect("settings are JSON");
    let back: Method =
        serde_json::from_str(&text).unwrap_or_else(|error| panic!("{text}: {error}"));
    assert_eq!(&back, method, "{text}");
}

/// That weights are weights.
fn kernel(composite: &Composite) {
    let Some(kernel) = heard(composite.resolve(Ok::<Bandwidth, _>)) else { return };
    let distances = [0.0, 1e-30, 1.0, 50.0, 1e6, f32::MAX];
    let mut filled = distances;
    kernel.fill(&mut filled);
    for (d2, filled) in distances.into_iter().zip(filled) {
        let weight = kernel.weight(d2);
        assert!(!weight.is_nan() && weight >= 0.0, "{composite:?} of {d2}: {weight}");
        assert_eq!(weight, filled, "{composite:?} of {d2}");
    }
}

fn names(text: &str) {
    named::<WeightScheme>(text);
    named::<Bandwidth>(text);
    named::<Normalization>(text);
    named::<Solver>(text);
    named::<ScaleEstimate>(text);
    named::<HistogramScale>(text);
    named::<ViewpointSource>(text);
    named::<Channel>(text);
    if let Some(method) = heard(text.parse::<Method>()) {
        assert!(Method::NAMES.contains(&text), "{text}");
        checked(&method);
    }
    heard(benchmark::parse_method(text));
    let channels = heard(Channels::default().with(text, vec![1.0]));
    assert_eq!(channels.is_some(), Channels::is_name(text), "{text:?}");
}

/// That what has a name has it again, once it was written.
fn named<T: FromStr<Err = cfreg::Error> + Display>(text: &str) {
    let Some(value) = heard(text.parse::<T>()) else { return };
    let written = value.to_string();
    let back: T = written.parse().unwrap_or_else(|error| panic!("{text:?}, {written:?}: {error}"));
    // By their names: NaN is not NaN.
    assert_eq!(back.to_string(), written, "{text:?}");
}
