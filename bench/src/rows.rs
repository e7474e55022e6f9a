//! The simulated ECU for a row of the table of engines, and its wire.

use jetlink::config::EngineConfig;
use jetlink::ecu::EcuConfig;
use sim::any::{AnyConfig, Protocol};
use sim::ecu::Ecu;
use sim::wire::{Plug, WireRx, WireTx, connect};

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

/// The same as the configuration of the row's protocol.
///
/// # Panics
/// If the row has another protocol.
pub fn simulated_as<C: TryFrom<AnyConfig, Error = AnyConfig>>(row: &EngineConfig) -> C {
    simulated(row).try_into().unwrap_or_else(|other| panic!("{} has an ECU of {other}", row.name))
}

/// An ECU on the row's line, powered up now: the node's UART, and the ECU's end.
pub fn wire<E: Ecu>(row: &EngineConfig, ecu: E, seed: u64) -> (WireRx, WireTx, Plug<E>) {
    connect(ecu, sim::line_of!(row.line), seed)
}
