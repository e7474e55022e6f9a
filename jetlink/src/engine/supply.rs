//! The supply voltage: the ECU's, or the board's for an ECU that reports none.

use super::data::Engine;
use crate::link::Link;
use crate::report::Timed;
use crate::units::Millivolts;

impl Engine {
    /// The supply voltage: the ECU's where it reports one with a known scale, otherwise the board's.
    pub(super) fn supply(&self) -> Option<Timed<Millivolts>> {
        let reported = self.link.status().report.supply;
        let voltage = reported.and_then(|supply| Some(Timed::new(supply.value.voltage?, supply.at)));
        voltage.or(self.board_supply)
    }
}
