//! Benches of the tests, of the library and of whole nodes: for tests only.
//!
//! - [`by_hand`]: a link or an engine without clock and task. The bench plays the runner and the UART.
//! - [`wired`]: an engine with its runner on a simulated wire, a simulated ECU on the other end.

#![forbid(unsafe_code)]

pub mod by_hand;
pub mod wired;
