//! An AMT ECU as one of any protocol.

use super::{AmtConfig, AmtEcu, EngineModel, error};
use crate::ecu::{Counts, Nanos};
use crate::line::Line;
use crate::turbine::{Parameters, Turbine};
use crate::vendor::{VendorConfig, VendorEcu};
use core::fmt;

impl fmt::Display for AmtConfig {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "AMT {}", self.engine)
    }
}

impl VendorConfig for AmtConfig {
    type Ecu = AmtEcu;

    const HAS_CHECKSUM: bool = false;
    const HAS_REPLY_WINDOW: bool = true;

    /// From 1 on, in the order of [`EngineModel::ALL`]; the Olympus is the usual one.
    fn of_engine(number: u8) -> Self {
        let engine = EngineModel::ALL.into_iter().zip(1..).find(|(_, known)| *known == number);
        Self::new(engine.map_or(EngineModel::Olympus, |(engine, _)| engine))
    }

    fn on(self, line: Line) -> Self {
        Self::on(self, line)
    }

    fn with_log(self, log: usize) -> Self {
        Self { log, ..self }
    }

    fn with_reply_window(self, reply_window: Nanos) -> Self {
        Self { reply_window, ..self }
    }

    fn turbine(&self) -> &Parameters {
        &self.turbine
    }

    fn turbine_mut(&mut self) -> &mut Parameters {
        &mut self.turbine
    }

    fn ecu(self) -> AmtEcu {
        AmtEcu::new(self)
    }
}

impl VendorEcu for AmtEcu {
    fn turbine(&self) -> &Turbine {
        Self::turbine(self)
    }

    fn turbine_mut(&mut self) -> &mut Turbine {
        Self::turbine_mut(self)
    }

    fn received(&self) -> (u64, u64) {
        (self.stats.valid, self.stats.bad.total() + self.stats.stray_bytes)
    }

    fn counts(&self) -> Counts {
        self.stats.counts()
    }

    fn host_faults(&self) -> Vec<&'static str> {
        self.stats.host_faults()
    }

    /// Meanwhile it sends error sets, which do not report the engine's state.
    fn report_low_supply(&mut self, low: bool) {
        self.set_errors(if low { error::SUPPLY_LOW } else { 0 });
    }
}
