//! How wide a text is: fonts differ, and this is one of the widest that browsers take for sans-serif, DejaVu Sans.

/// Advance widths of the characters from space to tilde, in thousandths of the font's size.
const ADVANCES: [u16; 95] = [
    318, 401, 460, 838, 636, 950, 780, 275, 390, 390, 500, 838, 318, 361, 318, 337, // space to /
    636, 636, 636, 636, 636, 636, 636, 636, 636, 636, 337, 337, 838, 838, 838, 531, // 0 to ?
    1000, 684, 686, 698, 770, 632, 575, 775, 752, 295, 295, 656, 557, 863, 748, 787, // @ to O
    603, 787, 695, 635, 611, 732, 684, 989, 685, 611, 685, 390, 337, 390, 838, 500, // P to _
    500, 613, 635, 550, 635, 615, 352, 635, 634, 278, 278, 579, 278, 974, 634, 612, // ` to o
    635, 635, 411, 521, 392, 634, 592, 818, 592, 592, 525, 636, 337, 636, 838, // p to ~
];

/// Any other character: none of those that are used is wider.
const OTHER: u16 = 1000;

/// The width of a text, in pixels.
pub fn width(text: &str, size: u32) -> f64 {
    let advance = |c: char| match c {
        '\u{a0}' => ADVANCES[0],
        '°' => ADVANCES[usize::from(b'*' - b' ')],
        c => (c as usize).checked_sub(0x20).and_then(|at| ADVANCES.get(at)).copied().unwrap_or(OTHER),
    };
    let thousandths: u32 = text.chars().map(|c| u32::from(advance(c))).sum();
    f64::from(thousandths) * f64::from(size) / 1000.0
}
