//! Benches of the tests, of the library and of whole nodes. The rig and the runner of QEMU use [`rows`] only.
//!
//! - [`by_hand`]: a link or an engine without clock and task. The bench plays the runner and the UART.
//! - [`rows`]: the simulated ECU for a row of the table of engines, and its wire.
//! - [`wired`]: an engine with its runner on a simulated wire, a simulated ECU on the other end.

#![forbid(unsafe_code)]

pub mod by_hand;
pub mod rows;
pub mod wired;
