//! Imports go one way: in no package do files import one another in a circle.
//!
//! A node is a file. An edge is every `use`, every re-export, and every inline path, those in attributes included, outside
//! `#[cfg(test)]`, that names something in another file of the same package. A `mod` line is none: it says where a file is, not
//! what its parent needs. Calls of methods are also edges, where the `impl` of a type is in several files: `imports/methods.rs`.
//!
//! The same holds for test programs, where the tests themselves are included.

#[path = "imports/methods.rs"]
mod methods;
#[path = "imports/planted.rs"]
mod planted;
#[path = "imports/source.rs"]
mod source;

use source::{Crate, Edges, root};
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

/// The imports between files, or their method calls.
fn edges(crate_: &Crate) -> Edges {
    let mut edges = crate_.imports();
    for (file, targets) in methods::edges(crate_) {
        edges.entry(file).or_default().extend(targets);
    }
    edges
}

/// The first circle that is found: its files, in the order in which each imports the next.
fn circle(edges: &Edges) -> Option<Vec<PathBuf>> {
    fn walk(
        file: &PathBuf,
        edges: &Edges,
        way: &mut Vec<PathBuf>,
        done: &mut BTreeSet<PathBuf>,
    ) -> Option<Vec<PathBuf>> {
        if let Some(start) = way.iter().position(|before| before == file) {
            return Some(way[start..].to_vec());
        }
        if !done.insert(file.clone()) {
            return None;
        }
        way.push(file.clone());
        let found = edges.get(file).into_iter().flatten().find_map(|next| walk(next, edges, way, done));
        way.pop();
        found
    }
    let mut done = BTreeSet::new();
    edges.keys().find_map(|file| walk(file, edges, &mut Vec::new(), &mut done))
}

/// Fails with the circle, file by file.
fn assert_one_way(root: &Path) {
    let edges = edges(&Crate::read(root));
    if let Some(circle) = circle(&edges) {
        let files: Vec<String> = circle.iter().map(|file| file.display().to_string()).collect();
        panic!("{} imports in a circle:\n  {}", root.display(), files.join("\n  imports "));
    }
}

/// The folder of every package, with a trailing slash; that of the root is empty. Members of the workspace, and packages that it
/// excludes.
fn packages() -> Vec<String> {
    let manifest = std::fs::read_to_string(root("Cargo.toml")).unwrap();
    let list = |key: &str| -> Vec<String> {
        let line = manifest.lines().find_map(|line| line.strip_prefix(key)).expect("a list in one line");
        line.split('"').skip(1).step_by(2).map(str::to_owned).collect()
    };
    let mut found = vec![String::new()];
    for folder in list("members = ").into_iter().chain(list("exclude = ")) {
        let below = names(&folder).into_iter().map(|name| format!("{folder}/{name}"));
        let all = std::iter::once(folder.clone()).chain(below);
        found
            .extend(all.filter(|folder| root(folder).join("Cargo.toml").exists()).map(|folder| folder + "/"));
    }
    found
}

/// The names in a folder, none if there is no such folder.
fn names(folder: &str) -> Vec<String> {
    let entries = std::fs::read_dir(root(folder)).into_iter().flatten().flatten();
    entries.map(|entry| entry.file_name().display().to_string()).collect()
}

/// The roots of the programs in a folder: `name.rs` and `name/main.rs`.
fn programs(folder: &str) -> Vec<String> {
    let all = names(folder).into_iter().map(|name| format!("{folder}/{name}"));
    let roots = all.map(|name| if name.ends_with(".rs") { name } else { name + "/main.rs" });
    roots.filter(|name| root(name).exists()).collect()
}

/// The roots of every package's libraries and programs.
fn crates() -> Vec<String> {
    let mut found = Vec::new();
    for package in packages() {
        let single = ["src/lib.rs", "src/main.rs", "build.rs"].map(|name| format!("{package}{name}"));
        found.extend(single.into_iter().filter(|name| root(name).exists()));
        found.extend(
            ["src/bin", "examples"].iter().flat_map(|folder| programs(&format!("{package}{folder}"))),
        );
    }
    found
}

/// The roots of every package's test programs and benchmarks.
fn test_programs() -> Vec<String> {
    let folders = ["tests", "benches"];
    let all = packages().into_iter().flat_map(|package| folders.map(|folder| format!("{package}{folder}")));
    all.flat_map(|folder| programs(&folder)).collect()
}

#[test]
fn circles_are_sought_in_every_package() {
    let found = crates();
    for root in [
        "src/lib.rs",
        "src/main.rs",
        "build.rs",
        "jetlink/src/lib.rs",
        "commands/src/lib.rs",
        "host/src/main.rs",
        "emulation/src/lib.rs",
        "emulation/src/bin/emu.rs",
        "examples/embedded/src/main.rs",
        "examples/linux/src/main.rs",
    ] {
        assert!(found.iter().any(|name| name == root), "{root}: {found:?}");
    }
}

#[test]
fn circles_are_sought_in_test_programs_too() {
    let found = test_programs();
    for program in [
        "jetlink/tests/it/main.rs",
        "tests/truth/main.rs",
        "tests/wire_zk.rs",
        "emulation/tests/board/main.rs",
    ] {
        assert!(found.iter().any(|name| name == program), "{program}: {found:?}");
    }
}

#[test]
fn no_package_has_a_circle_of_imports() {
    let packages = crates().into_iter().map(|file| {
        let edges = edges(&Crate::read(&root(&file)));
        (file, edges)
    });
    let tests = test_programs().into_iter().map(|file| {
        let edges = edges(&Crate::read_test_program(&root(&file)));
        (file, edges)
    });
    let found: Vec<String> = packages
        .chain(tests)
        .filter_map(|(file, edges)| {
            let circle = circle(&edges)?;
            let files: Vec<String> = circle.iter().map(|file| file.display().to_string()).collect();
            Some(format!("{file}:\n  {}", files.join("\n  imports ")))
        })
        .collect();
    assert!(found.is_empty(), "imports in a circle\n{}", found.join("\n"));
}

#[test]
fn every_kind_of_import_is_seen() {
    let edges = edges(&Crate::read(&root("jetlink/src/lib.rs")));
    let imports = |from: &str, to: &str| {
        edges
            .get(&root(&format!("jetlink/src/{from}")))
            .is_some_and(|files| files.contains(&root(&format!("jetlink/src/{to}"))))
    };
    assert!(imports("ecu/zk/link.rs", "ecu/zk/codec/mod.rs"), "use super::");
    assert!(imports("command.rs", "limit.rs"), "use crate::");
    assert!(imports("ecu/mod.rs", "ecu/zk/codec/mod.rs"), "a path without a use");
    assert!(!imports("limit.rs", "command.rs"));
}
