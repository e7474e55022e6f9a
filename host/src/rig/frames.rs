//! Frames out of the bytes on a line, as the wire view shows them: both ways, with their times, and what they say.

use super::engines::{Ecu as Kind, Engine};
use super::tap::received;
use jetlink::ecu::amt::codec as amt;
use jetlink::ecu::zk::codec as zk;
use sim::ecu::{MILLIS, Nanos};
use sim::wire::{Direction, Entry, Fate};
use std::collections::VecDeque;

/// Bytes of one frame of the node follow each other.
const LONGEST_GAP: Nanos = 5 * MILLIS;
/// Bytes of a command, by protocol.
const AMT_COMMAND: usize = 5;
const ZK_COMMAND: usize = 4;
/// Frames that are kept.
const KEPT: usize = 200;
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
    /// As the receiver got it; of the node, as it was sent.
    pub bytes: Vec<u8>,
    /// What it says; `None`: it is no frame, and was skipped.
    pub text: Option<String>,
    /// A byte of it did not arrive as it was sent.
    pub damaged: bool,
}

#[derive(Debug)]
enum Decoder {
    Amt(amt::Decoder),
    Zk(zk::Decoder),
}

/// Finds the frames of one line.
#[derive(Debug)]
pub struct Frames {
    kind: Kind,
    decoder: Decoder,
    /// Bytes from the ECU that belong to no frame yet.
    pending: VecDeque<Entry>,
    /// The frame of the node under way.
    command: Vec<Entry>,
    kept: VecDeque<Frame>,
}

impl Frames {
    /// Of this engine's line.
    pub fn new(engine: &Engine) -> Self {
        let decoder = match engine.ecu {
            Kind::Amt(_) => Decoder::Amt(amt::Decoder::new()),
            Kind::Zk { .. } => Decoder::Zk(zk::Decoder::new()),
        };
        Self {
            kind: engine.ecu,
            decoder,
            pending: VecDeque::new(),
            command: Vec::new(),
            kept: VecDeque::new(),
        }
    }

    /// The last of them, the oldest first.
    pub fn last(&self, count: usize) -> impl DoubleEndedIterator<Item = &Frame> {
        self.kept.iter().skip(self.kept.len().saturating_sub(count))
    }

    /// Takes what the line has recorded.
    pub fn add(&mut self, entries: &[Entry]) {
        for entry in entries {
            match entry.direction {
                Direction::ToNode => self.ecu_byte(entry),
                Direction::ToEcu => self.node_byte(entry),
            }
        }
    }

    fn keep(&mut self, direction: Direction, entries: &[Entry], text: Option<String>) {
        let (Some(first), Some(last)) = (entries.first(), entries.last()) else { return };
        let bytes = entries.iter().map(|entry| match direction {
            Direction::ToNode => received(entry).unwrap_or(entry.byte),
            Direction::ToEcu => entry.byte,
        });
        let damaged = entries.iter().any(|entry| entry.fate != Fate::Delivered);
        let frame =
            Frame { direction, from: first.start, to: last.end, bytes: bytes.collect(), text, damaged };
        // Frames of both directions come in the order of their ends.
        let place = self.kept.iter().rposition(|other| other.to <= frame.to).map_or(0, |place| place + 1);
        self.kept.insert(place, frame);
        if self.kept.len() > KEPT {
            self.kept.pop_front();
        }
    }

    fn ecu_byte(&mut self, entry: &Entry) {
        let Some(byte) = received(entry) else { return };
        self.pending.push_back(*entry);
        let (length, text) = match &mut self.decoder {
            Decoder::Amt(decoder) => match decoder.feed(&[byte]).1 {
                Some(frame) => (frame.raw().len(), Some(amt_text(&frame))),
                None => (decoder.pending(), None),
            },
            Decoder::Zk(decoder) => match decoder.feed(&[byte]).1 {
                Some(frame) => (frame.raw().len(), Some(zk_text(&frame))),
                None => (decoder.pending(), None),
            },
        };
        // What came before the frame, or before the one begun, belongs to none.
        let skipped = self.pending.len().saturating_sub(length);
        if skipped >= LONGEST_SKIP || (skipped > 0 && text.is_some()) {
            let bytes: Vec<Entry> = self.pending.drain(..skipped).collect();
            self.keep(Direction::ToNode, &bytes, None);
        }
        if text.is_some() {
            let bytes: Vec<Entry> = self.pending.drain(..).collect();
            self.keep(Direction::ToNode, &bytes, text);
        }
    }

    fn node_byte(&mut self, entry: &Entry) {
        if self.command.last().is_some_and(|last| entry.start > last.end + LONGEST_GAP) {
            let bytes = core::mem::take(&mut self.command);
            self.keep(Direction::ToEcu, &bytes, None);
        }
        self.command.push(*entry);
        let length = match self.kind {
            Kind::Amt(_) => AMT_COMMAND,
            Kind::Zk { .. } => ZK_COMMAND,
        };
        if self.command.len() == length {
            let entries = core::mem::take(&mut self.command);
            let bytes: Vec<u8> = entries.iter().map(|entry| entry.byte).collect();
            let text = command_text(self.kind, &bytes);
            self.keep(Direction::ToEcu, &entries, text);
        }
    }
}

fn command_text(kind: Kind, bytes: &[u8]) -> Option<String> {
    match kind {
        Kind::Amt(_) => {
            let command = sim::amt::parse_command(bytes).ok()?;
            let throttle = f64::from(command.throttle_half_percent) / 2.0;
            Some(match command.ops {
                sim::amt::Ops::EmergencyStop => "emergency stop".to_owned(),
                sim::amt::Ops::AutoStop => "standby (auto stop)".to_owned(),
                sim::amt::Ops::Run => format!("run, throttle {throttle:.1} %"),
                sim::amt::Ops::Ctf => "special functions".to_owned(),
            })
        }
        Kind::Zk { .. } => {
            use sim::zk::{Sw, ZkCommand};
            let command = sim::zk::parse_command(<&[u8; 4]>::try_from(bytes).ok()?).ok()?;
            let switch = |sw: Sw| match sw {
                Sw::Stop => "stop",
                Sw::Standby => "standby",
                Sw::Run => "run",
                _ => "no switch",
            };
            let percent = |tenths: u16| f64::from(tenths) / 10.0;
            Some(match command {
                ZkCommand::Empty => "ID 0: keeps the connection".to_owned(),
                ZkCommand::Control { sw, throttle } => {
                    format!("ID 1: {}, throttle {:.1} %", switch(sw), percent(throttle))
                }
                ZkCommand::Action(action) => format!("ID 2: {action:?}"),
                ZkCommand::Switch { sw, factor } => format!("ID 6: {}, RPM_X {factor}", switch(sw)),
                ZkCommand::Rpm(code) => format!("ID 7: rpm / 10 / RPM_X = {code}"),
                ZkCommand::Pressure(pressure) => format!("ID 8: {pressure} hPa"),
                other => format!("ID {}", other.id()),
            })
        }
    }
}

fn amt_text(frame: &amt::Frame) -> String {
    match frame.message() {
        amt::Message::Normal { switch, state, rpm, egt, throttle, .. } => format!(
            "{}, {}, rpm byte {rpm}, EGT {} °C, throttle {:.1} %",
            switch.name(),
            state.name(),
            egt.celsius().tenths() / 10,
            f64::from(throttle.tenths()) / 10.0
        ),
        amt::Message::Error { errors, egt, .. } => {
            let names: Vec<&str> = errors.names().collect();
            format!("faults: {}; EGT {} °C; no rpm", names.join(", "), egt.celsius().tenths() / 10)
        }
        amt::Message::Alternate { engine_id, .. } => {
            format!(
                "alternate: {}",
                amt::EngineModel::from_id(engine_id).map_or("unknown engine", amt::EngineModel::name)
            )
        }
        amt::Message::Setup(_) => "set-up".to_owned(),
        amt::Message::Unknown => "unknown kind".to_owned(),
    }
}

fn zk_text(frame: &zk::StatusFrame) -> String {
    let rpm = frame.rpm().get();
    let what = match frame.status() {
        zk::Status::Engine { state, error, egt, switch } => format!(
            "{}, {}, fault {}, EGT {} °C",
            switch.name(),
            state.name(),
            error.name(),
            egt.tenths() / 10
        ),
        zk::Status::Throttle { percent, pressure } => format!("throttle {percent} %, {} Pa", pressure.get()),
        zk::Status::Voltages { .. } => "voltages".to_owned(),
        zk::Status::Load { current, thrust } => format!("{} mA, thrust {} g", current.get(), thrust.get()),
        zk::Status::Settings { .. } => "settings".to_owned(),
        zk::Status::Identity { max_rpm, version, .. } => {
            format!("maximum {} rpm, protocol version {}", max_rpm.get(), version.get())
        }
        zk::Status::Fuel { .. } => "fuel".to_owned(),
        zk::Status::Idle { idle_rpm, .. } => format!("idle {} rpm", idle_rpm.get()),
        zk::Status::Temperature { ecu } => format!("ECU {} °C", ecu.tenths() / 10),
        zk::Status::Unknown => "unknown".to_owned(),
    };
    format!("status {}: {rpm} rpm, {what}", frame.id())
}

/// A frame of an AMT ECU with the reply to it, for the window: when the reply began and ended, counted from the end of
/// the frame; `None` where there is none yet.
pub fn last_window(frames: &[&Frame]) -> Option<Option<(Nanos, Nanos)>> {
    let replies = |end: Nanos| {
        let reply = frames.iter().find(|frame| frame.direction == Direction::ToEcu && frame.from >= end);
        reply.map(|reply| (reply.from - end, reply.to - end)).filter(|(from, _)| *from <= 30 * MILLIS)
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
        let entry = |(i, &byte): (usize, &u8)| {
            let start = from + i as Nanos * 4_166_667;
            Entry { direction, byte, start, end: start + 4_166_667, fate: Fate::Delivered }
        };
        bytes.iter().enumerate().map(entry).collect()
    }

    #[test]
    fn frames_are_found_between_bytes_that_are_none() {
        let engines = engines(&[]).unwrap();
        let mut frames = Frames::new(&engines[0]);
        frames.add(&entries(Direction::ToNode, 0, &[0x11, 0x12, 0xFF, 0x64, 0x84, 0x7B, 0x65, 0x99]));
        frames.add(&entries(Direction::ToEcu, 40 * MILLIS, &[0xFF, 0x14, 0x65, 0x14, 0x65]));
        let all: Vec<&Frame> = frames.last(10).collect();
        assert_eq!(all.len(), 3);
        assert_eq!((all[0].text.as_deref(), all[0].bytes.as_slice()), (None, &[0x11, 0x12][..]));
        assert!(all[1].text.as_deref().unwrap().starts_with("run, full-operation, rpm byte 132, EGT 51"));
        assert_eq!(all[2].text.as_deref(), Some("run, throttle 34.5 %"));
        let (from, to) = last_window(&all).unwrap().unwrap();
        assert_eq!((from / MILLIS, to / MILLIS), (6, 27));
    }

    #[test]
    fn a_part_of_a_command_is_no_frame() {
        let engines = engines(&[]).unwrap();
        let mut frames = Frames::new(&engines[2]);
        frames.add(&entries(Direction::ToEcu, 0, &[0xFF, 0x00]));
        frames.add(&entries(Direction::ToEcu, 50 * MILLIS, &[0x00]));
        let all: Vec<&Frame> = frames.last(10).collect();
        assert_eq!((all.len(), all[0].text.as_deref()), (1, None));
    }
}
