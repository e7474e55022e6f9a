//! Every reading point of the two protocols is asserted by a test that names it, and cited where the code
//! follows it, so that a user with a differing ECU finds the one place to change.

use std::fs;
use std::path::{Path, PathBuf};

/// ZK-1 to ZK-16 and AMT-1 to AMT-14.
fn points() -> impl Iterator<Item = (&'static str, u32)> {
    (1..=16).map(|number| ("ZK", number)).chain((1..=14).map(|number| ("AMT", number)))
}

fn rust_files(folder: &Path, into: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(folder).expect("folder is there") {
        let path = entry.expect("entry is readable").path();
        if path.is_dir() {
            rust_files(&path, into);
        } else if path.extension().is_some_and(|extension| extension == "rs") {
            into.push(path);
        }
    }
}

fn sources(folder: &str) -> Vec<String> {
    let mut files = Vec::new();
    rust_files(&Path::new(env!("CARGO_MANIFEST_DIR")).join(folder), &mut files);
    files.into_iter().map(|file| fs::read_to_string(file).expect("file is text")).collect()
}

/// Whether `text` contains `name` without a letter or digit next to it: `ZK-1` is not in `ZK-16`.
fn names(text: &str, name: &str) -> bool {
    text.match_indices(name).any(|(at, _)| {
        let before = text[..at].chars().next_back();
        let after = text[at + name.len()..].chars().next();
        !before.is_some_and(char::is_alphanumeric) && !after.is_some_and(|c| c.is_ascii_digit())
    })
}

/// Name and doc comment of every test of a file, also of those inside `proptest!`.
fn tests_of(source: &str) -> Vec<String> {
    let (mut tests, mut doc, mut is_test) = (Vec::new(), String::new(), false);
    for line in source.lines().map(str::trim) {
        if line.starts_with("///") {
            doc.push_str(line);
        } else if line == "#[test]" {
            is_test = true;
        } else if let Some(name) = line.strip_prefix("fn ") {
            if is_test {
                let name = name.split('(').next().unwrap_or_default();
                tests.push(format!("{doc} {name}"));
            }
            (doc, is_test) = (String::new(), false);
        } else if !line.starts_with("#[") && !line.starts_with("//") {
            (doc, is_test) = (String::new(), false);
        }
    }
    tests
}

#[test]
fn every_point_is_named_by_a_test() {
    let tests: Vec<String> = sources("tests").iter().flat_map(|source| tests_of(source)).collect();
    let missing: Vec<String> = points()
        .filter(|(protocol, number)| {
            let in_doc = format!("{protocol}-{number}");
            let in_name = format!("{}_{number}_", protocol.to_lowercase());
            !tests.iter().any(|test| names(test, &in_doc) || test.contains(&format!(" {in_name}")))
        })
        .map(|(protocol, number)| format!("{protocol}-{number}"))
        .collect();
    assert!(missing.is_empty(), "no test names {missing:?}");
}

#[test]
fn every_point_is_cited_in_the_source() {
    let sources = sources("src");
    let missing: Vec<String> = points()
        .map(|(protocol, number)| format!("{protocol}-{number}"))
        .filter(|point| !sources.iter().any(|source| names(source, point)))
        .collect();
    assert!(missing.is_empty(), "src cites no {missing:?}");
}

#[test]
fn a_point_is_not_found_inside_a_longer_number() {
    assert!(names("see ZK-1.", "ZK-1") && names("(ZK-1)", "ZK-1"));
    assert!(!names("see ZK-16", "ZK-1") && !names("BZK-1", "ZK-1"));
    let source = "/// AMT-3\n#[test]\nfn a() {\n}\n/// ZK-2\nfn helper() {}\n#[test]\nfn zk_4_b() {}";
    assert_eq!(tests_of(source), ["/// AMT-3 a", " zk_4_b"]);
}
