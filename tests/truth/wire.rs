//! The control frames in the record of a wire, in the terms of the judge. What the bytes mean is up to the simulation's reader.

use crate::ecus;
use crate::history::Frame;
use sim::any::Protocol;
use sim::control;
use sim::wire::Entry;

#[derive(Debug)]
pub struct Reader(control::Reader);

impl Reader {
    pub const fn new(protocol: Protocol) -> Self {
        Self(control::Reader::new(protocol))
    }

    /// The frames whose last byte is in this part of the record.
    pub fn read(&mut self, record: &[Entry]) -> Vec<Frame> {
        let frame = |frame: control::Frame| Frame {
            at: frame.start / 1000,
            arrived: frame.delivered,
            sent: ecus::sent(&frame),
        };
        self.0.read(record).map(frame).collect()
    }
}
