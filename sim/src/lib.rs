//! Simulated ECUs with the turbines behind them, the serial line to them, and the clock that tests
//! and the rig run on.
//!
//! Everything here is written from the two protocol documents and from the page that settles their
//! open points (cited as `ZK-6`, `AMT-11`, ...), never from the driver under test: a misreading
//! must not appear on both sides of the line and cancel itself out.
//!
//! - [`clock`]: embassy's time driver for the host: virtual time, optionally limited to the wall clock.
//! - [`mod@line`]: baud rate, stop bits and the exact time that bytes take.
//! - [`ecu`]: the interface between an ECU and its line: bytes and times, no IO.
//! - [`wire`]: the two directions between one UART of the node and one ECU, with faults on demand.
//! - [`turbine`]: a plausible single-spool turbine.
//! - [`amt`], [`zk`]: the two kinds of ECU; [`any`](mod@any): any of them, and its configuration; [`vendor`]: what each provides.
//! - [`frame`]: a protocol's control frames; [`control`]: finds and reads those of any protocol.
//! - [`receiver`]: frames of radio control receivers.
//! - [`log`]: the commands that an ECU has obeyed, with their times.

#![deny(missing_docs, missing_debug_implementations, unsafe_code)]

pub mod amt;
pub mod any;
pub mod clock;
pub mod control;
pub mod ecu;
pub mod frame;
pub mod line;
pub mod log;
mod protocols;
pub mod receiver;
pub mod turbine;
pub mod vendor;
pub mod wire;
pub mod zk;
