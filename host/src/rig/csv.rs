//! The CSV file: one row for each engine and sample.

use super::audit::Said;
use super::desk::Lever;
use super::quantity::seconds;
use super::sample::{Sample, loss};
use embassy_time::Instant;
use jetlink::command::{Order, Origin};
use std::fs::File;
use std::io::{BufWriter, Write};

const HEAD: &str = "t_s,engine,phase,state,rpm,egt_c,command,demand_throttle_pct,demand_rpm,throttle_pct,link,frames,\
                    sent,missed,decode_errors,rejected,engine_state,rules,waiting,loss,limited,armed,order,wire_throttle_pct,wire_rpm";

/// A CSV file that is being written.
#[derive(Debug)]
pub struct Csv {
    path: String,
    file: BufWriter<File>,
}

impl Csv {
    /// A new file with its head.
    pub fn create(path: &str) -> Result<Self, String> {
        let file = File::create(path).map_err(|error| format!("cannot write {path}: {error}"))?;
        let mut csv = Self { path: path.to_owned(), file: BufWriter::new(file) };
        csv.write(HEAD)?;
        Ok(csv)
    }

    /// One row for each engine.
    pub fn samples(&mut self, at: Instant, names: &[&str], samples: &[Sample]) -> Result<(), String> {
        for (name, sample) in names.iter().zip(samples) {
            self.write(&row(at, name, sample))?;
        }
        Ok(())
    }

    /// The last bytes.
    pub fn finish(mut self) -> Result<(), String> {
        self.file.flush().map_err(|error| format!("cannot write {}: {error}", self.path))
    }

    fn write(&mut self, line: &str) -> Result<(), String> {
        writeln!(self.file, "{line}").map_err(|error| format!("cannot write {}: {error}", self.path))
    }
}

fn row(at: Instant, name: &str, sample: &Sample) -> String {
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
    ]
    .join(",")
}
