//! What the node put on the wire, read by the simulation's parsers.

use sim::wire::{Direction, Entry, Fate};
use sim::{amt, zk};

/// What a control frame says of the engine's switch.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Switch {
    Pwm,
    Stop,
    Standby,
    Run,
}

#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Frame {
    /// Switch and throttle in tenths of a percent: every AMT message, ZK ID 1.
    Full(Switch, u16),
    /// ZK ID 6: the switch and RPM_X.
    Mode(Switch, u8),
    /// ZK ID 7.
    RpmCode(u16),
    /// Any other: it orders nothing of a running engine.
    Other(u8),
    /// No frame that the document knows.
    Bad([u8; 5]),
}

/// Finds the frames in the record of a wire.
#[derive(Debug, Default)]
pub struct Reader {
    amt: bool,
    bytes: Vec<(u64, u8)>,
}

impl Reader {
    pub fn new(amt: bool) -> Self {
        Self { amt, bytes: Vec::new() }
    }

    /// Each frame with the beginning of its first start bit, in µs.
    pub fn read(&mut self, log: &[Entry], mut each: impl FnMut(u64, Frame)) {
        for entry in log {
            if entry.direction != Direction::ToEcu || entry.fate == Fate::Added {
                continue;
            }
            // 0xFF begins every AMT message and is nowhere else in one.
            if self.amt && entry.byte == 0xFF {
                self.bytes.clear();
            }
            self.bytes.push((entry.start / 1000, entry.byte));
            if let Some((at, frame)) = if self.amt { self.amt_frame() } else { self.zk_frame() } {
                each(at, frame);
            }
        }
    }

    fn raw<const N: usize>(&self) -> Option<(u64, [u8; N])> {
        let bytes: &[(u64, u8); N] = self.bytes.first_chunk()?;
        Some((bytes[0].0, bytes.map(|(_, byte)| byte)))
    }

    fn amt_frame(&mut self) -> Option<(u64, Frame)> {
        let (at, raw) = self.raw::<5>()?;
        self.bytes.clear();
        let frame = match amt::parse_command(&raw) {
            Ok(command) => {
                let switch = match command.ops {
                    amt::Ops::EmergencyStop => Switch::Stop,
                    amt::Ops::AutoStop => Switch::Standby,
                    amt::Ops::Run => Switch::Run,
                    // CTF is never asked for here.
                    amt::Ops::Ctf => return Some((at, Frame::Bad(raw))),
                };
                Frame::Full(switch, u16::from(command.throttle_half_percent) * 5)
            }
            Err(_) => Frame::Bad(raw),
        };
        Some((at, frame))
    }

    fn zk_frame(&mut self) -> Option<(u64, Frame)> {
        let (at, raw) = self.raw::<4>()?;
        let parsed = match zk::parse_command(&raw) {
            Err(zk::BadCommand::Head | zk::BadCommand::Crc) => {
                // Only what is left of a write that was cut short: look for the next frame.
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
        let frame = match parsed {
            Ok(zk::ZkCommand::Control { sw, throttle }) => Frame::Full(switch(sw), throttle),
            Ok(zk::ZkCommand::Switch { sw, factor }) => Frame::Mode(switch(sw), factor),
            Ok(zk::ZkCommand::Rpm(code)) => Frame::RpmCode(code),
            Ok(other) => Frame::Other(other.id()),
            Err(_) => Frame::Bad([raw[0], raw[1], raw[2], raw[3], 0]),
        };
        Some((at, frame))
    }
}
