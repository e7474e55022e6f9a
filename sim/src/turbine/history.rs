//! What happened to a turbine that no report of its ECU shows reliably: for judges that know only the truth.

use crate::ecu::Nanos;

/// Fuel that flowed into a hot engine without a fire.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct HotFuel {
    /// When it began.
    pub from: Nanos,
    /// For how long it flowed.
    pub length: Nanos,
}

/// Everything since the turbine was built.
#[derive(Clone, Debug, Default)]
pub struct History {
    /// Each instant at which a start began: starter and igniter on.
    pub ignitions: Vec<Nanos>,
    /// Those of them that the ECU began by itself.
    pub relights: Vec<Nanos>,
    /// Each instant at which fuel caught fire.
    pub light_offs: Vec<Nanos>,
    /// Each time that fuel flowed into an engine that neither starts nor runs, with its exhaust at
    /// [`COOL_EGT`](super::COOL_EGT) or above.
    pub hot_fuel: Vec<HotFuel>,
}

impl History {
    /// All fuel into a hot engine without a fire.
    pub fn hot_fuel_time(&self) -> Nanos {
        self.hot_fuel.iter().map(|fuel| fuel.length).sum()
    }

    /// The step from `from` to `until` let fuel into a hot engine.
    pub(super) fn add_hot_fuel(&mut self, from: Nanos, until: Nanos) {
        match self.hot_fuel.last_mut() {
            Some(last) if last.from + last.length == from => last.length = until - last.from,
            _ => self.hot_fuel.push(HotFuel { from, length: until - from }),
        }
    }
}
