//! The study of weight schemes that the paper leaves to the future: which kernel, bandwidth,
//! normalisation and descriptor, against noise, outliers, sampling and partial overlap.
//!
//! Every scheme is one step: weights on the full connection from descriptors, one closed form. A
//! grid of schemes is screened on a few trials a condition. The best ones, and user-defined
//! schemes, are measured on many other trials, so that the ranking has no selection bias.

mod condition;
mod page;
mod pictures;
mod ranking;
mod scheme;
mod screening;
mod tables;
mod trials;

use std::path::PathBuf;

pub use condition::{Condition, Scenes};
pub use ranking::{Interval, SchemeRanking};
pub use scheme::{DescriptorSetup, GridPoint, Scheme};
pub use screening::ScreeningResult;
pub use trials::TrialOutcome;

use self::ranking::Errors;
use self::trials::{Entrant, TrialDraws};
use super::csv_cache;
use crate::files;
use cfreg::error::{Error, Result};
use cfreg::figure::Figure;
use cfreg::method::{Method, Teaser};

/// What is run, and where it goes.
pub struct StudyOptions {
    /// Folder of the results, made if it is not there; what is in it already, made by the
    /// same settings, is not run again; with schemes of one's own, which may have changed
    /// under their names, all finals are.
    pub output: PathBuf,
    /// A few schemes and trials only.
    pub smoke: bool,
    /// User-defined schemes, measured beside the best of the grid.
    pub own: Vec<Scheme>,
}

/// Results of the study.
#[derive(Debug, Clone, PartialEq)]
pub struct Study {
    /// Every scheme of the grid in every condition.
    pub screened: Vec<ScreeningResult>,
    /// The finalists, the best first.
    pub rankings: Vec<SchemeRanking>,
    /// Their trials by condition, trial by trial.
    pub finals: Vec<(Condition, Vec<TrialOutcome>)>,
    /// Trials of a condition in the screening, and in the finals.
    pub trials: [usize; 2],
}

impl Study {
    /// Formats the ranking, its errors, and the gain of each choice, as tables.
    pub fn markdown(&self) -> String {
        tables::markdown(self)
    }

    /// Draws the finalists against overlap, noise and outliers, and the screening of bandwidths and
    /// neighbourhoods, as curves.
    pub fn figure(&self) -> Figure {
        pictures::figure(self)
    }
}

/// Seeds of the two rounds; they differ from the seeds of the paper's tests, and of the trials
/// before the grid was defined.
const SEEDS: [u64; 2] = [11, 13];

/// The method of many steps that stands beside the schemes.
const REFERENCE_METHOD: &str = "TEASER";

/// Runs the study on `scenes`; `progress` receives the number of finished parts and of all parts.
///
/// # Errors
/// [`Error::Io`] for a folder that cannot be written, [`Error::Config`] for two schemes of one
/// name; the errors of [`Scenes::trial`].
pub fn run(
    options: &StudyOptions,
    scenes: &Scenes,
    mut progress: impl FnMut(usize, usize),
) -> Result<Study> {
    std::fs::create_dir_all(&options.output).map_err(|error| Error::io(&options.output, error))?;
    let [few, many] = if options.smoke { [2, 3] } else { [6, 60] };
    let wanted = |condition: &&Condition| {
        scenes.supports(**condition) && !(options.smoke && SKIPPED_BY_SMOKE.contains(*condition))
    };
    let conditions: Vec<Condition> = Condition::ALL.iter().filter(wanted).copied().collect();
    let parts = 2 * conditions.len();

    let grid: Vec<Scheme> =
        GridPoint::grid(options.smoke).into_iter().map(Scheme::from_grid).collect();
    let mut screened = Vec::new();
    for (done, &condition) in conditions.iter().enumerate() {
        progress(done, parts);
        let draws = TrialDraws::new(scenes, condition, SEEDS[0], few);
        screened.extend(screening::run(scenes, draws, &grid, &options.output)?);
    }

    let finalists = screening::finalists(&screened, &conditions, &grid);
    let beside = Teaser { noise_bound: Some(0.05), ..Teaser::default() };
    let mut entrants: Vec<Entrant<'_>> =
        finalists.into_iter().chain(&options.own).map(Entrant::Scheme).collect();
    entrants.push(Entrant::Reference(REFERENCE_METHOD, Box::new(Method::Teaser(beside))));
    let names: Vec<String> = entrants.iter().map(|entrant| entrant.name().to_string()).collect();
    if let Some(twice) = (1..names.len()).find(|&k| names[..k].contains(&names[k])) {
        return Err(Error::config("scheme", &names[twice], "must be the name of one scheme only"));
    }
    let mut finals = Vec::new();
    for (done, &condition) in conditions.iter().enumerate() {
        progress(conditions.len() + done, parts);
        let draws = TrialDraws::new(scenes, condition, SEEDS[1], many);
        let path = options.output.join(format!("final_{}.csv", condition.stem()));
        let maker = ("final", draws);
        let known = csv_cache::read(&path, &maker).filter(|rows: &Vec<TrialOutcome>| {
            options.own.is_empty()
                && rows.len() == many * names.len()
                && rows.iter().zip(names.iter().cycle()).all(|(r, n)| r.scheme == *n)
        });
        let outcomes = match known {
            Some(known) => known,
            None => {
                let outcomes = trials::run(scenes, draws, &entrants)?;
                csv_cache::write(&path, &maker, &outcomes)?;
                outcomes
            }
        };
        finals.push((condition, outcomes));
    }
    progress(parts, parts);
    let errors: Vec<Errors> = finals
        .iter()
        .map(|(condition, outcomes)| Errors::from_outcomes(*condition, outcomes, names.len()))
        .collect();
    // The paper's scheme is always the first finalist.
    let standings = ranking::rank_schemes(&names, 0, &errors);
    let study = Study { screened, rankings: standings, finals, trials: [few, many] };
    let ranking = options.output.join("ranking.md");
    files::write_bytes(&ranking, study.markdown().as_bytes())?;
    study.figure().save(&options.output.join("fig12-weights"))?;
    Ok(study)
}

/// `items` without those that came before.
fn without_duplicates<T: PartialEq>(items: impl IntoIterator<Item = T>) -> Vec<T> {
    items.into_iter().fold(Vec::new(), |mut once, item| {
        if !once.contains(&item) {
            once.push(item);
        }
        once
    })
}

/// One condition of each kind is enough to check that everything runs.
const SKIPPED_BY_SMOKE: [Condition; 8] = [
    Condition::Noise(0.005),
    Condition::Noise(0.02),
    Condition::Outliers(0.2),
    Condition::Outliers(1.0),
    Condition::Overlap(1.0),
    Condition::Overlap(0.8),
    Condition::Overlap(0.65),
    Condition::Overlap(0.3),
];
