//! What every page of docs/ has.

use std::fs;
use std::path::Path;

#[test]
fn each_page_begins_with_its_readers() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs");
    let mut pages = 0;
    for entry in fs::read_dir(folder).expect("docs/ is there") {
        let path = entry.expect("entry is readable").path();
        if path.extension().is_none_or(|extension| extension != "md") {
            continue;
        }
        pages += 1;
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
    assert!(pages > 0);
}
