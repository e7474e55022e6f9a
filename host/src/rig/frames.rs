//! Frames from the bytes on a line, as the wire view shows them: both ways, with their times and their content.

use super::engines::Engine;
use super::tap::received;
use crate::telemetry::decoder::Decoder;
use crate::telemetry::{self, Hints};
use sim::any::Protocol;
use sim::control::Command;
use sim::ecu::{MILLIS, Nanos};
use sim::wire::{Direction, Entry, Fate};
use std::collections::VecDeque;

/// Bytes of one frame of the node follow each other.
const LONGEST_GAP: Nanos = 5 * MILLIS;
/// Frames that are stored.
const CAPACITY: usize = 200;
/// Bytes without a frame that are shown in one piece.
const LONGEST_SKIP: usize = 8;

/// A frame, or bytes that belong to none.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct Frame {
    /// Which way it went.
    pub direction: Direction,
    /// Its first start bit.
    pub from: Nanos,
    /// Its last stop bit.
    pub to: Nanos,
    /// As received; frames of the node, as sent.
    pub bytes: Vec<u8>,
    /// Its content in words; `None`: it is not a frame, and was skipped.
    pub text: Option<String>,
    /// Its fate at the other end.
    pub arrival: Arrival,
}

/// How much of a frame arrived as it was sent.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Arrival {
    /// All bytes.
    Whole,
    /// Not all.
    Damaged,
    /// None: the wire is cut.
    Nothing,
}

/// The reply to a frame of an AMT ECU. Its times count from the end of that frame.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Reply {
    /// Its first start bit.
    pub from: Nanos,
    /// Its last stop bit.
    pub to: Nanos,
    /// Its fate at the ECU.
    pub arrival: Arrival,
}

/// Finds the frames of one line.
#[derive(Debug)]
pub struct Frames {
    protocol: Protocol,
    decoder: Box<dyn Decoder>,
    /// Bytes from the ECU that belong to no frame yet.
    pending: VecDeque<Entry>,
    /// The frame that the node is sending.
    command: Vec<Entry>,
    frames: VecDeque<Frame>,
}

impl Frames {
    /// Of this engine's line.
    pub fn new(engine: &Engine) -> Self {
        let protocol = engine.ecu.protocol();
        Self {
            protocol,
            decoder: telemetry::Protocol::from(protocol).decoder(&Hints::default()),
            pending: VecDeque::new(),
            command: Vec::new(),
            frames: VecDeque::new(),
        }
    }

    /// The last of them, the oldest first.
    pub fn last(&self, count: usize) -> impl DoubleEndedIterator<Item = &Frame> {
        self.frames.iter().skip(self.frames.len().saturating_sub(count))
    }

    /// Takes the recording of the line.
    pub fn add(&mut self, entries: &[Entry]) {
        for entry in entries {
            match entry.direction {
                Direction::ToNode => self.ecu_byte(entry),
                Direction::ToEcu => self.node_byte(entry),
            }
        }
    }

    fn push(&mut self, direction: Direction, entries: &[Entry], text: Option<String>) {
        let (Some(first), Some(last)) = (entries.first(), entries.last()) else { return };
        let bytes = entries.iter().map(|entry| match direction {
            Direction::ToNode => received(entry).unwrap_or(entry.byte),
            Direction::ToEcu => entry.byte,
        });
        let all = |fate: Fate| entries.iter().all(|entry| entry.fate == fate);
        let arrival = match (all(Fate::Delivered), all(Fate::Lost)) {
            (true, _) => Arrival::Whole,
            (false, true) => Arrival::Nothing,
            (false, false) => Arrival::Damaged,
        };
        let frame =
            Frame { direction, from: first.start, to: last.end, bytes: bytes.collect(), text, arrival };
        // Frames of both directions come in the order of their ends.
        let place = self.frames.iter().rposition(|other| other.to <= frame.to).map_or(0, |place| place + 1);
        self.frames.insert(place, frame);
        if self.frames.len() > CAPACITY {
            self.frames.pop_front();
        }
    }

    fn ecu_byte(&mut self, entry: &Entry) {
        let Some(byte) = received(entry) else { return };
        self.pending.push_back(*entry);
        let (length, text) = match self.decoder.next_text(&[byte]).1 {
            Some((length, text)) => (length, Some(text)),
            None => (self.decoder.pending(), None),
        };
        // Bytes before the frame, or before the one begun, belong to none.
        let skipped = self.pending.len().saturating_sub(length);
        if skipped >= LONGEST_SKIP || (skipped > 0 && text.is_some()) {
            let bytes: Vec<Entry> = self.pending.drain(..skipped).collect();
            self.push(Direction::ToNode, &bytes, None);
        }
        if text.is_some() {
            let bytes: Vec<Entry> = self.pending.drain(..).collect();
            self.push(Direction::ToNode, &bytes, text);
        }
    }

    fn node_byte(&mut self, entry: &Entry) {
        if self.command.last().is_some_and(|last| entry.start > last.end + LONGEST_GAP) {
            let bytes = core::mem::take(&mut self.command);
            self.push(Direction::ToEcu, &bytes, None);
        }
        self.command.push(*entry);
        if self.command.len() == self.protocol.control_length() {
            let entries = core::mem::take(&mut self.command);
            let bytes: Vec<u8> = entries.iter().map(|entry| entry.byte).collect();
            let text = Command::read(self.protocol, &bytes).ok().map(|command| command.to_string());
            self.push(Direction::ToEcu, &entries, text);
        }
    }
}

/// A frame of an AMT ECU with the reply to it, for the window; `None` if there is none yet.
pub fn last_window(frames: &[&Frame]) -> Option<Option<Reply>> {
    let replies = |end: Nanos| {
        let reply = frames.iter().find(|frame| frame.direction == Direction::ToEcu && frame.from >= end);
        let of =
            |reply: &&Frame| Reply { from: reply.from - end, to: reply.to - end, arrival: reply.arrival };
        reply.map(of).filter(|reply| reply.from <= 30 * MILLIS)
    };
    let mut sets =
        frames.iter().rev().filter(|frame| frame.direction == Direction::ToNode && frame.text.is_some());
    let last = sets.next()?;
    match (replies(last.to), sets.next()) {
        // The reply to the last one may be under way.
        (None, Some(before)) => Some(replies(before.to)),
        (reply, _) => Some(reply),
    }
}

#[cfg(test)]
mod tests {
    use super::super::engines::engines;
    use super::*;

    fn entries(direction: Direction, from: Nanos, bytes: &[u8]) -> Vec<Entry> {
        Entry::delivered(direction, from, 4_166_667, bytes)
    }

    #[test]
    fn frames_are_found_between_stray_bytes() {
        let engines = engines(&[]).unwrap();
        let mut frames = Frames::new(&engines[0]);
        frames.add(&entries(Direction::ToNode, 0, &[0x11, 0x12, 0xFF, 0x64, 0x84, 0x7B, 0x65, 0x99]));
        frames.add(&entries(Direction::ToEcu, 40 * MILLIS, &[0xFF, 0x14, 0x65, 0x14, 0x65]));
        let all: Vec<&Frame> = frames.last(10).collect();
        assert_eq!(all.len(), 3);
        assert_eq!((all[0].text.as_deref(), all[0].bytes.as_slice()), (None, &[0x11, 0x12][..]));
        assert!(all[1].text.as_deref().unwrap().starts_with("run, full-operation, rpm byte 132, EGT 51"));
        assert_eq!(all[2].text.as_deref(), Some("run, throttle 34.5 %"));
        let reply = last_window(&all).unwrap().unwrap();
        assert_eq!((reply.from / MILLIS, reply.to / MILLIS), (6, 27));
        assert_eq!(reply.arrival, Arrival::Whole);
    }

    #[test]
    fn a_part_of_a_command_is_not_a_frame() {
        let engines = engines(&[]).unwrap();
        let mut frames = Frames::new(&engines[2]);
        frames.add(&entries(Direction::ToEcu, 0, &[0xFF, 0x00]));
        frames.add(&entries(Direction::ToEcu, 50 * MILLIS, &[0x00]));
        let all: Vec<&Frame> = frames.last(10).collect();
        assert_eq!((all.len(), all[0].text.as_deref()), (1, None));
    }

    /// Voltages have a scale that the version gives, which status 6 reports.
    #[test]
    fn the_text_of_each_zk_status_has_its_values() {
        let engines = engines(&[]).unwrap();
        let mut frames = Frames::new(&engines[2]);
        // Of a capture (tests/golden/zk-version-5.hex).
        let voltages = [0xF2, 0x39, 0x30, 0x32, 0x7B, 0x41, 0x3F];
        let all = [
            voltages,
            [0xF6, 0x39, 0x30, 0xA0, 0x7B, 0x16, 0xDC],
            voltages,
            [0xF5, 0x39, 0x30, 0x7B, 0x28, 0x1E, 0xBD],
            [0xF7, 0x39, 0x30, 0x2D, 0xED, 0x01, 0xEE],
        ];
        for (i, bytes) in all.iter().enumerate() {
            frames.add(&entries(Direction::ToNode, i as Nanos * 100 * MILLIS, bytes));
        }
        let texts = frames.last(10).filter_map(|frame| frame.text.as_deref());
        let texts: Vec<&str> = texts.filter_map(|text| text.strip_prefix("status ")).collect();
        assert_eq!(
            texts,
            [
                "2: 123450 rpm, voltages: their scale depends on the protocol version, not known yet",
                "6: 123450 rpm, maximum 160000 rpm, protocol version 5",
                "2: 123450 rpm, radio 10 V, power 24.6 V, pump 13 V",
                "5: 123450 rpm, ignition pump 2.46 V, curve increase 40, decrease 30",
                "7: 123450 rpm, flow 3.01 L/min, 12.3 L used",
            ]
        );
    }
}
