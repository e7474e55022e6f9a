//! The record of a run.

use crate::board::Board;
use crate::chip::Rig;
use crate::fram::Fram;
use crate::image::Image;
use crate::log::Log;
use crate::wire::{Far, Wire};
use rigless::device::ResetCause;
use rigless::session::Session;
use sim::ecu::Nanos;
use std::collections::BTreeMap;
use std::hash::{DefaultHasher, Hash, Hasher};

/// One access of the core to a data register of a tapped UART.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Tap {
    /// When.
    pub at: Nanos,
    /// Number of instructions before it.
    pub instructions: u64,
    /// The port.
    pub port: &'static str,
    /// Whether the access wrote a byte, to send it, or read one.
    pub write: bool,
}

/// One write of the core to a recorded register.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Written {
    /// When.
    pub at: Nanos,
    /// The register.
    pub register: u64,
    /// The value.
    pub value: u64,
}

/// The record of a run.
pub struct Report {
    /// The board.
    pub board: &'static Board,
    /// The image.
    pub image: Image,
    /// Instructions per second of the core.
    pub instructions_per_second: u64,
    pub(crate) session: Session<Rig>,
    pub(crate) wires: BTreeMap<&'static str, Wire>,
    /// The memory of settings, if the board has one.
    pub fram: Option<Fram>,
    /// The firmware's log, over all resets.
    pub logs: Vec<Log>,
    /// The core's accesses to the tapped UARTs.
    pub taps: Vec<Tap>,
    /// The core's writes to the recorded registers.
    pub written: Vec<Written>,
    pub(crate) pins_written: Vec<Written>,
    /// When the core passed each watched label.
    pub passed: Vec<(Nanos, &'static str)>,
    /// When and why the part was reset.
    pub resets: Vec<(Nanos, ResetCause)>,
    /// When the core took a fault.
    pub faults: Vec<Nanos>,
    /// When the run ended.
    pub at: Nanos,
    /// Total number of instructions. A sleeping core executes none.
    pub instructions: u64,
}

impl Report {
    /// The wire of a port: its bytes and its ECU.
    ///
    /// # Panics
    /// If there is none.
    pub fn wire(&self, port: &str) -> &Wire {
        self.wires.get(port).unwrap_or_else(|| panic!("nothing is on {port}"))
    }

    /// All wires by port.
    pub fn wires(&self) -> impl Iterator<Item = (&'static str, &Wire)> {
        self.wires.iter().map(|(&port, wire)| (port, wire))
    }

    /// The ECU on a port.
    pub fn ecu<E: Far>(&self, port: &str) -> &E {
        self.wire(port).ecu()
    }

    /// The log lines that contain this text.
    pub fn lines<'a>(&'a self, text: &'a str) -> impl DoubleEndedIterator<Item = &'a Log> {
        self.logs.iter().filter(move |log| log.text.contains(text))
    }

    /// The events of an engine, as the firmware logs them, with their times.
    pub fn events(&self, engine: &str) -> Vec<(Nanos, &str)> {
        let sent = self.logs.iter().filter_map(|log| {
            let text = log.text.strip_prefix(engine)?.strip_prefix(": ")?;
            // A status line, once a second, has the same beginning.
            (!text.starts_with("link ")).then_some((log.at, text))
        });
        sent.collect()
    }

    /// Whether a log line contains this text.
    pub fn logged(&self, text: &str) -> bool {
        self.lines(text).next().is_some()
    }

    /// When a log line first contained this text.
    ///
    /// # Panics
    /// If none did.
    pub fn when(&self, text: &str) -> Nanos {
        let line = self.lines(text).next();
        line.unwrap_or_else(|| panic!("the firmware never logged \"{text}\":\n{}", self.log_text())).at
    }

    /// The whole log as text.
    pub fn log_text(&self) -> String {
        let line = |log: &Log| format!("{:>12.6} {} {}\n", log.at as f64 / 1e9, log.level, log.text);
        self.logs.iter().map(line).collect()
    }

    /// How busy the core was, in percent.
    pub fn load(&self) -> f64 {
        self.instructions as f64 * 1e11 / (self.instructions_per_second as f64 * self.at as f64)
    }

    /// A hash of everything that two equal runs share: every byte, log line, tap, reset and
    /// instruction.
    pub fn fingerprint(&self) -> u64 {
        let mut hasher = DefaultHasher::new();
        for (port, wire) in &self.wires {
            (port, &wire.rx, &wire.tx).hash(&mut hasher);
        }
        (&self.logs, &self.taps, &self.faults, self.at, self.instructions).hash(&mut hasher);
        format!("{:?}", self.resets).hash(&mut hasher);
        hasher.finish()
    }
}
