//! MAVLink of a turbine node: engines in the ground station, throttle from the autopilot, settings as parameters.
//!
//! A [`Service`](service::Service) is sans IO, as the links are: bytes of each port and the time in, frames out. It commands
//! engines as one source, through [`jetlink::channel::Source`], and sees of them what everybody sees: telemetry and events.
//! `docs/mavlink.md` of the repository has the messages, commands and parameters.
//!
//! | module | contents |
//! |---|---|
//! | [`ids`], [`frame`] | numbers of MAVLink; frames to messages and back |
//! | [`signing`] | who has the key may command |
//! | [`settings`], [`services`], [`refusal`] | parameters; the table of services; why something was refused |
//! | `vehicle`, `servo`, `request` | our autopilot, its arming, its outputs, and the rate that is asked for |
//! | `engine` | one engine: its switch, its demand source, what arms it |
//! | [`report`], `text`, [`port`] | messages of an engine; texts; a port and its share of telemetry |
//! | [`service`] | all together |
//!
//! **Nothing here has run on hardware yet.** There is no storage: see `docs/mavlink.md`.
#![no_std]
#![forbid(unsafe_code)]
#![deny(missing_docs, missing_debug_implementations)]

#[cfg(test)]
extern crate std;

mod dialect;
mod engine;
pub mod frame;
pub mod ids;
mod number;
pub mod port;
pub mod refusal;
pub mod report;
mod request;
pub mod service;
pub mod services;
mod servo;
pub mod settings;
pub mod signing;
#[cfg(test)]
mod tests;
mod text;
mod vehicle;
