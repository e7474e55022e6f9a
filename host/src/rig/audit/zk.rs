//! The commands of a ZK ECU that each order allows.

use super::{Audit, Judged};
use jetlink::command::{Demand, Order};
use sim::zk::{Sw, ZkCommand};

impl Judged for ZkCommand {
    fn allowed_by(self, order: Order, audit: &Audit) -> bool {
        let switch = match order {
            Order::EmergencyStop => Sw::Stop,
            Order::Standby => Sw::Standby,
            Order::Run(_) => Sw::Run,
            Order::Pwm => Sw::None,
            // Nothing but ID 0, until the ECU has reported what its engine does; in mode 3 the rpm as well.
            Order::Listen => return self == ZkCommand::Empty,
            Order::Doubt(_) => return matches!(self, ZkCommand::Empty | ZkCommand::Rpm(_)),
        };
        match (self, order) {
            (ZkCommand::Empty, _) => true,
            (ZkCommand::Action(action), _) => Some(action) == audit.rate_action,
            (ZkCommand::Control { sw, throttle }, Order::Run(Demand::Throttle(given))) => {
                let given = given.tenths();
                let rises = audit.rises(throttle.into(), given.into(), 1000, 1);
                sw == switch && (throttle == 0 || throttle == given || rises)
            }
            (ZkCommand::Control { .. }, Order::Run(Demand::Rpm(_))) => false,
            (ZkCommand::Control { sw, throttle }, _) => sw == switch && throttle == 0,
            (ZkCommand::Switch { sw, factor }, Order::Run(Demand::Rpm(_))) => {
                sw == switch && factor == audit.factor
            }
            (ZkCommand::Switch { sw, factor }, _) => sw == switch && factor == 0,
            (ZkCommand::Rpm(code), Order::Run(Demand::Rpm(given))) => {
                let given = given.get();
                let step = u32::from(audit.factor) * 10;
                let exact =
                    [given, given.min(audit.idle_rpm), 0].iter().any(|rpm| u32::from(code) == rpm / step);
                exact || audit.rises(u32::from(code) * step, given, audit.max_rpm, step)
            }
            _ => false,
        }
    }
}
