//! Passes the session's messages to the screen and the files, in a thread of its own: neither a slow terminal nor a slow
//! disk may hold up an engine.

use super::capture::Capture;
use super::chronicle::Chronicle;
use super::csv::Csv;
use super::lines::Lines;
use super::message::Message;
use super::plot::Plot;
use super::unshown::ShowError;
use super::view::terminal::Screen;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::mpsc::{Receiver, RecvTimeoutError};
use std::time::Duration;

/// Time without a message after which the CSV file is flushed.
const IDLE: Duration = Duration::from_millis(200);

/// Where the run is shown.
#[derive(Debug)]
pub enum Shown {
    /// As plain lines.
    Lines(Lines),
    /// On the whole terminal.
    Screen(Box<Screen>),
}

/// The files that a run writes.
#[derive(Debug)]
pub struct Files {
    /// The engines.
    pub names: Vec<&'static str>,
    /// The CSV file, if one is wanted.
    pub csv: Option<Csv>,
    /// The data of pictures, if one is wanted.
    pub chronicle: Option<Chronicle>,
    /// The plot, if one is wanted.
    pub plot: Option<Plot>,
    /// The raw bytes, if they are wanted.
    pub capture: Option<Capture>,
}

impl Files {
    fn message(&mut self, message: &Message) -> Result<(), ShowError> {
        match message {
            Message::Note(note) => {
                if let Some(csv) = &mut self.csv {
                    csv.note(note);
                }
                if let Some(chronicle) = &mut self.chronicle {
                    chronicle.note(note);
                }
            }
            Message::Mark { at, label } => {
                if let Some(chronicle) = &mut self.chronicle {
                    chronicle.mark(*at, label);
                }
            }
            Message::Samples { at, samples, details } => {
                if let Some(csv) = &mut self.csv {
                    csv.samples(*at, &self.names, samples)?;
                }
                if let Some(chronicle) = &mut self.chronicle {
                    chronicle.samples(*at, samples);
                }
                if let Some(capture) = &mut self.capture {
                    capture.samples(details).map_err(ShowError::File)?;
                }
            }
            Message::Passing(_) | Message::Complete(_) => {}
        }
        Ok(())
    }

    /// No message has come for a while.
    fn idle(&mut self) -> Result<(), ShowError> {
        self.csv.as_mut().map_or(Ok(()), Csv::flush_in_time)
    }

    /// Completes all of them. A file that could not be written before cannot be completed either: the first error is the one.
    fn finish(self) -> (Result<(), ShowError>, Option<Chronicle>) {
        let csv = self.csv.map_or(Ok(()), Csv::finish);
        let plot = match (self.plot, &self.chronicle) {
            (Some(plot), Some(chronicle)) => plot.finish(chronicle),
            _ => Ok(()),
        };
        let capture = self.capture.map_or(Ok(()), Capture::finish);
        (csv.and(plot.and(capture).map_err(ShowError::File)), self.chronicle)
    }
}

/// Results after everything was shown.
#[derive(Debug)]
pub struct Ended {
    /// The first failure to show or write something.
    pub error: Option<ShowError>,
    /// Text to print after the terminal is restored.
    pub events: String,
    /// The data of a report.
    pub chronicle: Option<Chronicle>,
}

impl Ended {
    /// After a panic that was not caught elsewhere.
    pub const fn panicked() -> Self {
        Self { error: Some(ShowError::Panicked), events: String::new(), chronicle: None }
    }
}

/// Everything that shows a run.
#[derive(Debug)]
pub struct Show {
    /// The screen.
    pub shown: Shown,
    /// The files.
    pub files: Files,
}

impl Show {
    /// Takes messages until there are no more, or the screen takes none, and completes the files in either case.
    pub fn run(mut self, messages: &Receiver<Message>) -> Ended {
        let shown = catch_unwind(AssertUnwindSafe(|| self.messages(messages)));
        let shown = shown.unwrap_or(Err(ShowError::Panicked));
        let events = match &self.shown {
            Shown::Screen(screen) => screen.events(),
            Shown::Lines(_) => String::new(),
        };
        // The terminal is restored before anything else can be printed.
        drop(self.shown);
        let (files, chronicle) = self.files.finish();
        Ended { error: shown.and(files).err(), events, chronicle }
    }

    fn messages(&mut self, messages: &Receiver<Message>) -> Result<(), ShowError> {
        let Self { shown, files } = self;
        match shown {
            Shown::Lines(lines) => {
                loop {
                    let message = match messages.recv_timeout(IDLE) {
                        Ok(message) => message,
                        Err(RecvTimeoutError::Timeout) => {
                            files.idle()?;
                            continue;
                        }
                        Err(RecvTimeoutError::Disconnected) => return Ok(()),
                    };
                    files.message(&message)?;
                    match &message {
                        Message::Note(note) => lines.note(note),
                        Message::Samples { at, samples, .. } => lines.samples(*at, samples),
                        // A mark is also noted.
                        Message::Mark { .. } | Message::Passing(_) | Message::Complete(_) => Ok(()),
                    }
                    .map_err(ShowError::Screen)?;
                }
            }
            Shown::Screen(screen) => {
                let store = |message: Option<&Message>| match message {
                    Some(message) => files.message(message),
                    None => files.idle(),
                };
                screen.run(messages, store)?.map_err(ShowError::Screen)
            }
        }
    }
}
