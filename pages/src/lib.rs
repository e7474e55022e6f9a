//! Parts of the documentation that are made from code. For tests only.

use std::fs;

/// Compares the text between two lines of a page with what is made, or writes it where `JETLINK_WRITE` is set.
///
/// # Panics
/// The page does not have the lines, or something else between them.
pub fn compare(path: &str, begin: &str, end: &str, made: &str) {
    let text = fs::read_to_string(path).expect("the page can be read");
    let (before, rest) = text.split_once(begin).expect("the page marks its table");
    let (found, after) = rest.split_once(end).expect("the page marks the table's end");
    if std::env::var_os("JETLINK_WRITE").is_some() {
        fs::write(path, format!("{before}{begin}{made}{end}{after}")).expect("the page can be written");
    } else {
        assert_eq!(found, made, "rewrite it with JETLINK_WRITE=1");
    }
}
