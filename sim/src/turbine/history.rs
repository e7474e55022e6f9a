//! Events of a turbine that its ECU's reports do not show reliably, for judges that use only true events.

use crate::ecu::Nanos;

/// Fuel that flowed into a hot engine without combustion.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct HotFuel {
    /// Time at which it began.
    pub from: Nanos,
    /// Duration of the flow.
    pub length: Nanos,
}

/// All events since the turbine's creation.
#[derive(Clone, Debug, Default)]
pub struct History {
    /// Times at which a start began: starter and igniter on.
    pub ignitions: Vec<Nanos>,
    /// Those of them that the ECU began automatically.
    pub relights: Vec<Nanos>,
    /// Times of ignition.
    pub light_offs: Vec<Nanos>,
    /// Every flow of fuel into an engine that neither starts nor runs, with its exhaust at
    /// [`COOL_EGT`](super::COOL_EGT) or above.
    pub hot_fuel: Vec<HotFuel>,
}

impl History {
    /// All fuel into a hot engine without combustion.
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
