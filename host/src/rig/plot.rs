//! The plot of a run: the engines under one another on one time axis.

mod palette;
mod panel;
mod scale;
mod subject;
mod svg;

use self::palette::Palette;
use self::panel::Panel;
use self::scale::Scale;
pub use self::subject::{Happening, Subject};
use self::svg::{Anchor, Svg, width};
use super::desk::Note;
use super::output::Whole;
use super::quantity::seconds;
use super::record::{Record, thinned};
use super::sample::Sample;
use embassy_time::Instant;

const WIDTH: f64 = 1300.0;
const HEAD: f64 = 78.0;
const FOOT: f64 = 44.0;
/// The left and the right end of the time axis.
const SIDES: (f64, f64) = (100.0, 1220.0);
/// What is shown before the first mark, in seconds.
const BEFORE_FIRST_MARK: f64 = 15.0;
/// Points of a curve: more would not be seen.
const MOST_POINTS: usize = 2400;

/// What is needed to draw, gathered while the run goes on.
#[derive(Debug)]
pub struct Plot {
    file: Whole,
    subjects: Vec<Subject>,
    title: String,
    record: Record,
    happened: Vec<Happening>,
    /// When the first mark of a scenario was set.
    first_mark: Option<f64>,
    dark: bool,
}

/// Events that a picture shows, by what they begin with, and in its words.
const SHOWN: [(&str, &str); 19] = [
    ("the line is cut", "line cut"),
    ("the line is joined again", "line joined"),
    ("faults on all lines begin", "noise begins"),
    ("faults on all lines end", "noise ends"),
    ("the flame goes out", "flame out"),
    ("its source falls silent", "source silent"),
    ("its source speaks again", "source speaks"),
    ("the source of commands is back", "in control"),
    ("SOURCE LOST: its last", "held"),
    ("SOURCE LOST: the demand", "to idle"),
    ("SOURCE LOST: standby", "standby"),
    ("LINK LOST", "link lost"),
    ("EMERGENCY STOP", "emergency stop"),
    ("FAULT: ", "fault: "),
    ("LIMIT: ", "limit: "),
    ("NOT REACHED", "NOT REACHED"),
    ("uncommanded shutdown", "uncommanded shutdown"),
    ("played: the watchdog", "node reset"),
    ("played: ", ""),
];

impl Plot {
    /// For these engines.
    pub fn create(path: &str, subjects: Vec<Subject>, title: String, dark: bool) -> Result<Self, String> {
        let record = Record::new(subjects.len());
        Ok(Self {
            file: Whole::create(path)?,
            subjects,
            title,
            record,
            happened: Vec::new(),
            first_mark: None,
            dark,
        })
    }

    /// Keeps a sample of all engines.
    pub fn samples(&mut self, at: Instant, samples: &[Sample]) {
        self.record.add(at, samples);
    }

    /// Marks this moment of a scenario.
    pub fn mark(&mut self, at: Instant, label: &str) {
        let t = seconds(at - Instant::MIN);
        self.first_mark.get_or_insert(t);
        self.happened.push(Happening { t, engine: None, text: label.to_owned() });
    }

    /// Something happened.
    pub fn note(&mut self, note: &Note) {
        let shown = SHOWN.iter().find_map(|(begins, words)| {
            let rest = note.text.strip_prefix(begins)?;
            // What is named stands behind its name, up to the next comma.
            let rest = if begins.ends_with(' ') { rest.split(',').next().unwrap_or_default() } else { "" };
            Some(format!("{words}{rest}"))
        });
        if let Some(text) = shown {
            self.happened.push(Happening { t: seconds(note.at - Instant::MIN), engine: note.engine, text });
        }
    }

    /// Draws it.
    pub fn finish(self) -> Result<(), String> {
        let picture = self.draw();
        self.file.finish(&picture)
    }

    fn draw(&self) -> String {
        let palette = Palette::of(self.dark);
        let height = HEAD + panel::HEIGHT * self.subjects.len() as f64 + FOOT;
        let mut svg = Svg::new(WIDTH, height, palette.ground);
        let last = |engine| self.record.points(engine).last().map_or(1.0, |point| point.t);
        let end = (0..self.subjects.len()).map(last).fold(1.0, f64::max);
        // A scenario's way to its first event is not what it is about.
        let begin = self.first_mark.map_or(0.0, |t| (t - BEFORE_FIRST_MARK).max(0.0));
        let time = Scale::new(begin..end, SIDES.0..SIDES.1);

        let mut each = 1;
        for (i, subject) in self.subjects.iter().enumerate() {
            let all = self.record.since(i, begin);
            let points = thinned(all, MOST_POINTS);
            each = each.max(self.record.samples_a_point() as usize * all.len().div_ceil(points.len().max(1)));
            let of_engine = |happening: &&Happening| happening.engine.is_none_or(|engine| engine == i);
            let happened: Vec<Happening> = self.happened.iter().filter(of_engine).cloned().collect();
            let panel = Panel {
                subject,
                points: &points,
                happened: &happened,
                time: &time,
                sides: SIDES,
                bands: points.len() < all.len() || self.record.samples_a_point() > 1,
                palette,
            };
            panel.draw(&mut svg, HEAD + panel::HEIGHT * i as f64);
        }
        self.head(&mut svg, palette, each);
        let y = height - FOOT;
        for mark in time.marks(12) {
            let x = time.at(mark);
            svg.line((x, y), (x, y + 6.0), palette.ink, 1.0);
            svg.text((x, y + 21.0), 14, Anchor::Middle, palette.ink, &format!("{mark:.0}"));
        }
        svg.text((SIDES.1, y + 38.0), 14, Anchor::End, palette.ink, "time in s");
        svg.finish()
    }

    /// The title and the legend, which holds for all panels. `each`: samples that the points stand for.
    fn head(&self, svg: &mut Svg, palette: Palette, each: usize) {
        svg.text((20.0, 30.0), 23, Anchor::Start, palette.ink, &self.title);
        let mut x = 20.0;
        for (name, color, wide) in [
            ("rpm", palette.rpm, 2.0),
            ("EGT", palette.egt, 2.0),
            ("demand of the source", palette.commanded, 4.0),
            ("demand on the wire", palette.sent, 2.0),
        ] {
            svg.line((x, 56.0), (x + 34.0, 56.0), color, wide);
            svg.text((x + 42.0, 61.0), 16, Anchor::Start, palette.ink, name);
            x += 70.0 + width(name, 16);
        }
        svg.path(&[(x, 56.0), (x + 34.0, 56.0)], palette.ink, 2.0, true);
        svg.text((x + 42.0, 61.0), 16, Anchor::Start, palette.ink, "no new value");
        if each > 1 {
            let text =
                format!("long run: each point is {:.1} s, a band from least to most", each as f64 / 10.0);
            svg.text((SIDES.1, 30.0), 14, Anchor::End, palette.ink, &text);
        }
    }
}
