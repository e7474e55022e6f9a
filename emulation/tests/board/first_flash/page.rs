//! The tables of docs/first-flash.md: the columns of the two chips, and how they are compared with the values of the
//! emulated boards.

use std::collections::BTreeMap;

/// The page.
pub const PAGE: &str = include_str!(concat!(env!("CARGO_MANIFEST_DIR"), "/../docs/first-flash.md"));

/// In place of a value that the emulator cannot show.
const NOT_SHOWN: &str = "not shown";

/// The columns with values from the emulator, by their headings.
const CHIPS: [&str; 2] = ["H743", "F427"];

/// A row of the page, by its section and words in it that no other row of the section has; and the chip.
pub type Place = (u8, &'static str, &'static str);

/// One cell with a value from the emulator.
struct Cell<'a> {
    /// Counted from 0.
    line: usize,
    /// Cell of the line, counted from 0.
    number: usize,
    section: u8,
    chip: &'static str,
    /// The text to the left of the values.
    row: String,
    value: &'a str,
}

/// The cells of a line of a table.
fn cells(line: &str) -> Option<Vec<&str>> {
    let inner = line.trim().strip_prefix('|')?.strip_suffix('|')?;
    Some(inner.split('|').map(str::trim).collect())
}

/// All cells of the page in the columns of the two chips.
fn values(page: &str) -> Vec<Cell<'_>> {
    let (mut section, mut columns) = (0, Vec::new());
    let mut found = Vec::new();
    for (number, line) in page.lines().enumerate() {
        if let Some(heading) = line.strip_prefix("## ") {
            section = heading.split('.').next().and_then(|number| number.parse().ok()).unwrap_or(0);
        }
        let Some(cells) = cells(line) else {
            columns.clear();
            continue;
        };
        if columns.is_empty() {
            let place = |chip| cells.iter().position(|cell| *cell == chip).map(|at| (at, chip));
            columns = CHIPS.into_iter().filter_map(place).collect();
            // The other rows of a table without values have no values either.
            if columns.is_empty() {
                columns.push((usize::MAX, ""));
            }
            continue;
        }
        let first = columns[0].0;
        for &(at, chip) in &columns {
            let Some(&value) = cells.get(at) else { continue };
            if !value.starts_with("---") {
                let row = cells[..first].join(" | ");
                found.push(Cell { line: number, number: at, section, chip, row, value });
            }
        }
    }
    found
}

/// Differences between page and measurements: a line for each cell with another value, each cell without a
/// measurement, and each measurement without a cell.
pub fn complaints(page: &str, measured: &BTreeMap<Place, String>) -> Vec<String> {
    let cells = values(page);
    let mut complaints = Vec::new();
    for (place @ (section, words, chip), found) in measured {
        match &of(&cells, place)[..] {
            [cell] if agrees(cell.value, found) => {}
            [cell] => complaints.push(format!(
                "line {}, {chip}: {}: the page says {:?}, the emulator {found:?}",
                cell.line + 1,
                cell.row,
                cell.value
            )),
            none_or_more => complaints.push(format!(
                "section {section}: {} cells for {chip} of \"{words}\": {found:?}",
                none_or_more.len()
            )),
        }
    }
    for cell in cells.iter().filter(|cell| cell.value != NOT_SHOWN) {
        if !measured.keys().any(|place| is_at(cell, place)) {
            let (line, row) = (cell.line + 1, &cell.row);
            complaints.push(format!("line {line}, {}: {row}: {:?} was not measured", cell.chip, cell.value));
        }
    }
    complaints
}

/// The page with the measurements in its cells.
pub fn renewed(page: &str, measured: &BTreeMap<Place, String>) -> String {
    let mut lines: Vec<String> = page.lines().map(str::to_string).collect();
    for (place, found) in measured {
        for cell in of(&values(page), place) {
            let mut cells: Vec<String> =
                self::cells(&lines[cell.line]).expect("a row").into_iter().map(str::to_string).collect();
            if !agrees(&cells[cell.number], found) {
                cells[cell.number].clone_from(found);
                lines[cell.line] = format!("| {} |", cells.join(" | ")).replace("|  |", "| |");
            }
        }
    }
    lines.join("\n") + "\n"
}

fn is_at(cell: &Cell<'_>, (section, words, chip): &Place) -> bool {
    cell.section == *section && cell.chip == *chip && cell.row.contains(words)
}

fn of<'a, 'b>(cells: &'b [Cell<'a>], place: &Place) -> Vec<&'b Cell<'a>> {
    cells.iter().filter(|cell| is_at(cell, place)).collect()
}

/// Tolerance of a number: a share of it, plus a number of its units. Beyond it a person has to look.
type Tolerance = (f64, f64);

/// The unit of a number: the unit and the tolerance of its comparison. Times of less than a millisecond are
/// counts of instructions, which every build moves.
fn unit(word: &str, number: f64) -> Option<(f64, &'static str, Tolerance)> {
    let time = |ns: f64| (ns, "ns", if number * ns < 1e6 { (0.25, 0.0) } else { (0.1, 0.0) });
    Some(match word {
        "ns" => time(1.0),
        "us" | "µs" => time(1e3),
        "ms" => time(1e6),
        "s" => time(1e9),
        "bytes" => (1.0, "bytes", (0.1, 0.0)),
        "Hz" => (1.0, "Hz", (0.001, 0.0)),
        "kHz" => (1e3, "Hz", (0.001, 0.0)),
        "ppm" => (1.0, "ppm", (0.0, 10.0)),
        _ => return None,
    })
}

/// Whether a cell agrees with the measurement: word for word, except that numbers with a unit may differ within that unit's
/// tolerance.
fn agrees(cell: &str, found: &str) -> bool {
    let words = |text: &str| -> Vec<String> {
        let spaced = text.replace(',', " ,").replace(';', " ;").replace('`', " ` ");
        spaced.split_whitespace().map(str::to_string).collect()
    };
    let (cell, found) = (words(cell), words(found));
    let mut at = 0;
    while at < cell.len().max(found.len()) {
        let (Some(expected), Some(word)) = (cell.get(at), found.get(at)) else { return false };
        let measure = |words: &[String]| {
            let number: f64 = words[at].parse().ok()?;
            let (factor, kind, tolerance) = unit(words.get(at + 1)?, number)?;
            Some((number * factor, kind, tolerance))
        };
        match (measure(&cell), measure(&found)) {
            (Some((expected, kind, (part, units))), Some((number, other, _))) if kind == other => {
                if (number - expected).abs() > (part * expected.abs()).max(units) {
                    return false;
                }
                at += 2;
            }
            _ if expected == word => at += 1,
            _ => return false,
        }
    }
    true
}

/// The page's own values, as if they had been measured.
fn own_values() -> BTreeMap<Place, String> {
    let leak = |text: String| -> &'static str { Box::leak(text.into_boxed_str()) };
    values(PAGE)
        .into_iter()
        .filter(|cell| cell.value != NOT_SHOWN)
        .map(|cell| ((cell.section, leak(cell.row), cell.chip), cell.value.to_string()))
        .collect()
}

#[test]
fn the_page_agrees_with_itself_and_has_values_for_both_chips_in_each_section() {
    let own = own_values();
    assert_eq!(complaints(PAGE, &own), Vec::<String>::new());
    assert_eq!(renewed(PAGE, &own), PAGE);
    for section in 2..=9 {
        for chip in CHIPS.into_iter().filter(|chip| section != 8 || *chip == "F427") {
            assert!(own.keys().any(|place| place.0 == section && place.2 == chip), "{section} {chip}");
        }
    }
}

/// Each value of the page, one after the other, with another number or other words in its place.
#[test]
fn a_wrong_value_anywhere_on_the_page_is_found() {
    let own = own_values();
    assert!(own.len() > 60, "{}", own.len());
    for (place, value) in &own {
        let digit = value.find(|c: char| c.is_ascii_digit() && c != '0');
        let wrong = match digit {
            // The first digit that counts, by a third or more.
            Some(at) => {
                let digit = if value[at..].starts_with(['6', '7', '8', '9']) { "1" } else { "9" };
                format!("{}{digit}{}", &value[..at], &value[at + 1..])
            }
            None => format!("not {value}"),
        };
        let cell = |value: &str| format!("| {value} |");
        let line = values(PAGE).into_iter().find(|cell| is_at(cell, place)).expect("its cell").line;
        let mut lines: Vec<String> = PAGE.lines().map(str::to_string).collect();
        let planted = lines[line].replacen(&cell(value), &cell(&wrong), 1);
        assert_ne!(planted, lines[line], "{place:?}");
        lines[line] = planted;
        let complaints = complaints(&lines.join("\n"), &own);
        assert!(complaints.iter().any(|line| line.contains("the page says")), "{place:?}: {wrong:?}");
    }
}

#[test]
fn a_row_without_a_measurement_and_a_measurement_without_a_row_are_found() {
    let mut measured = own_values();
    let row = *measured.keys().find(|place| place.0 == 3).expect("a row");
    let value = measured.remove(&row).expect("it was there");
    let found = complaints(PAGE, &measured);
    assert!(matches!(&found[..], [one] if one.ends_with("was not measured")), "{found:?}");
    measured.insert(row, value);
    measured.insert((3, "a row that is not there", "H743"), "1 ms".to_string());
    let found = complaints(PAGE, &measured);
    assert!(matches!(&found[..], [one] if one.starts_with("section 3: 0 cells")), "{found:?}");
}

#[test]
fn numbers_agree_within_the_tolerance_of_their_unit_and_words_exactly() {
    for (cell, found) in [
        ("2.30 ms", "2.40 ms"),
        ("1.00 ms", "999 µs"),
        ("20.0 µs to 30.0 µs", "22.0 µs to 25.0 µs"),
        ("5600 bytes deep, 0x22", "5700 bytes deep, 0x22"),
        ("HSI 0 ppm", "HSI -4 ppm"),
    ] {
        assert!(agrees(cell, found), "{cell} {found}");
    }
    for (cell, found) in [
        ("2.30 ms", "2.60 ms"),
        ("2.30 ms", "2.30 s"),
        ("2.30 ms", "2.30"),
        ("20.0 µs to 30.0 µs", "20.0 µs"),
        ("20.0 µs", "20.0 µs to 30.0 µs"),
        ("5600 bytes deep, 0x22", "5600 bytes deep, 0x23"),
        ("5", "4"),
        ("`reset pin`", "`power-on`"),
        ("HSI 0 ppm", "HSI 20 ppm"),
        ("LSI 32000 Hz", "LSI 32100 Hz"),
    ] {
        assert!(!agrees(cell, found), "{cell} {found}");
    }
}
