//! The ECUs of the worlds, by protocol: every behaviour that the documents allow. A new protocol is a file, with its `mod`
//! line and its place in `random`; the code below is generated from the table of protocols.

pub mod amt;
mod vendor;
pub mod zk;

use crate::history::{PilotCommand, Sent};
use crate::kind::Kind;
use crate::pilots::Rng;
use jetlink::config::EngineConfig;
use jetlink::ecu::Service;
use sim::any::{AnyConfig, AnyEcu};
use sim::control::{self, Command};
pub use vendor::{Odd, Seen, WorldConfig, WorldEcu};

/// An engine with an ECU of any protocol.
pub fn random(rng: &mut Rng, port: u8) -> (EngineConfig, AnyConfig) {
    if rng.percent(45) { amt::random(rng, port) } else { zk::random(rng, port) }
}

/// Makes an engine start and cool quickly, with an ECU for the drills.
pub fn quicken(rng: &mut Rng, engine: &mut EngineConfig, ecu: &mut AnyConfig) {
    let turbine = ecu.turbine_mut();
    *turbine = turbine.starting_in(10.0);
    turbine.cooling_s = rng.pick(&[8.0, 8.0, 8.0, 20.0, turbine.cooling_s]);
    config_mut(ecu).for_drills(rng, &mut engine.ecu);
}

macro_rules! ecus {
    ($($(#[$doc:meta])* $name:ident $module:ident($config:ty, $ecu:ty, $command:ty);)+) => {
        pub fn config(config: &AnyConfig) -> &dyn WorldConfig {
            match config {
                $(AnyConfig::$name(config) => config,)+
            }
        }

        fn config_mut(config: &mut AnyConfig) -> &mut dyn WorldConfig {
            match config {
                $(AnyConfig::$name(config) => config,)+
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

        /// A service command of radio control or MAVLink in the judge's terms.
        pub fn pilot_command(service: Service) -> PilotCommand {
            match service {
                $(Service::$name(service) => $module::pilot_command(service),)+
            }
        }

        /// A control frame in the judge's terms.
        pub fn sent(frame: &control::Frame) -> Sent {
            match frame.command {
                Err(_) => Sent::Bad(frame.raw),
                $(Ok(Command::$name(command)) => $module::sent(command, frame),)+
            }
        }
    };
}
sim::protocols!(ecus);

/// Whether an ECU that reports this fault marks its own exhaust temperature as wrong.
pub fn disowns_exhaust(kind: Kind, fault: u8) -> bool {
    match kind {
        Kind::Amt => amt::disowns_exhaust(fault),
        Kind::Zk(_) => false,
    }
}
