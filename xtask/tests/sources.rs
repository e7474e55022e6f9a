//! What every source file has.

use std::fs;
use std::path::Path;

/// Most lines of one file. A longer one is about more than one thing.
const LINES: usize = 800;
/// Folders of what is not written here: build products, and clones of this repository in them.
const SKIPPED: [&str; 2] = ["target", ".git"];
/// Files that are made.
const MADE: [&str; 1] = ["mavlink/src/messages.rs"];

#[test]
fn no_source_file_is_long() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let mut read = 0;
    let mut long = Vec::new();
    visit(&root, &mut |path| {
        read += 1;
        let text = fs::read_to_string(path).expect("source is text");
        if is_long(&text) && !MADE.iter().any(|made| path.ends_with(made)) {
            long.push(path.to_owned());
        }
    });
    assert!(read > 100, "{read} files");
    assert!(long.is_empty(), "more than {LINES} lines: {long:?}");
    // The control.
    assert_eq!([LINES, LINES + 1].map(|lines| is_long(&"\n".repeat(lines))), [false, true]);
}

fn is_long(text: &str) -> bool {
    text.lines().count() > LINES
}

/// Visits each source file in a folder.
fn visit(folder: &Path, file: &mut impl FnMut(&Path)) {
    for entry in fs::read_dir(folder).expect("folder is there") {
        let path = entry.expect("entry is readable").path();
        if path.is_dir() {
            if !SKIPPED.iter().any(|skipped| path.ends_with(skipped)) {
                visit(&path, file);
            }
        } else if path.extension().is_some_and(|extension| extension == "rs") {
            file(&path);
        }
    }
}
