//! Messages from the engines to the display.

use super::context::{Entry, Note};
use super::outcome::Outcomes;
use super::passing::Passing;
use super::sample::{Detail, Sample};
use embassy_time::Instant;

/// A message from the engines to the display.
#[derive(Clone, Debug)]
pub enum Message {
    /// Every [`SAMPLE_EVERY`](super::sample::SAMPLE_EVERY): all engines.
    Samples {
        /// When.
        at: Instant,
        /// In the order of the list of engines.
        samples: Vec<Sample>,
        /// In the same order, or none, where no view shows them.
        details: Vec<Detail>,
    },
    /// How the run passes from now on.
    Passing(Passing),
    /// All was done; the run may still be played on.
    Complete(Box<Outcomes>),
    /// Something happened.
    Note(Note),
    /// A moment to be found again in the plot.
    Mark {
        /// When.
        at: Instant,
        /// What.
        label: String,
    },
}

impl From<Entry> for Message {
    fn from(entry: Entry) -> Self {
        match entry {
            Entry::Note(note) => Self::Note(note),
            Entry::Mark { at, label } => Self::Mark { at, label },
        }
    }
}
