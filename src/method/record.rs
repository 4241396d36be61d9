//! The record of how a pose was found.

use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use serde_json::Value;

/// Name and settings of a method, built-in or not: every [`Registration`](super::Registration) has
/// one.
///
/// ```
/// use cfreg::method::{Icp, MethodRecord};
/// let mine = MethodRecord::new("mine", &serde_json::json!({ "rounds": 3 }));
/// assert_eq!((mine.name.as_str(), &mine.settings["rounds"]), ("mine", &3.into()));
/// ```
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct MethodRecord {
    /// Name of the method, as accepted by `--method`.
    #[serde(rename = "method")]
    pub name: String,
    /// Every setting in force, by name, defaults filled in; the entry `method` names the family
    /// that the settings belong to.
    #[serde(rename = "config")]
    pub settings: Value,
}

impl MethodRecord {
    /// Returns the record of a method; `settings` is empty if it does not serialise to an object.
    ///
    /// Settings are any `serde::Serialize`: a struct that derives it (the crate `serde` with the
    /// feature `derive`), or `&()` for a method without settings.
    pub fn new(name: &str, settings: &impl Serialize) -> MethodRecord {
        MethodRecord::of_family(name, name, settings)
    }

    /// Returns the record of a method whose settings belong to the variant `family` of
    /// [`Method`](super::Method).
    pub(super) fn of_family(name: &str, family: &str, settings: &impl Serialize) -> MethodRecord {
        let mut settings = match serde_json::to_value(settings) {
            Ok(Value::Object(settings)) => settings,
            _ => serde_json::Map::new(),
        };
        settings.insert("method".into(), family.into());
        MethodRecord { name: name.into(), settings: settings.into() }
    }

    /// Records that the pose comes from so many given correspondences, if it does, as
    /// `given_correspondences`.
    pub(super) fn with_given_correspondences(mut self, count: Option<usize>) -> MethodRecord {
        if let (Some(count), Value::Object(settings)) = (count, &mut self.settings) {
            settings.insert("given_correspondences".into(), count.into());
        }
        self
    }

    /// Parses the settings as those of a built-in method ([`Method`](super::Method)) or of its
    /// configuration; `None` for other methods, and for weights that were a function.
    pub fn parse<T: DeserializeOwned>(&self) -> Option<T> {
        serde_json::from_value(self.settings.clone()).ok()
    }
}

#[cfg(test)]
mod tests {
    use super::super::{Consensus, Icp, Method};
    use super::*;

    #[test]
    fn settings_come_back_as_the_method() {
        let icp = Icp { max_distance: Some(0.1 + 0.2), ..Icp::default() };
        let record = MethodRecord::of_family("icp-paper", "icp", &icp);
        assert_eq!(record.parse::<Method>(), Some(Method::Icp(icp)));
        let text = serde_json::to_string(&record).unwrap();
        assert_eq!(serde_json::from_str::<MethodRecord>(&text).unwrap(), record);
        let consensus = Consensus { voxel: Some(1.0 / 3.0), ..Consensus::default() };
        let record = MethodRecord::new("consensus", &consensus);
        assert_eq!(record.parse::<Consensus>().unwrap(), consensus);
        assert_eq!(MethodRecord::new("mine", &[1, 2]).parse::<Method>(), None);
    }
}
