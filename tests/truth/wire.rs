//! The control frames in the record of a wire, in the terms of the judge. What the bytes mean is up to the simulation's reader.

use crate::history::{Frame, Sent};
use sim::any::Protocol;
use sim::control::{self, Command};
use sim::wire::Entry;
use sim::zk::ZkCommand;

#[derive(Debug)]
pub struct Reader(control::Reader);

impl Reader {
    pub const fn new(protocol: Protocol) -> Self {
        Self(control::Reader::new(protocol))
    }

    /// The frames whose last byte is in this part of the record.
    pub fn read(&mut self, record: &[Entry]) -> Vec<Frame> {
        let frame = |frame: control::Frame| Frame {
            at: frame.start / 1000,
            arrived: frame.delivered,
            sent: sent(&frame),
        };
        self.0.read(record).map(frame).collect()
    }
}

fn sent(frame: &control::Frame) -> Sent {
    let Ok(command) = frame.command else { return Sent::Bad(frame.raw) };
    match (command, command.switch(), command.throttle_tenths()) {
        // In ID 6 a switch of 0 means nothing.
        (Command::Zk(ZkCommand::Switch { factor, .. }), switch, _) => Sent::Mode(switch, factor),
        (_, Some(switch), Some(tenths)) => Sent::Full(switch, tenths.into()),
        (Command::Amt(_), ..) => Sent::Ctf,
        (Command::Zk(ZkCommand::Empty), ..) => Sent::Nothing,
        (Command::Zk(ZkCommand::Action(action)), ..) => Sent::Action(action.number()),
        // Without a factor a speed means nothing, and the ECU ignores it.
        (Command::Zk(other), ..) => frame.rpm().map_or(Sent::Other(other.id()), Sent::Rpm),
    }
}
