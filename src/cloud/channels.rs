//! Named scalars of points: intensity, colours and other values that a sensor measured beside the
//! position.

use rustc_hash::FxHashMap;

use crate::error::{Error, Result};

/// Bit depth of the integers that files store for a colour.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ColorDepth {
    /// 0 to 255.
    Eight,
    /// 0 to 65535.
    Sixteen,
}

impl ColorDepth {
    /// The integer that represents 1.
    pub fn max(self) -> u16 {
        match self {
            ColorDepth::Eight => 255,
            ColorDepth::Sixteen => 65535,
        }
    }

    /// Returns the integer nearest to a value from 0 to 1; values beyond are clamped to 0 or 1.
    ///
    /// ```
    /// # use cfreg::ColorDepth;
    /// assert_eq!([-0.5, 0.2, 2.0].map(|x| ColorDepth::Eight.level(x)), [0, 51, 255]);
    /// ```
    pub fn level(self, value: f32) -> u16 {
        (value.clamp(0.0, 1.0) * f32::from(self.max())).round() as u16
    }
}

/// Scalar channels by name, one f32 a point each, all finite, in any unit; colours are `red`,
/// `green` and `blue` in 0 to 1.
///
/// Names are compared without regard to case. A name consists of letters, digits, `_`, `-` and `.`,
/// is no number, and is none of the names that files use for positions, normals and weights.
///
/// A channel may be marked as a colour ([`with_color`](Self::with_color)): its values are used like
/// any others, and files get integers again. Selecting, moving and averaging points keeps the mark.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Channels {
    channels: Vec<NamedChannel>,
    /// Index of each channel, by its name in lower case.
    indices: FxHashMap<String, usize>,
    /// Names of the channels of a file that are left out, and the first row that is the reason.
    left_out: Vec<(String, usize)>,
}

#[derive(Debug, Clone, PartialEq)]
struct NamedChannel {
    name: String,
    values: Vec<f32>,
    color: Option<ColorDepth>,
}

impl Channels {
    /// Names of the channels that may be colours.
    pub(crate) const COLORS: [&str; 4] = ["red", "green", "blue", "alpha"];

    /// Names that have another meaning in files.
    pub(crate) const RESERVED_NAMES: [&str; 10] =
        ["x", "y", "z", "nx", "ny", "nz", "normal_x", "normal_y", "normal_z", "weight"];

    /// Returns whether a channel may have this name.
    pub fn is_name(name: &str) -> bool {
        let fits = |c: char| c.is_alphanumeric() || matches!(c, '_' | '-' | '.');
        !name.is_empty()
            && name.chars().all(fits)
            && name.parse::<f64>().is_err()
            && !Self::RESERVED_NAMES.iter().any(|taken| taken.eq_ignore_ascii_case(name))
    }

    /// Appends one more channel.
    ///
    /// # Errors
    /// [`Error::Config`] for an invalid or duplicate name, [`Error::Shape`] unless the channel has
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
        if let Some(expected) = self.channels.first().map(|first| first.values.len())
            && expected != values.len()
        {
            let what = format!("values of the channel {name}");
            return Err(Error::Shape { what, expected, found: values.len() });
        }
        if let Some(index) = values.iter().position(|value| !value.is_finite()) {
            return Err(Error::NonFinite { what: format!("the channel {name}"), index });
        }
        self.indices.insert(name.to_ascii_lowercase(), self.channels.len());
        self.channels.push(NamedChannel { name: name.into(), values, color: None });
        Ok(self)
    }

    /// Appends one more channel that is a colour or an opacity, `red`, `green`, `blue` or `alpha`:
    /// values from 0 to 1 that PLY, PCD and text store as integers, rounded where they are means.
    ///
    /// # Errors
    /// As [`with`](Self::with), and [`Error::Config`] for another name.
    ///
    /// ```
    /// # use cfreg::{Channels, ColorDepth};
    /// let channels = Channels::default().with_color("red", vec![0.2, 1.0], ColorDepth::Eight)?;
    /// assert_eq!(channels.color_depth("red"), Some(ColorDepth::Eight));
    /// # Ok::<(), cfreg::Error>(())
    /// ```
    pub fn with_color(self, name: &str, values: Vec<f32>, depth: ColorDepth) -> Result<Self> {
        if !Self::COLORS.iter().any(|color| color.eq_ignore_ascii_case(name)) {
            let rule = format!("is no colour: those are {}", Self::COLORS.join(", "));
            return Err(Error::config("channels", name, rule));
        }
        let mut channels = self.with(name, values)?;
        if let Some(last) = channels.channels.last_mut() {
            last.color = Some(depth);
        }
        Ok(channels)
    }

    /// Returns the bit depth of the integers that files store for a colour channel; `None` for
    /// plain numbers and for a missing channel.
    pub fn color_depth(&self, name: &str) -> Option<ColorDepth> {
        self.find(name)?.color
    }

    fn find(&self, name: &str) -> Option<&NamedChannel> {
        self.indices.get(&name.to_ascii_lowercase()).map(|&place| &self.channels[place])
    }

    /// Records that a channel is left out, because its value in `row`, from 0, of a file is no
    /// number that f32 represents.
    pub(crate) fn without(mut self, name: &str, row: usize) -> Self {
        self.left_out.push((name.into(), row));
        self
    }

    /// Returns the first row, from 0, of the cloud's file whose value in the column of that name is
    /// NaN, infinite or missing: the reason why the channel is left out.
    pub fn left_out(&self, name: &str) -> Option<usize> {
        let named = self.left_out.iter().find(|(own, _)| own.eq_ignore_ascii_case(name));
        named.map(|(_, row)| *row)
    }

    /// Returns the values of a channel, one a point.
    pub fn get(&self, name: &str) -> Option<&[f32]> {
        self.find(name).map(|own| own.values.as_slice())
    }

    /// Returns names and values, in order.
    pub fn iter(&self) -> impl ExactSizeIterator<Item = (&str, &[f32])> {
        self.channels.iter().map(|own| (own.name.as_str(), own.values.as_slice()))
    }

    /// Returns the names, in order.
    pub fn names(&self) -> impl ExactSizeIterator<Item = &str> {
        self.channels.iter().map(|own| own.name.as_str())
    }

    /// Returns whether there is no channel.
    pub fn is_empty(&self) -> bool {
        self.channels.is_empty()
    }

    /// Replaces the values of every channel by values computed from them, as many for each channel.
    /// They are finite: means or selections of finite values.
    pub(crate) fn map(&self, values: impl Fn(&[f32]) -> Vec<f32>) -> Channels {
        let other = |own: &NamedChannel| NamedChannel {
            name: own.name.clone(),
            values: values(&own.values),
            color: own.color,
        };
        Channels {
            channels: self.channels.iter().map(other).collect(),
            indices: self.indices.clone(),
            left_out: self.left_out.clone(),
        }
    }

    /// Refuses channels that do not have one value for each of `points`.
    pub(super) fn check(&self, points: usize) -> Result<()> {
        match self.channels.first().filter(|own| own.values.len() != points) {
            None => Ok(()),
            Some(own) => Err(Error::Shape {
                what: format!("values of the channel {} for the points of a cloud", own.name),
                expected: points,
                found: own.values.len(),
            }),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colours_stay_colours() {
        let channels = Channels::default().with("glow", vec![0.5, 1.0]).unwrap();
        let channels = channels.with_color("Red", vec![0.2, 1.0], ColorDepth::Sixteen).unwrap();
        let halves = channels.map(|values| values.iter().map(|x| x / 2.0).collect());
        assert_eq!(halves.color_depth("red"), Some(ColorDepth::Sixteen));
        assert_eq!(halves.get("RED"), Some(&[0.1, 0.5][..]));
        assert_eq!(halves.color_depth("glow").or(halves.color_depth("blue")), None);
        assert!(channels.clone().with("rED", vec![0.0; 2]).is_err());
        let all = (0..=255).map(|k| ColorDepth::Eight.level(k as f32 / 255.0));
        assert!(all.eq(0..=255));
        let all = (0..=65535).map(|k| ColorDepth::Sixteen.level((f64::from(k) / 65535.0) as f32));
        assert!(all.eq(0..=65535));
    }

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
