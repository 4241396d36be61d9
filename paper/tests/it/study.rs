//! The study of weight schemes in small: whole, the same again, open to anybody's scheme.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use cfreg::Error;
use cfreg::cloud::shape::boulder;
use cfreg::method::FeatureConfig;
use cfreg::weight::Normalization;
use cfreg_paper::experiments::cell::Shape;
use cfreg_paper::study::{Scenes, Scheme, Study, StudyOptions, run};

fn scenes() -> Scenes {
    Scenes::new(vec![(Shape::Bunny, boulder().into())], vec![(Shape::Bunny, boulder())]).unwrap()
}

fn study(output: &Path, own: Vec<Scheme>) -> Result<Study, Error> {
    run(&StudyOptions { output: output.to_path_buf(), smoke: true, own }, &scenes(), |_, _| {})
}

fn files(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let read = |entry: fs::DirEntry| {
        (entry.file_name().to_string_lossy().into_owned(), fs::read(entry.path()).unwrap())
    };
    fs::read_dir(folder).unwrap().map(|entry| read(entry.unwrap())).collect()
}

#[test]
fn a_scheme_of_ones_own_takes_part() {
    let mine = Scheme::new("quartic", FeatureConfig::default(), |connection| {
        let kernel = |d2: f32| 1.0 / (1.0 + d2 * d2 * 1e-4);
        connection.moments(&kernel, Normalization::Both)
    });
    let folder = tempfile::tempdir().unwrap();
    let study = study(folder.path(), vec![mine]).unwrap();
    let of = |name: &str| study.rankings.iter().find(|s| s.scheme == name).unwrap().overall;
    let (mine, paper) = (of("quartic"), of("150 | gaussian | 100 | none"));
    assert_eq!(paper.value, 1.0);
    assert!(mine.low <= mine.value && mine.value <= mine.high && mine.value < 3.0, "{mine:?}");
    // Weights that do not look at descriptors find nothing.
    assert!(of("150 | uniform | 100 | none").value > 1.5);
    assert_eq!(study.finals.len(), 4);
    for (condition, outcomes) in &study.finals {
        let mine = outcomes.iter().filter(|outcome| outcome.scheme == "quartic");
        assert_eq!(mine.count(), 3, "{condition}");
    }
    let ranking = fs::read_to_string(folder.path().join("ranking.md")).unwrap();
    assert!(ranking.contains("| quartic |") && ranking.contains("not a measurement"));
    assert!(folder.path().join("fig12-weights.png").is_file());
}

#[test]
fn two_schemes_of_one_name_are_refused() {
    let twin = || {
        Scheme::new("twin", FeatureConfig::default(), |c| {
            c.moments(&|d2: f32| (-d2).exp(), Normalization::None)
        })
    };
    let folder = tempfile::tempdir().unwrap();
    let refused = study(folder.path(), vec![twin(), twin()]);
    assert!(matches!(refused, Err(Error::Config { field: "scheme", .. })), "{refused:?}");
}

#[test]
fn a_second_run_gives_the_same_bytes_and_goes_on_where_it_was_cut() {
    let folder = tempfile::tempdir().unwrap();
    study(folder.path(), Vec::new()).unwrap();
    let first = files(folder.path());
    fs::remove_file(folder.path().join("final_overlap-050.csv")).unwrap();
    let half = folder.path().join("screening_noise-100.csv");
    let text = fs::read(&half).unwrap();
    fs::write(&half, &text[..text.len() - 7]).unwrap();
    study(folder.path(), Vec::new()).unwrap();
    assert!(files(folder.path()) == first, "a second run differs");

    // What is whole is read, not run again: a number that nothing would make is kept.
    let kept = folder.path().join("final_independent.csv");
    let text = fs::read_to_string(&kept).unwrap();
    let row = text.lines().nth(2).unwrap();
    let other = format!("{},0.125", row.rsplit_once(',').unwrap().0);
    let edited = text.replacen(row, &other, 1);
    fs::write(&kept, &edited).unwrap();
    study(folder.path(), Vec::new()).unwrap();
    assert_eq!(fs::read_to_string(&kept).unwrap(), edited);
}
