//! The tests that docs/hazards.md names exist.

mod files;

use std::collections::HashSet;
use std::fs;
use std::path::Path;

const HEADER: &str = "| hazard | causes | barriers | tests | remaining risk |";
const TESTS: usize = 3;

#[test]
fn each_hazard_names_tests_that_exist() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let page = fs::read_to_string(root.join("docs/hazards.md")).expect("page is text");
    let mut tests = HashSet::new();
    files::visit(&root, &mut |file| {
        tests.extend(tests_of(&fs::read_to_string(file).expect("source is text")));
    });
    assert!(tests.len() > 1000, "{} tests", tests.len());
    assert!(rows(&page).len() > 10, "{} hazards", rows(&page).len());
    assert_eq!(problems(&page, &tests), [""; 0]);
}

#[test]
fn an_unknown_name_a_helper_and_a_row_without_a_test_are_found() {
    let source = "#[test]\n#[should_panic(expected = \"no\")]\nfn rain_is_wet() {}\nfn helper_of_rain() {}\n";
    let tests: HashSet<String> = tests_of(source).collect();
    assert_eq!(tests, HashSet::from(["rain_is_wet".to_owned()]));

    let page = |cell: &str| {
        format!("# Hazards\n\n{HEADER}\n|---|---|---|---|---|\n| Rain | | | {cell} | |\n\n| a | b |\n")
    };
    let found = |cell: &str| problems(&page(cell), &tests);
    assert_eq!(found("`weather/rain.rs`: `rain_is_wet`; rule Wet of `truth/`"), [""; 0]);
    assert_eq!(found("none: nothing shows it"), [""; 0]);
    assert_eq!(found("`rain_is_wet`, `snow_is_cold`"), ["Rain: `snow_is_cold` is not a test"]);
    assert_eq!(found("`helper_of_rain`"), ["Rain: `helper_of_rain` is not a test"]);
    assert_eq!(found("`weather/rain.rs`"), ["Rain: neither a test nor \"none\""]);
    // A cell too many hides the column.
    assert_eq!(found("`rain_is_wet` | "), ["Rain: 6 cells"]);
}

/// What is wrong with the column "tests" of the table of hazards.
fn problems(page: &str, tests: &HashSet<String>) -> Vec<String> {
    let mut problems = Vec::new();
    for row in rows(page) {
        let hazard = row[0];
        if row.len() != HEADER.split(" | ").count() {
            problems.push(format!("{hazard}: {} cells", row.len()));
            continue;
        }
        let names = names(row[TESTS]);
        if names.is_empty() && !row[TESTS].starts_with("none") {
            problems.push(format!("{hazard}: neither a test nor \"none\""));
        }
        let unknown = names.iter().filter(|name| !tests.contains(**name));
        problems.extend(unknown.map(|name| format!("{hazard}: `{name}` is not a test")));
    }
    problems
}

/// Cells of each row of the table of hazards.
fn rows(page: &str) -> Vec<Vec<&str>> {
    let table = page.lines().skip_while(|line| *line != HEADER).skip(2);
    let rows = table.take_while(|line| line.starts_with('|'));
    rows.map(|row| row.trim_matches('|').split('|').map(str::trim).collect()).collect()
}

/// Words in backticks that can be the name of a function: not paths, and not commands.
fn names(cell: &str) -> Vec<&str> {
    let quoted = cell.split('`').skip(1).step_by(2);
    let is_name = |name: &&str| {
        name.bytes().all(|byte| byte == b'_' || byte.is_ascii_lowercase() || byte.is_ascii_digit())
    };
    quoted.filter(is_name).collect()
}

/// Names of the functions behind `#[test]`, with other attributes between them or not.
fn tests_of(source: &str) -> impl Iterator<Item = String> + '_ {
    let after = source.split("#[test]\n").skip(1);
    let names = after.filter_map(|text| text.lines().find_map(|line| line.trim().strip_prefix("fn ")));
    names.filter_map(|name| name.split('(').next()).map(str::to_owned)
}
