//! Checksum of what survives a reset or a loss of power: CRC-32/ISO-HDLC, four bits at a time.
//!
//! Not by the crate `crc`, which computes the CRC-8 of ZK frames and is the reference of the test below: its table is 1 KiB instead of
//! 64 bytes, and no image has that much flash left; without a table it takes four times as many steps, under the lock of an engine.

/// Table of the reflected polynomial, for each value of four bits.
const TABLE: [u32; 16] = {
    let mut table = [0; 16];
    let mut value = 0;
    while value < 16 {
        let mut sum = value as u32;
        let mut bit = 0;
        while bit < 4 {
            sum = if sum & 1 == 1 { sum >> 1 ^ 0xEDB8_8320 } else { sum >> 1 };
            bit += 1;
        }
        table[value] = sum;
        value += 1;
    }
    table
};

/// A checksum of the bytes added so far.
#[derive(Clone, Copy, Debug)]
pub struct Checksum(u32);

impl Checksum {
    /// Checksum of no bytes.
    pub const fn new() -> Self {
        Self(u32::MAX)
    }

    /// Adds bytes.
    #[must_use]
    pub fn bytes(self, bytes: &[u8]) -> Self {
        bytes.iter().fold(self, |sum, &byte| sum.add(byte.into(), 2))
    }

    /// Adds words, each with its lowest byte first.
    #[must_use]
    pub fn words(self, words: &[u32]) -> Self {
        words.iter().fold(self, |sum, &word| sum.add(word, 8))
    }

    fn add(self, what: u32, half_bytes: u32) -> Self {
        Self((0..half_bytes).fold(self.0 ^ what, |sum, _| TABLE[(sum & 0xF) as usize] ^ sum >> 4))
    }

    /// The checksum.
    pub const fn value(self) -> u32 {
        !self.0
    }
}

impl Default for Checksum {
    fn default() -> Self {
        Self::new()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crc::{CRC_32_ISO_HDLC, Crc};

    #[test]
    fn it_is_the_checksum_of_another_implementation() {
        assert_eq!(Checksum::new().bytes(b"123456789").value(), 0xCBF4_3926);
        let other = Crc::<u32>::new(&CRC_32_ISO_HDLC);
        let words: [u32; 64] = core::array::from_fn(|i| (i as u32).wrapping_mul(0x9E37_79B9));
        let bytes: [u8; 256] = core::array::from_fn(|i| words[i / 4].to_le_bytes()[i % 4]);
        for count in 0..=words.len() {
            let (words, bytes) = (&words[..count], &bytes[..4 * count]);
            assert_eq!(Checksum::new().words(words).value(), other.checksum(bytes));
            let (front, back) = bytes.split_at(bytes.len() / 3);
            assert_eq!(Checksum::new().bytes(front).bytes(back).value(), other.checksum(bytes));
        }
    }
}
