//! A toy ECU as one of any protocol.

use super::{ToyConfig, ToyEcu};
use crate::ecu::Counts;
use crate::line::Line;
use crate::turbine::{Parameters, Turbine};
use crate::vendor::{VendorConfig, VendorEcu};
use core::fmt;

impl fmt::Display for ToyConfig {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "toy {}", self.engine)
    }
}

impl VendorConfig for ToyConfig {
    type Ecu = ToyEcu;

    const HAS_CHECKSUM: bool = false;
    const HAS_REPLY_WINDOW: bool = false;

    fn of_engine(number: u8) -> Self {
        Self::new(number)
    }

    fn on(self, line: Line) -> Self {
        Self { line, ..self }
    }

    fn with_log(self, log: usize) -> Self {
        Self { log, ..self }
    }

    fn turbine(&self) -> &Parameters {
        &self.turbine
    }

    fn turbine_mut(&mut self) -> &mut Parameters {
        &mut self.turbine
    }

    fn ecu(self) -> ToyEcu {
        ToyEcu::new(self)
    }
}

impl VendorEcu for ToyEcu {
    fn turbine(&self) -> &Turbine {
        &self.turbine
    }

    fn turbine_mut(&mut self) -> &mut Turbine {
        &mut self.turbine
    }

    fn received(&self) -> (u64, u64) {
        (self.commands.total(), self.stats.bad)
    }

    fn counts(&self) -> Counts {
        let Self { stats, .. } = self;
        let accepted = self.commands.total();
        Counts {
            frames: stats.frames,
            accepted,
            bad: stats.bad,
            loss_stops: stats.loss_stops,
            ..Counts::default()
        }
    }

    fn host_faults(&self) -> Vec<&'static str> {
        if self.stats.loss_stops > 0 { vec!["it stopped its engine without a command"] } else { Vec::new() }
    }
}
