//! Control frames, from the host to an ECU: found among the bytes of a line, and their content in the terms of
//! either protocol. Whatever watches a line reads it with this: the rig, the judges of random worlds, tests.

use crate::amt::{self, AmtCommand, Ops};
use crate::any::Protocol;
use crate::ecu::Nanos;
use crate::wire::{Direction, Entry, Fate};
use crate::zk::{self, Sw, ZkCommand};
use core::fmt;

/// Engine switch commanded by a control frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Switch {
    /// ZK ID 1 with SW 0: the ECU obeys its PWM input (ZK-8).
    Pwm,
    /// Stop without cooling.
    Stop,
    /// Stop with cooling.
    Standby,
    /// Run.
    Run,
}

impl fmt::Display for Switch {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Pwm => "PWM input",
            Self::Stop => "emergency stop",
            Self::Standby => "standby",
            Self::Run => "run",
        })
    }
}

/// Command in a control frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Command {
    /// An AMT message.
    Amt(AmtCommand),
    /// A ZK frame.
    Zk(ZkCommand),
}

impl Command {
    /// Reads the bytes of one frame.
    pub fn read(protocol: Protocol, bytes: &[u8]) -> Result<Self, BadFrame> {
        match protocol {
            Protocol::Amt => amt::parse_command(bytes).map(Self::Amt).map_err(BadFrame::Amt),
            Protocol::Zk => {
                let bytes = bytes.try_into().map_err(|_| BadFrame::Length(bytes.len()))?;
                zk::parse_command(bytes).map(Self::Zk).map_err(BadFrame::Zk)
            }
        }
    }

    /// The switch, where there is one: not in AMT's CTF, nor in ZK ID 6 with SW 0, which leaves the switch as it is.
    pub const fn switch(self) -> Option<Switch> {
        match self {
            Self::Amt(command) => match command.ops {
                Ops::EmergencyStop => Some(Switch::Stop),
                Ops::AutoStop => Some(Switch::Standby),
                Ops::Run => Some(Switch::Run),
                Ops::Ctf => None,
            },
            Self::Zk(ZkCommand::Control { sw: Sw::None, .. }) => Some(Switch::Pwm),
            Self::Zk(ZkCommand::Control { sw, .. } | ZkCommand::Switch { sw, .. }) => match sw {
                Sw::None => None,
                Sw::Stop => Some(Switch::Stop),
                Sw::Standby => Some(Switch::Standby),
                Sw::Run => Some(Switch::Run),
            },
            Self::Zk(_) => None,
        }
    }

    /// The throttle in 0.1 %, with any switch: in every AMT message, and in ZK ID 1.
    pub const fn throttle_tenths(self) -> Option<u16> {
        match self {
            Self::Amt(command) => Some(command.throttle_half_percent as u16 * 5),
            Self::Zk(ZkCommand::Control { throttle, .. }) => Some(throttle),
            Self::Zk(_) => None,
        }
    }

    /// The throttle in 0.1 %, if the switch is run.
    pub const fn run_throttle_tenths(self) -> Option<u16> {
        match self.switch() {
            Some(Switch::Run) => self.throttle_tenths(),
            _ => None,
        }
    }
}

/// What it orders, for people.
impl fmt::Display for Command {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Amt(command) => command.fmt(f),
            Self::Zk(command) => command.fmt(f),
        }
    }
}

/// Reason why bytes are not a valid control frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BadFrame {
    /// AMT.
    Amt(amt::BadCommand),
    /// ZK.
    Zk(zk::BadCommand),
    /// ZK: this number of bytes, where a frame has four.
    Length(usize),
}

impl fmt::Display for BadFrame {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Amt(bad) => bad.fmt(f),
            Self::Zk(bad) => bad.fmt(f),
            Self::Length(length) => write!(f, "{length} bytes, where a frame has four"),
        }
    }
}

/// A sequence of bytes with the length of a control frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Frame {
    /// Start of the first start bit.
    pub start: Nanos,
    /// End of the last stop bit.
    pub end: Nanos,
    /// All bytes reached the ECU as they were sent.
    pub delivered: bool,
    /// The bytes; the last one is 0 for ZK, whose frames have four.
    pub raw: [u8; amt::LENGTH],
    length: usize,
    /// Their command.
    pub command: Result<Command, BadFrame>,
    /// ZK: RPM_X as last sent, 0 if it was not.
    pub factor: u8,
}

impl Frame {
    /// The bytes.
    pub fn bytes(&self) -> &[u8] {
        &self.raw[..self.length]
    }

    /// The speed commanded by ZK ID 7, if RPM_X gives its scale (ZK-9).
    pub fn rpm(&self) -> Option<u32> {
        match self.command {
            Ok(Command::Zk(ZkCommand::Rpm(code))) if self.factor > 0 => {
                Some(u32::from(code) * u32::from(self.factor) * 10)
            }
            _ => None,
        }
    }
}

/// Result of a strict [`Reader`].
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Found {
    /// Bytes with the length of a frame.
    Frame(Frame),
    /// Fewer bytes, followed by a pause.
    Fragment {
        /// Start of the first start bit.
        start: Nanos,
        /// The bytes.
        bytes: Vec<u8>,
    },
}

/// How a [`Reader`] finds the start of a frame.
#[derive(Clone, Copy, Debug)]
enum Framing {
    Heads,
    Pauses(Nanos),
}

/// Finds control frames in the recording of a line.
#[derive(Clone, Debug)]
pub struct Reader {
    protocol: Protocol,
    framing: Framing,
    bytes: Vec<Entry>,
    factor: u8,
}

impl Reader {
    /// Finds frames as an ECU does, and skips everything else: 0xFF begins every AMT message and occurs nowhere else in one; four
    /// bytes with the head and the right CRC are a ZK frame.
    pub const fn new(protocol: Protocol) -> Self {
        Self { protocol, framing: Framing::Heads, bytes: Vec::new(), factor: 0 }
    }

    /// Skips nothing: the number of bytes in a frame makes one, and a pause longer than this ends it.
    pub const fn strict(protocol: Protocol, longest_pause: Nanos) -> Self {
        Self { protocol, framing: Framing::Pauses(longest_pause), bytes: Vec::new(), factor: 0 }
    }

    /// The frames whose last byte is in this part of a recording.
    pub fn read(&mut self, record: &[Entry]) -> impl Iterator<Item = Frame> {
        record.iter().filter_map(|entry| match self.entry(entry) {
            Some(Found::Frame(frame)) => Some(frame),
            Some(Found::Fragment { .. }) | None => None,
        })
    }

    /// Takes one entry of a recording. Skips bytes from the ECU and bytes created by noise.
    pub fn entry(&mut self, entry: &Entry) -> Option<Found> {
        if entry.direction != Direction::ToEcu || entry.fate == Fate::Added {
            return None;
        }
        let fragment = match self.framing {
            Framing::Heads if self.protocol == Protocol::Amt && entry.byte == amt::HEAD => {
                self.bytes.clear();
                None
            }
            Framing::Pauses(longest)
                if self.bytes.last().is_some_and(|last| entry.start > last.end + longest) =>
            {
                self.fragment()
            }
            _ => None,
        };
        self.bytes.push(*entry);
        fragment.or_else(|| self.frame().map(Found::Frame))
    }

    /// Discards the partial frame: its sender was reset.
    pub fn restart(&mut self) {
        self.bytes.clear();
    }

    fn fragment(&mut self) -> Option<Found> {
        let start = self.bytes.first()?.start;
        let bytes = self.bytes.drain(..).map(|entry| entry.byte).collect();
        Some(Found::Fragment { start, bytes })
    }

    fn frame(&mut self) -> Option<Frame> {
        let length = self.protocol.control_length();
        let entries = self.bytes.get(..length)?;
        let mut raw = [0; amt::LENGTH];
        for (to, entry) in raw.iter_mut().zip(entries) {
            *to = entry.byte;
        }
        let command = Command::read(self.protocol, &raw[..length]);
        if matches!(self.framing, Framing::Heads)
            && matches!(command, Err(BadFrame::Zk(zk::BadCommand::Head | zk::BadCommand::Crc)))
        {
            // The rest of a frame that a reset has cut short.
            self.bytes.remove(0);
            return None;
        }
        if let Ok(Command::Zk(ZkCommand::Switch { factor, .. })) = command {
            self.factor = factor;
        }
        let frame = Frame {
            start: entries[0].start,
            end: entries[length - 1].end,
            delivered: entries.iter().all(|entry| entry.fate == Fate::Delivered),
            raw,
            length,
            command,
            factor: self.factor,
        };
        self.bytes.drain(..length);
        Some(frame)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const BYTE: Nanos = 100_000;

    /// These bytes back to back from `start` on, 0.1 ms each.
    fn sent(start: Nanos, bytes: &[u8]) -> Vec<Entry> {
        (0..)
            .zip(bytes)
            .map(|(i, &byte)| Entry {
                direction: Direction::ToEcu,
                byte,
                start: start + i * BYTE,
                end: start + (i + 1) * BYTE,
                fate: Fate::Delivered,
            })
            .collect()
    }

    fn zk(high: u8, low: u8) -> [u8; 4] {
        [zk::HEAD, high, low, zk::crc8(&[high, low])]
    }

    fn command(protocol: Protocol, bytes: &[u8]) -> Command {
        let mut reader = Reader::new(protocol);
        let frames: Vec<_> = reader.read(&sent(0, bytes)).collect();
        assert_eq!(frames.len(), 1, "{bytes:02X?}");
        frames[0].command.expect("a good frame")
    }

    #[test]
    fn each_switch_has_the_same_meaning_in_either_protocol() {
        for (ops, switch) in [
            (0x11, Some(Switch::Stop)),
            (0x12, Some(Switch::Standby)),
            (0x14, Some(Switch::Run)),
            (0x91, None),
        ] {
            assert_eq!(command(Protocol::Amt, &[0xFF, ops, 132, ops, 132]).switch(), switch);
        }
        for (sw, in_id_1, in_id_6) in [
            (0, Some(Switch::Pwm), None),
            (1, Some(Switch::Stop), Some(Switch::Stop)),
            (2, Some(Switch::Standby), Some(Switch::Standby)),
            (3, Some(Switch::Run), Some(Switch::Run)),
        ] {
            assert_eq!(command(Protocol::Zk, &zk(0x10 | sw << 2, 0)).switch(), in_id_1);
            assert_eq!(command(Protocol::Zk, &zk(0x60, sw)).switch(), in_id_6);
        }
        assert_eq!(command(Protocol::Zk, &zk(0x00, 0)).switch(), None);
    }

    #[test]
    fn a_throttle_is_in_tenths_of_a_percent_in_either_protocol() {
        let run = command(Protocol::Amt, &[0xFF, 0x14, 132, 0x14, 132]);
        assert_eq!((run.throttle_tenths(), run.run_throttle_tenths()), (Some(500), Some(500)));
        let run = command(Protocol::Zk, &zk(0x1D, 0xF4));
        assert_eq!((run.throttle_tenths(), run.run_throttle_tenths()), (Some(500), Some(500)));
        let stop = command(Protocol::Zk, &zk(0x14, 0x64));
        assert_eq!((stop.throttle_tenths(), stop.run_throttle_tenths()), (Some(100), None));
        assert_eq!(command(Protocol::Zk, &zk(0x60, 0x13)).run_throttle_tenths(), None);
    }

    /// ZK-9.
    #[test]
    fn a_speed_is_read_with_the_factor_that_was_sent_last() {
        let mut reader = Reader::new(Protocol::Zk);
        let bytes = [zk(0x70, 100), zk(0x60, 0x13), zk(0x70, 100), zk(0x60, 3), zk(0x70, 100)];
        let rpm: Vec<_> = reader.read(&sent(0, bytes.as_flattened())).map(|frame| frame.rpm()).collect();
        assert_eq!(rpm, [None, None, Some(4000), None, None]);
    }

    #[test]
    fn frames_are_found_behind_what_a_reset_has_cut_short() {
        let whole = [0xFF, 0x12, 32, 0x12, 32];
        let mut reader = Reader::new(Protocol::Amt);
        let record = [sent(0, &[0xFF, 0x14, 132]), sent(10 * BYTE, &whole)].concat();
        let frames: Vec<_> = reader.read(&record).collect();
        assert_eq!(frames.iter().map(|frame| frame.start).collect::<Vec<_>>(), [10 * BYTE]);
        assert_eq!((frames[0].raw, frames[0].end), (whole, 15 * BYTE));

        let mut reader = Reader::new(Protocol::Zk);
        let record = [sent(0, &[0xFF, 0x14]), sent(10 * BYTE, &zk(0x18, 0))].concat();
        let starts: Vec<_> = reader.read(&record).map(|frame| frame.start).collect();
        assert_eq!(starts, [10 * BYTE]);
    }

    #[test]
    fn a_strict_reader_skips_nothing() {
        let mut reader = Reader::strict(Protocol::Zk, BYTE);
        let [good, bad] = [zk(0x18, 0), [0xFF, 0x18, 0, 0]];
        let record =
            [sent(0, &good[..2]), sent(10 * BYTE, &bad), sent(14 * BYTE, &good), sent(30 * BYTE, &good[..1])]
                .concat();
        let found: Vec<_> = record.iter().filter_map(|entry| reader.entry(entry)).collect();
        assert_eq!(found[0], Found::Fragment { start: 0, bytes: vec![0xFF, 0x18] });
        let commands: Vec<_> = found[1..]
            .iter()
            .map(|found| match found {
                Found::Frame(frame) => frame.command,
                Found::Fragment { .. } => panic!("{found:?}"),
            })
            .collect();
        let standby = Command::Zk(ZkCommand::Control { sw: Sw::Standby, throttle: 0 });
        assert_eq!(commands, [Err(BadFrame::Zk(zk::BadCommand::Crc)), Ok(standby)]);
    }

    #[test]
    fn bytes_of_the_ecu_and_of_noise_are_none_of_the_host() {
        let mut record = sent(0, &[0xFF, 0x12, 32, 0x12, 32]);
        record.insert(2, Entry { fate: Fate::Added, ..record[0] });
        record.insert(3, Entry { direction: Direction::ToNode, ..record[0] });
        record[4].fate = Fate::Lost;
        let frames: Vec<_> = Reader::new(Protocol::Amt).read(&record).collect();
        assert_eq!(frames.len(), 1);
        assert!(frames[0].command.is_ok() && !frames[0].delivered);
    }
}
