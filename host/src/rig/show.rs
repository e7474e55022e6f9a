//! Takes what the session sends and gives it to the screen, the CSV file and the plot, in a thread of its
//! own: neither a slow terminal nor a slow disk may hold up an engine.

use super::lines::Lines;
use super::sample::Message;
use embassy_time::Duration;
use std::sync::mpsc::Receiver;

/// Where the run is shown.
#[derive(Debug)]
pub enum Screen {
    /// As plain lines.
    Lines(Lines),
}

/// Everything that shows a run.
#[derive(Debug)]
pub struct Show {
    /// The screen.
    pub screen: Screen,
}

impl Show {
    /// Takes messages until there are no more, or something cannot be written.
    pub fn run(mut self, messages: &Receiver<Message>) -> Result<Self, String> {
        while let Ok(message) = messages.recv() {
            self.message(&message)?;
        }
        Ok(self)
    }

    fn message(&mut self, message: &Message) -> Result<(), String> {
        let shown = match (&mut self.screen, message) {
            (Screen::Lines(lines), Message::Note(note)) => lines.note(note),
            (Screen::Lines(lines), Message::Samples { at, samples }) => lines.samples(*at, samples),
        };
        shown.map_err(|error| format!("cannot write to the standard output: {error}"))
    }
}

/// Between two lines of one engine, in engine time.
pub const fn lines_every(fast_on_terminal: bool) -> Duration {
    Duration::from_secs(if fast_on_terminal { 30 } else { 5 })
}
