//! The library with a toy protocol, which is added as docs/porting.md says: a folder, `ecu/toy/`, and two lines in `ecu/mod.rs`.
//! All other files are those of the library itself, so that it builds proves that no other one has to change. A test compares
//! the two lists of modules and both `ecu/mod.rs`.
//!
//! The simulated toy ECU and the tests are in `tests/it/`.
#![no_std]
#![forbid(unsafe_code)]
#![deny(missing_docs, missing_debug_implementations)]
#![allow(clippy::int_plus_one, reason = "the sum of all bits in wiring.rs ends with the toy's one")]

#[path = "../../jetlink/src/channel.rs"]
pub mod channel;
#[path = "../../jetlink/src/checksum.rs"]
pub mod checksum;
#[path = "../../jetlink/src/codes.rs"]
mod codes;
#[path = "../../jetlink/src/command.rs"]
pub mod command;
#[path = "../../jetlink/src/config.rs"]
pub mod config;
#[path = "../../jetlink/src/consecutive.rs"]
mod consecutive;
#[path = "../../jetlink/src/copies.rs"]
pub mod copies;
#[path = "../../jetlink/src/debounce.rs"]
mod debounce;
pub mod ecu;
#[path = "../../jetlink/src/engine/mod.rs"]
pub mod engine;
#[path = "../../jetlink/src/event.rs"]
pub mod event;
#[path = "../../jetlink/src/health.rs"]
pub mod health;
#[path = "../../jetlink/src/indication.rs"]
pub mod indication;
#[path = "../../jetlink/src/limit.rs"]
pub mod limit;
#[path = "../../jetlink/src/line.rs"]
pub mod line;
#[path = "../../jetlink/src/link.rs"]
pub mod link;
#[path = "../../jetlink/src/mistake.rs"]
mod mistake;
#[path = "../../jetlink/src/node.rs"]
pub mod node;
#[path = "../../jetlink/src/report.rs"]
pub mod report;
#[path = "../../jetlink/src/runner.rs"]
pub mod runner;
#[path = "../../jetlink/src/sentence.rs"]
mod sentence;
#[path = "../../jetlink/src/setting.rs"]
pub mod setting;
#[path = "../../jetlink/src/telemetry.rs"]
pub mod telemetry;
#[path = "../../jetlink/src/units.rs"]
pub mod units;
#[path = "../../jetlink/src/watch.rs"]
pub mod watch;
#[path = "../../jetlink/src/wiring.rs"]
pub mod wiring;
