//! What a run leaves behind.

use crate::board::Board;
use crate::chip::Rig;
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
    /// After how many instructions.
    pub instructions: u64,
    /// The port.
    pub port: &'static str,
    /// Whether a byte was written, to be sent; else it was read.
    pub write: bool,
}

/// One write of the core to a recorded register.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Written {
    /// When.
    pub at: Nanos,
    /// The register.
    pub register: u64,
    /// What.
    pub value: u64,
}

/// What a run leaves behind.
pub struct Report {
    /// The board.
    pub board: &'static Board,
    /// The image.
    pub image: Image,
    /// How many instructions a second the core did.
    pub instructions_per_second: u64,
    pub(crate) session: Session<Rig>,
    pub(crate) wires: BTreeMap<&'static str, Wire>,
    /// The firmware's log, over all resets.
    pub logs: Vec<Log>,
    /// What the core did with the tapped UARTs.
    pub taps: Vec<Tap>,
    /// What the core wrote to the recorded registers.
    pub written: Vec<Written>,
    /// When the core came by which of the watched labels.
    pub passed: Vec<(Nanos, &'static str)>,
    /// When and why the part was reset.
    pub resets: Vec<(Nanos, ResetCause)>,
    /// When the core took a fault.
    pub faults: Vec<Nanos>,
    /// The end.
    pub at: Nanos,
    /// Instructions in all; a core that sleeps does none.
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
        let told = self.logs.iter().filter_map(|log| {
            let text = log.text.strip_prefix(engine)?.strip_prefix(": ")?;
            // A status line, once a second, begins so too.
            (!text.starts_with("link ")).then_some((log.at, text))
        });
        told.collect()
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

    /// A number that is the same for two runs only if they were the same: every byte, log line, tap, reset and
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
