//! Frames of radio control receivers, written from the public descriptions of SBUS and CRSF, not from the decoders.

use crate::line::Line;

/// Channels of a frame.
pub const CHANNELS: usize = 16;
/// Default channels of throttle and switch, from 1.
const USUAL: [u8; 2] = [3, 5];
/// Flags of an SBUS receiver without its transmitter: frame lost, and fail-safe.
const LOST: u8 = 0x0C;

/// Protocol of a receiver.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Protocol {
    /// SBUS.
    Sbus,
    /// CRSF.
    Crsf,
}

impl Protocol {
    /// Its line.
    pub const fn line(self) -> Line {
        match self {
            Self::Sbus => Line::e2(100_000),
            Self::Crsf => Line::n1(420_000),
        }
    }

    /// The frame of a receiver with its transmitter on or off: an SBUS receiver without one flags its frames, a CRSF
    /// receiver sends none.
    pub fn frame(self, channels: [u16; CHANNELS], on: bool) -> Option<Vec<u8>> {
        match (self, on) {
            (Self::Sbus, on) => Some(sbus(channels, if on { 0 } else { LOST })),
            (Self::Crsf, true) => Some(crsf(channels)),
            (Self::Crsf, false) => None,
        }
    }
}

/// Position of a switch with three positions.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Position {
    /// Stop.
    Stop,
    /// Standby.
    Standby,
    /// Run allowed.
    Run,
}

impl Position {
    /// Pulse width in µs.
    pub const fn pulse_us(self) -> u16 {
        match self {
            Self::Stop => 1000,
            Self::Standby => 1500,
            Self::Run => 2000,
        }
    }

    /// Name in lower case.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Stop => "stop",
            Self::Standby => "standby",
            Self::Run => "run allowed",
        }
    }
}

/// The channels of one stick and one switch: the throttle in 0.1 % on channel 3, from 1100 to 1900 µs, the switch on channel
/// 5. The others are centred.
pub fn channels(throttle_tenths: u16, switch: Position) -> [u16; CHANNELS] {
    channels_on(USUAL, throttle_tenths, switch)
}

/// The same with throttle and switch on these channels, from 1.
pub fn channels_on(
    [throttle_channel, switch_channel]: [u8; 2],
    throttle_tenths: u16,
    switch: Position,
) -> [u16; CHANNELS] {
    let mut channels = [steps(1500); CHANNELS];
    for (number, pulse) in
        [(throttle_channel, throttle_us(throttle_tenths)), (switch_channel, switch.pulse_us())]
    {
        if let Some(channel) = usize::from(number).checked_sub(1).and_then(|place| channels.get_mut(place)) {
            *channel = steps(pulse);
        }
    }
    channels
}

/// Pulse width of the throttle in µs, from 1100 to 1900 µs.
pub const fn throttle_us(throttle_tenths: u16) -> u16 {
    1100 + throttle_tenths * 8 / 10
}

/// Sixteen channels of 11 bits, lowest bit first: bit by bit.
fn packed(channels: [u16; CHANNELS]) -> [u8; 22] {
    let mut bytes = [0; 22];
    for bit in 0..176 {
        bytes[bit / 8] |= ((channels[bit / 11] >> (bit % 11) & 1) as u8) << (bit % 8);
    }
    bytes
}

/// An SBUS frame. Flags: 0x04 frame lost, 0x08 fail-safe.
pub fn sbus(channels: [u16; CHANNELS], flags: u8) -> Vec<u8> {
    [&[0x0F][..], &packed(channels), &[flags, 0]].concat()
}

/// CRC-8 with the polynomial 0xD5, bit by bit.
fn crc8(bytes: &[u8]) -> u8 {
    bytes.iter().fold(0, |sum, byte| {
        (0..8).fold(sum ^ byte, |sum, _| if sum & 0x80 != 0 { sum << 1 ^ 0xD5 } else { sum << 1 })
    })
}

/// A CRSF frame of any type.
pub fn crsf_frame(kind: u8, payload: &[u8]) -> Vec<u8> {
    let body = [&[kind], payload].concat();
    let sum = crc8(&body);
    [&[0xC8, body.len() as u8 + 1][..], &body, &[sum]].concat()
}

/// A CRSF frame of channels.
pub fn crsf(channels: [u16; CHANNELS]) -> Vec<u8> {
    crsf_frame(0x16, &packed(channels))
}

/// CRSF link statistics with this uplink quality.
pub fn crsf_link(quality: u8) -> Vec<u8> {
    crsf_frame(0x14, &[60, 70, quality, 9, 1, 5, 3, 80, 98, 0xF6])
}

/// The number of an SBUS or CRSF channel for a pulse width.
pub fn steps(us: u16) -> u16 {
    ((i32::from(us) - 1500) * 8 / 5 + 992) as u16
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_have_their_length_and_their_ends() {
        let sbus = sbus([0x7FF; CHANNELS], 0x08);
        assert_eq!((sbus.len(), sbus[0], sbus[1], sbus[23], sbus[24]), (25, 0x0F, 0xFF, 0x08, 0));
        let crsf = crsf([0; CHANNELS]);
        assert_eq!((crsf.len(), &crsf[..3]), (26, &[0xC8, 24, 0x16][..]));
        assert_eq!([1000, 1500, 2000].map(steps), [192, 992, 1792]);
    }

    #[test]
    fn stick_and_switch_are_on_channels_3_and_5() {
        for (throttle, switch, third, fifth) in [
            (0, Position::Stop, 352, 192),
            (500, Position::Standby, 992, 992),
            (1000, Position::Run, 1632, 1792),
        ] {
            let mut expected = [992; CHANNELS];
            (expected[2], expected[4]) = (third, fifth);
            assert_eq!(channels(throttle, switch), expected, "{switch:?}");
        }
    }

    #[test]
    fn a_receiver_without_its_transmitter_flags_its_frames_or_sends_none() {
        let channels = [992; CHANNELS];
        assert_eq!(Protocol::Sbus.frame(channels, true), Some(sbus(channels, 0)));
        assert_eq!(Protocol::Sbus.frame(channels, false), Some(sbus(channels, 0x0C)));
        assert_eq!(Protocol::Crsf.frame(channels, true), Some(crsf(channels)));
        assert_eq!(Protocol::Crsf.frame(channels, false), None);
    }
}
