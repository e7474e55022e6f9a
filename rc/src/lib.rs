//! Radio control of a turbine node: a receiver's channels become commands, and an engine's state switches its fuel valve and
//! the power of its starter and ignition.
//!
//! Everything but the runner is sans IO, like the links of the library: bytes, pulse widths and the time in, commands and
//! levels out. `docs/rc.md` in the repository describes the rules, the settings and what is missing.
//!
//! | module | contents |
//! |---|---|
//! | [`channels`], `confirm` | channels of a receiver; when their values are valid |
//! | [`sbus`], [`crsf`], [`pwm`], [`input`] | the three inputs, and one type for all |
//! | [`edges`] | pulses from the edges that a timer catches |
//! | [`reception`] | counters of what was received, for people |
//! | [`settings`], [`config`] | settings of an engine and of its outputs; the receiver of a node |
//! | `position`, `alternation` | positions of a switch, debounced; a throttle that two senders move |
//! | [`calibration`], [`pilot`] | end points of the stick; one engine: its stick, its switch, its commands |
//! | [`service`], [`runner`] | one receiver and its engines; its UART |
//! | [`outputs`], [`wiring`] | fuel valve, power of starter and ignition; the pins that drive them |
//! | [`starts`] | a bound on a firmware that fails at each start |
//! | [`shared`], `parameters` | outputs as other tasks see them; with the feature `mavlink`, settings as parameters, and reports |
//!
//! **A value is valid when it is the median of three consecutive good frames.** So no single damaged frame moves a throttle or
//! a switch, with or without a checksum.
//!
//! The decoders are our own. The package `sbus-rs` 0.1.3 ignores time and takes every 0x0F for the start of a frame: if it
//! begins in the middle of a frame, it can stay out of step forever and report wrong values as good. `crsf` 2.0.1 panics on
//! a short frame with a correct checksum, and drops what follows a frame in its buffer.
//!
//! **Nothing here has run on hardware yet.**
#![no_std]
#![forbid(unsafe_code)]
#![deny(missing_docs, missing_debug_implementations)]

#[cfg(test)]
extern crate std;

mod alternation;
pub mod calibration;
pub mod channels;
pub mod config;
mod confirm;
mod count;
pub mod crsf;
pub mod edges;
pub mod input;
pub mod outputs;
#[cfg(feature = "mavlink")]
pub mod parameters;
pub mod pilot;
mod position;
pub mod pwm;
pub mod reception;
pub mod runner;
pub mod sbus;
pub mod service;
pub mod settings;
pub mod shared;
pub mod starts;
#[cfg(test)]
mod tests;
pub mod wiring;
