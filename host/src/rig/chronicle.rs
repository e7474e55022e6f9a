//! The data of a run's pictures: the record of its engines, and the events. Plot and report use the same data.

use super::context::Note;
use super::quantity::seconds;
use super::record::Record;
use super::sample::Sample;
use super::title::Title;
use embassy_time::Instant;

/// Largest number of notes that are stored.
const MOST_NOTES: usize = 10_000;

/// Something that happened.
#[derive(Clone, PartialEq, Debug)]
pub struct Happening {
    /// When, in seconds.
    pub t: f64,
    /// The engine; `None`: all.
    pub engine: Option<usize>,
    /// What.
    pub text: String,
}

/// Data of one engine for the pictures.
#[derive(Debug)]
pub struct Subject {
    /// Its name.
    pub name: &'static str,
    /// Its description.
    pub caption: String,
    /// Shaft speed at full throttle.
    pub max_rpm: f64,
    /// Above this EGT in °C the node reports a limit.
    pub egt_limit: Option<f64>,
    /// It is commanded by rpm.
    pub by_rpm: bool,
}

/// The content of the pictures of a run, gathered during it.
#[derive(Debug)]
pub struct Chronicle {
    /// Description of the run.
    pub title: Title,
    /// The engines.
    pub subjects: Vec<Subject>,
    /// Their recorded samples.
    pub record: Record,
    /// What is marked in a picture, in few words.
    pub happened: Vec<Happening>,
    /// When the first mark of a scenario was set, in seconds.
    pub first_mark: Option<f64>,
    /// All that happened, in sentences.
    pub notes: Vec<Note>,
    /// Number of further notes that were not stored.
    pub dropped: usize,
}

/// Events that a picture shows, by the beginning of their text, and the text in the picture.
const SHOWN: [(&str, &str); 19] = [
    ("the line is cut", "line cut"),
    ("the line is joined again", "line joined"),
    ("faults on all lines begin", "noise begins"),
    ("faults on all lines end", "noise ends"),
    ("the flame goes out", "flame out"),
    ("its source falls silent", "source silent"),
    ("its source commands again", "source back"),
    ("source received again", "in control"),
    ("source lost: hold", "held"),
    ("source lost: fail-safe", "to idle"),
    ("source lost: standby", "standby"),
    ("ECU link lost", "link lost"),
    ("emergency stop", "emergency stop"),
    ("ECU reports a fault: ", "fault: "),
    ("limit violated: ", "limit: "),
    ("NOT REACHED", "NOT REACHED"),
    ("uncommanded shutdown", "uncommanded shutdown"),
    ("played: the watchdog", "node reset"),
    ("played: ", ""),
];

/// An event in the few words of a picture; `None`: it is not marked there.
pub fn shown(text: &str) -> Option<String> {
    SHOWN.iter().find_map(|(begins, words)| {
        let rest = text.strip_prefix(begins)?;
        // A name is followed by its value, up to the next comma.
        let rest = if begins.ends_with(' ') { rest.split(',').next().unwrap_or_default() } else { "" };
        Some(format!("{words}{rest}"))
    })
}

impl Chronicle {
    /// Of these engines.
    pub fn new(title: Title, subjects: Vec<Subject>) -> Self {
        let record = Record::new(subjects.len());
        Self {
            title,
            subjects,
            record,
            happened: Vec::new(),
            first_mark: None,
            notes: Vec::new(),
            dropped: 0,
        }
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
        if note.text.starts_with("played: ") {
            self.title.played();
        }
        if self.notes.len() < MOST_NOTES {
            self.notes.push(note.clone());
        } else {
            self.dropped += 1;
        }
        if let Some(text) = shown(&note.text) {
            self.happened.push(Happening { t: seconds(note.at - Instant::MIN), engine: note.engine, text });
        }
    }

    /// When the last sample was taken, in seconds.
    pub fn end(&self) -> f64 {
        let last = |engine| self.record.points(engine).last().map_or(1.0, |point| point.t);
        (0..self.subjects.len()).map(last).fold(1.0, f64::max)
    }
}
