//! All engines of one board.

use crate::channels::{Channel, Handle};
use crate::command::{Accepted, Command, Origin, Rejected};
use crate::config::{ConfigError, EngineConfig, validate};
use crate::engine::keep::{Memory, Reset};
use crate::health::{ClockSource, Health, HealthCell};
use crate::runner::Runner;

/// `N` engines, each on its own channel.
#[derive(Debug)]
pub struct Node<const N: usize> {
    channels: [Channel; N],
    health: HealthCell,
}

impl<const N: usize> Node<N> {
    /// From a table of engines.
    ///
    /// # Errors
    /// [`ConfigError`], with what is wrong in the table. [`crate::config::check`] finds the same while
    /// compiling.
    pub fn new(engines: &[EngineConfig; N]) -> Result<Self, ConfigError> {
        validate(engines)?;
        let channels = core::array::from_fn(|i| Channel::new(&engines[i]));
        Ok(Self { channels, health: HealthCell::default() })
    }

    /// The same, with memory that a reset leaves alone, by port: engines that run go on after a reset. One on a port
    /// without memory goes on by what its ECU says. `reset` is what the node comes out of.
    ///
    /// # Errors
    /// As [`Node::new`].
    pub fn with_memory(
        engines: &[EngineConfig; N],
        memory: &'static [Memory],
        reset: Reset,
    ) -> Result<Self, ConfigError> {
        validate(engines)?;
        let channel = |engine: &EngineConfig| match memory.get(usize::from(engine.port)) {
            Some(memory) => Channel::with_memory(engine, memory, reset),
            None => Channel::new(engine),
        };
        Ok(Self { channels: engines.each_ref().map(channel), health: HealthCell::default() })
    }

    /// The runner of each engine, in the order of the table. Each wants to run exactly once.
    pub fn runners(&self) -> [Runner<'_>; N] {
        self.channels.each_ref().map(|channel| channel.runner_in(&self.channels))
    }

    /// A handle to each engine, in the order of the table.
    pub fn handles(&self) -> [Handle<'_>; N] {
        self.channels.each_ref().map(|channel| channel.handle_in(&self.channels))
    }

    /// Commands every engine; the answers are in the order of the table.
    pub fn command_all(&self, command: Command, origin: Origin) -> [Result<Accepted, Rejected>; N] {
        self.handles().map(|handle| handle.command(command, origin))
    }

    /// Stores what the board's clocks are made from, for [`Node::health`].
    pub fn set_clock(&self, clock: ClockSource) {
        self.health.set_clock(clock);
    }

    /// The state of the board, for telemetry and the status LED.
    pub fn health(&self) -> Health {
        self.health.get()
    }
}
