//! Named numbers of points: intensity, colours, whatever a sensor told beside the place.

use crate::error::{Error, Result};

/// Scalars by name, one f32 a point each, all finite, in any unit; colours as `red`, `green`
/// and `blue` in 0 to 1.
///
/// Names are compared without regard to case. A name is letters, digits, `_`, `-` and `.`, is
/// no number, and none of those that files have for positions, normals and weights.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Channels {
    own: Vec<(String, Vec<f32>)>,
    /// Names of those that a file had and that are left out, and the first row that is to blame.
    left_out: Vec<(String, usize)>,
}

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
        if let Some(expected) = self.own.first().map(|(_, first)| first.len())
            && expected != values.len()
        {
            let what = format!("values of the channel {name}");
            return Err(Error::Shape { what, expected, found: values.len() });
        }
        if let Some(index) = values.iter().position(|value| !value.is_finite()) {
            return Err(Error::NonFinite { what: format!("the channel {name}"), index });
        }
        self.own.push((name.into(), values));
        Ok(self)
    }

    /// The same, with the name of a channel that is left out as its value in `row`, from 0, of a
    /// file is no number that f32 holds.
    pub(crate) fn without(mut self, name: &str, row: usize) -> Self {
        self.left_out.push((name.into(), row));
        self
    }

    /// The first row, from 0, of the file that the cloud was read from, whose value in the column
    /// of that name is NaN, infinite or none: the reason why there is no such channel.
    pub fn left_out(&self, name: &str) -> Option<usize> {
        let named = self.left_out.iter().find(|(own, _)| own.eq_ignore_ascii_case(name));
        named.map(|(_, row)| *row)
    }

    /// The values of a channel, one a point.
    pub fn get(&self, name: &str) -> Option<&[f32]> {
        let named = self.own.iter().find(|(own, _)| own.eq_ignore_ascii_case(name));
        named.map(|(_, values)| values.as_slice())
    }

    /// Names and values, in order.
    pub fn iter(&self) -> impl ExactSizeIterator<Item = (&str, &[f32])> {
        self.own.iter().map(|(name, values)| (name.as_str(), values.as_slice()))
    }

    /// The names, in order.
    pub fn names(&self) -> impl ExactSizeIterator<Item = &str> {
        self.own.iter().map(|(name, _)| name.as_str())
    }

    /// Whether there is no channel.
    pub fn is_empty(&self) -> bool {
        self.own.is_empty()
    }

    /// Every channel with other values, made of its own, as many of each. Not finite is not
    /// possible: values are means or parts of what was.
    pub(crate) fn map(&self, values: impl Fn(&[f32]) -> Vec<f32>) -> Channels {
        let own = self.own.iter().map(|(name, own)| (name.clone(), values(own))).collect();
        Channels { own, left_out: self.left_out.clone() }
    }

    /// Refuses channels that have not one value for each of `points`.
    pub(super) fn check(&self, points: usize) -> Result<()> {
        match self.own.first().filter(|(_, values)| values.len() != points) {
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
