//! Finds status frames in a stream of bytes (ZK-16).

use super::frame::{STATUS_LEN, is_status_head};
use super::status::StatusFrame;
use crate::ecu::decoder::feed;
use core::ops::RangeInclusive;

/// The status IDs that the document names (ZK-15).
const STATUS_IDS: RangeInclusive<u8> = 1..=9;

/// Counters of a decoder. All wrap.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub struct DecoderCounters {
    /// Frames, including unknown ones.
    pub frames: u32,
    /// Frames with an ID the document does not name (ZK-15).
    pub unknown_frames: u32,
    /// Heads whose seven bytes had a wrong CRC.
    pub crc_failures: u32,
    /// Bytes that belonged to no frame.
    pub bytes_skipped: u32,
}

/// Finds status frames in a stream of bytes, in chunks of any size (ZK-16).
///
/// A window of seven bytes slides over the stream. After a CRC failure the search continues at the next
/// byte of the same window, so a frame after a false head is not lost.
#[derive(Clone, Copy, Debug, Default)]
pub struct Decoder {
    window: [u8; STATUS_LEN],
    len: usize,
    counters: DecoderCounters,
}

impl Decoder {
    /// An empty one.
    pub const fn new() -> Self {
        Self {
            window: [0; STATUS_LEN],
            len: 0,
            counters: DecoderCounters { frames: 0, unknown_frames: 0, crc_failures: 0, bytes_skipped: 0 },
        }
    }

    /// Takes bytes up to the end of the first frame. Returns how many it took, and the frame.
    /// Call it again while bytes are left.
    pub fn feed(&mut self, bytes: &[u8]) -> (usize, Option<StatusFrame>) {
        feed(bytes, |byte| self.push(byte))
    }

    /// Its counters.
    pub const fn counters(&self) -> DecoderCounters {
        self.counters
    }

    /// Number of bytes that may still become a frame.
    pub const fn pending(&self) -> usize {
        self.len
    }

    /// A byte was lost: the unfinished frame is discarded.
    pub fn byte_lost(&mut self) {
        self.counters.bytes_skipped = self.counters.bytes_skipped.wrapping_add(self.len as u32);
        self.len = 0;
    }

    fn push(&mut self, byte: u8) -> Option<StatusFrame> {
        if self.len == 0 && !is_status_head(byte) {
            self.counters.bytes_skipped = self.counters.bytes_skipped.wrapping_add(1);
            return None;
        }
        if let Some(slot) = self.window.get_mut(self.len) {
            *slot = byte;
            self.len += 1;
        }
        if self.len < STATUS_LEN {
            return None;
        }
        if let Some(frame) = StatusFrame::new(self.window) {
            self.len = 0;
            self.counters.frames = self.counters.frames.wrapping_add(1);
            if !STATUS_IDS.contains(&frame.id()) {
                self.counters.unknown_frames = self.counters.unknown_frames.wrapping_add(1);
            }
            return Some(frame);
        }
        self.counters.crc_failures = self.counters.crc_failures.wrapping_add(1);
        let next_head = (1..STATUS_LEN)
            .find(|&i| self.window.get(i).is_some_and(|&byte| is_status_head(byte)))
            .unwrap_or(STATUS_LEN);
        // A copy in place would be the only one of the firmware, and 1.4 kB of `core`.
        let window = self.window;
        self.window = core::array::from_fn(|i| window.get(i + next_head).copied().unwrap_or(0));
        self.len = STATUS_LEN - next_head;
        self.counters.bytes_skipped = self.counters.bytes_skipped.wrapping_add(next_head as u32);
        None
    }
}
