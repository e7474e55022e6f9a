//! All engines of one board.

use crate::channels::{Channel, Handle};
use crate::command::{Command, Origin, Rejected};
use crate::config::{ConfigError, EngineConfig, validate};
use crate::runner::Runner;

/// `N` engines, each on its own channel.
#[derive(Debug)]
pub struct Node<const N: usize> {
    channels: [Channel; N],
}

impl<const N: usize> Node<N> {
    /// From a table of engines.
    ///
    /// # Errors
    /// [`ConfigError`], with what is wrong in the table. [`crate::config::check`] finds the same while
    /// compiling.
    pub fn new(engines: &[EngineConfig; N]) -> Result<Self, ConfigError> {
        validate(engines)?;
        Ok(Self { channels: core::array::from_fn(|i| Channel::new(&engines[i])) })
    }

    /// The runner of each engine, in the order of the table. Each wants to run exactly once.
    pub fn runners(&self) -> [Runner<'_>; N] {
        self.channels.each_ref().map(Channel::runner)
    }

    /// A handle to each engine, in the order of the table.
    pub fn handles(&self) -> [Handle<'_>; N] {
        self.channels.each_ref().map(Channel::handle)
    }

    /// Commands every engine; the answers are in the order of the table.
    pub fn command_all(&self, command: Command, origin: Origin) -> [Result<(), Rejected>; N] {
        self.handles().map(|handle| handle.command(command, origin))
    }
}
