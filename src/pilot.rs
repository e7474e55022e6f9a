//! Source of commands for the demonstration and the trial: it repeats a refused start.

use jetlink::channel::Source;
use jetlink::command::{Command, Origin, Rejected};
use jetlink::node::Node;

/// The bench source of every engine.
pub struct Pilot<'a, const N: usize>([Source<'a>; N]);

impl<'a, const N: usize> Pilot<'a, N> {
    /// Claims the bench source of every engine, which nothing else on the board uses.
    pub fn new(node: &'a Node<N>) -> Self {
        Self(node.sources(Origin::Bench).map(|source| defmt::unwrap!(source)))
    }

    pub fn arm(&self) {
        for source in &self.0 {
            // A refusal is in the engine's events.
            let _ = source.command(Command::Arm);
        }
    }

    /// Commands every engine. A start refused by an interlock has used up its permission: standby permits the next one.
    /// Refusals are in the engine's events.
    pub fn command(&self, command: Command) {
        for source in &self.0 {
            if let Err(Rejected::Start(_) | Rejected::DisarmFirst) = source.command(command) {
                let _ = source.command(Command::Standby);
            }
        }
    }
}
