//! The node's frames on the wire, decoded by the simulation.

pub use sim::control::Command as Sent;
use sim::control::{self, Switch};
use sim::ecu::Nanos;
use sim::wire::Entry;
use sim::zk::{Action, ZkCommand};

/// One control frame and the beginning of its first start bit.
#[derive(Clone, Copy, Debug)]
pub struct Frame {
    pub at: Nanos,
    pub sent: Sent,
}

impl Frame {
    /// It switches the engine to run.
    pub fn is_run(&self) -> bool {
        self.sent.switch() == Some(Switch::Run)
    }

    /// It shuts the engine down: emergency stop or standby.
    pub fn is_stop(&self) -> bool {
        matches!(self.sent.switch(), Some(Switch::Stop | Switch::Standby))
    }

    /// Throttle sent with run, in tenths of a percent.
    pub fn throttle(&self) -> Option<u16> {
        self.sent.run_throttle_tenths()
    }

    /// ZK ID 6.
    pub fn is_id_6(&self) -> bool {
        matches!(self.sent, Sent::Zk(ZkCommand::Switch { .. }))
    }

    pub fn is_action(&self, action: Action) -> bool {
        self.sent == Sent::Zk(ZkCommand::Action(action))
    }
}

/// The good frames in this part of the record of a wire.
pub fn read(reader: &mut control::Reader, record: &[Entry], frames: &mut Vec<Frame>) {
    let good = |frame: control::Frame| Some(Frame { at: frame.start, sent: frame.command.ok()? });
    frames.extend(reader.read(record).filter_map(good));
}
