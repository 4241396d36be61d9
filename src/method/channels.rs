//! Channels beside FPFH: points are similar if their channels are similar, too.

use std::str::FromStr;

use serde::{Deserialize, Serialize};

use crate::cloud::{Descriptors, PointCloud};
use crate::error::{Error, Result};

/// A channel by which points are compared, and its relative influence.
///
/// As text `NAME` or `NAME:SHARE`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Channel {
    /// Its name in both clouds.
    pub name: String,
    /// Influence relative to the whole FPFH, above 0 to 1000; default 1, equal influence.
    #[serde(default = "one")]
    pub share: f64,
}

fn one() -> f64 {
    1.0
}

impl Channel {
    /// Checks the range.
    ///
    /// # Errors
    /// [`Error::Config`] for a share out of range.
    pub fn validate(&self) -> Result<()> {
        if self.share > 0.0 && self.share <= 1000.0 {
            return Ok(());
        }
        let rule = "a share must be a finite number above 0, at most 1000";
        Err(Error::config("channels", self, rule))
    }
}

impl std::fmt::Display for Channel {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}:{}", self.name, self.share)
    }
}

impl FromStr for Channel {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self> {
        let (name, share) = match text.split_once(':') {
            Some((name, share)) => (name, share.trim().parse().ok()),
            None => (text, Some(one())),
        };
        let name = name.trim().to_string();
        match share {
            Some(share) if !name.is_empty() => Ok(Channel { name, share }),
            _ => Err(Error::config("channels", text, "must be NAME or NAME:SHARE")),
        }
    }
}

/// Returns the values of `channels` in `cloud`, called `name` in errors.
pub(super) fn channel_values<'a>(
    channels: &[Channel],
    cloud: &'a PointCloud,
    name: &str,
) -> Result<Vec<&'a [f32]>> {
    let values = |channel: &Channel| {
        cloud.channels().get(&channel.name).ok_or_else(|| {
            if let Some(row) = cloud.channels().left_out(&channel.name) {
                let rule = format!(
                    "{name} has a value in this channel that is no finite number, the first at \
                     point {row} of its file, counted from 0: put a number there, or remove that \
                     point"
                );
                return Error::config("channels", &channel.name, rule);
            }
            let there: Vec<&str> = cloud.channels().names().collect();
            let there = match there.is_empty() {
                true => "none".to_string(),
                false => there.join(", "),
            };
            let rule = format!("{name} has no such channel; it has {there}");
            Error::config("channels", &channel.name, rule)
        })
    };
    channels.iter().map(values).collect()
}

/// The values by which points of a cloud are compared.
#[derive(Clone, Copy)]
pub(super) struct DescriptorsWithChannels<'a> {
    pub(super) descriptors: &'a Descriptors,
    /// Descriptors that the cloud carries, to stand beside.
    pub(super) beside: Option<&'a Descriptors>,
    /// Values at the points, channel by channel.
    pub(super) channels: &'a [Vec<f32>],
}

impl DescriptorsWithChannels<'_> {
    fn channel(&self, c: usize) -> impl Iterator<Item = f64> + '_ {
        self.channels[c].iter().map(|&x| f64::from(x))
    }
}

/// Mean over both sides, and root mean square deviation from it; the same bits in either order.
fn mean_and_std<'a, V: Iterator<Item = f64> + 'a>(
    sides: &'a [DescriptorsWithChannels<'a>; 2],
    values: impl Fn(&'a DescriptorsWithChannels<'a>) -> V,
) -> (f64, f64) {
    let [a, b] = sides;
    let n = (a.descriptors.len() + b.descriptors.len()) as f64;
    let mean = (values(a).sum::<f64>() + values(b).sum::<f64>()) / n;
    let squares = |side| values(side).map(|x| (x - mean).powi(2)).sum::<f64>();
    (mean, ((squares(a) + squares(b)) / n).sqrt())
}

/// Root mean square distance of all rows of both sides of a table from their common mean.
fn root_mean_square_spread<'a>(
    sides: &'a [DescriptorsWithChannels<'a>; 2],
    table: impl Fn(&'a DescriptorsWithChannels<'a>) -> &'a Descriptors + Copy,
) -> f64 {
    let dims = table(&sides[0]).dim().min(table(&sides[1]).dim());
    let columns = (0..dims).map(|d| {
        mean_and_std(sides, move |side| table(side).rows().map(move |row| f64::from(row[d])))
    });
    columns.map(|(_, spread)| spread * spread).sum::<f64>().sqrt()
}

/// Appends to the descriptors of both clouds the scaled descriptors that the clouds carry, where
/// they stand beside, and the scaled channels, see [`FeatureConfig::concatenate_channels`]. The
/// spread of the descriptors counts as at least `min_spread`.
///
/// # Errors
/// Those of [`Descriptors::new`].
pub(super) fn concatenate_scaled_channels(
    channels: &[Channel],
    min_spread: f64,
    sides: [DescriptorsWithChannels<'_>; 2],
) -> Result<[Descriptors; 2]> {
    let whole = root_mean_square_spread(&sides, |side| side.descriptors).max(min_spread);
    // Without any spread the channels alone decide.
    let whole = if whole > 0.0 { whole } else { 1.0 };
    let beside = root_mean_square_spread(&sides, |side| side.beside.unwrap_or(side.descriptors));
    let beside = if beside > 0.0 { whole / beside } else { 0.0 };
    let scales: Vec<(f64, f64)> = (0..channels.len())
        .map(|c| {
            let (mean, spread) = mean_and_std(&sides, move |side| side.channel(c));
            // Rounding errors alone are no variation.
            let same = spread <= 1e-6 * mean.abs();
            (mean, if same { 0.0 } else { channels[c].share * whole / spread })
        })
        .collect();
    let joined = |side: &DescriptorsWithChannels<'_>| {
        let values = (0..side.descriptors.len()).flat_map(|i| {
            let channels = side.channels.iter().zip(&scales);
            let scaled =
                channels.map(move |(values, (mean, scale))| (f64::from(values[i]) - mean) * scale);
            let given = side.beside.map_or(&[][..], |rows| rows.row(i));
            let given = given.iter().map(|&x| (f64::from(x) * beside) as f32);
            side.descriptors.row(i).iter().copied().chain(given).chain(scaled.map(|x| x as f32))
        });
        let given = side.beside.map_or(0, Descriptors::dim);
        Descriptors::new(side.descriptors.dim() + given + scales.len(), values.collect())
    };
    Ok([joined(&sides[0])?, joined(&sides[1])?])
}
