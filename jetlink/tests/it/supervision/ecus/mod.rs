//! The ECUs of the worlds, by protocol. A new protocol needs a file, its `mod` line and its place in `random`: the
//! rest is made from the table of protocols.

mod amt;
mod vendor;
mod zk;

use super::rng::Rng;
use super::wire::Frame;
use jetlink::config::EngineConfig;
use sim::any::{AnyConfig, AnyEcu};
use sim::control::{self, Command};
pub use vendor::WorldEcu;

/// An engine with an ECU of any protocol.
pub fn random(rng: &mut Rng, port: u8) -> (EngineConfig, AnyConfig) {
    if rng.percent(55) { amt::random(rng, port) } else { zk::random(rng, port) }
}

macro_rules! ecus {
    ($($(#[$doc:meta])* $name:ident $module:ident($config:ty, $ecu:ty, $command:ty);)+) => {
        /// Whether an ECU governs the rpm itself.
        pub const fn holds_rpm(config: &AnyConfig) -> bool {
            match config {
                $(AnyConfig::$name(config) => $module::holds_rpm(config),)+
            }
        }

        pub fn ecu(ecu: &AnyEcu) -> &dyn WorldEcu {
            match ecu {
                $(AnyEcu::$name(ecu) => &**ecu,)+
            }
        }

        pub fn ecu_mut(ecu: &mut AnyEcu) -> &mut dyn WorldEcu {
            match ecu {
                $(AnyEcu::$name(ecu) => &mut **ecu,)+
            }
        }

        /// A frame of the node in the judge's terms.
        pub fn frame(frame: &control::Frame) -> Frame {
            let read = match frame.command {
                Err(_) => None,
                $(Ok(Command::$name(command)) => $module::frame(command),)+
            };
            read.unwrap_or(Frame::Bad(frame.raw))
        }
    };
}
sim::protocols!(ecus);
