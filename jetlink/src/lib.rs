//! Small turbines through their engine control units (ECUs): one UART for each engine, the AMT serial protocol or the
//! ZK-Protocol on any of them.
//!
//! An engine is a [`Channel`](channel::Channel). A task owns its UART and runs its [`Runner`](runner::Runner), which keeps
//! the reply window (AMT, 30 ms) or the cadence (ZK). Whoever commands holds a [`Source`](channel::Source); the engine
//! arbitrates between sources, guards starts, and brings an engine without a source to its fail-safe. Whoever listens has
//! a [`Handle`](channel::Handle): telemetry, events, progress for a watchdog.
//!
//! **A wrong byte costs an engine or an aircraft. Nothing here has run on hardware yet.**
//!
//! ```no_run
//! use embedded_io_async::{Read, Write};
//! use embassy_time::{Duration, Ticker};
//! use jetlink::channel::{Channel, Source};
//! use jetlink::command::{Command, Demand, Origin};
//! use jetlink::config::{EngineConfig, check};
//! use jetlink::ecu::zk::codec::Rate;
//! use jetlink::engine::retained::{RetainedMemory, Reset};
//! use jetlink::line::Line;
//! use jetlink::runner::LineErrors;
//! use jetlink::units::Throttle;
//!
//! // A status rate that the line cannot carry, or a baud rate that no document prints, does not build.
//! const ENGINE: EngineConfig = EngineConfig::zk("left", 0, Line::new(9600), Rate::Hz50);
//! const _: () = check(&[ENGINE]);
//!
//! // In RAM that start-up leaves alone, so that a running engine goes on after a reset (docs/porting.md).
//! static RETAINED: RetainedMemory = RetainedMemory::new();
//!
//! /// One engine on the two halves of a UART: for ever.
//! async fn engine(rx: impl Read, tx: impl Write, reset: Reset) {
//!     let channel = Channel::new(&ENGINE, Some((&RETAINED, reset)));
//!     let errors = LineErrors::new(); // what the UART's interrupt counts, if it does
//!     let Ok(source) = channel.handle().source(Origin::Rc) else { return };
//!     let pilot = pilot(source);
//!     embassy_futures::join::join(channel.runner().run(rx, tx, &errors), pilot).await;
//! }
//!
//! /// Starts the engine and runs it at idle. A source repeats its command within its age limit, 0.5 s.
//! async fn pilot(source: Source<'_>) {
//!     let mut tick = Ticker::every(Duration::from_millis(100));
//!     let _ = source.command(Command::Arm);
//!     loop {
//!         // A start is a permission that is used once: standby, then run at idle with every interlock true.
//!         let run = Command::Run(Demand::Throttle(Throttle::IDLE));
//!         if let Err(_why) = source.command(run) {
//!             let _ = source.command(Command::Standby);
//!         }
//!         tick.next().await;
//!     }
//! }
//! ```
//!
//! The layers, from the wire up. A file imports only from those before it.
//!
//! | module | what it knows |
//! |---|---|
//! | [`units`], [`mod@line`] | quantities; the serial line |
//! | [`ecu::amt::codec`], [`ecu::zk::codec`] | bytes and typed frames of one protocol; scale and offset |
//! | [`ecu::amt::config`], [`ecu::zk::config`], [`ecu`] | each ECU's settings and services, and what is common to them |
//! | [`limit`], [`command`], [`report`], [`event`] | what can be asked, what an ECU has said, what happens |
//! | [`link`], [`ecu::amt::link`], [`ecu::zk::link`], [`ecu::any`] | one protocol's conversation: reply window, cadence, loss |
//! | [`engine`], [`config`], [`telemetry`] | one engine in plain words: sources, starts, lives, stages of loss, limits |
//! | [`channel`], [`runner`] | bytes and time between one engine and one UART; sources and handles |
//! | [`node`], [`health`] | all engines of one board, and how the board is |
//!
//! Codecs, links and engines do no IO and read no clock: time comes in as an argument. So every rule of
//! timing can be tested as a table, and whoever reads a link reads the protocol.
//!
//! The library needs an `embassy-time` driver of any tick rate from 32 768 Hz, and a `critical-section` implementation. Feature
//! `defmt` derives `defmt::Format`.
//!
//! Numbers such as `ZK-6` or `AMT-11` in comments are reading points: `docs/protocols.md` of the
//! repository explains each, with what the protocol documents say and leave open.
#![no_std]
#![forbid(unsafe_code)]
#![deny(missing_docs, missing_debug_implementations)]

mod open_enum;
mod sentence;

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
pub mod setting;
pub mod telemetry;
pub mod units;
