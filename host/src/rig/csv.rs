//! The CSV file: one row for each engine and sample. It is written directly and flushed every second, so that it can be
//! read while the run goes on, and a kill loses a second.

use super::audit::Said;
use super::desk::{Lever, Note};
use super::output::cannot_write;
use super::quantity::seconds;
use super::sample::{Sample, loss};
use embassy_time::Instant;
use jetlink::command::{Order, Origin};
use std::fs::File;
use std::io::{BufWriter, Write};
use std::time::{Duration as WallDuration, Instant as WallInstant};

/// Between two times that rows are handed to the file.
const FLUSH_EVERY: WallDuration = WallDuration::from_secs(1);

const HEAD: &str = "t_s,engine,phase,state,rpm,egt_c,command,demand_throttle_pct,demand_rpm,throttle_pct,link,frames,\
                    sent,missed,decode_errors,rejected,engine_state,rules,waiting,loss,limited,armed,order,wire_throttle_pct,wire_rpm,\
                    faults,events";

/// A CSV file that is being written.
#[derive(Debug)]
pub struct Csv {
    path: String,
    file: BufWriter<File>,
    flushed: WallInstant,
    /// What happened since the last rows, by the place of the engine; `None`: to the whole run.
    happened: Vec<(Option<usize>, String)>,
}

impl Csv {
    /// A new file with its head.
    pub fn create(path: &str) -> Result<Self, String> {
        let file = File::create(path).map_err(|error| cannot_write(path, &error))?;
        let (file, flushed) = (BufWriter::new(file), WallInstant::now());
        let mut csv = Self { path: path.to_owned(), file, flushed, happened: Vec::new() };
        csv.write(HEAD)?;
        Ok(csv)
    }

    /// Something happened: it stands in the next row of its engine.
    pub fn note(&mut self, note: &Note) {
        self.happened.push((note.engine, note.text.clone()));
    }

    /// One row for each engine.
    pub fn samples(&mut self, at: Instant, names: &[&str], samples: &[Sample]) -> Result<(), String> {
        let happened = core::mem::take(&mut self.happened);
        for (i, (name, sample)) in names.iter().zip(samples).enumerate() {
            self.write(&row(at, name, sample, &events(&happened, i)))?;
        }
        if self.flushed.elapsed() >= FLUSH_EVERY {
            self.flushed = WallInstant::now();
            self.flush()?;
        }
        Ok(())
    }

    /// The last bytes.
    pub fn finish(mut self) -> Result<(), String> {
        self.flush()
    }

    fn flush(&mut self) -> Result<(), String> {
        self.file.flush().map_err(|error| cannot_write(&self.path, &error))
    }

    fn write(&mut self, line: &str) -> Result<(), String> {
        writeln!(self.file, "{line}").map_err(|error| cannot_write(&self.path, &error))
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

fn row(at: Instant, name: &str, sample: &Sample, events: &str) -> String {
    let tenths = |value: Option<f64>| value.map_or_else(String::new, |value| format!("{value:.1}"));
    let whole = |value: Option<u32>| value.map_or_else(String::new, |value| value.to_string());
    [
        format!("{:.1}", seconds(at - Instant::MIN)),
        name.to_owned(),
        sample.stage.name().to_owned(),
        sample.state.unwrap_or_default().to_owned(),
        whole(sample.rpm),
        tenths(sample.egt),
        match (sample.silent, sample.lever) {
            (true, _) => "",
            (false, Lever::Standby) => "standby",
            (false, Lever::Run(_)) => "run",
        }
        .to_owned(),
        tenths(sample.asked_percent()),
        whole(sample.asked_rpm()),
        tenths(sample.throttle),
        sample.link_name().to_owned(),
        sample.counters.frames.to_string(),
        sample.counters.sent.to_string(),
        sample.missed().to_string(),
        sample.decode_errors().to_string(),
        sample.counters.commands_rejected.to_string(),
        sample.does.name().to_owned(),
        sample.ruler.name().to_owned(),
        sample.waiting.map_or("", Origin::name).to_owned(),
        loss(sample.loss).to_owned(),
        if sample.limited { "yes" } else { "no" }.to_owned(),
        if sample.armed { "yes" } else { "no" }.to_owned(),
        match sample.order {
            Order::EmergencyStop => "stop",
            Order::Standby => "standby",
            Order::Run(_) => "run",
            Order::Pwm => "pwm",
            Order::Listen => "listen",
            Order::Doubt(_) => "doubt",
        }
        .to_owned(),
        tenths(match sample.on_wire {
            Some(Said::Run(tenths)) => Some(f64::from(tenths) / 10.0),
            _ => None,
        }),
        whole(match sample.on_wire {
            Some(Said::RunRpm(rpm)) => Some(rpm),
            _ => None,
        }),
        faults(sample),
        events.to_owned(),
    ]
    .join(",")
}
