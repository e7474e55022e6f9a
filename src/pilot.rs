//! What the demonstration and the trial share: a source of commands that starts engines again after a refusal.

use jetlink::channel::Source;
use jetlink::command::{Command, Origin, Rejected};
use jetlink::node::Node;

/// The bench source of every engine.
pub struct Pilot<'a, const N: usize>([Source<'a>; N]);

impl<'a, const N: usize> Pilot<'a, N> {
    /// Nobody else on the board commands from the bench.
    pub fn new(node: &'a Node<N>) -> Self {
        Self(node.sources(Origin::Bench).map(|source| defmt::unwrap!(source)))
    }

    pub fn arm(&self) {
        for source in &self.0 {
            // A latched stop refuses it: that is in the engine's events.
            let _ = source.command(Command::Arm);
        }
    }

    /// Commands every engine. A start that an interlock refuses has used its permission up: standby, and the next command
    /// asks again. What is refused is in the engine's events.
    pub fn command(&self, command: Command) {
        for source in &self.0 {
            if let Err(Rejected::Start(_)) = source.command(command) {
                let _ = source.command(Command::Standby);
            }
        }
    }
}
