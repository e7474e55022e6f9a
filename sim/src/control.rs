//! Control frames, from the host to an ECU: found among the bytes of a line, and their content in the terms of
//! any protocol. Everything that watches a line uses this reader: the rig, the judges of random worlds, tests.

use crate::any::Protocol;
use crate::ecu::Nanos;
use crate::frame::{self, ControlFrame};
use crate::wire::Entry;
use core::fmt;

pub use crate::frame::Switch;

macro_rules! control {
    ($($(#[$doc:meta])* $name:ident $module:ident($config:ty, $ecu:ty, $command:ty);)+) => {
        /// Bytes of the longest control frame.
        pub const LONGEST: usize = {
            let (lengths, mut longest, mut i) = ([$(frame::length::<$command>()),+], 0, 0);
            while i < lengths.len() {
                if lengths[i] > longest {
                    longest = lengths[i];
                }
                i += 1;
            }
            longest
        };

        /// Command in a control frame.
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        pub enum Command {
            $($(#[$doc])* $name($command),)+
        }

        impl Command {
            /// Reads the bytes of one frame.
            ///
            /// # Errors
            /// They are not a valid frame.
            pub fn read(protocol: Protocol, bytes: &[u8]) -> Result<Self, BadFrame> {
                match protocol {
                    $(Protocol::$name => {
                        let mut array = <$command as ControlFrame>::Bytes::default();
                        if array.len() != bytes.len() {
                            return Err(BadFrame::Length { bytes: bytes.len(), frame: array.len() });
                        }
                        array.copy_from_slice(bytes);
                        <$command>::read(&array).map(Self::$name).map_err(BadFrame::$name)
                    })+
                }
            }

            /// The switch, if there is one: not in AMT's CTF, nor in ZK ID 6 with SW 0, which leaves the switch as it is.
            pub fn switch(self) -> Option<Switch> {
                match self {
                    $(Self::$name(command) => command.switch(),)+
                }
            }

            /// The throttle in 0.1 %, with any switch: in every AMT message, and in ZK ID 1.
            pub fn throttle_tenths(self) -> Option<u16> {
                match self {
                    $(Self::$name(command) => command.throttle_tenths(),)+
                }
            }
        }

        /// What it orders, for people.
        impl fmt::Display for Command {
            fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                match self {
                    $(Self::$name(command) => command.fmt(f),)+
                }
            }
        }

        /// Reason why bytes are not a valid control frame.
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        pub enum BadFrame {
            $($(#[$doc])* $name(<$command as ControlFrame>::Bad),)+
            /// Another number of bytes than a frame of the protocol has.
            Length {
                /// Their number.
                bytes: usize,
                /// That of a frame.
                frame: usize,
            },
        }

        impl fmt::Display for BadFrame {
            fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                match self {
                    $(Self::$name(bad) => bad.fmt(f),)+
                    Self::Length { bytes, frame } => write!(f, "{bytes} bytes, where a frame has {frame}"),
                }
            }
        }

        $(
            impl From<frame::Frame<$command>> for Frame {
                fn from(frame: frame::Frame<$command>) -> Self {
                    let mut raw = [0; LONGEST];
                    for (to, byte) in raw.iter_mut().zip(frame.bytes) {
                        *to = byte;
                    }
                    Self {
                        start: frame.start,
                        end: frame.end,
                        delivered: frame.delivered,
                        raw,
                        length: frame.bytes.len(),
                        command: frame.command.map(Command::$name).map_err(BadFrame::$name),
                        rpm: frame.rpm,
                    }
                }
            }
        )+

        #[derive(Clone, Debug)]
        enum AnyReader {
            $($name(frame::Reader<$command>),)+
        }

        impl Reader {
            /// Finds frames as an ECU does, and skips everything else: 0xFF begins every AMT message and occurs nowhere else in
            /// one; four bytes with the head and the right CRC are a ZK frame. Another protocol has its own rule in [`ControlFrame`].
            pub const fn new(protocol: Protocol) -> Self {
                Self(match protocol {
                    $(Protocol::$name => AnyReader::$name(frame::Reader::new()),)+
                })
            }

            /// Skips nothing: each run of bytes with the length of a frame is one, and a pause longer than this ends it.
            pub const fn strict(protocol: Protocol, longest_pause: Nanos) -> Self {
                Self(match protocol {
                    $(Protocol::$name => AnyReader::$name(frame::Reader::strict(longest_pause)),)+
                })
            }

            /// Takes one entry of a recording. Skips bytes from the ECU and bytes created by noise.
            pub fn entry(&mut self, entry: &Entry) -> Option<Found> {
                match &mut self.0 {
                    $(AnyReader::$name(reader) => reader.entry(entry).map(|found| found.map(Frame::from)),)+
                }
            }

            /// Discards the partial frame: its sender was reset.
            pub fn restart(&mut self) {
                match &mut self.0 {
                    $(AnyReader::$name(reader) => reader.restart(),)+
                }
            }
        }

        impl Protocol {
            /// Bytes of a control frame.
            pub const fn control_length(self) -> usize {
                match self {
                    $(Self::$name => frame::length::<$command>(),)+
                }
            }
        }
    };
}

crate::protocols!(control);

impl Command {
    /// The throttle in 0.1 %, if the switch is run.
    pub fn run_throttle_tenths(self) -> Option<u16> {
        match self.switch() {
            Some(Switch::Run) => self.throttle_tenths(),
            _ => None,
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
    /// The bytes, padded with zeros if other protocols have longer frames.
    pub raw: [u8; LONGEST],
    length: usize,
    /// Their command.
    pub command: Result<Command, BadFrame>,
    rpm: Option<u32>,
}

impl Frame {
    /// The bytes.
    pub fn bytes(&self) -> &[u8] {
        &self.raw[..self.length]
    }

    /// The speed that it commands: that of ZK ID 7, if RPM_X gives its scale (ZK-9).
    pub const fn rpm(&self) -> Option<u32> {
        self.rpm
    }
}

/// Result of a strict [`Reader`].
pub type Found = frame::Found<Frame>;

/// Finds control frames in the recording of a line.
#[derive(Clone, Debug)]
pub struct Reader(AnyReader);

impl Reader {
    /// The frames whose last byte is in this part of a recording.
    pub fn read(&mut self, record: &[Entry]) -> impl Iterator<Item = Frame> {
        record.iter().filter_map(|entry| self.entry(entry).and_then(Found::frame))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::wire::{Direction, Fate};
    use crate::zk::{self, Sw, ZkCommand};

    const BYTE: Nanos = 100_000;

    /// These bytes back to back from `start` on, 0.1 ms each.
    fn sent(start: Nanos, bytes: &[u8]) -> Vec<Entry> {
        Entry::delivered(Direction::ToEcu, start, BYTE, bytes)
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
    fn frames_are_found_after_what_a_reset_has_cut_short() {
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
    fn bytes_of_the_ecu_and_of_noise_are_not_the_hosts() {
        let mut record = sent(0, &[0xFF, 0x12, 32, 0x12, 32]);
        record.insert(2, Entry { fate: Fate::Added, ..record[0] });
        record.insert(3, Entry { direction: Direction::ToNode, ..record[0] });
        record[4].fate = Fate::Lost;
        let frames: Vec<_> = Reader::new(Protocol::Amt).read(&record).collect();
        assert_eq!(frames.len(), 1);
        assert!(frames[0].command.is_ok() && !frames[0].delivered);
    }
}
