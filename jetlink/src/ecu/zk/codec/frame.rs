//! Properties of a ZK frame: length, head and CRC (ZK-1, ZK-16).

use crc::{CRC_8_MAXIM_DOW, Crc, NoTable};

/// Bytes of a control frame.
pub const CONTROL_LEN: usize = 4;
/// Bytes of a status frame.
pub const STATUS_LEN: usize = 7;
/// First byte of every control frame.
pub const CONTROL_HEAD: u8 = 0xFF;

/// CRC-8/MAXIM-DOW: polynomial 0x31 reflected (0x8C), start 0, no final xor (ZK-1). Without a table, which would be larger
/// than the frames are long.
const CRC: Crc<u8, NoTable> = Crc::<u8, NoTable>::new(&CRC_8_MAXIM_DOW);

/// The CRC of a frame's bytes (ZK-1).
pub const fn crc8(bytes: &[u8]) -> u8 {
    CRC.checksum(bytes)
}

/// A first byte of a status frame: 0xF0..=0xFE, as 0xFF is the control head (ZK-16).
pub(super) const fn is_status_head(byte: u8) -> bool {
    byte >= 0xF0 && byte != CONTROL_HEAD
}
