//! The commands of a ZK ECU that each order allows.

use super::super::engines::Engine;
use super::super::simulated::parameters;
use super::vendor::{self, Rise, WireCommand};
use jetlink::command::{Demand, Order};
use sim::ecu::MILLIS;
use sim::zk::{Action, Sw, ZkCommand};

/// Judges the commands to one ECU.
#[derive(Clone, Debug)]
pub struct Judge {
    /// ID 2 with the configured rate.
    rate_action: Option<Action>,
    idle_rpm: u32,
    max_rpm: u32,
    /// RPM_X that covers the engine's maximum (ZK-9).
    factor: u8,
}

impl vendor::Judge for Judge {
    type Command = ZkCommand;

    fn new(engine: &Engine) -> Self {
        let parameters = parameters(engine);
        Self {
            rate_action: engine.cadence().map(|cadence| match cadence / MILLIS {
                50 => Action::Rate20,
                20 => Action::Rate50,
                _ => Action::Rate100,
            }),
            idle_rpm: parameters.idle_rpm as u32,
            max_rpm: parameters.max_rpm as u32,
            factor: (1..=6_u8)
                .find(|&factor| 40_950.0 * f64::from(factor) >= parameters.max_rpm)
                .unwrap_or(6),
        }
    }

    /// A speed is read with the RPM_X that this engine needs, which may follow it. The switch alone demands nothing.
    fn wire(&self, command: ZkCommand) -> WireCommand {
        match command {
            ZkCommand::Control { sw: Sw::Stop, .. } | ZkCommand::Switch { sw: Sw::Stop, .. } => {
                WireCommand::Stop
            }
            ZkCommand::Control { sw: Sw::Standby, .. } | ZkCommand::Switch { sw: Sw::Standby, .. } => {
                WireCommand::Standby
            }
            ZkCommand::Control { sw: Sw::Run, throttle } => WireCommand::Run(throttle),
            ZkCommand::Rpm(code) => WireCommand::RunRpm(u32::from(code) * self.rpm_step()),
            ZkCommand::Control { sw: Sw::None, .. }
            | ZkCommand::Switch { sw: Sw::None | Sw::Run, .. }
            | ZkCommand::Empty
            | ZkCommand::Action(_)
            | ZkCommand::Unlock
            | ZkCommand::IgnitionVoltage(_)
            | ZkCommand::AccelerationCurve(_)
            | ZkCommand::Pressure(_) => WireCommand::Nothing,
        }
    }

    fn allows(&self, command: ZkCommand, order: Order, rise: &Rise) -> bool {
        let switch = match order {
            Order::EmergencyStop => Sw::Stop,
            Order::Standby => Sw::Standby,
            Order::Run(_) => Sw::Run,
            Order::Pwm => Sw::None,
            // Only ID 0 until the ECU has reported its engine's state; in mode 3 the rpm as well.
            Order::Listen => return command == ZkCommand::Empty,
            Order::Doubt(_) => return matches!(command, ZkCommand::Empty | ZkCommand::Rpm(_)),
        };
        match (command, order) {
            (ZkCommand::Empty, _) => true,
            (ZkCommand::Action(action), _) => Some(action) == self.rate_action,
            (ZkCommand::Control { sw, throttle }, Order::Run(Demand::Throttle(given))) => {
                let given = given.tenths();
                let rises = rise.allows(throttle.into(), given.into(), 1000, 1);
                sw == switch && (throttle == 0 || throttle == given || rises)
            }
            (ZkCommand::Control { .. }, Order::Run(Demand::Rpm(_))) => false,
            (ZkCommand::Control { sw, throttle }, _) => sw == switch && throttle == 0,
            (ZkCommand::Switch { sw, factor }, Order::Run(Demand::Rpm(_))) => {
                sw == switch && factor == self.factor
            }
            (ZkCommand::Switch { sw, factor }, _) => sw == switch && factor == 0,
            (ZkCommand::Rpm(code), Order::Run(Demand::Rpm(given))) => {
                let (given, step) = (given.get(), self.rpm_step());
                let exact =
                    [given, given.min(self.idle_rpm), 0].iter().any(|rpm| u32::from(code) == rpm / step);
                exact || rise.allows(u32::from(code) * step, given, self.max_rpm, step)
            }
            _ => false,
        }
    }

    /// The speed, or the throttle, comes directly after the switch when the mode changes.
    fn shares_slot(&self, command: ZkCommand) -> bool {
        matches!(command, ZkCommand::Switch { .. })
    }

    fn rpm_step(&self) -> u32 {
        u32::from(self.factor) * 10
    }
}
