//! What the demonstration and the trial share: a source of commands that starts engines again after a refusal.

use jetlink::command::{Command, Origin, Rejected};
use jetlink::node::Node;

/// Commands every engine. A start that an interlock refuses has used its permission up: standby, and the next word asks
/// again. What is refused is in the engine's events.
pub fn command_all<const N: usize>(node: &Node<N>, command: Command) {
    for handle in node.handles() {
        if let Err(Rejected::Start(_)) = handle.command(command, Origin::Bench) {
            let _ = handle.command(Command::Standby, Origin::Bench);
        }
    }
}
