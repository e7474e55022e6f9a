//! What receivers of radio control send, written from the public descriptions of SBUS and CRSF and not from the decoders.

/// Channels of a frame.
pub const CHANNELS: usize = 16;

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
}
