//! The control frame `FF, ID and data, data, CRC` (ZK-1, ZK-2): decoding it, and finding it in a
//! stream of bytes.

use crate::ecu::LineFault;
use crate::frame::{ControlFrame, Switch};
use core::fmt;

/// Begins every control frame.
pub const HEAD: u8 = 0xFF;

/// Bytes of a control frame.
pub const LENGTH: usize = 4;

/// CRC-8/MAXIM-DOW, as the document's first listing with seed 0 computes it (ZK-1).
pub fn crc8(bytes: &[u8]) -> u8 {
    // Contribution of each set bit of the running value; the document's eight constants.
    const BITS: [u8; 8] = [0x5E, 0xBC, 0x61, 0xC2, 0x9D, 0x23, 0x46, 0x8C];
    bytes.iter().fold(0, |crc, byte| {
        let key = byte ^ crc;
        (0..8).filter(|bit| key & (1 << bit) != 0).fold(0, |crc, bit| crc ^ BITS[bit])
    })
}

/// Engine switch commanded by the host (ZK-8).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Sw {
    /// 0: in ID 1 the PWM input is in control, in ID 6 it has no meaning.
    None,
    /// 1: stop without cooling.
    Stop,
    /// 2: stop with cooling.
    Standby,
    /// 3.
    Run,
}

impl Sw {
    const fn from_bits(bits: u8) -> Self {
        match bits & 3 {
            0 => Self::None,
            1 => Self::Stop,
            2 => Self::Standby,
            _ => Self::Run,
        }
    }
}

/// The parameter of ID 2.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Action {
    /// 1.
    DrainOil,
    /// 2.
    TestGlowPlug,
    /// 3.
    TestMainValve,
    /// 4.
    TestIgnitionValve,
    /// 5.
    TestPump,
    /// 6.
    TestStarter,
    /// 7: 20 Hz.
    Rate20,
    /// 8: 50 Hz.
    Rate50,
    /// 9: 100 Hz.
    Rate100,
    /// 10.
    ResetFuel,
    /// 11.
    ZeroThrust,
    /// 12: for a long time.
    OpenPump,
    /// 13.
    ClosePump,
}

impl Action {
    const ALL: [Self; 13] = [
        Self::DrainOil,
        Self::TestGlowPlug,
        Self::TestMainValve,
        Self::TestIgnitionValve,
        Self::TestPump,
        Self::TestStarter,
        Self::Rate20,
        Self::Rate50,
        Self::Rate100,
        Self::ResetFuel,
        Self::ZeroThrust,
        Self::OpenPump,
        Self::ClosePump,
    ];

    /// The number of this parameter.
    pub fn number(self) -> u8 {
        (1..).zip(Self::ALL).find(|&(_, action)| action == self).map_or(0, |(number, _)| number)
    }

    fn from_number(number: u8) -> Option<Self> {
        Self::ALL.get(usize::from(number.checked_sub(1)?)).copied()
    }
}

/// A command from the host.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ZkCommand {
    /// ID 0: keeps the connection alive and commands nothing.
    Empty,
    /// ID 1.
    Control {
        /// The engine's switch.
        sw: Sw,
        /// In 0.1 %, 0..=1000.
        throttle: u16,
    },
    /// ID 2.
    Action(Action),
    /// ID 3: the next frame may be ID 4 or 5.
    Unlock,
    /// ID 4, in steps of 0.02 V.
    IgnitionVoltage(u8),
    /// ID 5, 10..=70.
    AccelerationCurve(u8),
    /// ID 6 (ZK-3).
    Switch {
        /// The engine's switch.
        sw: Sw,
        /// RPM_X, 0..=6; with any value but 0, ID 7 controls the speed.
        factor: u8,
    },
    /// ID 7: rpm / 10 / RPM_X.
    Rpm(u16),
    /// ID 8, in hPa (ZK-4).
    Pressure(u16),
}

impl fmt::Display for Sw {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::None => "no switch",
            Self::Stop => "stop",
            Self::Standby => "standby",
            Self::Run => "run",
        })
    }
}

impl fmt::Display for Action {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::DrainOil => "drain oil",
            Self::TestGlowPlug => "test the glow plug",
            Self::TestMainValve => "test the main valve",
            Self::TestIgnitionValve => "test the ignition valve",
            Self::TestPump => "test the pump",
            Self::TestStarter => "test the starter",
            Self::Rate20 => "status rate 20 Hz",
            Self::Rate50 => "status rate 50 Hz",
            Self::Rate100 => "status rate 100 Hz",
            Self::ResetFuel => "reset the fuel counter",
            Self::ZeroThrust => "zero the thrust",
            Self::OpenPump => "open the pump",
            Self::ClosePump => "close the pump",
        })
    }
}

impl fmt::Display for ZkCommand {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Empty => f.write_str("ID 0: keeps the connection"),
            Self::Control { sw, throttle } => {
                write!(f, "ID 1: {sw}, throttle {:.1} %", f64::from(*throttle) / 10.0)
            }
            Self::Action(action) => write!(f, "ID 2: {action}"),
            Self::Switch { sw, factor } => write!(f, "ID 6: {sw}, RPM_X {factor}"),
            Self::Rpm(code) => write!(f, "ID 7: rpm / 10 / RPM_X = {code}"),
            Self::Pressure(pressure) => write!(f, "ID 8: {pressure} hPa"),
            other => write!(f, "ID {}", other.id()),
        }
    }
}

impl ZkCommand {
    /// The command ID.
    pub const fn id(self) -> u8 {
        match self {
            Self::Empty => 0,
            Self::Control { .. } => 1,
            Self::Action(_) => 2,
            Self::Unlock => 3,
            Self::IgnitionVoltage(_) => 4,
            Self::AccelerationCurve(_) => 5,
            Self::Switch { .. } => 6,
            Self::Rpm(_) => 7,
            Self::Pressure(_) => 8,
        }
    }

    /// The first protocol version that supports it (ZK-7).
    pub const fn since_version(self) -> u8 {
        match self {
            Self::Action(Action::ResetFuel | Action::ZeroThrust) => 2,
            Self::Action(Action::OpenPump | Action::ClosePump) => 5,
            Self::Switch { .. } | Self::Rpm(_) | Self::Pressure(_) => 4,
            _ => 1,
        }
    }
}

/// Reason why a control frame is invalid.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BadCommand {
    /// The first byte is not 0xFF.
    Head,
    /// The CRC is not that of bytes 1 and 2.
    Crc,
    /// Unknown command ID.
    Id(u8),
    /// A value outside its documented range.
    Range(u8),
}

impl fmt::Display for BadCommand {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Head => f.write_str("the first byte is not 0xFF"),
            Self::Crc => f.write_str("wrong CRC"),
            Self::Id(id) => write!(f, "unknown ID {id}"),
            Self::Range(id) => write!(f, "a value of ID {id} is out of its range"),
        }
    }
}

/// Reads one control frame. Reserved bits are ignored; see [`reserved_bits`].
pub fn parse_command(bytes: &[u8; 4]) -> Result<ZkCommand, BadCommand> {
    let &[head, high, low, crc] = bytes;
    if head != HEAD {
        return Err(BadCommand::Head);
    }
    if crc8(&[high, low]) != crc {
        return Err(BadCommand::Crc);
    }
    let id = high >> 4;
    let ten_bits = u16::from(high & 3) << 8 | u16::from(low);
    let twelve_bits = u16::from(high & 15) << 8 | u16::from(low);
    let in_range = |command, ok: bool| if ok { Ok(command) } else { Err(BadCommand::Range(id)) };
    match id {
        0 => Ok(ZkCommand::Empty),
        1 => in_range(
            ZkCommand::Control { sw: Sw::from_bits(high >> 2), throttle: ten_bits },
            ten_bits <= 1000,
        ),
        2 => Action::from_number(low).map(ZkCommand::Action).ok_or(BadCommand::Range(id)),
        3 => Ok(ZkCommand::Unlock),
        4 => Ok(ZkCommand::IgnitionVoltage(low)),
        5 => in_range(ZkCommand::AccelerationCurve(low), (10..=70).contains(&low)),
        6 => {
            let factor = low >> 2 & 7;
            in_range(ZkCommand::Switch { sw: Sw::from_bits(low), factor }, factor <= 6)
        }
        7 => Ok(ZkCommand::Rpm(twelve_bits)),
        8 => Ok(ZkCommand::Pressure(ten_bits)),
        _ => Err(BadCommand::Id(id)),
    }
}

impl ControlFrame for ZkCommand {
    type Bytes = [u8; LENGTH];
    type Bad = BadCommand;

    /// 0xFF also occurs inside frames.
    const UNIQUE_HEAD: Option<u8> = None;

    fn read(bytes: &Self::Bytes) -> Result<Self, BadCommand> {
        parse_command(bytes)
    }

    fn is_misaligned(bad: BadCommand) -> bool {
        match bad {
            BadCommand::Head | BadCommand::Crc => true,
            BadCommand::Id(_) | BadCommand::Range(_) => false,
        }
    }

    fn switch(self) -> Option<Switch> {
        match self {
            Self::Control { sw: Sw::None, .. } => Some(Switch::Pwm),
            Self::Control { sw, .. } | Self::Switch { sw, .. } => match sw {
                Sw::None => None,
                Sw::Stop => Some(Switch::Stop),
                Sw::Standby => Some(Switch::Standby),
                Sw::Run => Some(Switch::Run),
            },
            _ => None,
        }
    }

    fn throttle_tenths(self) -> Option<u16> {
        match self {
            Self::Control { throttle, .. } => Some(throttle),
            _ => None,
        }
    }

    fn sets_scale(self) -> bool {
        matches!(self, Self::Switch { .. })
    }

    /// Rpm / 10 / RPM_X, which the last ID 6 carried (ZK-9).
    fn rpm(self, scale: Option<Self>) -> Option<u32> {
        match (self, scale) {
            (Self::Rpm(code), Some(Self::Switch { factor: factor @ 1.., .. })) => {
                Some(u32::from(code) * u32::from(factor) * 10)
            }
            _ => None,
        }
    }
}

/// The reserved bits of a frame with a known ID; a host sends them as 0 (ZK-2).
pub fn reserved_bits(bytes: &[u8; 4]) -> u16 {
    let reserved = match bytes[1] >> 4 {
        0 | 3 => 0x0FFF,
        2 | 4 | 5 => 0x0F00,
        6 => 0x0FE0,
        8 => 0x0C00,
        _ => 0,
    };
    u16::from_be_bytes([bytes[1], bytes[2]]) & reserved
}

/// Result of a byte from the host.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Received {
    /// Nothing.
    Part,
    /// A byte that belongs to no frame.
    Stray,
    /// Four bytes with the right head and a wrong CRC.
    WrongCrc,
    /// Four bytes with the right head and CRC.
    Frame([u8; LENGTH]),
}

/// Finds control frames in the received bytes, by head and CRC over a sliding window, because 0xFF
/// also occurs inside frames.
#[derive(Clone, Debug, Default)]
pub(super) struct Receiver {
    bytes: [u8; LENGTH],
    len: usize,
}

impl Receiver {
    pub(super) fn receive(&mut self, byte: Result<u8, LineFault>) -> Received {
        let Ok(byte) = byte else {
            // The byte is unknown, so the frame that it belonged to is unknown too.
            self.len = 0;
            return Received::Part;
        };
        if self.len == 0 && byte != HEAD {
            return Received::Stray;
        }
        self.bytes[self.len] = byte;
        self.len += 1;
        if self.len < LENGTH {
            return Received::Part;
        }
        if crc8(&self.bytes[1..3]) == self.bytes[3] {
            self.len = 0;
            return Received::Frame(self.bytes);
        }
        // Look for another head in the window.
        let next = self.bytes[1..].iter().position(|&byte| byte == HEAD).map_or(LENGTH, |at| at + 1);
        self.bytes.copy_within(next.., 0);
        self.len = LENGTH - next;
        Received::WrongCrc
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn frame(high: u8, low: u8) -> [u8; 4] {
        [HEAD, high, low, crc8(&[high, low])]
    }

    #[test]
    fn all_printed_examples_have_the_right_crc() {
        for example in [
            &[0xFF, 0x14, 0x64, 0xD3][..],
            &[0xFF, 0x1D, 0xF4, 0x70],
            &[0xFF, 0x00, 0x00, 0x00],
            &[0xFF, 0x60, 0x13, 0x25],
        ] {
            assert_eq!(crc8(&example[1..3]), example[3], "{example:02X?}");
        }
        for example in
            [[0xF1, 0x00, 0x00, 0x00, 0x00, 0x4C, 0xA0], [0xF6, 0x00, 0x00, 0xA0, 0x00, 0x10, 0xAB]]
        {
            assert_eq!(crc8(&example[..6]), example[6], "{example:02X?}");
        }
    }

    #[test]
    fn the_crc_is_that_of_the_documents_table_too() {
        // Some entries of the table listing, which computes crc8 of one byte.
        for (byte, crc) in [(0, 0x00), (1, 0x5E), (2, 0xBC), (7, 0x83), (8, 0xC2), (128, 0x8C), (255, 0x35)] {
            assert_eq!(crc8(&[byte]), crc);
        }
        // The check value of CRC-8/MAXIM-DOW.
        assert_eq!(crc8(b"123456789"), 0xA1);
    }

    #[test]
    fn commands_are_read_as_in_the_documents_examples() {
        assert_eq!(
            parse_command(&[0xFF, 0x14, 0x64, 0xD3]),
            Ok(ZkCommand::Control { sw: Sw::Stop, throttle: 100 })
        );
        assert_eq!(
            parse_command(&[0xFF, 0x1D, 0xF4, 0x70]),
            Ok(ZkCommand::Control { sw: Sw::Run, throttle: 500 })
        );
        assert_eq!(
            parse_command(&[0xFF, 0x60, 0x13, 0x25]),
            Ok(ZkCommand::Switch { sw: Sw::Run, factor: 4 })
        );
        assert_eq!(parse_command(&[0xFF, 0, 0, 0]), Ok(ZkCommand::Empty));
    }

    #[test]
    fn each_id_is_read_as_documented() {
        for (high, low, command) in [
            (0x13, 0xE8, ZkCommand::Control { sw: Sw::None, throttle: 1000 }),
            (0x18, 0x00, ZkCommand::Control { sw: Sw::Standby, throttle: 0 }),
            (0x20, 1, ZkCommand::Action(Action::DrainOil)),
            (0x20, 13, ZkCommand::Action(Action::ClosePump)),
            (0x30, 0, ZkCommand::Unlock),
            (0x40, 255, ZkCommand::IgnitionVoltage(255)),
            (0x50, 10, ZkCommand::AccelerationCurve(10)),
            (0x50, 70, ZkCommand::AccelerationCurve(70)),
            (0x60, 0b0001_1001, ZkCommand::Switch { sw: Sw::Stop, factor: 6 }),
            (0x7F, 0xFF, ZkCommand::Rpm(4095)),
            (0x70, 1, ZkCommand::Rpm(1)),
            (0x83, 0xF5, ZkCommand::Pressure(1013)),
        ] {
            assert_eq!(parse_command(&frame(high, low)), Ok(command));
            assert_eq!(command.id(), high >> 4);
            assert_eq!(reserved_bits(&frame(high, low)), 0);
        }
        for (number, action) in (1..).zip(Action::ALL) {
            assert_eq!(action.number(), number);
        }
    }

    #[test]
    fn everything_else_is_rejected_with_its_reason() {
        assert_eq!(parse_command(&[0xFE, 0x14, 0x64, 0xD3]), Err(BadCommand::Head));
        assert_eq!(parse_command(&[0xFF, 0x14, 0x65, 0xD3]), Err(BadCommand::Crc));
        for (high, low) in [(0x17, 0xE9), (0x20, 0), (0x20, 14), (0x50, 9), (0x50, 71), (0x60, 0x1C)] {
            assert_eq!(parse_command(&frame(high, low)), Err(BadCommand::Range(high >> 4)));
        }
        for id in 9..=15 {
            assert_eq!(parse_command(&frame(id << 4, 0)), Err(BadCommand::Id(id)));
        }
    }

    #[test]
    fn reserved_bits_are_seen() {
        assert_eq!(reserved_bits(&frame(0x01, 0x80)), 0x0180);
        assert_eq!(reserved_bits(&frame(0x2F, 1)), 0x0F00);
        assert_eq!(reserved_bits(&frame(0x6C, 0xF3)), 0x0CE0);
        assert_eq!(reserved_bits(&frame(0x84, 1)), 0x0400);
    }

    fn receive(bytes: &[u8]) -> (Vec<[u8; 4]>, usize, usize) {
        let mut receiver = Receiver::default();
        let received: Vec<Received> = bytes.iter().map(|&byte| receiver.receive(Ok(byte))).collect();
        let frames = received
            .iter()
            .filter_map(|h| if let Received::Frame(f) = h { Some(*f) } else { None })
            .collect();
        let count = |what| received.iter().filter(|&&h| h == what).count();
        (frames, count(Received::WrongCrc), count(Received::Stray))
    }

    #[test]
    fn frames_are_found_after_noise_and_after_half_frames() {
        let good = [0xFF, 0x14, 0x64, 0xD3];
        assert_eq!(receive(&good), (vec![good], 0, 0));
        assert_eq!(receive(&[1, 2, 0xFF, 0x14, 0x64, 0xD3]), (vec![good], 0, 2));
        // Half a frame, then a whole one: no byte of the whole one is dropped.
        assert_eq!(receive(&[0xFF, 0x14, 0xFF, 0x14, 0x64, 0xD3]), (vec![good], 1, 0));
        assert_eq!(receive(&[0xFF, 0xFF, 0x14, 0x64, 0xD3]), (vec![good], 1, 0));
        // 0xFF within a frame.
        let with_ff = frame(0x40, 0xFF);
        assert_eq!(receive(&with_ff), (vec![with_ff], 0, 0));
    }
}
