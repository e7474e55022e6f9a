//! The simulated ECUs with that of the toy protocol, which is added as docs/porting.md says: a folder, `toy/`, its `mod` line here, and a
//! line in `protocols.rs`. All other files are those of `sim`. A test compares the two lists of modules and both tables.

#![deny(missing_docs, missing_debug_implementations, unsafe_code)]

#[path = "../../../sim/src/amt/mod.rs"]
pub mod amt;
#[path = "../../../sim/src/any.rs"]
pub mod any;
#[path = "../../../sim/src/clock/mod.rs"]
pub mod clock;
#[path = "../../../sim/src/control.rs"]
pub mod control;
#[path = "../../../sim/src/ecu.rs"]
pub mod ecu;
#[path = "../../../sim/src/frame.rs"]
pub mod frame;
#[path = "../../../sim/src/line.rs"]
pub mod line;
#[path = "../../../sim/src/log.rs"]
pub mod log;
mod protocols;
#[path = "../../../sim/src/receiver.rs"]
pub mod receiver;
pub mod toy;
#[path = "../../../sim/src/turbine/mod.rs"]
pub mod turbine;
#[path = "../../../sim/src/vendor.rs"]
pub mod vendor;
#[path = "../../../sim/src/wire/mod.rs"]
pub mod wire;
#[path = "../../../sim/src/zk/mod.rs"]
pub mod zk;
