//! The node's frames on the wire, in the judge's terms. The simulation's reader decodes the bytes.

use core::fmt;
use sim::any::Protocol;
pub use sim::control::Switch;
use sim::control::{self, Command};
use sim::wire::Entry;
use sim::zk::ZkCommand;

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

impl fmt::Display for Frame {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Full(switch, tenths) => write!(f, "{switch}, throttle {}", percent(*tenths)),
            Self::Mode(switch, factor) => write!(f, "ID 6: {switch}, RPM_X {factor}"),
            Self::RpmCode(code) => write!(f, "ID 7: rpm / 10 / RPM_X = {code}"),
            Self::Other(id) => write!(f, "ID {id}"),
            Self::Bad(bytes) => write!(f, "{bytes:02x?}, which is no control frame"),
        }
    }
}

/// Tenths of a percent, for a reader.
pub fn percent(tenths: impl Into<u32>) -> String {
    let tenths = tenths.into();
    format!("{}.{} %", tenths / 10, tenths % 10)
}

/// Finds the frames in the record of a wire.
#[derive(Debug)]
pub struct Reader(control::Reader);

impl Reader {
    pub const fn new(protocol: Protocol) -> Self {
        Self(control::Reader::new(protocol))
    }

    /// Each frame with the beginning of its first start bit, in µs.
    pub fn read(&mut self, record: &[Entry], mut each: impl FnMut(u64, Frame)) {
        for read in self.0.read(record) {
            each(read.start / 1000, frame(&read));
        }
    }
}

fn frame(frame: &control::Frame) -> Frame {
    let Ok(command) = frame.command else { return Frame::Bad(frame.raw) };
    match (command, command.switch(), command.throttle_tenths()) {
        (Command::Zk(ZkCommand::Switch { factor, .. }), switch, _) => {
            Frame::Mode(switch.unwrap_or(Switch::Pwm), factor)
        }
        (_, Some(switch), Some(tenths)) => Frame::Full(switch, tenths),
        // CTF is never commanded here.
        (Command::Amt(_), ..) => Frame::Bad(frame.raw),
        (Command::Zk(ZkCommand::Rpm(code)), ..) => Frame::RpmCode(code),
        (Command::Zk(other), ..) => Frame::Other(other.id()),
    }
}
