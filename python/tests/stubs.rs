//! The stub file names all that the extension module exports.

use std::fs;
use std::path::Path;

fn read(file: &str) -> String {
    fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join(file)).unwrap()
}

#[test]
fn every_exported_name_is_in_the_stub() {
    let module = read("src/lib.rs");
    let stub = read("cfreg/_native.pyi");
    let mut names = Vec::new();
    for export in module.split("#[pymodule_export]").skip(1) {
        let Some((_, list)) = export.split_once("use super::") else { continue };
        let list = list.split(';').next().unwrap();
        let list = list.split_once("::").map_or(list, |(_, names)| names);
        names.extend(
            list.split(|c: char| !c.is_alphanumeric() && c != '_')
                .filter(|name| !name.is_empty() && *name != "PyCloud")
                .map(String::from),
        );
    }
    assert!(names.len() > 20, "the scanner is broken: {names:?}");
    for name in names {
        let declared = [format!("def {name}("), format!("class {name}")];
        assert!(declared.iter().any(|text| stub.contains(text)), "{name} is not in _native.pyi");
    }
}
