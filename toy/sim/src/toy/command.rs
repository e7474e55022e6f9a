//! Control frames of the toy protocol.

use crate::frame::{ControlFrame, Switch};
use core::fmt;

const HEAD: u8 = 0x5A;

/// A command from the host.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ToyCommand {
    /// Nothing.
    Nothing,
    /// Shut down.
    Standby,
    /// Run.
    Run,
    /// Stop at once.
    EmergencyStop,
    /// Prime the fuel line.
    Prime,
}

/// Reason why bytes are not a valid command.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BadCommand {
    /// The first byte is not the head.
    Head,
    /// The document has no command of this number.
    Number(u8),
}

impl fmt::Display for ToyCommand {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Nothing => "nothing",
            Self::Standby => "standby",
            Self::Run => "run",
            Self::EmergencyStop => "emergency stop",
            Self::Prime => "prime",
        })
    }
}

impl fmt::Display for BadCommand {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Head => f.write_str("the first byte is not 0x5A"),
            Self::Number(number) => write!(f, "unknown command {number}"),
        }
    }
}

impl ControlFrame for ToyCommand {
    type Bytes = [u8; 2];
    type Bad = BadCommand;

    const UNIQUE_HEAD: Option<u8> = Some(HEAD);

    fn read(bytes: &[u8; 2]) -> Result<Self, BadCommand> {
        match *bytes {
            [HEAD, 0] => Ok(Self::Nothing),
            [HEAD, 1] => Ok(Self::Standby),
            [HEAD, 2] => Ok(Self::Run),
            [HEAD, 3] => Ok(Self::EmergencyStop),
            [HEAD, 4] => Ok(Self::Prime),
            [HEAD, number] => Err(BadCommand::Number(number)),
            _ => Err(BadCommand::Head),
        }
    }

    fn is_misaligned(bad: BadCommand) -> bool {
        bad == BadCommand::Head
    }

    fn switch(self) -> Option<Switch> {
        match self {
            Self::Nothing | Self::Prime => None,
            Self::Standby => Some(Switch::Standby),
            Self::Run => Some(Switch::Run),
            Self::EmergencyStop => Some(Switch::Stop),
        }
    }

    fn throttle_tenths(self) -> Option<u16> {
        None
    }

    fn sets_scale(self) -> bool {
        false
    }

    fn rpm(self, _: Option<Self>) -> Option<u32> {
        None
    }
}
