//! Counters of a simulated ZK ECU.

use crate::ecu::{Counts, Nanos};

/// Invalid frames, by reason.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Bad {
    /// Wrong CRC.
    pub crc: u64,
    /// Unknown command ID.
    pub id: u64,
    /// A value out of range.
    pub range: u64,
}

impl Bad {
    /// All of them.
    pub const fn total(&self) -> u64 {
        self.crc + self.id + self.range
    }
}

/// Good frames that changed nothing, by reason.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Ignored {
    /// The ECU's version does not support it. It is not answered either.
    pub version: u64,
    /// ID 4 or 5 without ID 3 directly before. It is not answered either.
    pub locked: u64,
    /// ID 1 in rpm mode, or ID 7 outside of it.
    pub mode: u64,
    /// A service command while the engine was not at rest.
    pub busy: u64,
}

/// The times between accepted commands.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Intervals {
    /// Their number.
    pub count: u64,
    /// The shortest.
    pub min: Option<Nanos>,
    /// The longest.
    pub max: Option<Nanos>,
}

impl Intervals {
    pub(super) fn add(&mut self, interval: Nanos) {
        self.count += 1;
        self.min = Some(self.min.map_or(interval, |min| min.min(interval)));
        self.max = Some(self.max.map_or(interval, |max| max.max(interval)));
    }
}

/// Counters of a ZK ECU since its creation; a loss of power does not clear them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Stats {
    /// Status frames sent, by ID.
    pub frames: [u64; 16],
    /// Commands that were obeyed but not answered, because an answer was already waiting.
    pub unanswered: u64,
    /// Good frames with a command that the version supports; all but the ignored ones are obeyed.
    pub accepted: u64,
    /// Good frames that changed nothing.
    pub ignored: Ignored,
    /// Invalid frames.
    pub bad: Bad,
    /// Good frames with reserved bits that were not 0.
    pub reserved_bits: u64,
    /// Good bytes outside of any frame.
    pub stray_bytes: u64,
    /// Good bytes.
    pub bytes_received: u64,
    /// Bytes received with an error.
    pub framing_errors: u64,
    /// The times between accepted commands, within one power-up.
    pub intervals: Intervals,
    /// Number of times the control signal of a live engine was lost.
    pub control_losses: u64,
    /// Pressures received.
    pub pressures: u64,
}

impl Stats {
    /// All status frames sent.
    pub fn frames_sent(&self) -> u64 {
        self.frames.iter().sum()
    }

    /// The counters that every ECU has.
    pub fn counts(&self) -> Counts {
        Counts {
            frames: self.frames_sent(),
            accepted: self.accepted,
            bad: self.bad.total() + self.reserved_bits + self.ignored.version,
            loss_stops: self.control_losses,
            intervals: self.intervals.min.zip(self.intervals.max),
            ..Counts::default()
        }
    }

    /// Faults that a host following the protocol never causes, in sentences.
    pub fn host_faults(&self) -> Vec<&'static str> {
        let found = [
            (self.reserved_bits > 0, "it received reserved bits other than 0"),
            (self.ignored != Ignored::default(), "it received commands that do not fit its version or state"),
            (self.control_losses > 0, "it lost its control signal"),
        ];
        found.into_iter().filter_map(|(found, text)| found.then_some(text)).collect()
    }
}
