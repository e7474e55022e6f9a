//! MAVLink of a turbine node: engines in the ground station, throttle from the autopilot, settings as parameters.
//!
//! A [`Service`](service::Service) is sans IO, like the links: bytes of each port and the time in, frames out. It commands
//! engines as one source, through [`jetlink::channel::Source`], and sees only their telemetry and events, like all other code.
//! `docs/mavlink.md` in the repository describes the messages, commands and parameters.
//!
//! | module | contents |
//! |---|---|
//! | [`ids`], [`frame`], `extras` | numbers of MAVLink; frames to messages and back; what the checksum of each message covers |
//! | [`signing`], `retained`, `cover` | only senders with the key may command; how the key survives a reset and a loss of power |
//! | [`store`], [`record`], [`fram`], [`retained_settings`] | stored settings; an F-RAM that stores them; RAM that retains them
//! over a reset |
//! | `identity` | ids over a reset in flight |
//! | [`settings`], [`services`], [`refusal`] | parameters; the table of services; why something was refused |
//! | `vehicle`, `servo`, `request` | our autopilot, its arming, its outputs, and the requested rate |
//! | `kind` | effect of a message: it stops, reads or acts |
//! | `engine` | one engine: its switch, its demand source, its arming |
//! | [`attached`] | other attached devices: a receiver of radio control, fuel valves |
//! | [`report`], `text`, [`port`] | messages of an engine; texts; a port and its share of telemetry |
//! | [`packets`] | a port of packets, like USB: when a program has it open |
//! | [`service`], [`runner`] | all together; the clock and the ports |
//!
//! **Nothing here has run on hardware yet.**
#![no_std]
#![forbid(unsafe_code)]
#![deny(missing_docs, missing_debug_implementations)]

#[cfg(test)]
extern crate std;

pub mod attached;
#[cfg(feature = "signing")]
mod cover;
mod dialect;
mod engine;
mod extras;
mod fields;
pub mod fram;
pub mod frame;
mod identity;
pub mod ids;
mod kind;
mod number;
pub mod packets;
pub mod port;
pub mod record;
pub mod refusal;
pub mod report;
mod request;
#[cfg(feature = "signing")]
pub mod retained;
pub mod retained_settings;
pub mod runner;
mod sent;
pub mod service;
pub mod services;
mod servo;
pub mod settings;
#[cfg_attr(not(feature = "signing"), allow(dead_code, reason = "nothing is signed, and nothing has to be"))]
pub mod signing;
pub mod store;
#[cfg(test)]
mod tests;
mod text;
mod vehicle;
