//! The control messages of an AMT ECU that each order allows.

use super::{Audit, Judged};
use jetlink::command::{Demand, Order};
use sim::amt::{AmtCommand, Ops};

impl Judged for AmtCommand {
    fn allowed_by(self, order: Order, audit: &Audit) -> bool {
        let throttle = u16::from(self.throttle_half_percent) * 5;
        match (self.ops, order) {
            // An ECU that was just powered up obeys auto stop: that is what it is sent while the node listens.
            (Ops::EmergencyStop, Order::EmergencyStop) | (Ops::AutoStop, Order::Standby | Order::Listen) => {
                throttle == 0
            }
            (Ops::Run, Order::Run(Demand::Throttle(given))) => {
                let given = given.tenths() / 5 * 5;
                throttle == 0 || throttle == given || audit.rises(throttle.into(), given.into(), 1000, 5)
            }
            _ => false,
        }
    }
}
