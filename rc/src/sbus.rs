//! SBUS: 25 bytes at 100 000 baud, 8E2, inverted, every 4 to 18 ms.
//!
//! | byte | contents |
//! |---|---|
//! | 0 | 0x0F |
//! | 1 to 22 | 16 channels with 11 bits each, lowest bit first |
//! | 23 | bit 0 channel 17, bit 1 channel 18, bit 2 frame lost, bit 3 fail-safe, others 0 |
//! | 24 | 0x00; SBUS 2 has 0x04, 0x14, 0x24 or 0x34 |
//!
//! There is no checksum, and 0x0F also occurs in the channels. So a frame begins only after a pause of the line or directly after a
//! good frame. Even parity finds one flipped bit of a byte: let the UART report it with [`Sbus::line_error`].

use crate::channels::{Channels, PACKED, Pulse, unpack};
use crate::confirm::Confirm;
use crate::count::count;
use embassy_time::{Duration, Instant};
use heapless::Vec;

/// Baud rate; 8E2, inverted.
pub const BAUD: u32 = 100_000;
/// Bytes of a frame.
pub const FRAME_LEN: usize = 25;

const START: u8 = 0x0F;
const FRAME_LOST: u8 = 0x04;
const FAIL_SAFE: u8 = 0x08;
const RESERVED: u8 = 0xF0;
/// Time of a byte on the line in µs: 12 bits.
const BYTE: u64 = 120;
/// Pause after which a frame may begin: four bytes.
const PAUSE: Duration = Duration::from_micros(4 * BYTE);
/// A frame takes 3 ms.
const LEAST: Duration = Duration::from_millis(3);
/// Longest time between two frames of a row.
const MOST: Duration = Duration::from_millis(50);

/// Counters of an SBUS input. All wrap.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct SbusCounters {
    /// Good frames.
    pub frames: u32,
    /// Those with the flag "fail-safe".
    pub fail_safe: u32,
    /// Those with the flag "frame lost" alone.
    pub frame_lost: u32,
    /// Those that came faster than the line can carry.
    pub too_fast: u32,
    /// Frames with a wrong end or a reserved flag, or in which the UART reported a fault.
    pub bad_frames: u32,
    /// Frames cut short by a pause.
    pub truncated: u32,
    /// Bytes that belonged to no frame.
    pub bytes_skipped: u32,
    /// Faults that the UART reported; several within one frame are one.
    pub line_errors: u32,
}

/// An SBUS input.
#[derive(Clone, Debug)]
pub struct Sbus {
    frame: Vec<u8, FRAME_LEN>,
    /// Time of the last byte.
    last: Option<Instant>,
    /// Nothing is taken until the line has paused.
    waits_for_pause: bool,
    /// The UART reported a fault since the last frame.
    damaged: bool,
    confirm: Confirm<18>,
    counters: SbusCounters,
}

impl Default for Sbus {
    fn default() -> Self {
        Self::new()
    }
}

impl Sbus {
    /// An input that has received nothing.
    pub const fn new() -> Self {
        Self {
            frame: Vec::new(),
            last: None,
            waits_for_pause: true,
            damaged: false,
            confirm: Confirm::new(LEAST, MOST),
            counters: SbusCounters {
                frames: 0,
                fail_safe: 0,
                frame_lost: 0,
                too_fast: 0,
                bad_frames: 0,
                truncated: 0,
                bytes_skipped: 0,
                line_errors: 0,
            },
        }
    }

    /// Its counters.
    pub const fn counters(&self) -> &SbusCounters {
        &self.counters
    }

    /// Takes bytes up to the end of one frame. Returns how many it took, and the channels that are valid with this frame. `now`
    /// is the time at which the last of `bytes` was received, or later.
    pub fn receive(&mut self, now: Instant, bytes: &[u8]) -> (usize, Option<Channels>) {
        let Some(behind) = bytes.len().checked_sub(1) else { return (0, None) };
        // The bytes came back to back: a late task must not see a pause where there was none.
        let first = earlier(now, behind);
        if let Some(last) = self.last
            && first.saturating_duration_since(last) >= PAUSE
            && !self.is_ended_by(bytes)
        {
            self.pause();
        }
        for (i, &byte) in bytes.iter().enumerate() {
            self.last = Some(earlier(now, behind - i));
            if let Some(channels) = self.byte(now, byte) {
                return (i + 1, channels);
            }
        }
        (bytes.len(), None)
    }

    /// Takes a fault that the UART reported, such as wrong parity: the frame that is being received, or the next one, is damaged.
    /// Report it before the bytes that were received with it.
    pub const fn line_error(&mut self) {
        if !self.damaged {
            count(&mut self.counters.line_errors);
        }
        self.damaged = true;
    }

    /// Whether these bytes complete the frame that is being received. A task that became late within a frame reads the rest at once: the
    /// line paused after it, not before.
    fn is_ended_by(&self, bytes: &[u8]) -> bool {
        let mut frame = self.frame.clone();
        !frame.is_empty()
            && frame.extend_from_slice(bytes).is_ok()
            && <&[u8; FRAME_LEN]>::try_from(frame.as_slice()).is_ok_and(is_whole)
    }

    fn pause(&mut self) {
        if !self.frame.is_empty() {
            count(&mut self.counters.truncated);
            self.spoil();
        }
        self.waits_for_pause = false;
    }

    /// Drops the frame that is being received.
    fn spoil(&mut self) {
        self.frame.clear();
        self.damaged = false;
        self.confirm.end();
        self.waits_for_pause = true;
    }

    /// Takes one byte. `Some` at the end of a good frame.
    fn byte(&mut self, now: Instant, byte: u8) -> Option<Option<Channels>> {
        if self.waits_for_pause || self.frame.is_empty() && byte != START {
            count(&mut self.counters.bytes_skipped);
            self.waits_for_pause = true;
            return None;
        }
        // There is room: it is emptied when it is full.
        let _ = self.frame.push(byte);
        let frame: &[u8; FRAME_LEN] = self.frame.as_slice().try_into().ok()?;
        let [_, packed @ .., flags, _] = frame;
        let (packed, flags): (&[u8; PACKED], u8) = (packed, *flags);
        if !is_whole(frame) || self.damaged {
            count(&mut self.counters.bad_frames);
            self.spoil();
            return None;
        }
        let analog = unpack(packed);
        self.frame.clear();
        Some(self.good(now, analog, flags))
    }

    fn good(&mut self, now: Instant, analog: [Pulse; 16], flags: u8) -> Option<Channels> {
        count(&mut self.counters.frames);
        if flags & FAIL_SAFE != 0 {
            count(&mut self.counters.fail_safe);
            self.confirm.end();
            return None;
        }
        if flags & FRAME_LOST != 0 {
            // The receiver repeats what it had: nothing new, and nothing wrong.
            count(&mut self.counters.frame_lost);
            return None;
        }
        let digital = |bit: u8| if flags >> bit & 1 == 1 { Pulse::ON } else { Pulse::OFF };
        let mut pulses = [Pulse::CENTRE; 18];
        for (place, pulse) in pulses.iter_mut().zip(analog.into_iter().chain([digital(0), digital(1)])) {
            *place = pulse;
        }
        self.confirm.channels(now, pulses, &mut self.counters.too_fast)
    }
}

/// Whether its flags and its end are those of a frame.
const fn is_whole(frame: &[u8; FRAME_LEN]) -> bool {
    let [.., flags, end] = *frame;
    (end == 0 || end & 0xCF == 0x04) && flags & RESERVED == 0
}

/// Time of a byte that `behind` others have followed until `now`.
fn earlier(now: Instant, behind: usize) -> Instant {
    now.checked_sub(Duration::from_micros(BYTE * behind as u64)).unwrap_or(Instant::from_ticks(0))
}
