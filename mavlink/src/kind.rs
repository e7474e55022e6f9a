//! What a message that came in would do: a stop is the least that a node obeys, and to read is no danger.

#[cfg(feature = "signing")]
use crate::dialect::{COMMAND_INT_DATA, COMMAND_LONG_DATA, PARAM_SET_DATA};
#[cfg(feature = "signing")]
use crate::fields::{command, param_set};
#[cfg(feature = "signing")]
use crate::frame::{Address, Frame};
use crate::ids::{
    CMD_DO_ENGINE_CONTROL, CMD_DO_FLIGHTTERMINATION, CMD_PREFLIGHT_REBOOT_SHUTDOWN, CMD_USER_1,
};
use crate::services::is_stop;
#[cfg(feature = "signing")]
use mavlink_core::MessageData;

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
            CMD_DO_ENGINE_CONTROL if first == 0.0 => Self::Stops,
            CMD_USER_1 if is_stop(first) => Self::Stops,
            CMD_DO_FLIGHTTERMINATION => Self::Stops,
            CMD_DO_ENGINE_CONTROL | CMD_USER_1 | CMD_PREFLIGHT_REBOOT_SHUTDOWN => Self::Acts,
            _ => Self::Reads,
        }
    }

    /// Of a frame that is not a `COMMAND_CANCEL`, with what it is addressed to.
    #[cfg(feature = "signing")]
    pub fn of_frame(frame: &Frame) -> (Self, Address) {
        let fields = &frame.fields;
        let target = |at| Address { system: fields.u8(at), component: fields.u8(at + 1) };
        match frame.id {
            COMMAND_LONG_DATA::ID | COMMAND_INT_DATA::ID => {
                let kind = Self::of_command(fields.u16(command::COMMAND), fields.f32(command::PARAMS));
                (kind, target(command::TARGET))
            }
            PARAM_SET_DATA::ID => (Self::Acts, target(param_set::TARGET)),
            _ => (Self::Reads, Address { system: 0, component: 0 }),
        }
    }

    /// Of a `COMMAND_CANCEL`.
    pub const fn of_cancel(command: u16) -> Self {
        if command == CMD_DO_ENGINE_CONTROL { Self::Stops } else { Self::Reads }
    }
}
