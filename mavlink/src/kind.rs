//! Effect of a received message: a node always obeys a stop, and a read is harmless.

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
    /// It only stops an engine.
    Stops,
    /// It reads, or sets what is sent.
    Reads,
    /// Anything else: it starts or tests an engine, releases a stop, changes a setting, restarts the node.
    Acts,
}

impl Kind {
    /// Kind of a command with its first parameter, whatever it is addressed to.
    pub fn of_command(command: u16, first: f32) -> Self {
        match command {
            CMD_DO_ENGINE_CONTROL if first == 0.0 => Self::Stops,
            CMD_USER_1 if is_stop(first) => Self::Stops,
            CMD_DO_FLIGHTTERMINATION => Self::Stops,
            CMD_DO_ENGINE_CONTROL | CMD_USER_1 | CMD_PREFLIGHT_REBOOT_SHUTDOWN => Self::Acts,
            _ => Self::Reads,
        }
    }

    /// Kind of a frame that is not a `COMMAND_CANCEL`, with its target.
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

    /// Kind of a `COMMAND_CANCEL`.
    pub const fn of_cancel(command: u16) -> Self {
        if command == CMD_DO_ENGINE_CONTROL { Self::Stops } else { Self::Reads }
    }
}
