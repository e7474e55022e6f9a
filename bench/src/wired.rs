//! One engine on a bench: the library's channel and runner on one end of a simulated wire, a simulated ECU on the
//! other, in virtual time. What the bytes mean is up to the simulation's reader.
#![allow(clippy::disallowed_methods, reason = "a scenario keeps its own time")]

use crate::rows;
use embassy_futures::select::{Either, select};
use embassy_time::{Duration, Timer};
use jetlink::channel::{Channel, Events, Handle, Owner};
use jetlink::command::{Accepted, Command, Demand, Origin, Rejected};
use jetlink::config::EngineConfig;
use jetlink::event::Event;
use jetlink::report::Phase;
use jetlink::runner::LineErrors;
use jetlink::units::{Rpm, Throttle};
use sim::any::Protocol;
use sim::clock;
use sim::control::{self, Found, Reader};
use sim::ecu::{Ecu, Nanos};
use sim::wire::{Entry, Plug, WireRx, WireTx};
use std::cell::RefCell;
use std::future::Future;

/// Longer than any start, any cooling and any retry.
pub const LONG: Duration = Duration::from_secs(900);
/// Time between two commands of a source.
const PERIOD: Duration = Duration::from_millis(100);

pub struct Bench<E> {
    pub channel: Channel,
    pub plug: Plug<E>,
    halves: RefCell<Option<(WireRx, WireTx)>>,
}

impl<E: Ecu> Bench<E> {
    pub fn new(config: &EngineConfig, ecu: E, seed: u64) -> Self {
        // The ECU is powered up at the time it is connected.
        clock::reset();
        let (rx, tx, plug) = rows::wire(config, ecu, seed);
        Self { channel: Channel::new(config, None), plug, halves: RefCell::new(Some((rx, tx))) }
    }

    pub fn handle(&self) -> Handle<'_> {
        self.channel.handle()
    }

    /// One command, by whatever source.
    pub fn command(&self, command: Command, origin: Origin) -> Result<Accepted, Rejected> {
        command_as(&self.channel.owner(), command, origin)
    }

    /// The engine's side of the world, forever.
    pub async fn live(&self) -> ! {
        static ERRORS: LineErrors = LineErrors::new();
        let (rx, tx) = self.halves.borrow_mut().take().expect("a bench lives once");
        match select(self.channel.runner().run(rx, tx, &ERRORS), self.plug.run()).await {
            Either::First(never) => never,
            Either::Second(never) => match never {},
        }
    }

    /// Runs a scenario beside the engine. Panics if it has not ended within `limit` of virtual time.
    pub fn play<T>(&self, limit: Duration, scenario: impl Future<Output = T>) -> T {
        let both = select(self.live(), scenario);
        match clock::run_for(both, limit) {
            Some(Either::Second(output)) => output,
            Some(Either::First(never)) => never,
            None => panic!("the scenario did not end within {} s", limit.as_secs()),
        }
    }

    /// Repeats a command, as a source does, until `done`. Refusals do not stop it.
    pub async fn command_until(&self, command: Command, mut done: impl FnMut(&Self) -> bool) {
        loop {
            let _ = self.command(command, Origin::Bench);
            if done(self) {
                return;
            }
            Timer::after(PERIOD).await;
        }
    }

    /// Repeats a command for a time.
    pub async fn command_for(&self, command: Command, time: Duration) {
        let end = embassy_time::Instant::now() + time;
        self.command_until(command, |_| embassy_time::Instant::now() >= end).await;
    }

    /// From anywhere to a running engine at idle, the way every source has to go.
    pub async fn start(&self) {
        // After an emergency stop arming has to be a change.
        for command in [Command::Disarm, Command::Arm] {
            self.command(command, Origin::Bench).expect("accepted where no stop is latched");
        }
        loop {
            self.command_until(Command::Standby, |bench| bench.in_phase(Phase::Standby)).await;
            // A refusal uses up the permission, so standby comes again.
            if self.command(throttle_percent(0), Origin::Bench) == Ok(Accepted::InForce) {
                break;
            }
            Timer::after(PERIOD).await;
        }
        self.command_until(throttle_percent(0), |bench| bench.in_phase(Phase::Running)).await;
    }

    pub fn in_phase(&self, phase: Phase) -> bool {
        self.handle().telemetry().report.phase.is_some_and(|now| now.value == phase)
    }

    pub async fn until(&self, mut done: impl FnMut(&Self) -> bool) {
        while !done(self) {
            Timer::after(Duration::from_millis(10)).await;
        }
    }
}

/// What a listener has received since it was last read.
pub fn received(events: &mut Events<'_>) -> Vec<Event> {
    std::iter::from_fn(|| events.try_next_message_pure()).collect()
}

pub fn throttle_percent(percent: u8) -> Command {
    Command::Run(Demand::Throttle(Throttle::from_percent(percent).expect("0..=100")))
}

pub fn rpm(rpm: u32) -> Command {
    Command::Run(Demand::Rpm(Rpm::new(rpm)))
}

/// The control frames that the node put on the wire, before any fault: when each began, and what it commands. The record may begin or
/// end inside a frame.
///
/// # Panics
/// On bytes that are no control frame.
pub fn control_frames(protocol: Protocol, record: &[Entry]) -> Vec<(Nanos, control::Command)> {
    let mut reader = Reader::strict(protocol, 1_000);
    let found: Vec<_> = record.iter().filter_map(|entry| reader.entry(entry)).collect();
    let begins_inside = matches!(found.first(), Some(Found::Fragment { .. }));
    let whole = found[usize::from(begins_inside)..].iter().map(|found| match found {
        Found::Frame(frame) => match frame.command {
            Ok(command) => (frame.start, command),
            Err(bad) => panic!("{:02x?} on the wire: {bad:?}", frame.bytes()),
        },
        Found::Fragment { bytes, .. } => panic!("{bytes:02x?} on the wire: part of a frame"),
    });
    whole.collect()
}

/// One command, by whatever source: a test commands as any of them.
pub fn command_as(owner: &Owner<'_>, command: Command, origin: Origin) -> Result<Accepted, Rejected> {
    let source = match origin {
        Origin::Emergency => owner.emergency_source(),
        origin => owner.source(origin),
    };
    source.expect("nobody else holds it").command(command)
}
