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

/// The protocols: each a variant of the configuration, the services, the faults and the link of any ECU. A new one is a
/// folder and a line here (docs/porting.md); `Config`, `Service` and the faults provide what the macros need.
macro_rules! protocols {
    ($make:ident) => {
        $make! {
            /// AMT serial control.
            Amt($crate::ecu::amt::config::Config, $crate::ecu::amt::config::Mistake, $crate::ecu::amt::config::Service, $crate::ecu::amt::codec::ErrorBits);
            /// ZK-Protocol.
            Zk($crate::ecu::zk::config::Config, $crate::ecu::zk::config::Mistake, $crate::ecu::zk::config::Service, $crate::ecu::zk::codec::ErrorCode);
            /// The toy protocol.
            Toy($crate::ecu::toy::config::Config, $crate::ecu::toy::config::Mistake, $crate::ecu::toy::config::Service, $crate::ecu::toy::codec::Faults);
        }
    };
}
use protocols;
use types::vendor_types;

protocols!(vendor_types);
