//! Small turbines through their engine control units (ECUs): one UART for each engine, the AMT serial protocol or the
//! ZK-Protocol on any of them.
//!
//! An engine is a [`Channel`](channel::Channel). A task owns its UART and runs its [`Runner`](runner::Runner), which keeps
//! the reply window (AMT, 30 ms) or the cadence (ZK). A [`Source`](channel::Source) commands the engine, which arbitrates
//! between its sources, guards starts, and goes to its fail-safe without a source. A [`Handle`](channel::Handle) gives
//! telemetry and events.
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
//! // A status rate that the line cannot carry, or a baud rate that no document lists, does not build.
//! const ENGINE: EngineConfig = EngineConfig::zk("left", 0, Line::new(9600), Rate::Hz50);
//! const _: () = check(&[ENGINE]);
//!
//! // So that a running engine resumes after a reset. On a board it needs a `#[unsafe(link_section = "...")]` that start-up does not
//! // clear; in ordinary RAM nothing survives.
//! static RETAINED: RetainedMemory = RetainedMemory::new();
//!
//! /// Runs one engine on the two halves of a UART, forever.
//! async fn engine(rx: impl Read, tx: impl Write, reset: Reset) {
//!     let channel = Channel::new(&ENGINE, Some((&RETAINED, reset)));
//!     let errors = LineErrors::new(); // counted by the UART's interrupt, if it does
//!     let Ok(source) = channel.owner().source(Origin::Rc) else { return };
//!     let pilot = pilot(source);
//!     embassy_futures::join::join(channel.runner().run(rx, tx, &errors), pilot).await;
//! }
//!
//! /// Starts the engine once and runs it at idle. A source repeats its command within its timeout, 0.5 s.
//! async fn pilot(source: Source<'_>) {
//!     let mut tick = Ticker::every(Duration::from_millis(100));
//!     // Standby for 5 s. Standby, armed, permits one start: by run at idle, with every interlock satisfied.
//!     let _ = source.command(Command::Arm);
//!     for _ in 0..50 {
//!         let _ = source.command(Command::Standby);
//!         tick.next().await;
//!     }
//!     let run = Command::Run(Demand::Throttle(Throttle::IDLE));
//!     while source.command(run).is_ok() {
//!         tick.next().await;
//!     }
//!     // Refused, or the engine went out. Whether it is started again is for a person to decide, never for a loop.
//!     loop {
//!         let _ = source.command(Command::Standby);
//!         tick.next().await;
//!     }
//! }
//! ```
//!
//! The layers, from the wire up. Imports between files go one way: there is no circle.
//!
//! | module | contents |
//! |---|---|
//! | [`units`], [`mod@line`], [`setting`], [`checksum`] | quantities; the serial line; a row of the table of settings; of what survives a reset |
//! | [`ecu::amt::codec`], [`ecu::zk::codec`] | bytes and typed frames of one protocol; scale and offset |
//! | [`ecu::amt::config`], [`ecu::zk::config`], [`ecu`] | settings and services of each ECU, and their common types |
//! | [`limit`], [`command`], [`report`], [`event`] | commands, reports of an ECU, events |
//! | [`link`], [`ecu::amt::link`], [`ecu::zk::link`], [`ecu::any`] | one protocol's conversation: reply window, cadence, loss |
//! | [`engine`], [`config`], [`wiring`], [`telemetry`] | one engine: sources, starts, lives, stages of loss, limits; its port, line and ECU as numbers |
//! | [`channel`], [`runner`] | bytes and time between one engine and one UART; sources and handles |
//! | [`node`], [`health`], [`watch`], [`indication`] | all engines of one board, and the board's health; which runners are stuck; what a status LED shows |
//!
//! Codecs, links and engines do no IO and read no clock: time is an argument. So every timing rule can be tested as a table.
//!
//! The library needs an `embassy-time` driver of any tick rate from 32 768 Hz, and a `critical-section` implementation. Feature
//! `defmt` derives `defmt::Format`.
//!
//! Numbers such as `ZK-6` or `AMT-11` in comments are reading points: `docs/protocols.md` in the repository explains each,
//! with the text of the protocol documents and the questions that they leave open.
#![no_std]
#![forbid(unsafe_code)]
#![deny(missing_docs, missing_debug_implementations)]

mod codes;
mod consecutive;
mod debounce;
mod mistake;
mod sentence;

pub mod channel;
pub mod checksum;
pub mod command;
pub mod config;
pub mod ecu;
pub mod engine;
pub mod event;
pub mod health;
pub mod indication;
pub mod limit;
pub mod line;
pub mod link;
pub mod node;
pub mod report;
pub mod runner;
pub mod setting;
pub mod telemetry;
pub mod units;
pub mod watch;
pub mod wiring;
