//! No circle between source files: imports are followed through re-exports, a module and its own
//! parts count as one.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::Path;

/// Text of each module without comments and without its tests, by its path: `method::icp`.
fn modules() -> BTreeMap<String, String> {
    let src = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let mut found = BTreeMap::new();
    let mut folders = vec![src.clone()];
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
                continue;
            }
            if path.extension().is_none_or(|extension| extension != "rs") {
                continue;
            }
            let relative = path.strip_prefix(&src).unwrap().with_extension("");
            let parts: Vec<_> = relative.iter().map(|part| part.to_str().unwrap()).collect();
            let name = parts.join("::");
            let name = name.strip_suffix("::mod").unwrap_or(&name).to_string();
            let text = fs::read_to_string(&path).unwrap();
            let text = text.split("#[cfg(test)]\nmod tests").next().unwrap();
            let lines = text.lines().map(|line| line.split("//").next().unwrap());
            found.insert(name, lines.collect::<Vec<_>>().join(" "));
        }
    }
    found
}

/// `a::{b, c::{d, e}}` as `a::b`, `a::c::d`, `a::c::e`.
fn expanded(prefix: &str, tree: &str, found: &mut Vec<String>) {
    let tree = tree.trim();
    let path = |tail: &str| {
        [prefix, tail].iter().filter(|p| !p.is_empty()).copied().collect::<Vec<_>>().join("::")
    };
    let Some(start) = tree.find('{') else {
        let name = tree.split(" as ").next().unwrap().trim();
        found.push(path(name.trim_end_matches("::self")));
        return;
    };
    let prefix = path(tree[..start].trim_end_matches("::"));
    let inner = &tree[start + 1..tree.rfind('}').unwrap()];
    let (mut depth, mut from) = (0, 0);
    for (at, c) in inner.char_indices().chain([(inner.len(), ',')]) {
        match c {
            '{' => depth += 1,
            '}' => depth -= 1,
            ',' if depth == 0 => {
                if !inner[from..at].trim().is_empty() {
                    expanded(&prefix, &inner[from..at], found);
                }
                from = (at + 1).min(inner.len());
            }
            _ => {}
        }
    }
}

/// Paths from the root of the crate that `text`, the module `own`, imports, and whether each is
/// exported again.
fn imports(own: &str, text: &str) -> Vec<(String, bool)> {
    let mut found = Vec::new();
    for (at, _) in text.match_indices("use ") {
        let before = text[..at].trim_end();
        if !(before.is_empty()
            || before.ends_with([';', '}', ']', ')', '{'])
            || before.ends_with("pub"))
        {
            continue;
        }
        let is_public = before.ends_with("pub") || before.ends_with(')');
        let Some(end) = text[at..].find(';') else { continue };
        let mut tree = text[at + 4..at + end].trim();
        let mut base: Vec<&str> = own.split("::").collect();
        if let Some(rest) = tree.strip_prefix("crate::") {
            (base, tree) = (Vec::new(), rest);
        } else if let Some(rest) = tree.strip_prefix("self::") {
            tree = rest;
        } else if tree.starts_with("super::") {
            while let Some(rest) = tree.strip_prefix("super::") {
                base.pop();
                tree = rest;
            }
        } else if !is_public {
            // Of another crate.
            continue;
        }
        let mut paths = Vec::new();
        expanded(&base.join("::"), tree, &mut paths);
        found.extend(paths.into_iter().map(|path| (path, is_public)));
    }
    for (at, _) in text.match_indices("crate::") {
        let rest = &text[at + 7..];
        let end = rest.find(|c: char| !(c.is_alphanumeric() || "_:".contains(c)));
        found.push((rest[..end.unwrap_or(rest.len())].trim_end_matches(':').into(), false));
    }
    found
}

/// The longest part of `path` that is a module, and the name behind it.
fn split<'a>(path: &'a str, modules: &BTreeMap<String, String>) -> Option<(String, &'a str)> {
    let mut end = path.len();
    loop {
        if modules.contains_key(&path[..end]) {
            let rest = path[end..].trim_start_matches("::");
            return Some((path[..end].into(), rest.split("::").next().unwrap()));
        }
        end = path[..end].rfind("::")?;
    }
}

/// Modules that each module imports from, but for its own parts and those that it is a part of.
fn graph(modules: &BTreeMap<String, String>) -> BTreeMap<String, BTreeSet<String>> {
    let mut exported = BTreeMap::new();
    for (own, text) in modules {
        for (path, _) in imports(own, text).into_iter().filter(|(_, is_public)| *is_public) {
            let name = path.rsplit("::").next().unwrap().to_string();
            if let Some((module, _)) = split(&path, modules) {
                exported.insert((own.clone(), name), module);
            }
        }
    }
    let kin = |a: &str, b: &str| {
        a == b || a.starts_with(&format!("{b}::")) || b.starts_with(&format!("{a}::"))
    };
    let edges = |(own, text): (&String, &String)| {
        let mut onto = BTreeSet::new();
        for (path, _) in imports(own, text) {
            let Some((module, name)) = split(&path, modules) else { continue };
            let origin = exported.get(&(module.clone(), name.to_string()));
            let module = origin.cloned().unwrap_or(module);
            if !kin(own, &module) {
                onto.insert(module);
            }
        }
        (own.clone(), onto)
    };
    modules.iter().map(edges).collect()
}

/// A circle, if there is one.
fn circle(graph: &BTreeMap<String, BTreeSet<String>>) -> Option<Vec<String>> {
    fn visit<'a>(
        at: &'a str,
        graph: &'a BTreeMap<String, BTreeSet<String>>,
        done: &mut BTreeSet<&'a str>,
        path: &mut Vec<&'a str>,
    ) -> Option<Vec<String>> {
        if let Some(start) = path.iter().position(|&other| other == at) {
            return Some(path[start..].iter().map(|name| name.to_string()).collect());
        }
        if !done.insert(at) {
            return None;
        }
        path.push(at);
        let found = graph[at].iter().find_map(|next| visit(next, graph, done, path));
        path.pop();
        found
    }
    let mut done = BTreeSet::new();
    graph.keys().find_map(|at| visit(at, graph, &mut done, &mut Vec::new()))
}

#[test]
fn files_make_no_circle() {
    let graph = graph(&modules());
    let edges: usize = graph.values().map(BTreeSet::len).sum();
    assert!(edges > 500, "{edges} imports were found: the scanner is broken");
    assert_eq!(circle(&graph), None, "these files import from each other");
}

#[test]
fn a_circle_is_seen_through_a_re_export() {
    let text = |pairs: &[(&str, &str)]| {
        pairs.iter().map(|(name, text)| (name.to_string(), text.to_string())).collect()
    };
    let modules: BTreeMap<String, String> = text(&[
        ("a", "mod b; mod c; pub use b::{B, C as D};"),
        ("a::b", "use super::c::{Thing, other::X}; use std::fmt;"),
        ("a::c", "use crate::a::B;"),
    ]);
    let found = circle(&graph(&modules)).unwrap();
    assert_eq!(found, ["a::b", "a::c"]);
    let modules = text(&[("a", "mod b; mod c;"), ("a::b", "use super::c;"), ("a::c", "")]);
    assert_eq!(circle(&graph(&modules)), None);
}
