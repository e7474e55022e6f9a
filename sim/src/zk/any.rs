//! A ZK ECU as one of any protocol.

use super::{ZkConfig, ZkEcu};
use crate::ecu::Counts;
use crate::line::Line;
use crate::turbine::{Parameters, Turbine};
use crate::vendor::{VendorConfig, VendorEcu};
use core::fmt;

impl fmt::Display for ZkConfig {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "ZK version {}", self.version)
    }
}

impl VendorConfig for ZkConfig {
    type Ecu = ZkEcu;

    const HAS_CHECKSUM: bool = true;
    const HAS_REPLY_WINDOW: bool = false;

    /// Its engines have no numbers; version 5 is the usual one.
    fn of_engine(_: u8) -> Self {
        Self::new(5)
    }

    fn with_version(self, version: u8) -> Self {
        Self { version, ids: Self::new(version).ids, ..self }
    }

    fn on(self, line: Line) -> Self {
        Self::on(self, line)
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

    fn ecu(self) -> ZkEcu {
        ZkEcu::new(self)
    }
}

impl VendorEcu for ZkEcu {
    fn turbine(&self) -> &Turbine {
        Self::turbine(self)
    }

    fn turbine_mut(&mut self) -> &mut Turbine {
        Self::turbine_mut(self)
    }

    fn received(&self) -> (u64, u64) {
        (self.stats.accepted, self.stats.bad.total() + self.stats.stray_bytes)
    }

    fn counts(&self) -> Counts {
        self.stats.counts()
    }

    fn host_faults(&self) -> Vec<&'static str> {
        self.stats.host_faults()
    }

    fn unknown_to_version(&self) -> u64 {
        self.stats.ignored.version
    }
}
