//! Drives small turbines through their engine control units (ECUs): one UART for each engine, the
//! AMT serial protocol or the ZK-Protocol on any of them.
//!
//! The layers, from the wire up. Each knows the one below by its types, never the one above.
//!
//! | module | what it knows |
//! |---|---|
//! | [`ecu::amt::codec`], [`ecu::zk::codec`] | bytes and typed frames of one protocol; scale and offset |
//! | [`ecu::amt::link`], [`ecu::zk::link`] | one protocol's conversation: reply window, cadence, loss, what is known of the ECU |
//! | [`engine`] | one engine in plain words: command, demand, emergency stop, stages of loss |
//! | [`runner`], [`channel`] | bytes and time between one engine and one UART; handles for everybody else |
//! | [`node`], [`config`], [`health`] | all engines of one board, and how the board is |
//!
//! Codecs, links and engines do no IO and read no clock: time comes in as an argument. So every rule of
//! timing can be tested as a table, and whoever reads a link reads the protocol.
//!
//! Numbers such as `ZK-6` or `AMT-11` in comments are reading points: `docs/protocols.md` of the
//! repository explains each, with what the protocol documents say and leave open.
#![no_std]
#![forbid(unsafe_code)]
#![deny(missing_docs, missing_debug_implementations)]

mod open_enum;

pub mod channel;
pub mod command;
pub mod config;
pub mod ecu;
pub mod engine;
pub mod event;
pub mod health;
pub mod limit;
pub mod line;
pub mod link;
pub mod node;
pub mod report;
pub mod runner;
pub mod telemetry;
pub mod units;
