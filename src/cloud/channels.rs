//! Named numbers of points: intensity, colours, whatever a sensor told beside the place.

use crate::error::{Error, Result};

/// Scalars by name, one f32 a point each, all finite, in any unit; colours as `red`, `green`
/// and `blue` in 0 to 1.
///
/// Names are compared without regard to case. A name is letters, digits, `_`, `-` and `.`, is
/// no number, and none of those that files have for positions, normals and weights.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Channels(Vec<(String, Vec<f32>)>);

/// Names that mean something else in files.
const TAKEN: [&str; 10] =
    ["x", "y", "z", "nx", "ny", "nz", "normal_x", "normal_y", "normal_z", "weight"];

impl Channels {
    /// Whether a channel may have this name.
    pub fn is_name(name: &str) -> bool {
        let fits = |c: char| c.is_alphanumeric() || matches!(c, '_' | '-' | '.');
        !name.is_empty()
            && name.chars().all(fits)
            && name.parse::<f64>().is_err()
            && !TAKEN.iter().any(|taken| taken.eq_ignore_ascii_case(name))
    }

    /// The same with one more channel, last.
    ///
    /// # Errors
    /// [`Error::Config`] for what is no name or is there already, [`Error::Shape`] unless it has
    /// as many values as the others, [`Error::NonFinite`] with the first NaN or infinity.
    ///
    /// ```
    /// let channels = cfreg::Channels::default().with("intensity", vec![0.2, 0.7])?;
    /// assert_eq!(channels.get("Intensity"), Some(&[0.2, 0.7][..]));
    /// # Ok::<(), cfreg::Error>(())
    /// ```
    pub fn with(mut self, name: &str, values: Vec<f32>) -> Result<Self> {
        if !Self::is_name(name) {
            let rule = "is no name of a channel: letters, digits, _, - and ., no number, and none \
                        of those for positions, normals and weights";
            return Err(Error::config("channels", name, rule));
        }
        if self.get(name).is_some() {
            return Err(Error::config("channels", name, "is there twice"));
        }
        if let Some(expected) = self.0.first().map(|(_, first)| first.len())
            && expected != values.len()
        {
            let what = format!("values of the channel {name}");
            return Err(Error::Shape { what, expected, found: values.len() });
        }
        if let Some(index) = values.iter().position(|value| !value.is_finite()) {
            return Err(Error::NonFinite { what: format!("the channel {name}"), index });
        }
        self.0.push((name.into(), values));
        Ok(self)
    }

    /// The values of a channel, one a point.
    pub fn get(&self, name: &str) -> Option<&[f32]> {
        let named = self.0.iter().find(|(own, _)| own.eq_ignore_ascii_case(name));
        named.map(|(_, values)| values.as_slice())
    }

    /// Names and values, in order.
    pub fn iter(&self) -> impl ExactSizeIterator<Item = (&str, &[f32])> {
        self.0.iter().map(|(name, values)| (name.as_str(), values.as_slice()))
    }

    /// The names, in order.
    pub fn names(&self) -> impl ExactSizeIterator<Item = &str> {
        self.0.iter().map(|(name, _)| name.as_str())
    }

    /// Whether there is no channel.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// Every channel with other values, made of its own, as many of each. Not finite is not
    /// possible: values are means or parts of what was.
    pub(crate) fn map(&self, values: impl Fn(&[f32]) -> Vec<f32>) -> Channels {
        Channels(self.0.iter().map(|(name, own)| (name.clone(), values(own))).collect())
    }

    /// Refuses channels that have not one value for each of `points`.
    pub(super) fn check(&self, points: usize) -> Result<()> {
        match self.0.first().filter(|(_, values)| values.len() != points) {
            None => Ok(()),
            Some((name, values)) => Err(Error::Shape {
                what: format!("values of the channel {name} for the points of a cloud"),
                expected: points,
                found: values.len(),
            }),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_and_lengths_are_checked() {
        let one = Channels::default().with("intensity", vec![0.1, 0.2]).unwrap();
        for bad in ["", "a b", "a,b", "a:b", "nan", "1e3", "X", "normal_y", "Weight", "#red"] {
            let found = one.clone().with(bad, vec![0.0; 2]);
            assert!(matches!(found, Err(Error::Config { field: "channels", .. })), "{bad}");
        }
        assert!(one.clone().with("INTENSITY", vec![0.0; 2]).is_err());
        assert!(matches!(one.clone().with("red", vec![0.0]), Err(Error::Shape { .. })));
        let nan = one.clone().with("red", vec![0.0, f32::NAN]);
        assert!(matches!(nan, Err(Error::NonFinite { index: 1, .. })));
        let two = one.with("red", vec![0.5, 1.0]).unwrap();
        assert_eq!(two.names().collect::<Vec<_>>(), ["intensity", "red"]);
        assert!(two.check(2).is_ok() && two.check(3).is_err());
    }
}
