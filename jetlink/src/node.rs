//! All engines of one board.

use crate::channel::{Channel, ClaimError, Handle, Owner, Source};
use crate::command::Origin;
use crate::config::{ConfigError, EngineConfig, validate};
use crate::engine::retained::{Reset, RetainedMemory};
use crate::health::{ClockSource, Health, HealthCell};
use crate::runner::Runner;
use core::array::from_fn;
use heapless::Vec;

/// `N` engines, each with its own channel.
#[derive(Debug)]
pub struct Node<const N: usize> {
    /// Always `N` of them: an incomplete node is never handed out.
    channels: Vec<Channel, N>,
    health: HealthCell,
}

/// Memory in which a node is built channel by channel. Place it in a static of a firmware: [`Node::new`] needs more stack
/// than the size of the node, which is large.
#[derive(Debug)]
pub struct NodePlace<const N: usize>(Node<N>);

impl<const N: usize> NodePlace<N> {
    /// Empty.
    pub const fn new() -> Self {
        Self(Node { channels: Vec::new(), health: HealthCell::new() })
    }

    /// Builds the node here, as [`Node::new`] does.
    ///
    /// # Errors
    /// As [`Node::new`].
    pub fn build(
        &mut self,
        engines: &[EngineConfig; N],
        retained: Option<(&'static [RetainedMemory], Reset)>,
    ) -> Result<&Node<N>, ConfigError> {
        validate(engines)?;
        self.0.channels.clear();
        for (row, engine) in engines.iter().enumerate() {
            let own = match retained {
                Some((memory, reset)) => {
                    let own = memory.get(usize::from(engine.port));
                    Some((own.ok_or(ConfigError::RetainedMemory(row))?, reset))
                }
                None => None,
            };
            // There is space for each of them.
            let _ = self.0.channels.push(Channel::new(engine, own));
        }
        Ok(&self.0)
    }
}

impl<const N: usize> Default for NodePlace<N> {
    fn default() -> Self {
        Self::new()
    }
}

impl<const N: usize> Node<N> {
    /// A node from a table of engines. `retained` is memory that survives a reset, with the kind of the last reset: running
    /// engines resume after a reset. An engine has the one at the index of its port, so their number must exceed the highest port of
    /// the table. `None` is for tests, see [`Channel::new`].
    ///
    /// # Errors
    /// [`ConfigError`] with the mistake in the table, which [`crate::config::check`] finds at compile time;
    /// [`ConfigError::RetainedMemory`] where the port of an engine has no memory.
    pub fn new(
        engines: &[EngineConfig; N],
        retained: Option<(&'static [RetainedMemory], Reset)>,
    ) -> Result<Self, ConfigError> {
        let mut place = NodePlace::new();
        place.build(engines, retained)?;
        Ok(place.0)
    }

    /// The runner of each engine, in the order of the table. Run each exactly once.
    pub fn runners(&self) -> [Runner<'_>; N] {
        from_fn(|i| self.channels[i].runner_in(&self.channels))
    }

    /// A handle to each engine, in the order of the table.
    pub fn handles(&self) -> [Handle<'_>; N] {
        self.owners().map(|owner| owner.handle())
    }

    /// The owner of each engine, in the order of the table.
    pub fn owners(&self) -> [Owner<'_>; N] {
        from_fn(|i| self.channels[i].owner_in(&self.channels))
    }

    /// Claims the same source of each engine, in the order of the table; see [`Owner::source`].
    pub fn sources(&self, origin: Origin) -> [Result<Source<'_>, ClaimError>; N] {
        self.owners().map(|owner| owner.source(origin))
    }

    /// Sets the source of the board's clocks, for [`Node::health`].
    pub fn set_clock(&self, clock: ClockSource) {
        self.health.set_clock(clock);
    }

    /// Sets whether the stored settings are damaged and not confirmed, for [`Node::health`].
    pub fn set_settings_damaged(&self, damaged: bool) {
        self.health.set_settings_damaged(damaged);
    }

    /// The state of the board, for telemetry and the status LED.
    pub fn health(&self) -> Health {
        self.health.get()
    }
}
