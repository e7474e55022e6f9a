//! The CSV file: one row for each engine and sample. It is written directly and flushed every second, so that it can be
//! read while the run goes on, and a kill loses a second.

use super::audit::WireCommand;
use super::context::{Note, PilotInput};
use super::out::reader_left;
use super::output::cannot_write;
use super::quantity::seconds;
use super::sample::{Sample, loss};
use super::unshown::ShowError;
use csv::Writer;
use embassy_time::Instant;
use jetlink::command::{Order, Origin};
use serde::{Serialize, Serializer};
use std::fs::File;
use std::io;
use std::time::{Duration as WallDuration, Instant as WallInstant};

/// Between two times that rows are handed to the file.
const FLUSH_EVERY: WallDuration = WallDuration::from_secs(1);

/// One row; its fields are the columns. Empty where nothing is known.
#[derive(Serialize)]
struct Row<'a> {
    t_s: Tenths,
    engine: &'a str,
    phase: &'static str,
    state: Option<&'a str>,
    rpm: Option<u32>,
    egt_c: Option<Tenths>,
    command: &'static str,
    demand_throttle_pct: Option<Tenths>,
    demand_rpm: Option<u32>,
    throttle_pct: Option<Tenths>,
    link: &'static str,
    frames: u32,
    sent: u32,
    missed: u32,
    decode_errors: u32,
    rejected: u32,
    engine_state: &'static str,
    rules: &'static str,
    waiting: Option<&'static str>,
    loss: &'static str,
    limited: &'static str,
    armed: &'static str,
    order: &'static str,
    wire_throttle_pct: Option<Tenths>,
    wire_rpm: Option<u32>,
    faults: String,
    events: String,
}

/// A number with one decimal.
struct Tenths(f64);

impl Serialize for Tenths {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(&format_args!("{:.1}", self.0))
    }
}

/// A CSV file that is being written.
#[derive(Debug)]
pub struct Csv {
    path: String,
    file: Writer<File>,
    flushed: WallInstant,
    /// What happened since the last rows, by the place of the engine; `None`: to the whole run.
    happened: Vec<(Option<usize>, String)>,
}

impl Csv {
    /// A new file. Its head comes with the first row.
    pub fn create(path: &str) -> Result<Self, String> {
        let file = File::create(path).map_err(|error| cannot_write(path, &error))?;
        let (file, flushed) = (Writer::from_writer(file), WallInstant::now());
        Ok(Self { path: path.to_owned(), file, flushed, happened: Vec::new() })
    }

    /// Something happened: it stands in the next row of its engine.
    pub fn note(&mut self, note: &Note) {
        self.happened.push((note.engine, note.text.clone()));
    }

    /// One row for each engine.
    pub fn samples(&mut self, at: Instant, names: &[&str], samples: &[Sample]) -> Result<(), ShowError> {
        let happened = core::mem::take(&mut self.happened);
        for (i, (name, sample)) in names.iter().zip(samples).enumerate() {
            let row = Row::new(at, name, sample, events(&happened, i));
            let written = self.file.serialize(row);
            written.map_err(|error| match error.into_kind() {
                csv::ErrorKind::Io(error) => self.failed(error),
                other => ShowError::File(cannot_write(&self.path, &io::Error::other(format!("{other:?}")))),
            })?;
        }
        if self.flushed.elapsed() >= FLUSH_EVERY {
            self.flushed = WallInstant::now();
            self.flush()?;
        }
        Ok(())
    }

    /// The last bytes.
    pub fn finish(mut self) -> Result<(), ShowError> {
        self.flush()
    }

    fn flush(&mut self) -> Result<(), ShowError> {
        let flushed = self.file.flush();
        flushed.map_err(|error| self.failed(error))
    }

    /// A pipe's reader that has had enough ends the run, as one of the lines does.
    fn failed(&self, error: io::Error) -> ShowError {
        if reader_left(&error) {
            ShowError::Screen(error)
        } else {
            ShowError::File(cannot_write(&self.path, &error))
        }
    }
}

/// What happened to this engine, in a cell without commas. What concerns all stands with the first.
fn events(happened: &[(Option<usize>, String)], engine: usize) -> String {
    let of_engine = happened.iter().filter(|(of, _)| of.unwrap_or(0) == engine);
    let texts = of_engine.map(|(of, text)| {
        let text = text.replace(',', ";");
        if of.is_none() { format!("all: {text}") } else { text }
    });
    texts.collect::<Vec<_>>().join(" | ")
}

/// What the ECU reports to be wrong, in a cell without commas.
fn faults(sample: &Sample) -> String {
    let faults = sample.faults.filter(|faults| !faults.is_empty());
    faults.map_or_else(String::new, |faults| faults.to_string().replace(',', ";"))
}

impl<'a> Row<'a> {
    fn new(at: Instant, name: &'a str, sample: &'a Sample, events: String) -> Self {
        let yes_no = |yes| if yes { "yes" } else { "no" };
        Self {
            t_s: Tenths(seconds(at - Instant::MIN)),
            engine: name,
            phase: sample.stage.name(),
            state: sample.state,
            rpm: sample.rpm,
            egt_c: sample.egt.map(Tenths),
            command: match (sample.silent, sample.input) {
                (true, _) => "",
                (false, PilotInput::Standby) => "standby",
                (false, PilotInput::Run(_)) => "run",
            },
            demand_throttle_pct: sample.asked_percent().map(Tenths),
            demand_rpm: sample.asked_rpm(),
            throttle_pct: sample.throttle.map(Tenths),
            link: sample.link_name(),
            frames: sample.counters.frames,
            sent: sample.counters.sent,
            missed: sample.missed(),
            decode_errors: sample.decode_errors(),
            rejected: sample.counters.commands_rejected,
            engine_state: sample.does.name(),
            rules: sample.in_control.name(),
            waiting: sample.waiting.map(Origin::name),
            loss: loss(sample.loss),
            limited: yes_no(sample.limited),
            armed: yes_no(sample.armed),
            order: match sample.order {
                Order::EmergencyStop => "stop",
                Order::Standby => "standby",
                Order::Run(_) => "run",
                Order::Pwm => "pwm",
                Order::Listen => "listen",
                Order::Doubt(_) => "doubt",
            },
            wire_throttle_pct: match sample.on_wire {
                Some(WireCommand::Run(tenths)) => Some(Tenths(f64::from(tenths) / 10.0)),
                _ => None,
            },
            wire_rpm: match sample.on_wire {
                Some(WireCommand::RunRpm(rpm)) => Some(rpm),
                _ => None,
            },
            faults: faults(sample),
            events,
        }
    }
}
