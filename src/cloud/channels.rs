//! Named numbers of points: intensity, colours, whatever a sensor told beside the place.

use rustc_hash::FxHashMap;

use crate::error::{Error, Result};

/// The whole numbers that a colour is stored with in files.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ColorDepth {
    /// 0 to 255.
    Eight,
    /// 0 to 65535.
    Sixteen,
}

impl ColorDepth {
    /// The number that stands for 1.
    pub fn max(self) -> u16 {
        match self {
            ColorDepth::Eight => 255,
            ColorDepth::Sixteen => 65535,
        }
    }

    /// The whole number nearest to a value from 0 to 1; those beyond count as 0 or 1.
    ///
    /// ```
    /// # use cfreg::ColorDepth;
    /// assert_eq!([-0.5, 0.2, 2.0].map(|x| ColorDepth::Eight.level(x)), [0, 51, 255]);
    /// ```
    pub fn level(self, value: f32) -> u16 {
        (value.clamp(0.0, 1.0) * f32::from(self.max())).round() as u16
    }
}

/// Scalars by name, one f32 a point each, all finite, in any unit; colours as `red`, `green`
/// and `blue` in 0 to 1.
///
/// Names are compared without regard to case. A name is letters, digits, `_`, `-` and `.`, is
/// no number, and none of those that files have for positions, normals and weights.
///
/// A channel may be noted to be a colour ([`with_color`](Self::with_color)): its values are used
/// like any others, and files get whole numbers again. Selecting, moving and averaging points
/// keeps the note.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Channels {
    channels: Vec<NamedChannel>,
    /// Where each is among them, by its name in lower case.
    indices: FxHashMap<String, usize>,
    /// Names of those that a file had and that are left out, and the first row that is to blame.
    left_out: Vec<(String, usize)>,
}

#[derive(Debug, Clone, PartialEq)]
struct NamedChannel {
    name: String,
    values: Vec<f32>,
    color: Option<ColorDepth>,
}

impl Channels {
    /// Those that may be colours.
    pub(crate) const COLORS: [&str; 4] = ["red", "green", "blue", "alpha"];

    /// Names that mean something else in files.
    pub(crate) const RESERVED_NAMES: [&str; 10] =
        ["x", "y", "z", "nx", "ny", "nz", "normal_x", "normal_y", "normal_z", "weight"];

    /// Whether a channel may have this name.
    pub fn is_name(name: &str) -> bool {
        let fits = |c: char| c.is_alphanumeric() || matches!(c, '_' | '-' | '.');
        !name.is_empty()
            && name.chars().all(fits)
            && name.parse::<f64>().is_err()
            && !Self::RESERVED_NAMES.iter().any(|taken| taken.eq_ignore_ascii_case(name))
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

    /// The same with one more channel, last, that is a colour or an opacity, `red`, `green`,
    /// `blue` or `alpha`: values from 0 to 1 that PLY, PCD and text have as whole numbers, rounded
    /// where they are means.
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

    /// The whole numbers that files have for a channel that is a colour; `None` for plain numbers,
    /// and where there is no such channel.
    pub fn color_depth(&self, name: &str) -> Option<ColorDepth> {
        self.find(name)?.color
    }

    fn find(&self, name: &str) -> Option<&NamedChannel> {
        self.indices.get(&name.to_ascii_lowercase()).map(|&place| &self.channels[place])
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
        self.find(name).map(|own| own.values.as_slice())
    }

    /// Names and values, in order.
    pub fn iter(&self) -> impl ExactSizeIterator<Item = (&str, &[f32])> {
        self.channels.iter().map(|own| (own.name.as_str(), own.values.as_slice()))
    }

    /// The names, in order.
    pub fn names(&self) -> impl ExactSizeIterator<Item = &str> {
        self.channels.iter().map(|own| own.name.as_str())
    }

    /// Whether there is no channel.
    pub fn is_empty(&self) -> bool {
        self.channels.is_empty()
    }

    /// Every channel with other values, made of its own, as many of each. Not finite is not
    /// possible: values are means or parts of what was.
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

    /// Refuses channels that have not one value for each of `points`.
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
