//! What a message that came in would do: a stop is the least that a node obeys, and to read is no danger.

use crate::ids::{
    CMD_DO_ENGINE_CONTROL, CMD_DO_FLIGHTTERMINATION, CMD_PREFLIGHT_REBOOT_SHUTDOWN, CMD_USER_1,
};
use crate::number::whole;
use crate::services::is_stop;

/// Kind of a message.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) enum Kind {
    /// It stops an engine, and does nothing else.
    Stops,
    /// It reads, or sets what is sent.
    Reads,
    /// All else: it starts an engine or tests it, releases a stop, sets, restarts the node.
    Acts,
}

impl Kind {
    /// Of a command with its first parameter, whatever it is addressed to.
    pub fn of_command(command: u16, first: f32) -> Self {
        match command {
            CMD_DO_ENGINE_CONTROL if whole(first) == Some(0) => Self::Stops,
            CMD_USER_1 if is_stop(first) => Self::Stops,
            CMD_DO_FLIGHTTERMINATION => Self::Stops,
            CMD_DO_ENGINE_CONTROL | CMD_USER_1 | CMD_PREFLIGHT_REBOOT_SHUTDOWN => Self::Acts,
            _ => Self::Reads,
        }
    }

    /// Of a `COMMAND_CANCEL`.
    pub const fn of_cancel(command: u16) -> Self {
        if command == CMD_DO_ENGINE_CONTROL { Self::Stops } else { Self::Reads }
    }
}
