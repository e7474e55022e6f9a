//! The plot of a run: the engines under one another on one time axis.

mod font;
mod marks;
mod palette;
mod panel;
mod scale;
mod svg;

use self::font::width;
use self::palette::Palette;
use self::panel::Panel;
use self::scale::Scale;
use self::svg::{Anchor, Stroke, Svg};
use super::chronicle::{Chronicle, Happening};
use super::ending::EndRequest;
use super::output::Whole;
use super::record::thinned;

const WIDTH: f64 = 1300.0;
/// The title's first line and the legend.
const HEAD: f64 = 78.0;
/// Each further line of the title.
const TITLE_LINE: f64 = 28.0;
/// The left end of the title, and the room to its right, in pixels.
const TITLE_SIDE: f64 = 20.0;
const TITLE_SIZE: u32 = 23;
const FOOT: f64 = 44.0;
/// The left and the right end of the time axis.
const SIDES: (f64, f64) = (100.0, 1220.0);
/// Time shown before the first mark, in seconds.
const BEFORE_FIRST_MARK: f64 = 15.0;
/// Largest number of points of a curve: more would not be visible.
const MOST_POINTS: usize = 2400;

/// A picture that is to be written at the end of the run.
#[derive(Debug)]
pub struct Plot {
    file: Whole,
    dark: bool,
}

impl Plot {
    /// To be written here.
    pub fn new(path: &str, dark: bool, end: &EndRequest) -> Self {
        Self { file: Whole::new(path, end), dark }
    }

    /// Draws it.
    pub fn finish(self, chronicle: &Chronicle) -> Result<(), String> {
        let picture = Picture { chronicle, dark: self.dark }.draw();
        self.file.finish(&picture)
    }
}

/// What is drawn.
#[derive(Debug)]
struct Picture<'a> {
    chronicle: &'a Chronicle,
    dark: bool,
}

impl Picture<'_> {
    fn draw(&self) -> String {
        let palette = Palette::of(self.dark);
        let Chronicle { record, subjects, happened, first_mark, .. } = self.chronicle;
        let title = lines(&self.chronicle.title.to_string(), TITLE_SIZE, WIDTH - 2.0 * TITLE_SIDE);
        let head = HEAD + TITLE_LINE * title.len().saturating_sub(1) as f64;
        // The time before a scenario's first event is of little interest.
        let begin = first_mark.map_or(0.0, |t| (t - BEFORE_FIRST_MARK).max(0.0));
        let time = Scale::new(begin..self.chronicle.end(), SIDES.0..SIDES.1);
        let happened: Vec<Vec<Happening>> = (0..subjects.len())
            .map(|i| {
                let of_engine = |happening: &&Happening| happening.engine.is_none_or(|engine| engine == i);
                happened.iter().filter(of_engine).cloned().collect()
            })
            .collect();
        let lanes = happened.iter().map(|of_engine| marks::lanes(of_engine, &time, SIDES)).max().unwrap_or(0);
        let panel_height = panel::height(lanes);
        let height = head + panel_height * subjects.len() as f64 + FOOT;
        let mut svg = Svg::new(WIDTH, height, palette.ground);

        let mut each = 1;
        for (i, (subject, happened)) in subjects.iter().zip(&happened).enumerate() {
            let all = record.since(i, begin);
            let points = thinned(all, MOST_POINTS);
            each = each.max(record.samples_a_point() as usize * all.len().div_ceil(points.len().max(1)));
            let panel = Panel {
                subject,
                points: &points,
                happened,
                lanes,
                time: &time,
                sides: SIDES,
                bands: points.len() < all.len() || record.samples_a_point() > 1,
                palette,
            };
            panel.draw(&mut svg, head + panel_height * i as f64);
        }
        self.head(&mut svg, palette, &title);
        let y = height - FOOT;
        for mark in time.marks(12) {
            let x = time.at(mark);
            svg.line((x, y), (x, y + 6.0), palette.ink, 1.0);
            svg.text((x, y + 21.0), 14, Anchor::Middle, palette.ink, &format!("{mark:.0}"));
        }
        svg.text((SIDES.1, y + 38.0), 14, Anchor::End, palette.ink, "time in s");
        if each > 1 {
            let text =
                format!("long run: each point is {:.1} s, a band from least to most", each as f64 / 10.0);
            svg.text((SIDES.0, y + 38.0), 14, Anchor::Start, palette.ink, &text);
        }
        svg.finish()
    }

    /// The title and the legend, which holds for all panels.
    fn head(&self, svg: &mut Svg, palette: Palette, title: &[String]) {
        let mut y = 30.0;
        for line in title {
            svg.text((TITLE_SIDE, y), TITLE_SIZE, Anchor::Start, palette.ink, line);
            y += TITLE_LINE;
        }
        // The legend, below the last line.
        let y = y - TITLE_LINE + 26.0;
        let mut x = 20.0;
        for (name, color, wide) in [
            ("rpm", palette.rpm, 2.0),
            ("EGT", palette.egt, 2.0),
            ("demand of the source", palette.commanded, 4.0),
            ("demand on the wire", palette.sent, 2.0),
        ] {
            svg.line((x, y), (x + 34.0, y), color, wide);
            svg.text((x + 42.0, y + 5.0), 16, Anchor::Start, palette.ink, name);
            x += 70.0 + width(name, 16);
        }
        for (name, color, stroke) in
            [("no new value", palette.ink, Stroke::Dashed), ("EGT limit", palette.egt, Stroke::Dotted)]
        {
            svg.path(&[(x, y), (x + 34.0, y)], color, 2.0, stroke);
            svg.text((x + 42.0, y + 5.0), 16, Anchor::Start, palette.ink, name);
            x += 70.0 + width(name, 16);
        }
    }
}

/// A text in lines that are no wider than this, broken between words.
fn lines(text: &str, size: u32, most: f64) -> Vec<String> {
    let mut lines: Vec<String> = Vec::new();
    for word in text.split_whitespace() {
        match lines.last_mut() {
            Some(line) if width(&format!("{line} {word}"), size) <= most => {
                line.push(' ');
                line.push_str(word);
            }
            _ => lines.push(word.to_owned()),
        }
    }
    lines
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_title_is_broken_between_words_before_it_runs_out_of_the_picture() {
        let text = "one two three four";
        assert_eq!(lines(text, 10, width("one two three", 10)), ["one two three", "four"]);
        assert_eq!(lines(text, 10, width(text, 10)), [text]);
        assert_eq!(lines("", 10, 100.0), Vec::<String>::new());
    }
}
