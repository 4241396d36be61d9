//! Entrants of the study: weight schemes of the grid and user-defined ones.

use cfreg::descriptor::HistogramScale;
use cfreg::error::Result;
use cfreg::method::{DescriptorScale, FeatureConfig};
use cfreg::moments::{FullConnection, Moments};
use cfreg::search::Neighborhood;
use cfreg::weight::{Bandwidth, Normalization, WeightScheme};

/// Descriptors of the points, and the moments of a full connection of descriptors: all choices that
/// CF leaves open. The closed form is the same for all.
///
/// User-defined schemes can take part:
///
/// ```
/// use cfreg::{experiment::study::Scheme, method::FeatureConfig, weight::Normalization};
/// let mine = Scheme::new("quartic", FeatureConfig::default(), |connection| {
///     let kernel = |d2: f32| 1.0 / (1.0 + d2 * d2 * 1e-4);
///     connection.moments(&kernel, Normalization::Both)
/// });
/// assert_eq!(mine.name, "quartic");
/// ```
pub struct Scheme {
    /// Name in tables; no two schemes may share a name.
    pub name: String,
    /// Settings of the descriptors.
    pub describe: FeatureConfig,
    /// Its place in the grid; `None` for user-defined schemes.
    pub(super) place: Option<Place>,
    weigh: Box<Weigh>,
}

type Weigh = dyn Fn(&FullConnection) -> Result<Moments> + Send + Sync;

impl Scheme {
    /// Creates a user-defined scheme.
    pub fn new(
        name: impl Into<String>,
        describe: FeatureConfig,
        weigh: impl Fn(&FullConnection) -> Result<Moments> + Send + Sync + 'static,
    ) -> Self {
        Scheme { name: name.into(), describe, place: None, weigh: Box::new(weigh) }
    }

    /// Creates the scheme at a place of the grid.
    pub(super) fn at(place: Place) -> Self {
        let Place { kernel, beta, normalize, .. } = place;
        let weigh = move |connection: &FullConnection| {
            connection.scheme_moments(kernel, connection.bandwidth(beta)?, normalize)
        };
        let describe = place.points.describe();
        Scheme { name: place.name(), describe, place: Some(place), weigh: Box::new(weigh) }
    }

    /// Computes the moments of its step.
    ///
    /// # Errors
    /// The errors of the scheme.
    pub fn moments(&self, connection: &FullConnection) -> Result<Moments> {
        (self.weigh)(connection)
    }
}

/// Settings of the descriptors, one of [`Points::ALL`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Points {
    /// Nearest points of the neighbourhoods whose descriptors are concatenated, each with the
    /// number for its normals; `None`: the same number.
    pub scales: &'static [(usize, Option<usize>)],
    /// Library whose FPFH is computed.
    pub histogram: HistogramScale,
}

impl Points {
    /// The settings of the grid, the paper's first.
    pub const ALL: [Points; 16] = {
        use HistogramScale::{Open3d, Pcl};
        const SAME: [(usize, Option<usize>); 3] =
            [(100, Some(10)), (200, Some(10)), (400, Some(10))];
        const OWN: [(usize, Option<usize>); 3] =
            [(100, Some(10)), (200, Some(50)), (400, Some(150))];
        [
            Points { scales: &[(150, None)], histogram: Pcl },
            Points { scales: &[(50, None)], histogram: Pcl },
            Points { scales: &[(100, None)], histogram: Pcl },
            Points { scales: &[(250, None)], histogram: Pcl },
            Points { scales: &[(50, None)], histogram: Open3d },
            Points { scales: &[(150, None)], histogram: Open3d },
            Points { scales: &[(50, Some(10))], histogram: Pcl },
            Points { scales: &[(100, Some(10))], histogram: Pcl },
            Points { scales: &[(150, Some(10))], histogram: Pcl },
            Points { scales: &[(250, Some(10))], histogram: Pcl },
            Points { scales: &[(150, Some(10))], histogram: Open3d },
            Points { scales: &SAME, histogram: Pcl },
            Points { scales: &SAME, histogram: Open3d },
            Points { scales: &OWN, histogram: Pcl },
            Points { scales: &OWN, histogram: Open3d },
            Points {
                scales: &[(200, Some(10)), (200, Some(50)), (200, Some(150))],
                histogram: Open3d,
            },
        ]
    };

    /// Returns them as a setting of the methods.
    pub fn describe(self) -> FeatureConfig {
        let nearest = Neighborhood::Nearest;
        let (k, normals) = self.scales[0];
        let scale = |&(k, normals): &(usize, Option<usize>)| DescriptorScale {
            neighborhood: nearest(k),
            normal_neighborhood: Some(nearest(normals.unwrap_or(k))),
        };
        FeatureConfig {
            neighborhood: nearest(k),
            normal_neighborhood: normals.map(nearest),
            more_scales: self.scales[1..].iter().map(scale).collect(),
            histogram: self.histogram,
            ..FeatureConfig::default()
        }
    }

    /// Returns a short name for tables: `100n10+200n50 open3d`.
    pub fn name(self) -> String {
        let scale = |&(k, normals): &(usize, Option<usize>)| {
            format!("{k}{}", normals.map_or(String::new(), |normals| format!("n{normals}")))
        };
        let scales: Vec<String> = self.scales.iter().map(scale).collect();
        let histogram = match self.histogram {
            HistogramScale::Pcl => "",
            HistogramScale::Open3d => " open3d",
        };
        format!("{}{histogram}", scales.join("+"))
    }
}

/// A place of the grid.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Place {
    /// Settings of the descriptors.
    pub points: Points,
    /// The kernel.
    pub kernel: WeightScheme,
    /// Its bandwidth.
    pub beta: Bandwidth,
    /// The normalisation.
    pub normalize: Normalization,
}

/// Bandwidths of the grid, on PCL's scale.
const BETAS: [Bandwidth; 4] = [
    Bandwidth::Fixed(25.0),
    Bandwidth::Fixed(100.0),
    Bandwidth::Fixed(400.0),
    Bandwidth::Auto(Bandwidth::DEFAULT_SHARE),
];

const NORMALIZATIONS: [Normalization; 5] = [
    Normalization::None,
    Normalization::Source,
    Normalization::Target,
    Normalization::Both,
    Normalization::Sinkhorn(3),
];

impl Place {
    /// The paper's scheme.
    pub const PAPER: Place = Place {
        points: Points::ALL[0],
        kernel: WeightScheme::Gaussian,
        beta: Bandwidth::Fixed(100.0),
        normalize: Normalization::None,
    };

    /// [`Cf::multiscale`](cfreg::method::Cf::multiscale): its error is within the interval of the
    /// best scheme of the study, and among these it is the one that is also good under noise.
    pub const BEST: Place = Place {
        points: Points::ALL[14],
        kernel: WeightScheme::Gaussian,
        beta: Bandwidth::Auto(Bandwidth::DEFAULT_SHARE),
        normalize: Normalization::Both,
    };

    /// From the paper's scheme to the best, one choice at a time.
    pub const STEPS: [Place; 6] = {
        let normalized = Place { normalize: Normalization::Both, ..Place::PAPER };
        let adapted = Place { beta: Place::BEST.beta, ..normalized };
        [
            Place::PAPER,
            normalized,
            adapted,
            Place { points: Points::ALL[8], ..adapted },
            Place { points: Points::ALL[10], ..adapted },
            Place::BEST,
        ]
    };

    /// The change at each of [`STEPS`](Self::STEPS), for curves.
    pub(super) const STEP_NAMES: [&str; 6] = [
        "CF, the paper's",
        "+ dual softmax",
        "+ automatic bandwidth",
        "+ normals of 10",
        "+ own histogram",
        "+ three scales: multiscale",
    ];

    /// Returns every place of the grid, or a few of them.
    pub fn grid(few: bool) -> Vec<Place> {
        // The uniform kernel has only one place: it has neither bandwidth nor descriptors.
        let uniform = WeightScheme::Uniform;
        let mut places = vec![Place { kernel: uniform, ..Place::PAPER }];
        let (points, kernels) = match few {
            true => ([0, 8, 10, 14].map(|at| Points::ALL[at]).to_vec(), 1),
            false => (Points::ALL.to_vec(), WeightScheme::ALL.len()),
        };
        let kernels = WeightScheme::ALL[..kernels].iter().filter(|&&kernel| kernel != uniform);
        for &points in &points {
            // Squared distances are about four times as large on Open3D's scale.
            let unit = points.histogram.default_beta() / HistogramScale::Pcl.default_beta();
            for &kernel in kernels.clone() {
                for beta in BETAS {
                    let beta = match beta {
                        Bandwidth::Fixed(beta) => Bandwidth::Fixed(unit * beta),
                        auto => auto,
                    };
                    let at = |normalize| Place { points, kernel, beta, normalize };
                    places.extend(NORMALIZATIONS.map(at));
                }
            }
        }
        places
    }

    /// Returns the name for tables: description, kernel, bandwidth, normalisation.
    pub fn name(&self) -> String {
        let Place { points, kernel, beta, normalize } = self;
        format!("{} | {kernel} | {beta} | {normalize}", points.name())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use cfreg::method::Cf;

    #[test]
    fn places_have_names_of_their_own_and_the_two_that_matter_are_there() {
        for few in [false, true] {
            let grid = Place::grid(few);
            let mut names: Vec<String> = grid.iter().map(Place::name).collect();
            names.sort();
            names.dedup();
            assert_eq!(names.len(), grid.len());
            assert!(Place::STEPS.iter().all(|step| grid.contains(step)));
        }
        assert_eq!(Place::BEST.name(), "100n10+200n50+400n150 open3d | gaussian | auto | both");
    }

    #[test]
    fn the_papers_place_and_the_best_are_methods() {
        for (place, cf) in [(Place::PAPER, Cf::default()), (Place::BEST, Cf::multiscale())] {
            assert_eq!(place.points.describe(), cf.features);
            assert_eq!(place.beta, cf.bandwidth());
            assert_eq!((place.kernel, place.normalize), (cf.weights, cf.normalization));
        }
    }
}
