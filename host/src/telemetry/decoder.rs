//! Interface of a decoder of telemetry.

use crate::json::Hex;
use serde::ser::SerializeMap;
use serde::{Serialize, Serializer};
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

    /// The bytes of a frame.
    fn raw(frame: &Self::Frame) -> &[u8];

    /// The name of a frame.
    fn frame_name(frame: &Self::Frame) -> &'static str;

    /// Takes bytes up to the end of the first frame, as the codecs' decoders do, and retains what the ECU reports about itself in it.
    fn feed(&mut self, bytes: &[u8]) -> (usize, Option<Self::Frame>);

    /// A frame in one line, for people.
    fn text(&self, frame: &Self::Frame) -> String;

    /// Writes the content of a frame.
    ///
    /// # Errors
    /// Those of the writer.
    fn fields<M: SerializeMap>(&self, frame: &Self::Frame, map: &mut M) -> Result<(), M::Error>;

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

    /// The length of the next frame, and its name; replaces the line by its record. `before`: offset of the first byte.
    fn next_record(
        &mut self,
        before: u64,
        bytes: &[u8],
        line: &mut Vec<u8>,
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
        (taken, frame.map(|frame| T::raw(&frame).len()))
    }

    fn next_text(&mut self, bytes: &[u8]) -> (usize, Option<(usize, String)>) {
        let (taken, frame) = self.feed(bytes);
        (taken, frame.map(|frame| (T::raw(&frame).len(), self.text(&frame))))
    }

    fn next_record(
        &mut self,
        before: u64,
        bytes: &[u8],
        line: &mut Vec<u8>,
    ) -> (usize, Option<(usize, &'static str)>) {
        let (taken, frame) = self.feed(bytes);
        let frame = frame.map(|frame| {
            line.clear();
            let record = Record { telemetry: self, end: before + taken as u64, frame: &frame };
            // Memory takes everything, and no key is anything but a text.
            let _ = serde_json::to_writer(&mut *line, &record);
            line.push(b'\n');
            (T::raw(&frame).len(), T::frame_name(&frame))
        });
        (taken, frame)
    }

    fn counters(&self) -> Vec<(&'static str, u32)> {
        Telemetry::counters(self)
    }

    fn pending(&self) -> usize {
        Telemetry::pending(self)
    }
}

/// The JSON object of a frame that ends at this offset of the input.
struct Record<'a, T: Telemetry> {
    telemetry: &'a T,
    end: u64,
    frame: &'a T::Frame,
}

impl<T: Telemetry> Serialize for Record<'_, T> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let raw = T::raw(self.frame);
        let mut map = serializer.serialize_map(None)?;
        map.serialize_entry("offset", &(self.end - raw.len() as u64))?;
        map.serialize_entry("protocol", Telemetry::name(self.telemetry))?;
        map.serialize_entry("frame", T::frame_name(self.frame))?;
        map.serialize_entry("raw", &Hex(raw))?;
        self.telemetry.fields(self.frame, &mut map)?;
        map.end()
    }
}
