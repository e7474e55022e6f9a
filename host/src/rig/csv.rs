//! The CSV file: one row for each engine and sample. It is written directly and flushed every second, so that it can be
//! read during the run, and a kill loses 1 s at most.

use super::audit::WireCommand;
use super::context::{Note, PilotInput};
use super::ending::EndRequest;
use super::out::reader_left;
use super::output::cannot_write;
use super::quantity::seconds;
use super::sample::{Sample, loss};
use super::unshown::ShowError;
use super::waiting;
use csv::Writer;
use embassy_time::Instant;
use jetlink::command::{Order, Origin};
use std::fs::File;
use std::io;
use std::time::{Duration as WallDuration, Instant as WallInstant};

/// Between two times that rows are handed to the file.
const FLUSH_EVERY: WallDuration = WallDuration::from_secs(1);

/// A CSV file that is being written.
#[derive(Debug)]
pub struct Csv {
    path: String,
    file: Writer<File>,
    has_head: bool,
    flushed: WallInstant,
    /// What happened since the last rows, by the place of the engine; `None`: to the whole run.
    happened: Vec<(Option<usize>, String)>,
}

impl Csv {
    /// A new file. Its head comes with the first row.
    pub fn create(path: &str, end: &EndRequest) -> Result<Self, String> {
        let file = waiting::create(path, end).map_err(|error| cannot_write(path, &error))?;
        let (file, flushed) = (Writer::from_writer(file), WallInstant::now());
        Ok(Self { path: path.to_owned(), file, has_head: false, flushed, happened: Vec::new() })
    }

    /// Something happened: the next row of its engine contains it.
    pub fn note(&mut self, note: &Note) {
        self.happened.push((note.engine, note.text.clone()));
    }

    /// One row for each engine.
    pub fn samples(&mut self, at: Instant, names: &[&str], samples: &[Sample]) -> Result<(), ShowError> {
        let happened = core::mem::take(&mut self.happened);
        for (i, (name, sample)) in names.iter().zip(samples).enumerate() {
            let row = row(at, name, sample, events(&happened, i));
            let head =
                (!self.has_head).then(|| self.file.write_record(row.each_ref().map(|(head, _)| *head)));
            self.has_head = true;
            let written = head.unwrap_or(Ok(()));
            let written = written.and_then(|()| self.file.write_record(row.each_ref().map(|(_, cell)| cell)));
            written.map_err(|error| {
                let text = error.to_string();
                match error.into_kind() {
                    csv::ErrorKind::Io(error) => self.failed(error),
                    _ => ShowError::File(cannot_write(&self.path, &io::Error::other(text))),
                }
            })?;
        }
        self.flush_in_time()
    }

    /// Writes rows to the file when it is time, even without new ones: the run may be paused or show its verdict.
    pub fn flush_in_time(&mut self) -> Result<(), ShowError> {
        if self.flushed.elapsed() < FLUSH_EVERY {
            return Ok(());
        }
        self.flushed = WallInstant::now();
        self.flush()
    }

    /// The last bytes.
    pub fn finish(mut self) -> Result<(), ShowError> {
        self.flush()
    }

    fn flush(&mut self) -> Result<(), ShowError> {
        let flushed = self.file.flush();
        flushed.map_err(|error| self.failed(error))
    }

    /// A pipe's reader that closes it ends the run, as for the lines.
    fn failed(&self, error: io::Error) -> ShowError {
        if reader_left(&error) {
            ShowError::Screen(error)
        } else {
            ShowError::File(cannot_write(&self.path, &error))
        }
    }
}

/// Events of this engine, in a cell without commas. Events of all engines are in the first engine's row.
fn events(happened: &[(Option<usize>, String)], engine: usize) -> String {
    let of_engine = happened.iter().filter(|(of, _)| of.unwrap_or(0) == engine);
    let texts = of_engine.map(|(of, text)| {
        let text = text.replace(',', ";");
        if of.is_none() { format!("all: {text}") } else { text }
    });
    texts.collect::<Vec<_>>().join(" | ")
}

/// Faults reported by the ECU, in a cell without commas.
fn faults(sample: &Sample) -> String {
    let faults = sample.faults.filter(|faults| !faults.is_empty());
    faults.map_or_else(String::new, |faults| faults.to_string().replace(',', ";"))
}

/// A cell; empty where nothing is known.
fn cell(value: Option<impl ToString>) -> String {
    value.map_or_else(String::new, |value| value.to_string())
}

/// A number with one decimal.
fn tenths(value: f64) -> String {
    format!("{value:.1}")
}

/// One row: its columns, each with its cell.
fn row(at: Instant, name: &str, sample: &Sample, events: String) -> [(&'static str, String); 29] {
    let yes_no = |yes| if yes { "yes" } else { "no" }.to_owned();
    let command = match (sample.silent, sample.input) {
        (true, _) => "",
        (false, PilotInput::Standby) => "standby",
        (false, PilotInput::Run(_)) => "run",
    };
    let order = match sample.order {
        Order::EmergencyStop => "stop",
        Order::Standby => "standby",
        Order::Run(_) => "run",
        Order::Pwm => "pwm",
        Order::Listen => "listen",
        Order::Doubt(_) => "doubt",
    };
    let (wire_percent, wire_rpm) = match sample.on_wire {
        Some(WireCommand::Run(tenths)) => (Some(f64::from(tenths) / 10.0), None),
        Some(WireCommand::RunRpm(rpm)) => (None, Some(rpm)),
        _ => (None, None),
    };
    [
        ("t_s", tenths(seconds(at - Instant::MIN))),
        ("engine", name.to_owned()),
        ("phase", sample.stage.name().to_owned()),
        ("state", cell(sample.state)),
        ("rpm", cell(sample.rpm)),
        ("egt_c", cell(sample.egt.map(tenths))),
        ("command", command.to_owned()),
        ("demand_throttle_pct", cell(sample.commanded_percent().map(tenths))),
        ("demand_rpm", cell(sample.commanded_rpm())),
        ("throttle_pct", cell(sample.throttle.map(tenths))),
        ("link", sample.link_name().to_owned()),
        ("frames", sample.counters.frames.to_string()),
        ("sent", sample.counters.sent.to_string()),
        ("missed", sample.missed().to_string()),
        ("decode_errors", sample.decode_errors().to_string()),
        ("rejected", sample.counters.commands_rejected.to_string()),
        ("engine_state", sample.does.name().to_owned()),
        ("in_control", sample.in_control.name().to_owned()),
        ("waiting", cell(sample.waiting.map(Origin::name))),
        ("loss", loss(sample.loss).to_owned()),
        ("limited", yes_no(sample.limited)),
        ("armed", yes_no(sample.armed)),
        ("order", order.to_owned()),
        ("wire_throttle_pct", cell(wire_percent.map(tenths))),
        ("wire_rpm", cell(wire_rpm)),
        ("fuel_valve", cell(sample.valve_open.map(|open| if open { "open" } else { "closed" }))),
        ("starter_power", cell(sample.power.map(|on| if on { "on" } else { "off" }))),
        ("faults", faults(sample)),
        ("events", events),
    ]
}
