//! The control message `FF OPS THR OPS THR` (AMT-10): decoding it, and finding it in a stream of bytes.

use crate::ecu::{LineFault, Nanos};
use crate::frame::{ControlFrame, Switch};
use core::fmt;

/// Begins every message in both directions and occurs nowhere else (AMT-1).
pub const HEAD: u8 = 0xFF;

/// Bytes of a control message.
pub const LENGTH: usize = 5;

/// The operation switch.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ops {
    /// 0x11.
    EmergencyStop,
    /// 0x12: stop and cool.
    AutoStop,
    /// 0x14.
    Run,
    /// 0x91, "special functions": stops a running engine after the serial delay (AMT-13).
    Ctf,
}

impl Ops {
    /// The switch with this code.
    pub const fn from_code(code: u8) -> Option<Self> {
        match code {
            0x11 => Some(Self::EmergencyStop),
            0x12 => Some(Self::AutoStop),
            0x14 => Some(Self::Run),
            0x91 => Some(Self::Ctf),
            _ => None,
        }
    }

    /// The code of this switch.
    pub const fn code(self) -> u8 {
        match self {
            Self::EmergencyStop => 0x11,
            Self::AutoStop => 0x12,
            Self::Run => 0x14,
            Self::Ctf => 0x91,
        }
    }
}

/// The host's command.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct AmtCommand {
    /// The operation switch.
    pub ops: Ops,
    /// Throttle in steps of half a percent, 0..=200.
    pub throttle_half_percent: u8,
}

impl fmt::Display for AmtCommand {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.ops {
            Ops::EmergencyStop => f.write_str("emergency stop"),
            Ops::AutoStop => f.write_str("standby (auto stop)"),
            Ops::Run => write!(f, "run, throttle {:.1} %", f64::from(self.throttle_half_percent) / 2.0),
            Ops::Ctf => f.write_str("special functions"),
        }
    }
}

/// Reason why a control message is invalid.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BadCommand {
    /// Not five bytes, or the first is not 0xFF.
    Shape,
    /// A new head before the end.
    Truncated,
    /// The two copies of OPS or of THR differ.
    Mismatch,
    /// Unknown switch.
    Ops(u8),
    /// Throttle outside 32..=232.
    Throttle(u8),
}

impl fmt::Display for BadCommand {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Shape => f.write_str("not five bytes that begin with 0xFF"),
            Self::Truncated => f.write_str("a new head before the end"),
            Self::Mismatch => f.write_str("the two copies differ"),
            Self::Ops(ops) => write!(f, "unknown switch 0x{ops:02X}"),
            Self::Throttle(throttle) => write!(f, "throttle byte {throttle} is not within 32 to 232"),
        }
    }
}

/// Reads one control message.
pub fn parse_command(bytes: &[u8]) -> Result<AmtCommand, BadCommand> {
    let &[HEAD, ops, throttle, ops_again, throttle_again] = bytes else {
        return Err(BadCommand::Shape);
    };
    if bytes[1..].contains(&HEAD) {
        return Err(BadCommand::Truncated);
    }
    if ops != ops_again || throttle != throttle_again {
        return Err(BadCommand::Mismatch);
    }
    let Some(ops) = Ops::from_code(ops) else {
        return Err(BadCommand::Ops(ops));
    };
    // THR = 2 x % + 32
    match throttle.checked_sub(32) {
        Some(throttle_half_percent @ 0..=200) => Ok(AmtCommand { ops, throttle_half_percent }),
        _ => Err(BadCommand::Throttle(throttle)),
    }
}

impl ControlFrame for AmtCommand {
    type Bytes = [u8; LENGTH];
    type Bad = BadCommand;

    const UNIQUE_HEAD: Option<u8> = Some(HEAD);

    fn read(bytes: &Self::Bytes) -> Result<Self, BadCommand> {
        parse_command(bytes)
    }

    /// Its head shows where a message begins.
    fn is_misaligned(_: BadCommand) -> bool {
        false
    }

    fn switch(self) -> Option<Switch> {
        match self.ops {
            Ops::EmergencyStop => Some(Switch::Stop),
            Ops::AutoStop => Some(Switch::Standby),
            Ops::Run => Some(Switch::Run),
            Ops::Ctf => None,
        }
    }

    fn throttle_tenths(self) -> Option<u16> {
        Some(u16::from(self.throttle_half_percent) * 5)
    }

    fn sets_scale(self) -> bool {
        false
    }

    fn rpm(self, _: Option<Self>) -> Option<u32> {
        None
    }
}

/// Result of a byte from the host.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Received {
    /// Nothing yet.
    Part,
    /// A byte that belongs to no message.
    Stray,
    /// A byte was received with an error; a message that it belongs to is lost.
    Broken { in_message: bool },
    /// A new message began within another one; the older one is lost.
    Truncated,
    /// Five bytes, and the start time of the first.
    Message { start: Nanos, command: Result<AmtCommand, BadCommand> },
}

/// Finds control messages in the received bytes.
#[derive(Clone, Debug, Default)]
pub(super) struct Receiver {
    bytes: [u8; LENGTH],
    len: usize,
    start: Nanos,
}

impl Receiver {
    /// `start` is the start time of this byte, in case it begins a message.
    pub(super) fn receive(&mut self, start: Nanos, byte: Result<u8, LineFault>) -> Received {
        let Ok(byte) = byte else {
            return Received::Broken { in_message: core::mem::take(&mut self.len) > 0 };
        };
        if byte == HEAD {
            let interrupted = self.len > 0;
            self.bytes[0] = byte;
            self.len = 1;
            self.start = start;
            return if interrupted { Received::Truncated } else { Received::Part };
        }
        if self.len == 0 {
            return Received::Stray;
        }
        self.bytes[self.len] = byte;
        self.len += 1;
        if self.len < LENGTH {
            return Received::Part;
        }
        self.len = 0;
        Received::Message { start: self.start, command: parse_command(&self.bytes) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_documents_example_50_percent_is_132() {
        let command = AmtCommand { ops: Ops::Run, throttle_half_percent: 100 };
        assert_eq!(parse_command(&[0xFF, 0x14, 132, 0x14, 132]), Ok(command));
    }

    #[test]
    fn the_four_switches_and_the_ends_of_the_throttle() {
        for (code, ops) in
            [(0x11, Ops::EmergencyStop), (0x12, Ops::AutoStop), (0x14, Ops::Run), (0x91, Ops::Ctf)]
        {
            assert_eq!(ops.code(), code);
            for (throttle, half_percent) in [(32, 0), (33, 1), (232, 200)] {
                assert_eq!(
                    parse_command(&[0xFF, code, throttle, code, throttle]),
                    Ok(AmtCommand { ops, throttle_half_percent: half_percent })
                );
            }
        }
    }

    #[test]
    fn everything_else_is_rejected_with_its_reason() {
        for (bytes, reason) in [
            (&[0xFF, 0x14, 132, 0x14, 133][..], BadCommand::Mismatch),
            (&[0xFF, 0x14, 132, 0x12, 132], BadCommand::Mismatch),
            (&[0xFF, 0x13, 132, 0x13, 132], BadCommand::Ops(0x13)),
            (&[0xFF, 0x14, 31, 0x14, 31], BadCommand::Throttle(31)),
            (&[0xFF, 0x14, 233, 0x14, 233], BadCommand::Throttle(233)),
            (&[0xFF, 0x14, 0xFF, 0x14, 0xFF], BadCommand::Truncated),
            (&[0xFE, 0x14, 132, 0x14, 132], BadCommand::Shape),
            (&[0xFF, 0x14, 132, 0x14], BadCommand::Shape),
            (&[], BadCommand::Shape),
        ] {
            assert_eq!(parse_command(bytes), Err(reason), "{bytes:02X?}");
        }
    }

    #[test]
    fn the_receiver_starts_over_at_every_head() {
        let mut receiver = Receiver::default();
        let bytes = [9, 0xFF, 0x14, 0xFF, 0x11, 32, 0x11, 32, 7];
        let received: Vec<Received> =
            (0..).zip(bytes).map(|(at, byte)| receiver.receive(at, Ok(byte))).collect();
        use Received::{Part, Stray, Truncated};
        let command = Ok(AmtCommand { ops: Ops::EmergencyStop, throttle_half_percent: 0 });
        let message = Received::Message { start: 3, command };
        assert_eq!(received, [Stray, Part, Part, Truncated, Part, Part, Part, message, Stray]);
    }

    #[test]
    fn a_broken_byte_loses_the_message() {
        let mut receiver = Receiver::default();
        receiver.receive(0, Ok(0xFF));
        assert_eq!(receiver.receive(1, Err(LineFault::Framing)), Received::Broken { in_message: true });
        assert_eq!(receiver.receive(2, Err(LineFault::Noise)), Received::Broken { in_message: false });
        assert_eq!(receiver.receive(3, Ok(0x14)), Received::Stray);
    }
}
