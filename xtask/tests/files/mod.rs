//! The source files of the repository.

use std::fs;
use std::path::Path;

/// Folders of what is not written here: build products, and clones of this repository in them.
const SKIPPED: [&str; 2] = ["target", ".git"];

/// Visits each source file in a folder.
pub fn visit(folder: &Path, file: &mut impl FnMut(&Path)) {
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
