//! Journals of `batch`, whatever became of them: a run that goes on ends with the rows that an
//! undisturbed one has, or says why not and leaves the file alone.

use std::fs;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

use cfreg::batch::{Batch, PairList, StartMode};
use cfreg::method::{Register, Registration};
use cfreg::par::Interrupt;
use cfreg::{Error, PointCloud};

use super::bytes::Bytes;
use super::door;
use super::readers::heard;

/// Answers at once, and asks for an end after so many pairs.
struct Quick<'a> {
    found: &'a Registration,
    left: AtomicUsize,
    end: Interrupt,
}

impl Register for Quick<'_> {
    fn register(&self, source: &PointCloud, _: &PointCloud) -> cfreg::Result<Registration> {
        if self.left.fetch_sub(1, Ordering::Relaxed) == 1 {
            self.end.request();
        }
        match source.len() {
            5 => Err(Error::Interrupted),
            _ => Ok(self.found.clone()),
        }
    }
}

/// The parts that all runs share, and the result of a run that nothing disturbs.
struct Honest {
    found: Registration,
    clouds: [Arc<PointCloud>; 2],
    list: PairList,
    output: PathBuf,
    journal: PathBuf,
    /// The journal after three of five pairs.
    begun: Vec<u8>,
    /// The rows of all.
    rows: Vec<u8>,
}

thread_local! {
    static HONEST: Honest = Honest::new();
}

impl Honest {
    fn new() -> Honest {
        let cloud = |count: usize| {
            let place = |i: usize| [i as f64, (i * i % 7) as f64, (i % 3) as f64];
            PointCloud::new(&(0..count).map(place).collect::<Vec<_>>()).expect("a cloud")
        };
        let six = cloud(6);
        let icp: cfreg::method::Method = "icp".parse().expect("a method");
        let mut honest = Honest {
            found: icp.register(&six, &six).expect("a cloud lies on itself"),
            clouds: [Arc::new(six), Arc::new(cloud(5))],
            list: PairList::new("", [["a", "b"], ["b", "a"], ["a", "a"], ["b", "b"], ["c", "a"]]),
            output: door::folder().join("rows.jsonl"),
            journal: door::folder().join("rows.jsonl.part"),
            begun: Vec::new(),
            rows: Vec::new(),
        };
        let ended = honest.run(3);
        assert!(matches!(ended, Err(Error::Interrupted)), "{ended:?}");
        honest.begun = fs::read(&honest.journal).expect("a run that was ended has left a journal");
        honest.run(usize::MAX).expect("the journal is as it was left");
        honest.rows = fs::read(&honest.output).expect("the rows are there");
        honest
    }

    fn run(&self, pairs: usize) -> cfreg::Result<()> {
        let end = Interrupt::default();
        let method = Quick { found: &self.found, left: AtomicUsize::new(pairs), end: end.clone() };
        let mut batch = Batch::new(&method, &"quick");
        batch.threads = 1;
        batch.interrupt = end;
        batch.start = StartMode::Resume;
        for (name, cloud) in ["a", "b"].into_iter().zip(&self.clouds) {
            batch.in_memory.insert(name.into(), cloud.clone());
        }
        batch.run(&self.list, &self.output).map(drop)
    }
}

/// A journal that was changed: bytes of its own, the honest one with some of its bytes changed, or
/// with others behind it.
pub fn journal(data: &[u8]) {
    HONEST.with(|honest| {
        let mut bytes = Bytes(data);
        let changed = match bytes.below(4) {
            0 => bytes.0.to_vec(),
            1 => {
                let header = honest.begun.iter().position(|&byte| byte == b'\n').unwrap_or(0);
                [&honest.begun[..=header], bytes.0].concat()
            }
            2 => [&honest.begun, bytes.0].concat(),
            _ => edited(honest.begun.clone(), &mut bytes),
        };
        let _ = fs::remove_file(&honest.output);
        fs::write(&honest.journal, &changed).expect("there is room for a journal");
        let ran = honest.run(usize::MAX);
        if heard(ran, None).is_some() {
            let rows = fs::read(&honest.output).expect("a run that ended well has left rows");
            let text = String::from_utf8_lossy;
            assert!(rows == honest.rows, "{}\nbecame\n{}", text(&honest.rows), text(&rows));
            assert!(!honest.journal.exists(), "the journal is left");
        } else {
            let left = fs::read(&honest.journal).expect("a journal that was refused is left");
            assert!(left == changed, "a journal that was refused was changed");
        }
    });
}

/// With bytes replaced, left out, put in; lines that come twice, or in another order.
fn edited(mut journal: Vec<u8>, bytes: &mut Bytes<'_>) -> Vec<u8> {
    for _ in 0..=bytes.below(4) {
        if journal.is_empty() {
            break;
        }
        let at = usize::from(bytes.byte()) << 8 | usize::from(bytes.byte());
        let at = at % journal.len();
        match bytes.below(6) {
            0 => journal[at] = bytes.byte(),
            1 => journal[at] ^= 1 << bytes.below(8),
            2 => drop(journal.remove(at)),
            3 => journal.insert(at, bytes.byte()),
            4 => journal.truncate(at),
            _ => {
                let mut lines: Vec<&[u8]> = journal.split_inclusive(|&b| b == b'\n').collect();
                let (from, to) = (bytes.below(lines.len()), bytes.below(lines.len()));
                match bytes.flag() {
                    true => lines.swap(from, to),
                    false => lines.insert(to, lines[from]),
                }
                journal = lines.concat();
            }
        }
    }
    journal
}
