//! The toy protocol, a folder as docs/porting.md describes it.
//!
//! The protocol's document: 9600 baud, 8N1.
//!
//! - ECU to host, every 100 ms: 0xA5, then the state: 0 at rest, 1 running; bit 7 is set while the engine is overheated. Then
//!   the exhaust temperature in 5 °C.
//! - Host to ECU: 0x5A, then 0 for nothing, 1 for standby, 2 for run, 3 for an emergency stop, 4 to prime the fuel line.
//! - An ECU without a command for 1 s stops its engine.

pub mod codec;
pub mod config;
pub mod link;
