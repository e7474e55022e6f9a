//! What every source file has.

mod files;

use std::fs;
use std::path::Path;

/// Most lines of one file. A longer one is about more than one thing.
const LINES: usize = 800;
/// Files that are made.
const MADE: [&str; 1] = ["mavlink/src/messages.rs"];

#[test]
fn no_source_file_is_long() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let mut read = 0;
    let mut long = Vec::new();
    files::visit(&root, &mut |path| {
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
