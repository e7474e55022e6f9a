//! The control frames in the record of a wire, in the words of the judge. What the bytes mean is up to the simulation's reader.

use crate::history::{Frame, Told};
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
            told: told(&frame),
        };
        self.0.read(record).map(frame).collect()
    }
}

fn told(frame: &control::Frame) -> Told {
    let Ok(command) = frame.command else { return Told::Bad(frame.raw) };
    match (command, command.switch(), command.throttle_tenths()) {
        // In ID 6 a switch of 0 says nothing.
        (Command::Zk(ZkCommand::Switch { factor, .. }), switch, _) => Told::Mode(switch, factor),
        (_, Some(switch), Some(tenths)) => Told::Full(switch, tenths.into()),
        (Command::Amt(_), ..) => Told::Ctf,
        (Command::Zk(ZkCommand::Empty), ..) => Told::Nothing,
        (Command::Zk(ZkCommand::Action(action)), ..) => Told::Action(action.number()),
        // Without a factor a speed means nothing, and the ECU ignores it.
        (Command::Zk(other), ..) => frame.rpm().map_or(Told::Other(other.id()), Told::Rpm),
    }
}
