//! MAVLink for tests of the rig, from the protocol's description.

/// A frame of a ground station, version 1.
pub fn frame(id: u8, extra: u8, payload: &[u8]) -> Vec<u8> {
    let mut frame = vec![0xFE, payload.len() as u8, 0, 255, 190, id];
    frame.extend(payload);
    let mut crc = 0xFFFF_u16;
    for byte in frame[1..].iter().chain(&[extra]) {
        crc ^= u16::from(*byte);
        for _ in 0..8 {
            crc = if crc & 1 != 0 { crc >> 1 ^ 0x8408 } else { crc >> 1 };
        }
    }
    frame.extend(crc.to_le_bytes());
    frame
}
