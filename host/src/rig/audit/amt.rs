//! The control messages of an AMT ECU that each order allows.

use super::Audit;
use jetlink::command::{Demand, Order};
use sim::amt::{AmtCommand, Ops};

impl Audit {
    /// Whether this order allows this message.
    pub(super) fn amt_allows(&self, order: Order, command: AmtCommand) -> bool {
        let throttle = u16::from(command.throttle_half_percent) * 5;
        match (command.ops, order) {
            // An ECU that was just powered up obeys auto stop: that is what it is sent while the node listens.
            (Ops::EmergencyStop, Order::EmergencyStop) | (Ops::AutoStop, Order::Standby | Order::Listen) => {
                throttle == 0
            }
            (Ops::Run, Order::Run(Demand::Throttle(given))) => {
                let given = given.tenths() / 5 * 5;
                throttle == 0 || throttle == given || self.rises(throttle.into(), given.into(), 1000, 5)
            }
            _ => false,
        }
    }
}
