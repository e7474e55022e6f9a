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
//! # An engine, from its configuration to its shutdown
//!
//! ```no_run
//! use core::fmt::Arguments;
//! use embassy_futures::join::join3;
//! use embassy_futures::select::{Either, select};
//! use embassy_sync::pubsub::WaitResult;
//! use embassy_time::{Duration, Ticker, Timer};
//! use embedded_io_async::{Read, Write};
//! use jetlink::channel::{Channel, ClaimError, Handle, Source};
//! use jetlink::command::{Command, Demand, Origin, Rejected};
//! use jetlink::config::{EngineConfig, check};
//! use jetlink::ecu::zk::codec::Rate;
//! use jetlink::engine::retained::{Reset, RetainedMemory};
//! use jetlink::engine::state::EngineState;
//! use jetlink::line::Line;
//! use jetlink::runner::LineErrors;
//! use jetlink::units::Throttle;
//!
//! // A status rate that the line cannot carry, or a baud rate that no document lists, does not build.
//! const ENGINE: EngineConfig = EngineConfig::zk("left", 0, Line::new(9600), Rate::Hz50);
//! const _: () = check(&[ENGINE]);
//!
//! // A running engine resumes after a reset. On a board this needs a `#[unsafe(link_section = "...")]` that start-up does
//! // not clear; in ordinary RAM nothing survives.
//! static RETAINED: RetainedMemory = RetainedMemory::new();
//!
//! /// Runs one engine on the two halves of a UART, forever.
//! async fn engine(rx: impl Read, tx: impl Write, reset: Reset) -> Result<(), ClaimError> {
//!     let channel = Channel::new(&ENGINE, Some((&RETAINED, reset)));
//!     let errors = LineErrors::new(); // counted by the UART's interrupt, if it does
//!     let owner = channel.owner();
//!     let source = owner.source(Origin::Rc)?;
//!     join3(channel.runner().run(rx, tx, &errors), pilot(source), monitor(owner.handle())).await;
//!     Ok(())
//! }
//!
//! /// Flies once, then stays in standby. Whether the engine is started again is for a person to decide, never for a loop.
//! async fn pilot(source: Source<'_>) {
//!     if let Err(why) = flight(&source).await {
//!         log(format_args!("refused: {why}")); // what a person has to do first
//!     }
//!     // Standby as the order of a person: obeyed at once, with cooling. `Command::EmergencyStop` stops without cooling, and is
//!     // latched until `Command::ReleaseStop`.
//!     let _ = source.command(Command::ShutDown);
//!     let mut tick = Ticker::every(Duration::from_millis(100));
//!     loop {
//!         let _ = source.command(Command::Standby);
//!         tick.next().await;
//!     }
//! }
//!
//! /// Starts the engine, and runs it at 40 % for a minute. A source repeats its command within its timeout, 0.5 s.
//! async fn flight(source: &Source<'_>) -> Result<(), Rejected> {
//!     let mut tick = Ticker::every(Duration::from_millis(100));
//!     // Standby for 5 s. Standby, armed, permits one start: by run at idle, with every interlock satisfied.
//!     source.command(Command::Arm)?;
//!     for _ in 0..50 {
//!         source.command(Command::Standby)?;
//!         tick.next().await;
//!     }
//!     // The first of these starts the engine, or is refused with the interlock that is not satisfied. A start that fails, or takes
//!     // too long, ends in standby: then the next one is refused.
//!     while source.handle().telemetry().state != EngineState::Running {
//!         source.command(Command::Run(Demand::Throttle(Throttle::IDLE)))?;
//!         tick.next().await;
//!     }
//!     let cruise = Throttle::from_percent(40).unwrap_or(Throttle::IDLE);
//!     for _ in 0..600 {
//!         source.command(Command::Run(Demand::Throttle(cruise)))?;
//!         tick.next().await;
//!     }
//!     Ok(())
//! }
//!
//! /// Logs every event, and what the ECU reports once a second.
//! async fn monitor(engine: Handle<'_>) {
//!     let Some(mut events) = engine.events() else { return };
//!     let mut tick = Ticker::every(Duration::from_secs(1));
//!     loop {
//!         match select(events.next_message(), tick.next()).await {
//!             Either::First(WaitResult::Message(event)) => log(format_args!("{event}")),
//!             Either::First(WaitResult::Lagged(lost)) => log(format_args!("{lost} events lost")),
//!             Either::Second(()) => {
//!                 let telemetry = engine.telemetry();
//!                 // A value that is older than 3 s, or was never received, is `None`.
//!                 match telemetry.current(telemetry.report.rpm) {
//!                     Some(rpm) => log(format_args!("{}, {} rpm", telemetry.state, rpm.get())),
//!                     None => log(format_args!("{}, link {}", telemetry.state, telemetry.link)),
//!                 }
//!             }
//!         }
//!     }
//! }
//!
//! /// To a terminal, a UART or RTT.
//! fn log(line: Arguments<'_>) {
//!     # let _ = line;
//! }
//! ```
//!
//! [`Node`](node::Node) joins the engines of a board to a group: they start one after the other. In the repository, `examples/embedded`
//! is an Embassy firmware with this library, and `examples/linux` a program on a serial port.
//!
//! # Errors
//!
//! Every error has a text that says what to do, and implements [`core::error::Error`].
//!
//! | error | of |
//! |---|---|
//! | [`ConfigError`](config::ConfigError) | a table of engines. [`check`](config::check) finds it while the table compiles |
//! | [`ClaimError`](channel::ClaimError) | a source that is claimed already |
//! | [`Rejected`](command::Rejected) | a command. The order in force does not change |
//! | [`SupervisionError`](engine::config::SupervisionError), [`LinkSettingsError`](config::LinkSettingsError), [`SettingError`](setting::SettingError) | settings. None of them has changed |
//! | [`WiringError`](wiring::WiringError) | engines as stored settings wire them |
//!
//! Faults of the ECU, losses of the link and limits are no errors of a call: they are [events](event::Event) and
//! [telemetry](telemetry::Telemetry).
//!
//! # Modules
//!
//! The layers, from the wire up. Imports between files go one way: there is no circle.
//!
//! | module | contents |
//! |---|---|
//! | [`units`], [`mod@line`], [`setting`], [`checksum`] | quantities; the serial line; the table of settings; the checksum of what survives a reset |
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
//! # What it needs
//!
//! - An [`embassy-time`](https://docs.rs/embassy-time) driver of any tick rate from 32 768 Hz.
//! - A [`critical-section`](https://docs.rs/critical-section) implementation.
//! - A UART whose halves implement `Read` and `Write` of [`embedded-io-async`](https://docs.rs/embedded-io-async), and which hands out each
//!   byte as it is received.
//!
//! The feature `defmt`, off by default, implements `defmt::Format`.
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
pub mod copies;
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

const _: () = assert!(
    embassy_time::TICK_HZ >= 32_768,
    "jetlink needs an embassy-time tick of 32 768 Hz or more: a reply of AMT begins within 9 ms"
);
