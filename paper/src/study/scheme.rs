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
/// use cfreg::{method::FeatureConfig, weight::Normalization};
/// use cfreg_paper::study::Scheme;
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
    /// Where it stands in the grid; `None` for one's own.
    pub(super) place: Option<GridPoint>,
    weigh: Box<WeightFunction>,
}

type WeightFunction = dyn Fn(&FullConnection) -> Result<Moments> + Send + Sync;

impl Scheme {
    /// Creates a user-defined scheme.
    pub fn new(
        name: impl Into<String>,
        describe: FeatureConfig,
        weigh: impl Fn(&FullConnection) -> Result<Moments> + Send + Sync + 'static,
    ) -> Self {
        Scheme { name: name.into(), describe, place: None, weigh: Box::new(weigh) }
    }

    /// The scheme at a place of the grid.
    pub(super) fn from_grid(place: GridPoint) -> Self {
        let GridPoint { kernel, beta, normalize, .. } = place;
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

/// A way to describe points, one of [`DescriptorSetup::ALL`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DescriptorSetup {
    /// Nearest points of the neighbourhoods whose descriptors stand beside each other, each
    /// with those for its normals; `None`: as many.
    pub scales: &'static [(usize, Option<usize>)],
    /// Library whose FPFH is computed.
    pub histogram: HistogramScale,
}

impl DescriptorSetup {
    /// The ways of the grid, the paper's first.
    pub const ALL: [DescriptorSetup; 16] = {
        use HistogramScale::{Open3d, Pcl};
        const SAME: [(usize, Option<usize>); 3] =
            [(100, Some(10)), (200, Some(10)), (400, Some(10))];
        const OWN: [(usize, Option<usize>); 3] =
            [(100, Some(10)), (200, Some(50)), (400, Some(150))];
        [
            DescriptorSetup { scales: &[(150, None)], histogram: Pcl },
            DescriptorSetup { scales: &[(50, None)], histogram: Pcl },
            DescriptorSetup { scales: &[(100, None)], histogram: Pcl },
            DescriptorSetup { scales: &[(250, None)], histogram: Pcl },
            DescriptorSetup { scales: &[(50, None)], histogram: Open3d },
            DescriptorSetup { scales: &[(150, None)], histogram: Open3d },
            DescriptorSetup { scales: &[(50, Some(10))], histogram: Pcl },
            DescriptorSetup { scales: &[(100, Some(10))], histogram: Pcl },
            DescriptorSetup { scales: &[(150, Some(10))], histogram: Pcl },
            DescriptorSetup { scales: &[(250, Some(10))], histogram: Pcl },
            DescriptorSetup { scales: &[(150, Some(10))], histogram: Open3d },
            DescriptorSetup { scales: &SAME, histogram: Pcl },
            DescriptorSetup { scales: &SAME, histogram: Open3d },
            DescriptorSetup { scales: &OWN, histogram: Pcl },
            DescriptorSetup { scales: &OWN, histogram: Open3d },
            DescriptorSetup {
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
pub struct GridPoint {
    /// How points are described.
    pub points: DescriptorSetup,
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

impl GridPoint {
    /// The paper's.
    pub const PAPER: GridPoint = GridPoint {
        points: DescriptorSetup::ALL[0],
        kernel: WeightScheme::Gaussian,
        beta: Bandwidth::Fixed(100.0),
        normalize: Normalization::None,
    };

    /// [`Cf::multiscale`](cfreg::method::Cf::multiscale): within the interval of the first of
    /// the study, and the one of those that also holds under noise.
    pub const BEST: GridPoint = GridPoint {
        points: DescriptorSetup::ALL[14],
        kernel: WeightScheme::Gaussian,
        beta: Bandwidth::Auto(Bandwidth::DEFAULT_SHARE),
        normalize: Normalization::Both,
    };

    /// From the paper's to the best, one choice at a time.
    pub const STEPS: [GridPoint; 6] = {
        let normalized = GridPoint { normalize: Normalization::Both, ..GridPoint::PAPER };
        let adapted = GridPoint { beta: GridPoint::BEST.beta, ..normalized };
        [
            GridPoint::PAPER,
            normalized,
            adapted,
            GridPoint { points: DescriptorSetup::ALL[8], ..adapted },
            GridPoint { points: DescriptorSetup::ALL[10], ..adapted },
            GridPoint::BEST,
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

    /// Every place of the grid, or a few of it.
    pub fn grid(few: bool) -> Vec<GridPoint> {
        // The uniform kernel has but one place: it has neither bandwidth nor descriptors.
        let uniform = WeightScheme::Uniform;
        let mut places = vec![GridPoint { kernel: uniform, ..GridPoint::PAPER }];
        let (points, kernels) = match few {
            true => ([0, 8, 10, 14].map(|at| DescriptorSetup::ALL[at]).to_vec(), 1),
            false => (DescriptorSetup::ALL.to_vec(), WeightScheme::ALL.len()),
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
                    let at = |normalize| GridPoint { points, kernel, beta, normalize };
                    places.extend(NORMALIZATIONS.map(at));
                }
            }
        }
        places
    }

    /// Returns the name for tables: description, kernel, bandwidth, normalisation.
    pub fn name(&self) -> String {
        let GridPoint { points, kernel, beta, normalize } = self;
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
            let grid = GridPoint::grid(few);
            let mut names: Vec<String> = grid.iter().map(GridPoint::name).collect();
            names.sort();
            names.dedup();
            assert_eq!(names.len(), grid.len());
            assert!(GridPoint::STEPS.iter().all(|step| grid.contains(step)));
        }
        assert_eq!(GridPoint::BEST.name(), "100n10+200n50+400n150 open3d | gaussian | auto | both");
    }

    #[test]
    fn the_papers_place_and_the_best_are_methods() {
        for (place, cf) in [(GridPoint::PAPER, Cf::default()), (GridPoint::BEST, Cf::multiscale())]
        {
            assert_eq!(place.points.describe(), cf.features);
            assert_eq!(place.beta, cf.bandwidth());
            assert_eq!((place.kernel, place.normalize), (cf.weights, cf.normalization));
        }
    }
}
