//! Takes what the session sends and gives it to the screen, the CSV file and the plot, in a thread of its
//! own: neither a slow terminal nor a slow disk may hold up an engine.

use super::csv::Csv;
use super::lines::Lines;
use super::plot::Plot;
use super::sample::Message;
use super::table::Table;
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

impl Show {
    /// Takes messages until there are no more, or somebody ends the run, and completes the files.
    pub fn run(mut self, messages: &Receiver<Message>) -> Result<(), String> {
        let shown = self.messages(messages);
        // The terminal is put back before anything else can be printed.
        drop(self.screen);
        shown?;
        if let Some(csv) = self.csv {
            csv.finish()?;
        }
        self.plot.map_or(Ok(()), Plot::finish)
    }

    fn messages(&mut self, messages: &Receiver<Message>) -> Result<(), String> {
        let cannot_show = |error| format!("cannot write to the standard output: {error}");
        while let Ok(message) = messages.recv() {
            let go_on = match (&mut self.screen, &message) {
                (Screen::Lines(lines), Message::Note(note)) => lines.note(note).map(|()| true),
                (Screen::Lines(lines), Message::Samples { at, samples }) => {
                    lines.samples(*at, samples).map(|()| true)
                }
                (Screen::Table(table), Message::Note(note)) => {
                    table.note(note);
                    Ok(true)
                }
                (Screen::Table(table), Message::Samples { at, samples }) => table.samples(*at, samples),
                // It is noted too.
                (_, Message::Mark { .. }) => Ok(true),
            };
            if let (Message::Mark { at, label }, Some(plot)) = (&message, &mut self.plot) {
                plot.mark(*at, label);
            }
            if let Message::Samples { at, samples } = &message {
                if let Some(csv) = &mut self.csv {
                    csv.samples(*at, &self.names, samples)?;
                }
                if let Some(plot) = &mut self.plot {
                    plot.samples(*at, samples);
                }
            }
            if !go_on.map_err(cannot_show)? {
                return Ok(());
            }
        }
        Ok(())
    }
}
