//! What takes part in the study: weight schemes, those of the grid and anybody's.

use serde::Serialize;

use crate::descriptor::HistogramScale;
use crate::error::Result;
use crate::method::Describe;
use crate::moments::{FullConnection, Moments};
use crate::search::Neighborhood;
use crate::weight::{Bandwidth, Normalization, WeightScheme};

/// How points are described, and the moments that a full connection of descriptors comes
/// to: all that CF leaves open. The closed form is the same for all.
///
/// Any scheme of one's own takes part:
///
/// ```
/// use cfreg::{experiment::study::Scheme, method::Describe, weight::Normalization};
/// let mine = Scheme::new("quartic", Describe::default(), |connection| {
///     let kernel = |d2: f32| 1.0 / (1.0 + d2 * d2 * 1e-4);
///     connection.moments(&kernel, Normalization::Both)
/// });
/// assert_eq!(mine.name, "quartic");
/// ```
pub struct Scheme {
    /// What tables call it; no two may share a name.
    pub name: String,
    /// How points are described.
    pub describe: Describe,
    /// Where it stands in the grid; `None` for one's own.
    pub(super) place: Option<Place>,
    weigh: Box<Weigh>,
}

type Weigh = dyn Fn(&FullConnection) -> Result<Moments> + Send + Sync;

impl Scheme {
    /// A scheme of one's own.
    pub fn new(
        name: impl Into<String>,
        describe: Describe,
        weigh: impl Fn(&FullConnection) -> Result<Moments> + Send + Sync + 'static,
    ) -> Self {
        Scheme { name: name.into(), describe, place: None, weigh: Box::new(weigh) }
    }

    /// The scheme at a place of the grid.
    pub(super) fn at(place: Place) -> Self {
        let Place { kernel, beta, normalize, .. } = place;
        let weigh = move |connection: &FullConnection| {
            connection.scheme_moments(kernel, connection.bandwidth(beta)?, normalize)
        };
        let describe = place.points.describe();
        Scheme { name: place.name(), describe, place: Some(place), weigh: Box::new(weigh) }
    }

    /// The moments that are solved.
    ///
    /// # Errors
    /// Those of the scheme.
    pub fn moments(&self, connection: &FullConnection) -> Result<Moments> {
        (self.weigh)(connection)
    }
}

/// A way to describe points, one of [`Points::ALL`].
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Points {
    /// Nearest points of the neighbourhoods whose descriptors stand beside each other.
    pub neighbors: &'static [usize],
    /// Nearest points for normals; `None`: as many as the first of `neighbors`.
    pub normals: Option<usize>,
    /// Whose FPFH.
    pub histogram: HistogramScale,
}

impl Points {
    /// The ways of the grid, the paper's first.
    pub const ALL: [Points; 16] = {
        use HistogramScale::{Open3d, Pcl};
        [
            Points::of(&[150], None, Pcl),
            Points::of(&[50], None, Pcl),
            Points::of(&[100], None, Pcl),
            Points::of(&[250], None, Pcl),
            Points::of(&[50], None, Open3d),
            Points::of(&[150], None, Open3d),
            Points::of(&[50], Some(10), Pcl),
            Points::of(&[100], Some(10), Pcl),
            Points::of(&[150], Some(10), Pcl),
            Points::of(&[250], Some(10), Pcl),
            Points::of(&[100, 200], Some(10), Pcl),
            Points::of(&[100, 200, 400], Some(10), Pcl),
            Points::of(&[50, 100, 200, 400], Some(10), Pcl),
            Points::of(&[100, 200, 400], Some(20), Pcl),
            Points::of(&[100, 200, 400], Some(40), Pcl),
            Points::of(&[100, 200, 400], Some(10), Open3d),
        ]
    };

    const fn of(
        neighbors: &'static [usize],
        normals: Option<usize>,
        histogram: HistogramScale,
    ) -> Self {
        Points { neighbors, normals, histogram }
    }

    /// As a setting of the methods.
    pub fn describe(self) -> Describe {
        let mut neighborhoods = self.neighbors.iter().map(|&k| Neighborhood::Nearest(k));
        let first = neighborhoods.next();
        Describe {
            neighborhood: first.unwrap_or(Describe::default().neighborhood),
            more_neighborhoods: neighborhoods.collect(),
            normal_neighborhood: self.normals.map(Neighborhood::Nearest),
            histogram: self.histogram,
            ..Describe::default()
        }
    }

    /// Short, for tables: `100+200 n10`.
    pub fn name(self) -> String {
        let sizes: Vec<String> = self.neighbors.iter().map(usize::to_string).collect();
        let normals = self.normals.map_or(String::new(), |k| format!(" n{k}"));
        let histogram = match self.histogram {
            HistogramScale::Pcl => "",
            HistogramScale::Open3d => " open3d",
        };
        format!("{}{normals}{histogram}", sizes.join("+"))
    }
}

/// A place of the grid.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Place {
    /// How points are described.
    pub points: Points,
    /// The kernel.
    pub kernel: WeightScheme,
    /// Its bandwidth.
    pub beta: Bandwidth,
    /// The normalisation.
    pub normalize: Normalization,
}

/// Kernels of the grid; the uniform one has but one place, for it has neither bandwidth nor
/// descriptors.
const KERNELS: [WeightScheme; 7] = [
    WeightScheme::Gaussian,
    WeightScheme::Laplacian,
    WeightScheme::Cauchy,
    WeightScheme::GemanMcClure,
    WeightScheme::TruncatedQuadratic,
    WeightScheme::StudentT(WeightScheme::DEFAULT_NU),
    WeightScheme::Tukey,
];

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
    /// The paper's.
    pub const PAPER: Place = Place {
        points: Points::ALL[0],
        kernel: WeightScheme::Gaussian,
        beta: Bandwidth::Fixed(100.0),
        normalize: Normalization::None,
    };

    /// The best of the study: CF with descriptors of three sizes on sharp normals, an automatic
    /// bandwidth and dual softmax.
    pub const BEST: Place = Place {
        points: Points::ALL[11],
        kernel: WeightScheme::Gaussian,
        beta: Bandwidth::Auto(Bandwidth::DEFAULT_SHARE),
        normalize: Normalization::Both,
    };

    /// From the paper's to the best, one choice at a time.
    pub const STEPS: [Place; 5] = [
        Place::PAPER,
        Place { normalize: Normalization::Both, ..Place::PAPER },
        Place { normalize: Normalization::Both, points: Points::ALL[8], ..Place::PAPER },
        Place { normalize: Normalization::Both, points: Points::ALL[11], ..Place::PAPER },
        Place::BEST,
    ];

    /// Every place of the grid, or a few of it.
    pub fn grid(few: bool) -> Vec<Place> {
        let mut places = vec![Place { kernel: WeightScheme::Uniform, ..Place::PAPER }];
        let (points, kernels) = match few {
            true => ([0, 8, 11].map(|at| Points::ALL[at]).to_vec(), &KERNELS[..1]),
            false => (Points::ALL.to_vec(), &KERNELS[..]),
        };
        for &points in &points {
            // Squared distances are about four times as large on Open3D's scale.
            let unit = points.histogram.default_beta() / HistogramScale::Pcl.default_beta();
            for &kernel in kernels {
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

    /// For tables: description, kernel, bandwidth, normalisation.
    pub fn name(&self) -> String {
        let Place { points, kernel, beta, normalize } = self;
        format!("{} | {kernel} | {beta} | {normalize}", points.name())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

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
        assert_eq!(Place::BEST.name(), "100+200+400 n10 | gaussian | auto | both");
    }

    #[test]
    fn the_papers_place_is_the_default() {
        let cf = crate::method::Cf::default();
        assert_eq!(Place::PAPER.points.describe(), cf.describe);
        assert_eq!(Place::PAPER.beta, cf.bandwidth());
        assert_eq!((Place::PAPER.kernel, Place::PAPER.normalize), (cf.weights, cf.normalization));
    }
}
