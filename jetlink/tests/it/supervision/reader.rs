//! Finds the node's frames in the record of a wire. The simulation's reader decodes the bytes.

use super::ecus;
use super::wire::Frame;
use sim::any::Protocol;
use sim::control;
use sim::wire::Entry;

#[derive(Debug)]
pub struct Reader(control::Reader);

impl Reader {
    pub const fn new(protocol: Protocol) -> Self {
        Self(control::Reader::new(protocol))
    }

    /// Each frame with the beginning of its first start bit, in µs.
    pub fn read(&mut self, record: &[Entry], mut each: impl FnMut(u64, Frame)) {
        for read in self.0.read(record) {
            each(read.start / 1000, ecus::frame(&read));
        }
    }
}
