//! The control frames in the record of a wire, in the judge's terms. The simulation's decoder interprets the bytes.

use crate::ecus;
use crate::history::Frame;
use sim::any::Protocol;
use sim::control;
use sim::wire::{Direction, Entry};

/// A pause between two bytes of an ECU that ends a frame of it, ns.
const PAUSE: u64 = 2_000_000;

#[derive(Debug)]
pub struct Reader {
    frames: control::Reader,
    /// End of the last byte of the ECU.
    last: u64,
}

impl Reader {
    pub const fn new(protocol: Protocol) -> Self {
        Self { frames: control::Reader::new(protocol), last: 0 }
    }

    /// The end, in µs, of each frame of the ECU after which another one begins in this part of the record.
    pub fn ends_of_reports(&mut self, record: &[Entry]) -> Vec<u64> {
        let mut ends = Vec::new();
        for entry in record.iter().filter(|entry| entry.direction == Direction::ToNode) {
            let before = core::mem::replace(&mut self.last, entry.end);
            if before > 0 && entry.start > before + PAUSE {
                ends.push(before / 1000);
            }
        }
        ends
    }

    /// End of the last one, or of its bytes up to now.
    pub fn last_report(&self) -> Option<u64> {
        Some(self.last / 1000).filter(|last| *last > 0)
    }

    /// The frames with their last byte in this part of the record.
    pub fn read(&mut self, record: &[Entry]) -> Vec<Frame> {
        let frame = |frame: control::Frame| Frame {
            at: frame.start / 1000,
            arrived: frame.delivered,
            sent: ecus::sent(&frame),
        };
        self.frames.read(record).map(frame).collect()
    }
}
