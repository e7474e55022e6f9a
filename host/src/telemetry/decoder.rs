//! Interface of a decoder of telemetry.

use crate::json::Record;
use std::fmt::Debug;

/// The telemetry of a protocol: its codec's frames, with names and units. It retains what the ECU has reported about itself.
pub trait Telemetry {
    /// A frame of the codec, and its content.
    type Frame;

    /// Settings of `jetlink decode`, until the stream reports them.
    type Hint: clap::Args + Copy + PartialEq + Default + Debug;

    /// Error message for a hint that is given with another protocol.
    const HINT_OF_ANOTHER: &'static str;

    /// All frames with the fields of their records, for the help: a line each, indented by four spaces.
    const FIELDS: &'static str;

    /// A decoder that has received nothing yet.
    fn new(hint: Self::Hint) -> Self;

    /// The protocol, as the command line names it.
    fn name(&self) -> &'static str;

    /// Number of bytes of a frame.
    fn len(frame: &Self::Frame) -> usize;

    /// Takes bytes up to the end of the first frame, as the codecs' decoders do, and retains what the ECU reports about itself in it.
    fn feed(&mut self, bytes: &[u8]) -> (usize, Option<Self::Frame>);

    /// A frame in one line, for people.
    fn text(&self, frame: &Self::Frame) -> String;

    /// Writes the record of a frame that ends at this offset. Returns the frame's name.
    fn write(&mut self, end: u64, frame: &Self::Frame, record: &mut Record) -> &'static str;

    /// Counters of the decoder, with names for people. They wrap at 32 bits.
    fn counters(&self) -> Vec<(&'static str, u32)>;

    /// Number of bytes of an incomplete frame.
    fn pending(&self) -> usize;
}

/// A decoder of any protocol. Each `next_` takes bytes up to the end of the first frame and returns how many it took.
pub trait Decoder: Debug + Send {
    /// The protocol, as the command line names it.
    fn name(&self) -> &'static str;

    /// The length of the next frame.
    fn next_length(&mut self, bytes: &[u8]) -> (usize, Option<usize>);

    /// The length of the next frame, and its text for people.
    fn next_text(&mut self, bytes: &[u8]) -> (usize, Option<(usize, String)>);

    /// The length of the next frame, and its name; writes its record. `before`: offset of the first byte.
    fn next_record(
        &mut self,
        before: u64,
        bytes: &[u8],
        record: &mut Record,
    ) -> (usize, Option<(usize, &'static str)>);

    /// Counters, with names for people. They wrap at 32 bits.
    fn counters(&self) -> Vec<(&'static str, u32)>;

    /// Number of bytes of an incomplete frame.
    fn pending(&self) -> usize;
}

impl<T: Telemetry + Debug + Send> Decoder for T {
    fn name(&self) -> &'static str {
        Telemetry::name(self)
    }

    fn next_length(&mut self, bytes: &[u8]) -> (usize, Option<usize>) {
        let (taken, frame) = self.feed(bytes);
        (taken, frame.map(|frame| T::len(&frame)))
    }

    fn next_text(&mut self, bytes: &[u8]) -> (usize, Option<(usize, String)>) {
        let (taken, frame) = self.feed(bytes);
        (taken, frame.map(|frame| (T::len(&frame), self.text(&frame))))
    }

    fn next_record(
        &mut self,
        before: u64,
        bytes: &[u8],
        record: &mut Record,
    ) -> (usize, Option<(usize, &'static str)>) {
        let (taken, frame) = self.feed(bytes);
        (taken, frame.map(|frame| (T::len(&frame), self.write(before + taken as u64, &frame, record))))
    }

    fn counters(&self) -> Vec<(&'static str, u32)> {
        Telemetry::counters(self)
    }

    fn pending(&self) -> usize {
        Telemetry::pending(self)
    }
}
