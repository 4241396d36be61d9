//! Conditions that make a registration hard, one at a time.

use std::fmt;
use std::path::Path;

use serde::Serialize;

use crate::Views;
use crate::experiments::cell::{Interpretation, Shape};
use crate::experiments::models;
use crate::protocol::{Draw, NormalViewpoint, Protocol, Trial};
use crate::{Model, Motion};
use cfreg::cloud::Mesh;
use cfreg::error::{Error, Result};

/// A condition of the study. Motions are the paper's large ones; sensors move along.
#[derive(Debug, Clone, Copy, PartialEq, PartialOrd, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Condition {
    /// Two independent samples of one surface (the paper's accuracy test).
    Independent,
    /// The same points twice, one with noise of this standard deviation, metres (its
    /// sensitivity test).
    Noise(f64),
    /// The same points twice, one cloud with this many additional points per point, uniformly from
    /// a ball of radius 0.1 m (its robustness test).
    Outliers(f64),
    /// Independent samples of the parts of a whole object that two sensors see; they have this
    /// share of the source's view in common.
    Overlap(f64),
}

impl Condition {
    /// All conditions of the study, including the paper's own.
    pub const ALL: [Condition; 12] = [
        Condition::Independent,
        Condition::Noise(0.005),
        Condition::Noise(0.01),
        Condition::Noise(0.02),
        Condition::Outliers(0.2),
        Condition::Outliers(0.5),
        Condition::Outliers(1.0),
        Condition::Overlap(1.0),
        Condition::Overlap(0.8),
        Condition::Overlap(0.65),
        Condition::Overlap(0.5),
        Condition::Overlap(0.3),
    ];

    /// Returns a word for the kind, and its amount.
    pub fn kind(self) -> (&'static str, f64) {
        match self {
            Condition::Independent => ("independent", 0.0),
            Condition::Noise(sigma) => ("noise", sigma),
            Condition::Outliers(share) => ("outliers", share),
            Condition::Overlap(share) => ("overlap", share),
        }
    }

    /// Returns a part for names of files.
    pub fn stem(self) -> String {
        match self {
            Condition::Independent => "independent".into(),
            Condition::Noise(sigma) => format!("noise-{:03.0}", 1e4 * sigma),
            Condition::Outliers(share) => format!("outliers-{:03.0}", 100.0 * share),
            Condition::Overlap(share) => format!("overlap-{:03.0}", 100.0 * share),
        }
    }
}

impl fmt::Display for Condition {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Condition::Independent => f.write_str("independent samples"),
            Condition::Noise(sigma) => write!(f, "noise {} mm", 1e3 * sigma),
            Condition::Outliers(share) => write!(f, "outliers {:.0} %", 100.0 * share),
            Condition::Overlap(share) => write!(f, "overlap {:.0} %", 100.0 * share),
        }
    }
}

/// Models that trials are sampled from: the scans of the paper, and whole objects to view.
pub struct Scenes {
    scans: Vec<(Shape, Model)>,
    views: Vec<(Shape, Views)>,
    digests: [String; 2],
}

impl Scenes {
    /// Creates scenes from scans and whole surfaces.
    ///
    /// # Errors
    /// [`Error::Config`] for no scan; the errors of [`Views::new`].
    pub fn new(scans: Vec<(Shape, Model)>, objects: Vec<(Shape, Mesh)>) -> Result<Self> {
        if scans.is_empty() {
            return Err(Error::config("scans", "[]", "a study needs at least one"));
        }
        let scanned: Vec<String> = scans.iter().map(|(_, model)| model.digest()).collect();
        let (mut views, mut whole) = (Vec::new(), Vec::new());
        for (shape, mesh) in objects {
            whole.push(Model::from(mesh.clone()).digest());
            views.push((shape, Views::new(mesh)?));
        }
        Ok(Scenes { scans, views, digests: [scanned.join(" "), whole.join(" ")] })
    }

    /// Loads the paper's scans and the whole objects in `folder` ([`models::load`],
    /// [`models::object`]), and returns a line for each missing one.
    ///
    /// # Errors
    /// [`Error::Io`] if there is no scan; the errors of [`new`](Self::new) and of the readers.
    pub fn load(folder: &Path) -> Result<(Self, Vec<String>)> {
        let (mut scans, mut objects, mut left_out) = (Vec::new(), Vec::new(), Vec::new());
        let mut last = None;
        for shape in Shape::ALL {
            match models::load(folder, shape, Interpretation::Fitting) {
                Ok(source) => scans.push((shape, source.model)),
                Err(error) if models::is_missing(&error) => {
                    left_out.push(models::missing_model_note(shape, &error));
                    last = Some(error);
                }
                Err(error) => return Err(error),
            }
            match models::object(folder, shape)? {
                Some(mesh) => objects.push((shape, mesh)),
                None => {
                    left_out.push(format!("{shape} left out of partial overlap: no whole surface"));
                }
            }
        }
        match last.filter(|_| scans.is_empty()) {
            Some(error) => Err(error),
            None => Ok((Scenes::new(scans, objects)?, left_out)),
        }
    }

    /// Whether there is anything to make such trials of.
    pub fn supports(&self, condition: Condition) -> bool {
        !matches!(condition, Condition::Overlap(_)) || !self.views.is_empty()
    }

    /// Returns the digests of the models that trials of `condition` are sampled from.
    pub(super) fn digest(&self, condition: Condition) -> &str {
        &self.digests[usize::from(matches!(condition, Condition::Overlap(_)))]
    }

    /// Trial `number` of `condition`, and of which shape it is: they take turns. `None` where
    /// [`have`](Self::supports) says so.
    ///
    /// # Errors
    /// The errors of [`Protocol::trial`] and [`Views::trial`].
    pub fn trial(
        &self,
        condition: Condition,
        points: usize,
        seed: u64,
        number: u64,
    ) -> Result<Option<(Shape, Trial)>> {
        let protocol = match condition {
            Condition::Independent => Protocol::Accuracy,
            Condition::Noise(sigma) => Protocol::Sensitivity { sigma },
            Condition::Outliers(share) => Protocol::Robustness {
                outliers: (share * points as f64).round() as usize,
                radius: 0.1,
            },
            Condition::Overlap(share) => {
                let Some((shape, views)) = cyclic_item(&self.views, number) else {
                    return Ok(None);
                };
                let (trial, _) = views.trial(share, points, seed, number)?;
                return Ok(Some((*shape, trial)));
            }
        };
        let Some((shape, model)) = cyclic_item(&self.scans, number) else { return Ok(None) };
        let (motion, viewpoint) = (Motion::Large, NormalViewpoint::Along);
        let trial = protocol.trial(model, Draw { motion, viewpoint, points, seed, number })?;
        Ok(Some((*shape, trial)))
    }
}

fn cyclic_item<T>(items: &[T], number: u64) -> Option<&T> {
    items.get((number % items.len().max(1) as u64) as usize)
}
