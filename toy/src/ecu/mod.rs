//! The supported ECUs, each in its own folder, and their common types: configuration, services, faults.

#[path = "../../../jetlink/src/ecu/amt/mod.rs"]
pub mod amt;
#[path = "../../../jetlink/src/ecu/any.rs"]
pub mod any;
#[path = "../../../jetlink/src/ecu/decoder.rs"]
mod decoder;
pub mod toy;
#[path = "../../../jetlink/src/ecu/types.rs"]
mod types;
#[path = "../../../jetlink/src/ecu/vendor.rs"]
pub mod vendor;
#[path = "../../../jetlink/src/ecu/zk/mod.rs"]
pub mod zk;

/// The protocols: each a variant of the configuration, the services, the faults and the link of any ECU, with its number, its name and
/// its own parts of the wiring. A new one is a folder and a line here (docs/porting.md); `Config`, `Service` and the faults provide what the
/// macros need. Numbers, bits and their order are stored, so they never change.
macro_rules! protocols {
    ($make:ident) => {
        $make! {
            /// AMT serial control.
            Amt = 1 "AMT" ($crate::ecu::amt::config::Config, $crate::ecu::amt::config::Mistake, $crate::ecu::amt::config::Service, $crate::ecu::amt::codec::ErrorBits) {
                amt_engine: number "E1_AMT_ENGINE" in 0..=7, 5 bits, "With AMT: the engine, if its scale shall be known before the ECU names it. 0: not known. 1 Mercury, 2 Pegasus, 3 Olympus, 4 Titan, 5 Nike, 6 Lynx, 7 Orion.";
            };
            /// ZK-Protocol.
            Zk = 2 "ZK" ($crate::ecu::zk::config::Config, $crate::ecu::zk::config::Mistake, $crate::ecu::zk::config::Service, $crate::ecu::zk::codec::ErrorCode) {
                zk_rate: status_rate "E1_ZK_RATE" in 20..=100, 7 bits, "With ZK: status rate in Hz: 20, 50 or 100.";
            };
            /// The toy protocol.
            Toy = 3 "toy" ($crate::ecu::toy::config::Config, $crate::ecu::toy::config::Mistake, $crate::ecu::toy::config::Service, $crate::ecu::toy::codec::Faults) { toy_engine: number "E1_TOY_ENGINE" in 0..=1, 1 bits, "With the toy: serial number of the engine."; };
        }
    };
}
pub(crate) use protocols;
use types::vendor_types;

protocols!(vendor_types);
