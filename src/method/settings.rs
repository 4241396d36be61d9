//! Settings by name: how flags, keywords and files set the fields of a configuration.

use serde_json::{Map, Value, json};

use super::Method;
use crate::error::{Error, Result};

impl Method {
    /// Returns the method with some of its settings replaced, each given by its name in the
    /// configuration's JSON (`config` of a registration) and a JSON value.
    ///
    /// Some have a short form: `channels` as `["intensity:0.5", "red"]`, `neighbors` and `radius`
    /// for `neighborhood`, `normal_neighbors` for `normal_neighborhood`, `more_neighbors` for
    /// `more_scales` (`[200, 400]`, or `["200:50", "400:150"]` with as many for normals),
    /// `normalize` for `normalization`, `detector` for the name of a keypoint detector in
    /// `keypoints`, `viewpoint` for an `orientation` towards a position.
    ///
    /// # Errors
    /// [`Error::Setting`] for a name that the method does not have, with the names it has, and for
    /// a value of the wrong type. Ranges are checked when the method runs.
    ///
    /// ```
    /// let method: cfreg::method::Method = "cf".parse()?;
    /// let method = method.with([("beta", 50.into()), ("neighbors", 80.into())])?;
    /// assert!(method.with([("sigma", 1.into())]).is_err());
    /// # Ok::<(), cfreg::Error>(())
    /// ```
    pub fn with<'a>(self, settings: impl IntoIterator<Item = (&'a str, Value)>) -> Result<Self> {
        let mut method = self;
        for (name, value) in settings {
            // One at a time, so that an error names its setting.
            method = method.with_setting(name, value)?;
        }
        Ok(method)
    }

    fn with_setting(&self, name: &str, value: Value) -> Result<Self> {
        let shown = value.to_string();
        let bad = |rule: String| {
            // Errors of parsed words already contain the name and the value: strip both.
            let said = format!("{name} = {}: ", shown.trim_matches('"'));
            let rule = rule.strip_prefix(&said).unwrap_or(&rule).to_string();
            Error::Setting { name: name.into(), value: shown.clone(), rule }
        };
        let (field, value) = expand_shorthand(name, value)?;
        let mut config = match serde_json::to_value(self) {
            Ok(Value::Object(config)) => config,
            _ => return Err(bad("the method has no settings".into())),
        };
        if field == "method" || !(config.contains_key(field) || self.has_unset(field)) {
            let rule =
                format!("{} has no such setting; it has {}", self.name(), setting_names(&config));
            return Err(bad(rule));
        }
        config.insert(field.into(), value);
        serde_json::from_value(Value::Object(config))
            .map_err(|error| bad(setting_error_text(error)))
    }
}

impl Method {
    /// Whether the method has this setting, which its JSON names only where it is set.
    fn has_unset(&self, field: &str) -> bool {
        match self {
            Method::Consensus(_) => matches!(field, "model" | "given_descriptors"),
            Method::Cf(_) | Method::CfSpectral(_) | Method::Cfk(_) | Method::Teaser(_) => {
                field == "given_descriptors"
            }
            Method::Icp(_) | Method::Kc(_) | Method::Cpd(_) | Method::Dare(_) => false,
        }
    }
}

fn expand_shorthand(name: &str, value: Value) -> Result<(&str, Value)> {
    Ok(match name {
        "neighbors" => ("neighborhood", json!({ "nearest": value })),
        "radius" => ("neighborhood", json!({ "radius": value })),
        "normal_neighbors" => ("normal_neighborhood", json!({ "nearest": value })),
        "more_neighbors" => match value {
            Value::Array(counts) => ("more_scales", counts.into_iter().map(parse_scale).collect()),
            value => ("more_scales", json!([parse_scale(value)])),
        },
        "channels" => match value {
            Value::Array(all) => {
                ("channels", all.into_iter().map(parse_channel).collect::<Result<_>>()?)
            }
            value => ("channels", json!([parse_channel(value)?])),
        },
        "detector" => match value {
            Value::String(name) => ("keypoints", json!({ name: {} })),
            value => ("keypoints", value),
        },
        "normalize" => ("normalization", value),
        "viewpoint" => ("orientation", json!({ "towards": value })),
        _ => (name, value),
    })
}

/// Parses `200`, or `"200:50"`: nearest points for descriptors, and for normals.
fn parse_scale(value: Value) -> Value {
    let nearest = |count: &str| match count.trim().parse::<u64>() {
        Ok(count) => json!({ "nearest": count }),
        Err(_) => json!({ "nearest": count }),
    };
    match value.as_str().map(|text| (text.split_once(':'), text)) {
        Some((None, count)) => json!({ "neighborhood": nearest(count) }),
        Some((Some((count, normals)), _)) => json!({
            "neighborhood": nearest(count), "normal_neighborhood": nearest(normals)
        }),
        None => json!({ "neighborhood": { "nearest": value } }),
    }
}

/// Parses `"intensity"`, or `"intensity:0.5"`: a channel, and its share.
fn parse_channel(value: Value) -> Result<Value> {
    let Some(text) = value.as_str() else { return Ok(value) };
    let parsed = text.parse::<super::Channel>();
    // Validated here, as JSON would turn NaN into null.
    match parsed.and_then(|channel| channel.validate().map(|()| channel)) {
        Ok(channel) => Ok(json!(channel)),
        Err(Error::Config { field, rule, .. }) => {
            Err(Error::Setting { name: field.into(), value: value.to_string(), rule })
        }
        Err(error) => Err(error),
    }
}

/// Returns serde's message about a value, without Rust's names of number types.
fn setting_error_text(error: serde_json::Error) -> String {
    let said = error.to_string();
    ["usize", "u32", "u64"]
        .iter()
        .fold(said, |said, kind| {
            said.replace(&format!("expected {kind}"), "expected a whole number")
        })
        .replace("expected f64", "expected a number")
}

fn setting_names(config: &Map<String, Value>) -> String {
    let names: Vec<&str> =
        config.keys().map(String::as_str).filter(|&name| name != "method").collect();
    names.join(", ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn settings_reach_their_fields() {
        let method: Method = "cf".parse().unwrap();
        let set = |name, value| method.clone().with([(name, value)]);
        let Method::Cf(cf) = set("neighbors", 20.into()).unwrap() else { panic!() };
        assert_eq!(cf.features.neighborhood, crate::search::Neighborhood::Nearest(20));
        let value = json!([200, "300", "400:150"]);
        let Method::Cf(cf) = set("more_neighbors", value).unwrap() else { panic!() };
        let nearest = crate::search::Neighborhood::Nearest;
        let scale = |k, normals: Option<usize>| crate::method::DescriptorScale {
            neighborhood: nearest(k),
            normal_neighborhood: normals.map(nearest),
        };
        let more = [scale(200, None), scale(300, None), scale(400, Some(150))];
        assert_eq!(cf.features.more_scales, more);
        let Method::Cf(cf) = set("channels", json!(["intensity:0.5", "red"])).unwrap() else {
            panic!()
        };
        let channel = |name: &str, share| crate::method::Channel { name: name.into(), share };
        assert_eq!(cf.features.channels, [channel("intensity", 0.5), channel("red", 1.0)]);
        let Method::Cf(cf) = set("beta", "auto".into()).unwrap() else { panic!() };
        assert_eq!(cf.beta, Some(crate::weight::Bandwidth::Auto(0.25)));
        let Method::Cf(cf) = set("normalize", "sinkhorn:3".into()).unwrap() else { panic!() };
        assert_eq!(cf.normalization, crate::weight::Normalization::Sinkhorn(3));
        let Method::Cf(cf) = set("viewpoint", json!([1, 2, 3])).unwrap() else { panic!() };
        assert_eq!(cf.features.orientation, crate::normals::Orientation::Towards([1.0, 2.0, 3.0]));
    }

    #[test]
    fn unknown_names_and_wrong_kinds_are_named() {
        let method: Method = "cf".parse().unwrap();
        let message = |name, value| method.clone().with([(name, value)]).unwrap_err().to_string();
        assert!(message("bta", 1.into()).contains("beta"), "{}", message("bta", 1.into()));
        assert!(message("beta", "x".into()).starts_with("beta = \"x\": "));
        assert!(message("weights", "x".into()).starts_with("weights = \"x\": must be one of"));
        assert!(message("method", "icp".into()).contains("no such setting"));
        for wrong in [json!("x"), json!([1.5]), json!("20:x"), json!("20:"), json!({})] {
            let message = message("more_neighbors", wrong);
            assert!(message.starts_with("more_neighbors = "), "{message}");
        }
        let said = message("channels", json!(["i:nan"]));
        assert!(said.ends_with("a share must be a finite number above 0, at most 1000"), "{said}");
        for wrong in
            [json!("red:x"), json!([1]), json!(":1"), json!({ "name": "red", "share": "x" })]
        {
            let message = message("channels", wrong);
            assert!(message.starts_with("channels = "), "{message}");
        }
        // Among several, the error names the wrong one, once.
        for several in [json!("x:abc"), json!(["red", "x:abc"])] {
            let rule = "channels = \"x:abc\": must be NAME or NAME:SHARE";
            assert_eq!(message("channels", several), rule);
        }
        assert!(message("neighbors", (-1).into()).starts_with("neighbors = -1: "));
    }
}
