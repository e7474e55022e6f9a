//! What the node put on the wire, read by the simulation's parsers.

use sim::amt::{self, AmtCommand, Ops};
use sim::ecu::Nanos;
use sim::wire::{Direction, Entry, Fate};
use sim::zk::{self, Action, BadCommand, Sw, ZkCommand};

/// One control frame.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Sent {
    Amt(AmtCommand),
    Zk(ZkCommand),
}

/// One control frame and the beginning of its first start bit.
#[derive(Clone, Copy, Debug)]
pub struct Frame {
    pub at: Nanos,
    pub sent: Sent,
}

impl Frame {
    /// It switches the engine to run.
    pub fn is_run(&self) -> bool {
        match self.sent {
            Sent::Amt(command) => command.ops == Ops::Run,
            Sent::Zk(ZkCommand::Control { sw, .. } | ZkCommand::Switch { sw, .. }) => sw == Sw::Run,
            Sent::Zk(_) => false,
        }
    }

    /// It shuts the engine down: emergency stop or standby.
    pub fn is_stop(&self) -> bool {
        match self.sent {
            Sent::Amt(command) => matches!(command.ops, Ops::EmergencyStop | Ops::AutoStop),
            Sent::Zk(ZkCommand::Control { sw, .. } | ZkCommand::Switch { sw, .. }) => {
                matches!(sw, Sw::Stop | Sw::Standby)
            }
            Sent::Zk(_) => false,
        }
    }

    /// The throttle that comes with run, in tenths of a percent.
    pub fn throttle(&self) -> Option<u16> {
        match self.sent {
            Sent::Amt(command) if command.ops == Ops::Run => {
                Some(u16::from(command.throttle_half_percent) * 5)
            }
            Sent::Zk(ZkCommand::Control { sw: Sw::Run, throttle }) => Some(throttle),
            _ => None,
        }
    }

    /// ZK ID 6.
    pub fn is_id_6(&self) -> bool {
        matches!(self.sent, Sent::Zk(ZkCommand::Switch { .. }))
    }

    pub fn is_action(&self, action: Action) -> bool {
        self.sent == Sent::Zk(ZkCommand::Action(action))
    }
}

/// Finds the frames in the record of a wire.
#[derive(Debug)]
pub struct Reader {
    amt: bool,
    bytes: Vec<(Nanos, u8)>,
}

impl Reader {
    pub fn new(amt: bool) -> Self {
        Self { amt, bytes: Vec::new() }
    }

    pub fn read(&mut self, log: &[Entry], frames: &mut Vec<Frame>) {
        for entry in log {
            if entry.direction != Direction::ToEcu || entry.fate == Fate::Added {
                continue;
            }
            // 0xFF begins every AMT message and is nowhere else in one.
            if self.amt && entry.byte == 0xFF {
                self.bytes.clear();
            }
            self.bytes.push((entry.start, entry.byte));
            frames.extend(if self.amt { self.amt_frame() } else { self.zk_frame() });
        }
    }

    fn amt_frame(&mut self) -> Option<Frame> {
        let raw: [(Nanos, u8); 5] = *self.bytes.first_chunk()?;
        self.bytes.clear();
        let command = amt::parse_command(&raw.map(|(_, byte)| byte)).ok()?;
        Some(Frame { at: raw[0].0, sent: Sent::Amt(command) })
    }

    fn zk_frame(&mut self) -> Option<Frame> {
        let raw: [(Nanos, u8); 4] = *self.bytes.first_chunk()?;
        match zk::parse_command(&raw.map(|(_, byte)| byte)) {
            // What is left of a write that a reset cut short.
            Err(BadCommand::Head | BadCommand::Crc) => {
                self.bytes.remove(0);
                None
            }
            parsed => {
                self.bytes.drain(..4);
                Some(Frame { at: raw[0].0, sent: Sent::Zk(parsed.ok()?) })
            }
        }
    }
}
