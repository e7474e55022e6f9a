//! The CSV file: one row for each engine and sample.

use super::desk::Lever;
use super::quantity::seconds;
use super::sample::Sample;
use embassy_time::Instant;
use std::fs::File;
use std::io::{BufWriter, Write};

const HEAD: &str = "t_s,engine,phase,state,rpm,egt_c,command,demand_throttle_pct,demand_rpm,throttle_pct,link,frames,\
                    sent,missed,decode_errors,rejected";

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
        if sample.lever == Lever::Standby { "standby" } else { "run" }.to_owned(),
        tenths(sample.lever.throttle_percent()),
        whole(sample.lever.rpm()),
        tenths(sample.throttle),
        sample.link_name().to_owned(),
        sample.counters.frames.to_string(),
        sample.counters.sent.to_string(),
        sample.missed().to_string(),
        sample.decode_errors().to_string(),
        sample.counters.commands_rejected.to_string(),
    ]
    .join(",")
}
