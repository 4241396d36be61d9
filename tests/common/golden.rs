//! Golden cases: problems solved by the independent f64 reference (`tests/golden/README.md`).

use std::fs;
use std::path::Path;

use serde::de::DeserializeOwned;

/// `part` (`input` or `expected`) of a case.
///
/// # Panics
/// When the file is not there or not of that shape.
pub fn read<T: DeserializeOwned>(case: &str, part: &str) -> T {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden").join(case);
    let text = fs::read_to_string(folder.join(part).with_extension("json")).unwrap();
    serde_json::from_str(&text).unwrap_or_else(|error| panic!("{case}/{part}: {error}"))
}
