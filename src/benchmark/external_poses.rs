//! Poses from other programs, evaluated by the same rules.

use std::collections::{HashMap, HashSet};
use std::path::{Path, PathBuf};

use super::list::PairTable;
use super::{BenchmarkRow, Pair, PairClouds, Settings, SuccessCriterion};
use crate::cloud::Transform;
use crate::error::{Error, Result};
use crate::io::limited_file::GROWTH_FACTOR;
use crate::io::quote_start;

/// Most programs that are compared at once. Chosen by hand.
const MAX_PROGRAMS: usize = 1000;

/// The result of another program.
struct ExternalPose {
    method: String,
    pose: Option<Transform>,
    seconds: f64,
    accepted: bool,
}

/// Poses from other programs.
#[derive(Default)]
pub struct ExternalPoses {
    /// Results by source and target.
    found: HashMap<[PathBuf; 2], Vec<ExternalPose>>,
    /// Names of the programs, in order of appearance.
    methods: Vec<String>,
}

impl ExternalPoses {
    /// Reads poses of pairs that are `listed`.
    ///
    /// CSV with the columns `method`, `source`, `target` (as in the list, relative to `folder`),
    /// `t00` to `t33` (source into target frame, of the clouds as they are in the files; empty
    /// without a pose) and, optionally, `seconds` and `accepted` (`true` or `false`: whether the
    /// program accepts its own pose; default true).
    ///
    /// # Errors
    /// [`Error::Io`]; [`Error::Parse`] with the invalid line, or with the first line whose pair is
    /// not listed: it would not be counted.
    pub fn read(path: &Path, folder: &Path, listed: &[Pair]) -> Result<ExternalPoses> {
        let listed: HashSet<[&Path; 2]> =
            listed.iter().map(|pair| [pair.source.as_path(), pair.target.as_path()]).collect();
        let mut poses = ExternalPoses::default();
        let (mut rows, mut strangers, mut first) = (0, 0, None);
        let mut row = PairTable::open(path)?;
        while row.next()? {
            let names = ["source", "target"].map(|name| row.text(name));
            let key = names.map(|name| folder.join(name));
            rows += 1;
            if listed.contains(&key.each_ref().map(PathBuf::as_path)) {
                let answer = ExternalPose::from_row(&row)?;
                let bytes = key.each_ref().map(|path| path.as_os_str().len()).iter().sum::<usize>();
                row.take(GROWTH_FACTOR * size_of::<ExternalPose>() + answer.method.len() + bytes)?;
                if !poses.methods.contains(&answer.method) {
                    if poses.methods.len() == MAX_PROGRAMS {
                        return Err(
                            row.wrong(format!("there are more than {MAX_PROGRAMS} methods"))
                        );
                    }
                    poses.methods.push(answer.method.clone());
                }
                poses.found.entry(key).or_default().push(answer);
            } else {
                strangers += 1;
                first.get_or_insert_with(|| (row.line(), names.map(String::from)));
            }
        }
        let Some((line, [source, target])) = first else { return Ok(poses) };
        let what = format!(
            "no listed pair has the source {source} and the target {target}; {strangers} of {rows} \
             rows are of none: write names as the list does, relative to its folder, or leave such \
             rows out"
        );
        Err(Error::parse(path, Some(line), what))
    }

    /// Returns for each program with missing rows its name and the number of `pairs` without a row.
    pub fn missing(&self, pairs: &[Pair]) -> Vec<(&str, usize)> {
        let number = |method: &&str| pairs.iter().filter(|pair| !self.has(pair, method)).count();
        let all = self.methods.iter().map(String::as_str);
        all.map(|method| (method, number(&method))).filter(|(_, missing)| *missing > 0).collect()
    }

    fn poses_of_pair(&self, pair: &Pair) -> &[ExternalPose] {
        self.found.get(&[pair.source.clone(), pair.target.clone()]).map_or(&[], Vec::as_slice)
    }

    fn has(&self, pair: &Pair, method: &str) -> bool {
        self.poses_of_pair(pair).iter().any(|answer| answer.method == method)
    }

    /// Evaluates each pose of each of `pairs`, one row per pose. `pairs` may be a part of the list.
    /// A pair without a row of a program counts as a failure of that program.
    ///
    /// # Errors
    /// Those of reading clouds.
    pub fn evaluate(&self, pairs: &[Pair], settings: Settings) -> Result<Vec<BenchmarkRow>> {
        let (mut clouds, mut rows) = (PairClouds::default(), Vec::new());
        for pair in pairs {
            let source = clouds.get(&pair.source, Settings { points: 0, ..settings }, 0)?;
            let rule = settings
                .rule
                .unwrap_or_else(|| SuccessCriterion::for_size(source.diagonal() * pair.unit));
            for answer in self.poses_of_pair(pair) {
                let mut row = BenchmarkRow::new(pair, &answer.method, rule, answer.seconds);
                row.accepted = answer.accepted;
                match &answer.pose {
                    Some(pose) => row.set_errors(pose, pair, &source),
                    None => row.error = "no pose".into(),
                }
                rows.push(row);
            }
            for method in self.methods.iter().filter(|method| !self.has(pair, method)) {
                let row = BenchmarkRow::new(pair, method, rule, f64::NAN);
                rows.push(BenchmarkRow { error: "no row among the poses".into(), ..row });
            }
        }
        Ok(rows)
    }
}

impl ExternalPose {
    fn from_row(row: &PairTable) -> Result<ExternalPose> {
        let pose = row.pose()?;
        let accepted = match row.text("accepted") {
            "" => pose.is_some(),
            word => word.parse().map_err(|_| {
                row.wrong(format!("accepted is {}: must be true or false", quote_start(word)))
            })?,
        };
        let method = row.text("method").to_string();
        Ok(ExternalPose {
            method,
            pose,
            seconds: row.number("seconds")?.unwrap_or(f64::NAN),
            accepted,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cloud::shape::boulder;
    use crate::io;

    #[test]
    fn poses_of_others_are_judged_alike() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        io::write(at("a.ply"), &boulder().sample(300, 1).unwrap()).unwrap();
        let pair = Pair {
            dataset: "boulder".into(),
            source: at("a.ply"),
            target: at("b.ply"),
            truth: Some(Transform::IDENTITY),
            overlap: Some(1.0),
            unit: 1.0,
        };
        // Listed, and omitted from this run.
        let unjudged = Pair { target: at("c.ply"), ..pair.clone() };
        let titles: Vec<String> = (0..16).map(|k| format!("t{}{}", k / 4, k % 4)).collect();
        let write = |rows: &str| {
            let text =
                format!("method,source,target,{},seconds,accepted\n{rows}", titles.join(","));
            std::fs::write(at("poses.csv"), text).unwrap();
            let pairs = [pair.clone(), unjudged.clone()];
            let poses = ExternalPoses::read(&at("poses.csv"), folder.path(), &pairs)?;
            // A program without a row for a pair has failed on it.
            assert_eq!(poses.missing(&pairs[..1]), []);
            let all = poses.evaluate(&pairs, Settings::default())?;
            let failed = |row: &&BenchmarkRow| row.error == "no row among the poses";
            let failed: Vec<_> = all.iter().filter(failed).map(|row| row.method.as_str()).collect();
            assert_eq!(failed, ["far", "none"]);
            assert_eq!(poses.missing(&pairs), [("far", 1), ("none", 1)]);
            poses.evaluate(&pairs[..1], Settings::default())
        };
        let rows = write(
            "near,a.ply,b.ply,1,0,0,0.1,0,1,0,0,0,0,1,0,0,0,0,1,0.5,\n\
             far,a.ply,b.ply,-1,0,0,0,0,-1,0,0,0,0,1,0,0,0,0,1,2,false\n\
             none,a.ply,b.ply,,,,,,,,,,,,,,,,,1,\n\
             near,a.ply,c.ply,1,0,0,0,0,1,0,0,0,0,1,0,0,0,0,1,1,\n",
        )
        .unwrap();
        let told: Vec<_> =
            rows.iter().map(|row| (row.right, row.accepted, row.error.as_str())).collect();
        assert_eq!(told, [(true, true, ""), (false, false, ""), (false, false, "no pose")]);
        assert_eq!((rows[0].seconds, rows[1].rotation_deg), (0.5, Some(180.0)));
        let said = write("x,a.ply,b.ply,1,0,0,0,0,1,0,0,0,0,1,0,0,0,0,1,1,maybe\n").unwrap_err();
        assert!(said.to_string().contains("line 2: accepted is \"maybe\""), "{said}");
        let said = write(
            "near,a.ply,b.ply,1,0,0,0.1,0,1,0,0,0,0,1,0,0,0,0,1,0.5,\n\
             near,other.ply,b.ply,1,0,0,0,0,1,0,0,0,0,1,0,0,0,0,1,1,\n\
             near,b.ply,a.ply,1,0,0,0,0,1,0,0,0,0,1,0,0,0,0,1,1,\n",
        )
        .unwrap_err();
        let named = "line 3: no listed pair has the source other.ply and the target b.ply";
        assert!(said.to_string().contains(named), "{said}");
        assert!(said.to_string().contains("2 of 3 rows"), "{said}");
    }
}
