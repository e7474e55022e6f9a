//! The simulated ECU for a row of the table of engines.

use jetlink::config::EngineConfig;
use jetlink::ecu::EcuConfig;
use sim::any::{AnyConfig, Protocol};

macro_rules! protocols {
    ($($(#[$doc:meta])* $name:ident $module:ident($config:ty, $ecu:ty, $command:ty);)+) => {
        const fn protocol(ecu: &EcuConfig) -> Protocol {
            match ecu {
                $(EcuConfig::$name(_) => Protocol::$name,)+
            }
        }
    };
}
sim::protocols!(protocols);

/// The usual ECU of the engine that the row names, on the row's line.
pub fn simulated(row: &EngineConfig) -> AnyConfig {
    let [_, engine] = row.ecu.identity();
    AnyConfig::of_engine(protocol(&row.ecu), engine).on(sim::line_of!(row.line))
}
