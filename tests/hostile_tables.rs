//! Lists and rows that are broken, made to break, or have no end: each is an error that says so,
//! within bounded memory, and prints nothing else.

use std::alloc::{GlobalAlloc, Layout, System};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

use cfreg::batch::{Batch, PairList, results};
use cfreg::cloud::shape::boulder;
use cfreg::method::Pipeline;
use cfreg::{Error, io};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use tempfile::TempDir;

/// Counts what is reserved, whether it is used or not, and refuses more than a test may have.
struct Counting;

static HELD: AtomicUsize = AtomicUsize::new(0);
static PEAK: AtomicUsize = AtomicUsize::new(0);

unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        let held = HELD.fetch_add(layout.size(), Ordering::Relaxed) + layout.size();
        PEAK.fetch_max(held, Ordering::Relaxed);
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, place: *mut u8, layout: Layout) {
        HELD.fetch_sub(layout.size(), Ordering::Relaxed);
        unsafe { System.dealloc(place, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// One test after the other: memory is that of the process.
static ALONE: Mutex<()> = Mutex::new(());

/// The memory that reading a file may take, as `io::guard` says, and that is held beside.
fn most(size: usize) -> usize {
    10 * size + (256 << 20) + (64 << 20)
}

fn alone<T>(work: impl FnOnce() -> T) -> (T, usize) {
    let _guard = ALONE.lock().unwrap_or_else(PoisonError::into_inner);
    let before = HELD.load(Ordering::Relaxed);
    PEAK.store(before, Ordering::Relaxed);
    let made = work();
    (made, PEAK.load(Ordering::Relaxed).saturating_sub(before))
}

/// Parquet of rows, which is a list too: some with a pose, some without.
fn parquet(folder: &Path) -> PathBuf {
    for seed in 0..3 {
        let cloud = boulder().sample(250, seed).unwrap();
        io::write(folder.join(format!("{seed}.ply")), &cloud).unwrap();
    }
    let names = ["0.ply", "1.ply", "2.ply", "none.ply"];
    let pairs = names.iter().flat_map(|source| names.iter().map(move |target| [*source, *target]));
    let method = Pipeline::new("consensus".parse().unwrap(), Vec::new()).unwrap();
    let path = folder.join("rows.parquet");
    Batch::new(&method, &method).run(&PairList::new(folder, pairs), &path).unwrap();
    path
}

/// Reads the file in every way.
fn read(path: &Path) -> [Result<(), Error>; 2] {
    let list = PairList::read(path, Path::new("")).map(drop);
    [list, results::read(path).map(drop)]
}

#[test]
fn parquet_that_was_changed_is_an_error_within_bounded_memory() {
    static SHOWN: AtomicBool = AtomicBool::new(false);
    let folder = tempfile::tempdir().unwrap();
    let ((), _) = alone(|| {
        let whole = fs::read(parquet(folder.path())).unwrap();
        let usual = std::panic::take_hook();
        std::panic::set_hook(Box::new(move |panic| {
            SHOWN.store(true, Ordering::Relaxed);
            usual(panic);
        }));
        let mut random = ChaCha8Rng::seed_from_u64(
            std::env::var("CFREG_SEED").ok().and_then(|seed| seed.parse().ok()).unwrap_or(7),
        );
        let path = folder.path().join("changed.parquet");
        let footer = whole.len()
            - 8
            - u32::from_le_bytes(whole[whole.len() - 8..whole.len() - 4].try_into().unwrap())
                as usize;
        let (mut errors, mut highest) = (0, 0);
        let trials =
            std::env::var("CFREG_TRIALS").ok().and_then(|n| n.parse().ok()).unwrap_or(4000);
        for trial in 0..trials {
            let mut bytes = whole.clone();
            for _ in 0..random.random_range(1..5) {
                // Half of the time in the footer.
                let from = if random.random::<bool>() { footer } else { 0 };
                let at = random.random_range(from..bytes.len() - 4);
                match random.random_range(0..4) {
                    0 => bytes[at] = random.random(),
                    1 => bytes[at] ^= 1 << random.random_range(0..8),
                    2 => bytes[at] = 0xff,
                    _ => {
                        let end = (at + 5).min(bytes.len());
                        bytes[at..end].fill(*[0x00, 0x7f, 0x80, 0xff].get(trial % 4).unwrap());
                    }
                }
            }
            fs::write(&path, &bytes).unwrap();
            PEAK.store(HELD.load(Ordering::Relaxed), Ordering::Relaxed);
            let before = HELD.load(Ordering::Relaxed);
            errors += read(&path).iter().filter(|read| read.is_err()).count();
            highest = highest.max(PEAK.load(Ordering::Relaxed).saturating_sub(before));
        }
        println!(
            "{trials} changed files, read twice: {errors} errors, {} kB at most",
            highest >> 10
        );
        assert!(highest < most(whole.len()), "{highest}");
        assert!(!SHOWN.load(Ordering::Relaxed), "a panic was printed");
        assert!(errors > trials / 2, "{errors}");
    });
}

#[test]
fn small_files_that_claim_much_are_errors() {
    let cases = std::env::var_os("CFREG_CASES").map_or_else(
        || Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/cases"),
        PathBuf::from,
    );
    for name in ["oom.parquet", "oom2.parquet", "rss1.3GB.parquet"] {
        let path = cases.join("robust").join(name);
        if !path.is_file() {
            println!("skipped: no {}", path.display());
            continue;
        }
        let (read, peak) = alone(|| read(&path));
        println!("{name}: {peak} bytes, {read:?}");
        assert!(read.iter().all(Result::is_err) && peak < most(1000), "{name}: {peak}");
    }
}

/// Numbers as Thrift's compact protocol has them.
fn varint(mut number: u64) -> Vec<u8> {
    let mut bytes = Vec::new();
    while number >= 0x80 {
        bytes.push(number as u8 | 0x80);
        number >>= 7;
    }
    bytes.push(number as u8);
    bytes
}

fn zigzag(number: i64) -> Vec<u8> {
    varint((number << 1 ^ number >> 63) as u64)
}

/// A list of one group with the columns `source` and `target`, both the same page: `head` is its
/// header, `body` what follows.
fn forged(rows: i64, values: i64, head: &[u8], body: &[u8]) -> Vec<u8> {
    let mut bytes = b"PAR1".to_vec();
    let mut chunks = Vec::new();
    for name in ["source", "target"] {
        let start = bytes.len() as i64;
        bytes.extend_from_slice(head);
        bytes.extend_from_slice(body);
        let length = bytes.len() as i64 - start;
        let mut chunk = vec![0x26];
        chunk.extend(zigzag(0));
        chunk.extend([0x1c, 0x15, 12, 0x19, 0x15, 0, 0x19, 0x18, name.len() as u8]);
        chunk.extend(name.as_bytes());
        chunk.extend([0x15, 0, 0x16]);
        chunk.extend(zigzag(values));
        chunk.push(0x16);
        chunk.extend(zigzag(length));
        chunk.push(0x16);
        chunk.extend(zigzag(length));
        chunk.push(0x26);
        chunk.extend(zigzag(start));
        chunk.extend([0, 0]);
        chunks.extend(chunk);
    }
    let mut footer = vec![0x15, 2, 0x19, 0x3c, 0x48, 1, b'r', 0x15, 4, 0];
    for name in ["source", "target"] {
        footer.extend([0x15, 12, 0x25, 0, 0x18, 6]);
        footer.extend(name.as_bytes());
        footer.push(0);
    }
    footer.push(0x16);
    footer.extend(zigzag(rows));
    footer.extend([0x19, 0x1c, 0x19, 0x2c]);
    footer.extend(chunks);
    footer.push(0x16);
    footer.extend(zigzag(100));
    footer.push(0x16);
    footer.extend(zigzag(rows));
    footer.extend([0, 0]);
    let length = footer.len() as u32;
    bytes.extend(footer);
    bytes.extend(length.to_le_bytes());
    bytes.extend(b"PAR1");
    bytes
}

/// The header of a data page of the first version.
fn data_page(unpacked: i64, packed: i64, values: i64, encoding: i64) -> Vec<u8> {
    let mut head = vec![0x15, 0, 0x15];
    head.extend(zigzag(unpacked));
    head.push(0x15);
    head.extend(zigzag(packed));
    head.extend([0x2c, 0x15]);
    head.extend(zigzag(values));
    head.push(0x15);
    head.extend(zigzag(encoding));
    head.extend([0x15, 6, 0x15, 6, 0, 0]);
    head
}

#[test]
fn forged_parquet_is_weighed() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("forged.parquet");
    let body = [b"\x02\0\0\0ab".as_slice(), b"\x02\0\0\0ab"].concat();
    let (size, many) = (body.len() as i64, i64::from(i32::MAX));
    let said = |bytes: &[u8]| {
        fs::write(&path, bytes).unwrap();
        let (read, peak) = alone(|| PairList::read(&path, Path::new("")));
        assert!(peak < most(bytes.len()), "{peak}");
        read
    };
    let list = said(&forged(2, 2, &data_page(size, size, 2, 0), &body)).unwrap();
    assert_eq!((list.len(), list.pair(1)), (2, ["ab", "ab"]));
    let page = |unpacked, packed, values, encoding| {
        forged(2, 2, &data_page(unpacked, packed, values, encoding), &body)
    };
    // A dictionary of nothing but claims, then a page of it.
    let dictionary = |values: i64| {
        let mut head = vec![0x15, 4, 0x15];
        head.extend(zigzag(size));
        head.push(0x15);
        head.extend(zigzag(size));
        head.extend([0x4c, 0x15]);
        head.extend(zigzag(values));
        head.extend([0x15, 0, 0, 0]);
        let mut rest = body.clone();
        rest.extend(data_page(3, 3, 2, 16 / 2));
        rest.extend([1, 4, 0]);
        forged(2, 2, &head, &rest)
    };
    assert_eq!(said(&dictionary(2)).unwrap().len(), 2);
    // Texts by their lengths, of which there are as many as two numbers say.
    let lengths = |count: u64| {
        let bytes = [vec![0x80, 1, 4], varint(count), vec![4, 0, 0, 0, 0, 0], b"abab".to_vec()];
        let bytes = bytes.concat();
        let size = bytes.len() as i64;
        forged(2, 2, &data_page(size, size, 2, 6), &bytes)
    };
    assert_eq!(said(&lengths(2)).unwrap().len(), 2);
    let wrong = [
        ("more rows than values", forged(many, 2, &data_page(size, size, 2, 0), &body)),
        ("more values than bytes", forged(many, many, &data_page(size, size, many, 0), &body)),
        ("values without end", forged(i64::MAX, i64::MAX, &data_page(size, size, 2, 0), &body)),
        ("negative rows", forged(-1, -1, &data_page(size, size, 2, 0), &body)),
        ("page beyond the column", page(size, size + 1, 2, 0)),
        ("page of nothing", page(size, -1, 2, 0)),
        ("large page", page(many, size, 2, 0)),
        ("too many values", page(size, size, 3, 0)),
        ("too few values", page(size, size, 1, 0)),
        ("no dictionary", page(size, size, 2, 8)),
        ("unknown encoding", page(size, size, 2, 77)),
        ("runs of texts", page(size, size, 2, 3)),
        ("large dictionary", dictionary(many)),
        ("small dictionary", dictionary(0)),
        ("many lengths", lengths(1 << 40)),
        ("some lengths", lengths(3)),
        ("long text", forged(1, 1, &data_page(8, 8, 1, 0), b"\xff\xff\xff\x7fabcd")),
        ("no text", forged(1, 1, &data_page(6, 6, 1, 0), b"\x02\0\0\0\xff\xfe")),
    ];
    for (name, bytes) in wrong {
        let error = said(&bytes).err().unwrap_or_else(|| panic!("{name} was read")).to_string();
        println!("{name}: {error}");
        assert!(error.contains("is not Parquet that can be read: "), "{name}: {error}");
    }
    // Two values that are a billion rows by runs: a list that no such file makes.
    let mut runs = vec![1];
    runs.extend(varint(1_000_000_000 << 1));
    runs.push(0);
    let mut head = vec![0x15, 4, 0x15];
    head.extend(zigzag(size));
    head.push(0x15);
    head.extend(zigzag(size));
    head.extend([0x4c, 0x15, 4, 0x15, 0, 0, 0]);
    let mut rest = body.clone();
    rest.extend(data_page(runs.len() as i64, runs.len() as i64, 1_000_000_000, 8));
    rest.extend(runs);
    let error = said(&forged(1_000_000_000, 1_000_000_000, &head, &rest)).unwrap_err().to_string();
    assert!(error.contains("would take more than 256 MiB of memory"), "{error}");
}

#[test]
fn rows_that_are_more_than_their_file_justifies_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("short.csv");
    let rows: String = (0..400_000).map(|index| format!("{index},a,b\n")).collect();
    fs::write(&path, format!("index,source,target\n{rows}")).unwrap();
    let (read, peak) = alone(|| results::read(&path));
    assert!(read.unwrap_err().to_string().contains("of memory"), "{peak}");
    assert!(peak < most(rows.len()), "{peak}");
}

const BINARY: &str = env!("CARGO_BIN_EXE_cfreg");

/// Runs a line of a shell in `folder`, with `CFREG` for the program and no more memory than 3 GB.
fn shell(folder: &TempDir, line: &str) -> Output {
    let line = format!("ulimit -v 3000000; {}", line.replace("CFREG", BINARY));
    let start = Instant::now();
    let output = Command::new("bash")
        .current_dir(folder.path())
        .args(["-c", &line])
        .stdin(Stdio::null())
        .output()
        .unwrap();
    assert!(start.elapsed() < Duration::from_secs(60), "{line}: {:?}", start.elapsed());
    output
}

#[cfg(target_os = "linux")]
#[test]
fn what_has_no_end_is_refused_by_every_reader() {
    let _guard = ALONE.lock().unwrap_or_else(PoisonError::into_inner);
    let folder = tempfile::tempdir().unwrap();
    for end in ["csv", "jsonl", "parquet", "json", "log"] {
        std::os::unix::fs::symlink("/dev/zero", folder.path().join(format!("zero.{end}"))).unwrap();
        std::os::unix::fs::symlink("/dev/urandom", folder.path().join(format!("any.{end}")))
            .unwrap();
        fs::File::create(folder.path().join(format!("sparse.{end}")))
            .unwrap()
            .set_len(1 << 40)
            .unwrap();
    }
    fs::write(folder.path().join("a.xyz"), "0 0 0\n1 0 0\n0 1 0\n0 0 1\n1 2 3\n").unwrap();
    let titles: Vec<String> = (0..16).map(|k| format!("t{}{}", k / 4, k % 4)).collect();
    let list = format!(
        "source,target,{}\na.xyz,a.xyz,{}\n",
        titles.join(","),
        "1,0,0,0,0,1,0,0,0,0,1,0,0,0,0,1"
    );
    fs::write(folder.path().join("known.csv"), list).unwrap();
    let mut lines = Vec::new();
    for start in ["zero", "any", "sparse"] {
        for end in ["csv", "parquet"] {
            lines.push(format!("CFREG batch {start}.{end} -o out.csv"));
        }
        for end in ["csv", "jsonl", "parquet"] {
            lines.push(format!("CFREG graph {start}.{end} -o out.g2o"));
            lines.push(format!("CFREG report {start}.{end} -o out"));
        }
        lines.push(format!("CFREG report {start}.json -o out.html"));
        lines.push(format!("CFREG pairs near {start}.csv --radius 1 -o near.csv"));
        lines.push(format!("CFREG benchmark {start}.csv"));
        lines.push(format!("CFREG benchmark {start}.log"));
        lines.push(format!("CFREG benchmark known.csv --poses {start}.csv"));
        lines.push(format!("CFREG benchmark known.csv --output {start}.csv"));
        lines.push(format!("CFREG evaluate a.xyz a.xyz --transform {start}.json"));
        lines.push(format!("CFREG register a.xyz a.xyz --near {start}.json"));
    }
    lines.extend([
        "CFREG batch <(yes) -o out.csv".into(),
        "CFREG batch <(echo source,target; yes a,b) -o out.csv".into(),
        "CFREG batch <(echo source,target; yes 'a,\"') -o out.csv".into(),
        "ln -s /dev/fd/3 fd.csv; CFREG graph fd.csv -o out.g2o 3< <(echo index,source,target; yes 1,a,b)".into(),
        "ln -s /dev/fd/3 fd.jsonl; CFREG graph fd.jsonl -o out.g2o 3< <(yes '{\"index\":1,\"source\":\"a\",\"target\":\"b\"}')".into(),
        "CFREG pairs near <(echo cloud,x,y,z; yes a,1,1,1) --radius 1 -o near.csv".into(),
        "CFREG benchmark <(yes)".into(),
        "mkfifo pipe.json; (yes > pipe.json &) ; CFREG report pipe.json -o out.html".into(),
        "CFREG evaluate a.xyz a.xyz --transform <(yes 1 0 0 0)".into(),
    ]);
    for line in lines {
        let output = shell(&folder, &line);
        let said = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{line}: {said}");
        assert!(said.starts_with("cfreg: ") && !said.contains("panicked"), "{line}: {said}");
        println!("{line}: {}", said.trim());
    }
}

#[test]
fn wide_tables_take_linear_time() {
    let _guard = ALONE.lock().unwrap_or_else(PoisonError::into_inner);
    let folder = tempfile::tempdir().unwrap();
    let wide = |first: &str, row: &str, rows: usize| {
        let mut text = first.to_string();
        (0..70_000).for_each(|k| text += &format!(",c{k}"));
        let row = format!("\n{row}{}", ",1".repeat(70_000));
        text + &row.repeat(rows)
    };
    let titles: Vec<String> = (0..16).map(|k| format!("t{}{}", k / 4, k % 4)).collect();
    let pose = "1,0,0,0,0,1,0,0,0,0,1,0,0,0,0,1";
    let known = format!("source,target,{}", titles.join(","));
    let object: String = (0..70_000).map(|k| format!("\"c{k}\":[[]],")).collect();
    let object = format!("{{{object}\"index\":0,\"source\":\"a\",\"target\":\"b\"}}\n");
    for (name, text) in [
        ("list.csv", wide("source,target", "a,b", 20)),
        ("rows.csv", wide("index,source,target", "0,a,b", 20)),
        ("rows.jsonl", object.repeat(10)),
        ("places.csv", wide("cloud,x,y,z", "a,1,2,3", 20)),
        ("known.csv", wide(&known, &format!("a,b,{pose}"), 20)),
    ] {
        fs::write(folder.path().join(name), text).unwrap();
    }
    let start = Instant::now();
    PairList::read(&folder.path().join("list.csv"), Path::new("")).unwrap();
    assert_eq!(results::read(&folder.path().join("rows.csv")).unwrap().len(), 20);
    assert_eq!(results::read(&folder.path().join("rows.jsonl")).unwrap().len(), 10);
    cfreg::batch::ScanPositions::read(&folder.path().join("places.csv")).unwrap();
    cfreg::benchmark::list::read(&folder.path().join("known.csv"), Path::new("")).unwrap();
    println!("five wide tables: {:?}", start.elapsed());
    assert!(start.elapsed() < Duration::from_secs(10), "{:?}", start.elapsed());
}
