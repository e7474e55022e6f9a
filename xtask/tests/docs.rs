//! What every page has.

use std::fs;
use std::path::{Path, PathBuf};

/// Pages outside of docs/.
const OTHERS: [&str; 5] =
    ["README.md", "jetlink/README.md", "CONTRIBUTING.md", "SECURITY.md", "CHANGELOG.md"];

#[test]
fn each_page_begins_with_its_readers() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let in_docs = fs::read_dir(root.join("docs")).expect("docs/ is there");
    let in_docs = in_docs.map(|entry| entry.expect("entry is readable").path());
    let in_docs = in_docs.filter(|path| path.extension().is_some_and(|extension| extension == "md"));
    let pages: Vec<PathBuf> = in_docs.chain(OTHERS.map(|page| root.join(page))).collect();
    assert!(pages.len() > OTHERS.len());
    for path in pages {
        let page = fs::read_to_string(&path).expect("page is text");
        let mut lines = page.lines().filter(|line| !line.is_empty());
        let title = lines.next().unwrap_or_default();
        let first = lines.next().unwrap_or_default();
        assert!(title.starts_with("# "), "{}: {title}", path.display());
        assert!(
            first.starts_with("For anyone who ") || first.starts_with("For the "),
            "{}: {first}",
            path.display()
        );
    }
}
