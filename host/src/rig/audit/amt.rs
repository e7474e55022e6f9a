//! The control messages of an AMT ECU that each order allows.

use super::super::engines::Engine;
use super::vendor::{self, Rise, WireCommand};
use jetlink::command::{Demand, Order};
use sim::amt::{AmtCommand, Ops};

/// Judges the messages to one ECU.
#[derive(Clone, Debug)]
pub struct Judge;

/// The throttle in tenths of a percent.
fn tenths(command: AmtCommand) -> u16 {
    u16::from(command.throttle_half_percent) * 5
}

impl vendor::Judge for Judge {
    type Command = AmtCommand;

    fn new(_: &Engine) -> Self {
        Self
    }

    fn wire(&self, command: AmtCommand) -> WireCommand {
        match command.ops {
            Ops::EmergencyStop => WireCommand::Stop,
            Ops::AutoStop => WireCommand::Standby,
            Ops::Run => WireCommand::Run(tenths(command)),
            Ops::Ctf => WireCommand::Nothing,
        }
    }

    fn allows(&self, command: AmtCommand, order: Order, rise: &Rise) -> bool {
        let throttle = tenths(command);
        match (command.ops, order) {
            // An ECU that was just powered up obeys auto stop: it is sent the same while the node listens.
            (Ops::EmergencyStop, Order::EmergencyStop) | (Ops::AutoStop, Order::Standby | Order::Listen) => {
                throttle == 0
            }
            (Ops::Run, Order::Run(Demand::Throttle(given))) => {
                let given = given.tenths() / 5 * 5;
                throttle == 0 || throttle == given || rise.allows(throttle.into(), given.into(), 1000, 5)
            }
            _ => false,
        }
    }

    /// Each message is the reply to a set.
    fn shares_slot(&self, _: AmtCommand) -> bool {
        false
    }

    /// It commands no speed.
    fn rpm_step(&self) -> u32 {
        1
    }
}
