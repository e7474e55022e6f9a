//! The screen as an SVG picture: text as runs of a fixed width, and boxes, blocks and braille as shapes, because a picture in
//! a page loads no font.

use ratatui::buffer::{Buffer, Cell};
use ratatui::style::{Color, Modifier};
use std::collections::BTreeMap;
use std::fmt::Write;

/// A cell, in pixels.
const CELL: (usize, usize) = (8, 17);
/// Around the screen.
const MARGIN: usize = 8;
/// From the top of a cell to its baseline.
const BASE: usize = 13;

/// SVG value of a colour.
fn hex(color: Color, dark: bool) -> &'static str {
    match (color, dark) {
        (Color::Green, false) => "#1a7f37",
        (Color::Green, true) => "#56d364",
        (Color::Cyan, false) => "#0b7285",
        (Color::Cyan, true) => "#39c5cf",
        (Color::Yellow, false) => "#9a6700",
        (Color::Yellow, true) => "#e3b341",
        (Color::Red, false) => "#c0281f",
        (Color::Red, true) => "#ff7b72",
        (Color::DarkGray, false) => "#8c959f",
        (Color::DarkGray, true) => "#768390",
        (_, false) => "#1f2328",
        (_, true) => "#e6edf3",
    }
}

const fn ground(dark: bool) -> &'static str {
    if dark { "#0d1117" } else { "#ffffff" }
}

/// How a character is drawn.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Kind {
    Blank,
    Text,
    Full,
    Light,
    /// Lines from the middle of the cell: left, right, up, down.
    Box(bool, bool, bool, bool),
    Braille(u8),
}

fn kind(symbol: &str) -> Kind {
    let Some(c) = symbol.chars().next() else { return Kind::Blank };
    match c {
        ' ' => Kind::Blank,
        '█' => Kind::Full,
        '░' => Kind::Light,
        '─' => Kind::Box(true, true, false, false),
        '│' => Kind::Box(false, false, true, true),
        '┌' => Kind::Box(false, true, false, true),
        '┐' => Kind::Box(true, false, false, true),
        '└' => Kind::Box(false, true, true, false),
        '┘' => Kind::Box(true, false, true, false),
        '\u{2800}'..='\u{28ff}' => Kind::Braille((c as u32 & 0xff) as u8),
        _ => Kind::Text,
    }
}

/// The dots of braille: bit, column, row.
const DOTS: [(u8, usize, usize); 8] =
    [(0, 0, 0), (1, 0, 1), (2, 0, 2), (3, 1, 0), (4, 1, 1), (5, 1, 2), (6, 0, 3), (7, 1, 3)];

/// The whole screen.
pub fn svg(buffer: &Buffer, dark: bool) -> String {
    let (columns, rows) = (usize::from(buffer.area.width), usize::from(buffer.area.height));
    let (width, height) = (columns * CELL.0 + 2 * MARGIN, rows * CELL.1 + 2 * MARGIN);
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width}\" height=\"{height}\" viewBox=\"0 0 {width} {height}\" \
         font-family=\"ui-monospace,Menlo,Consolas,monospace\" font-size=\"13\">\n<rect width=\"{width}\" height=\"{height}\" \
         rx=\"6\" fill=\"{}\"/>\n",
        ground(dark)
    );
    // Shapes of one colour are one path.
    let mut shapes: BTreeMap<&'static str, String> = BTreeMap::new();
    let mut faint: BTreeMap<&'static str, String> = BTreeMap::new();
    let mut texts = String::new();
    for y in 0..rows {
        let cell = |x: usize| &buffer[(x as u16, y as u16)];
        let mut x = 0;
        while x < columns {
            let first = cell(x);
            let same = |other: &Cell| {
                let alike = (other.fg, other.modifier) == (first.fg, first.modifier);
                let text = |kind| matches!(kind, Kind::Text | Kind::Blank);
                let (a, b) = (kind(first.symbol()), kind(other.symbol()));
                alike && (a == b || (text(a) && text(b)))
            };
            let end = (x..columns).find(|&x| !same(cell(x))).unwrap_or(columns);
            let (left, top, wide) = (MARGIN + x * CELL.0, MARGIN + y * CELL.1, (end - x) * CELL.0);
            let reversed = first.modifier.contains(Modifier::REVERSED);
            let mut ink = hex(first.fg, dark);
            if reversed {
                let _ = write!(shapes.entry(ink).or_default(), "M{left} {top}h{wide}v{}h-{wide}z", CELL.1);
                ink = ground(dark);
            }
            match kind(first.symbol()) {
                Kind::Full => {
                    let (top, high) = (top + 2, CELL.1 - 4);
                    let _ = write!(shapes.entry(ink).or_default(), "M{left} {top}h{wide}v{high}h-{wide}z");
                }
                Kind::Light => {
                    let (top, high) = (top + 2, CELL.1 - 4);
                    let _ = write!(faint.entry(ink).or_default(), "M{left} {top}h{wide}v{high}h-{wide}z");
                }
                Kind::Box(to_left, to_right, up, down) => {
                    let path = shapes.entry(ink).or_default();
                    let middle = top + CELL.1 / 2;
                    if to_left && to_right {
                        let _ = write!(path, "M{left} {middle}h{wide}v1h-{wide}z");
                    } else {
                        for x in x..end {
                            let left = MARGIN + x * CELL.0;
                            let centre = left + CELL.0 / 2;
                            if to_left || to_right {
                                let from = if to_left { left } else { centre };
                                let _ = write!(path, "M{from} {middle}h4v1h-4z");
                            }
                            let from = if up { top } else { middle };
                            let to = if down { top + CELL.1 } else { middle };
                            let _ = write!(path, "M{centre} {from}h1v{}h-1z", to - from);
                        }
                    }
                }
                Kind::Braille(_) => {
                    let path = shapes.entry(ink).or_default();
                    for x in x..end {
                        let Kind::Braille(bits) = kind(cell(x).symbol()) else { continue };
                        for (_, column, row) in DOTS.iter().filter(|(bit, ..)| bits >> bit & 1 == 1) {
                            let x = MARGIN + x * CELL.0 + 1 + column * 4;
                            let y = MARGIN + y * CELL.1 + 1 + row * 4;
                            let _ = write!(path, "M{x} {y}h2v2h-2z");
                        }
                    }
                }
                Kind::Text | Kind::Blank => {
                    let text: String = (x..end).map(|x| cell(x).symbol()).collect();
                    let before = text.len() - text.trim_start().len();
                    let shown = text.trim();
                    if !shown.is_empty() {
                        let count = shown.chars().count();
                        let (x, y, wide) = (left + before * CELL.0, top + BASE, count * CELL.0);
                        let bold = if first.modifier.contains(Modifier::BOLD) {
                            " font-weight=\"bold\""
                        } else {
                            ""
                        };
                        let shown = shown.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;");
                        let _ = writeln!(
                            texts,
                            "<text x=\"{x}\" y=\"{y}\" textLength=\"{wide}\" lengthAdjust=\"spacingAndGlyphs\" \
                             xml:space=\"preserve\" fill=\"{ink}\"{bold}>{shown}</text>"
                        );
                    }
                }
            }
            x = end;
        }
    }
    for (color, path) in faint {
        let _ = writeln!(svg, "<path d=\"{path}\" fill=\"{color}\" fill-opacity=\"0.22\"/>");
    }
    for (color, path) in shapes {
        let _ = writeln!(svg, "<path d=\"{path}\" fill=\"{color}\"/>");
    }
    svg + &texts + "</svg>\n"
}
