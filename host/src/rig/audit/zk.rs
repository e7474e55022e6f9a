//! The commands of a ZK ECU that each order allows.

use super::super::engines::Engine;
use super::super::simulated::parameters;
use super::vendor::{self, Rise, WireCommand};
use jetlink::command::{Demand, Order};
use sim::ecu::{MILLIS, Nanos, SECOND};
use sim::wire::{Entry, Fate};
use sim::zk::{Action, Sw, ZkCommand, crc8};

/// Bytes of a status, from its head to its CRC.
const STATUS: usize = 7;
/// Head of the status with the three voltages; the pump's is in this byte.
const VOLTAGES: u8 = 0xF2;
const PUMP_VOLTAGE: usize = 5;
/// Time after a status with a pump voltage in which the pump may be closed: ten frames, one in every second send slot.
const CLOSED_WITHIN: Nanos = 3 * SECOND;

/// Judges the commands to one ECU.
#[derive(Clone, Debug)]
pub struct Judge {
    /// ID 2 with the configured rate.
    rate_action: Option<Action>,
    idle_rpm: u32,
    max_rpm: u32,
    /// RPM_X that covers the engine's maximum (ZK-9).
    factor: u8,
    /// The last bytes that the node has received.
    received: [u8; STATUS],
    /// The last status that it received and that shows a pump voltage of an engine at rest, whether the ECU sent it so or not.
    pump_seen_open: Option<Nanos>,
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
            received: [0; STATUS],
            pump_seen_open: None,
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
            (ZkCommand::Action(Action::ClosePump), Order::Standby | Order::EmergencyStop) => {
                self.pump_seen_open.is_some_and(|seen| (seen..=seen + CLOSED_WITHIN).contains(&rise.at))
            }
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

    fn received(&mut self, entry: &Entry, at_rest: bool) {
        let byte = match entry.fate {
            Fate::Delivered | Fate::Added => entry.byte,
            Fate::Flipped(byte) => byte,
            Fate::Lost => return,
            Fate::Framing(_) => {
                self.received = [0; STATUS];
                return;
            }
        };
        self.received.rotate_left(1);
        if let Some(last) = self.received.last_mut() {
            *last = byte;
        }
        let [status @ .., crc] = &self.received;
        let is_whole = self.received.first() == Some(&VOLTAGES) && crc8(status) == *crc;
        if is_whole && at_rest && self.received.get(PUMP_VOLTAGE).is_some_and(|&volts| volts > 0) {
            self.pump_seen_open = Some(entry.end);
        }
    }

    /// The speed, or the throttle, comes directly after the switch when the mode changes.
    fn shares_slot(&self, command: ZkCommand) -> bool {
        matches!(command, ZkCommand::Switch { .. })
    }

    fn switches_to_run(&self, command: ZkCommand) -> bool {
        matches!(command, ZkCommand::Switch { sw: Sw::Run, .. })
    }

    fn rpm_step(&self) -> u32 {
        u32::from(self.factor) * 10
    }
}
