//! Finds the control frames in the record of a wire. What they mean is up to the simulation's own readers.

use crate::history::{Frame, Switch, Told};
use sim::wire::{Direction, Entry, Fate};
use sim::{amt, zk};

#[derive(Debug)]
pub struct Reader {
    amt: bool,
    /// When each byte began in µs, the byte, and whether it arrived.
    bytes: Vec<(u64, u8, bool)>,
    /// RPM_X as it was sent last.
    factor: u8,
}

impl Reader {
    pub const fn new(amt: bool) -> Self {
        Self { amt, bytes: Vec::new(), factor: 0 }
    }

    /// The frames whose last byte is in this part of the record.
    pub fn read(&mut self, record: &[Entry]) -> Vec<Frame> {
        let mut frames = Vec::new();
        for entry in record {
            if entry.direction != Direction::ToEcu || entry.fate == Fate::Added {
                continue;
            }
            // 0xFF begins every AMT message and is nowhere else in one.
            if self.amt && entry.byte == 0xFF {
                self.bytes.clear();
            }
            self.bytes.push((entry.start / 1000, entry.byte, entry.fate == Fate::Delivered));
            frames.extend(if self.amt { self.amt_frame() } else { self.zk_frame() });
        }
        frames
    }

    fn raw<const N: usize>(&self) -> Option<(u64, [u8; N], bool)> {
        let bytes: &[(u64, u8, bool); N] = self.bytes.first_chunk()?;
        Some((bytes[0].0, bytes.map(|(_, byte, _)| byte), bytes.iter().all(|(_, _, arrived)| *arrived)))
    }

    fn amt_frame(&mut self) -> Option<Frame> {
        let (at, raw, arrived) = self.raw::<5>()?;
        self.bytes.clear();
        let told = match amt::parse_command(&raw) {
            Ok(command) => {
                let tenths = u32::from(command.throttle_half_percent) * 5;
                match command.ops {
                    amt::Ops::EmergencyStop => Told::Full(Switch::Stop, tenths),
                    amt::Ops::AutoStop => Told::Full(Switch::Standby, tenths),
                    amt::Ops::Run => Told::Full(Switch::Run, tenths),
                    amt::Ops::Ctf => Told::Ctf,
                }
            }
            Err(_) => Told::Bad(raw),
        };
        Some(Frame { at, arrived, told })
    }

    fn zk_frame(&mut self) -> Option<Frame> {
        let (at, raw, arrived) = self.raw::<4>()?;
        let parsed = match zk::parse_command(&raw) {
            Err(zk::BadCommand::Head | zk::BadCommand::Crc) => {
                // Only what a reset left of a frame: look for the next one.
                self.bytes.remove(0);
                return None;
            }
            parsed => parsed,
        };
        self.bytes.drain(..4);
        let switch = |sw| match sw {
            zk::Sw::None => Switch::Pwm,
            zk::Sw::Stop => Switch::Stop,
            zk::Sw::Standby => Switch::Standby,
            zk::Sw::Run => Switch::Run,
        };
        let told = match parsed {
            Ok(zk::ZkCommand::Empty) => Told::Nothing,
            Ok(zk::ZkCommand::Control { sw, throttle }) => Told::Full(switch(sw), throttle.into()),
            Ok(zk::ZkCommand::Switch { sw, factor }) => {
                self.factor = factor;
                // In ID 6 a switch of 0 says nothing.
                Told::Mode((sw != zk::Sw::None).then(|| switch(sw)), factor)
            }
            // Without a factor it means nothing, and the ECU ignores it.
            Ok(zk::ZkCommand::Rpm(_)) if self.factor == 0 => Told::Other(7),
            Ok(zk::ZkCommand::Rpm(code)) => Told::Rpm(u32::from(code) * u32::from(self.factor) * 10),
            Ok(zk::ZkCommand::Action(action)) => Told::Action(action.number()),
            Ok(other) => Told::Other(other.id()),
            Err(_) => Told::Bad([raw[0], raw[1], raw[2], raw[3], 0]),
        };
        Some(Frame { at, arrived, told })
    }
}
