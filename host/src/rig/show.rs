//! Takes what the session sends and gives it to the screen, the CSV file and the plot, in a thread of its
//! own: neither a slow terminal nor a slow disk may hold up an engine.

use super::csv::Csv;
use super::lines::Lines;
use super::plot::Plot;
use super::sample::Message;
use super::table::Table;
use std::io;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::mpsc::Receiver;

/// Where the run is shown.
#[derive(Debug)]
pub enum Screen {
    /// As plain lines.
    Lines(Lines),
    /// As a live table.
    Table(Box<Table>),
}

/// Everything that shows a run.
#[derive(Debug)]
pub struct Show {
    /// The engines.
    pub names: Vec<&'static str>,
    /// The screen.
    pub screen: Screen,
    /// The CSV file, if one is wanted.
    pub csv: Option<Csv>,
    /// The plot, if one is wanted.
    pub plot: Option<Plot>,
}

/// Why a run could not be shown.
#[derive(Debug)]
pub enum ShowError {
    /// What text goes to takes nothing.
    Screen(io::Error),
    /// A file takes nothing.
    File(String),
    /// A panic, whose message has been printed.
    Panicked,
}

impl Show {
    /// Takes messages until there are no more, or the screen takes none, and completes the files in either case.
    pub fn run(mut self, messages: &Receiver<Message>) -> Result<(), ShowError> {
        let shown = catch_unwind(AssertUnwindSafe(|| self.messages(messages)));
        let shown = shown.unwrap_or(Err(ShowError::Panicked));
        // The terminal is put back before anything else can be printed.
        drop(self.screen);
        // A file that could not be written before cannot be completed either: the first error is the one.
        let csv = self.csv.map_or(Ok(()), Csv::finish).map_err(ShowError::File);
        let plot = self.plot.map_or(Ok(()), Plot::finish).map_err(ShowError::File);
        shown.and(csv).and(plot)
    }

    fn messages(&mut self, messages: &Receiver<Message>) -> Result<(), ShowError> {
        while let Ok(message) = messages.recv() {
            let shown = match (&mut self.screen, &message) {
                (Screen::Lines(lines), Message::Note(note)) => lines.note(note),
                (Screen::Lines(lines), Message::Samples { at, samples }) => lines.samples(*at, samples),
                (Screen::Table(table), Message::Note(note)) => {
                    table.note(note);
                    Ok(())
                }
                (Screen::Table(table), Message::Samples { at, samples }) => table.samples(*at, samples),
                // It is noted too.
                (_, Message::Mark { .. }) => Ok(()),
            };
            if let (Message::Mark { at, label }, Some(plot)) = (&message, &mut self.plot) {
                plot.mark(*at, label);
            }
            if let (Message::Note(note), Some(csv)) = (&message, &mut self.csv) {
                csv.note(note);
            }
            if let Message::Samples { at, samples } = &message {
                if let Some(csv) = &mut self.csv {
                    csv.samples(*at, &self.names, samples).map_err(ShowError::File)?;
                }
                if let Some(plot) = &mut self.plot {
                    plot.samples(*at, samples);
                }
            }
            shown.map_err(ShowError::Screen)?;
        }
        Ok(())
    }
}
