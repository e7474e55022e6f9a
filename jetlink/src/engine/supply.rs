//! The supply voltage: the ECU's, or the board's for an ECU that reports none.

use super::Engine;
use crate::link::Link;
use crate::report::Timed;
use crate::units::Millivolts;
use embassy_time::Instant;

impl Engine {
    /// Takes the supply voltage that the board measures. It counts where the ECU reports none: for the interlock of a start
    /// (`start.supply_min`) and the limit (`limits.supply_low`).
    pub fn board_supply(&mut self, now: Instant, voltage: Millivolts) {
        self.board_supply = Some(Timed::new(voltage, now));
        self.touch();
        self.look(now);
        self.update(now);
    }

    /// The supply voltage: the ECU's where it reports one with a known scale, otherwise the board's.
    pub(super) fn supply(&self) -> Option<Timed<Millivolts>> {
        let reported = self.link.status().report.supply;
        let voltage = reported.and_then(|supply| Some(Timed::new(supply.value.voltage?, supply.at)));
        voltage.or(self.board_supply)
    }
}
