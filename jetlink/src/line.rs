//! The serial line: its settings, the time that bytes take, its errors.

use crate::sentence::sentences;
use crate::setting::{SettingId, settings};
use crate::units::BaudRate;
use embassy_time::Duration;

/// Stop bits after each byte.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum StopBits {
    /// One: 10 bits per byte.
    One,
    /// Two: 11 bits per byte.
    Two,
}

/// A UART setting. Always 8 data bits and no parity (ZK-12, AMT-1).
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Line {
    /// Bits per second.
    pub baud: u32,
    /// Stop bits.
    pub stop_bits: StopBits,
}

impl Line {
    /// The rates that both documents print (ZK-12, AMT-1).
    pub const BAUD_RATES: [u32; 7] = BaudRate::ALL;

    /// 8N1 at a baud rate.
    pub const fn new(baud: u32) -> Self {
        Self { baud, stop_bits: StopBits::One }
    }

    /// 8N2 at a baud rate.
    pub const fn with_two_stop_bits(baud: u32) -> Self {
        Self { baud, stop_bits: StopBits::Two }
    }

    /// Bits on the line for one byte: start, 8 data, stop.
    pub const fn bits_per_byte(self) -> u32 {
        match self.stop_bits {
            StopBits::One => 10,
            StopBits::Two => 11,
        }
    }

    /// Whether the baud rate is one of [`Line::BAUD_RATES`].
    pub const fn is_printed_rate(self) -> bool {
        BaudRate::up_to(self.baud).get() == self.baud
    }

    /// Duration of `bytes` bytes sent back to back, rounded up to 1 µs.
    /// A baud rate of 0 counts as 1, so that nothing divides by zero.
    #[inline(never)]
    pub const fn time_of(self, bytes: u32) -> Duration {
        let bits = bytes as u64 * self.bits_per_byte() as u64;
        let baud = if self.baud == 0 { 1 } else { self.baud as u64 };
        Duration::from_micros((bits * 1_000_000).div_ceil(baud))
    }
}

/// Error that the UART reports.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[non_exhaustive]
pub enum LineError {
    /// Missing stop bit: a wrong baud rate, a broken or floating line.
    Framing,
    /// Samples of one bit differed.
    Noise,
    /// A byte was received before the last one was read.
    Overrun,
    /// Wrong parity: of a receiver of SBUS; neither protocol of an ECU uses parity.
    Parity,
    /// Any other error of the driver.
    Read,
}

settings! {
    /// Conditions for a link that is up, and for one that is lost. Each protocol has its own defaults, `TIMING` of its `Config`.
    pub struct Timing, "timing.", AtRest, defaults elsewhere {
        up_after: frames "LINK_UP_AFTER" in 1..=255, ConfigOnly, "Consecutive good frames, each within `lost_after` of the one before, until the link is up.";
        lost_after: ms "LINK_LOST" in 200..=60_000, "Silence until the link is lost.";
    }
}

impl Timing {
    /// The field and its range, as the text of an error. It is the same whatever the defaults are.
    pub(crate) const fn message(id: SettingId) -> &'static str {
        id.message(const { &Self::table(&Self { up_after: 1, lost_after: Duration::from_millis(500) }) })
    }

    /// Checks every range.
    pub(crate) const fn check(&self) -> Result<(), SettingId> {
        match self.check_own() {
            Ok(()) => Ok(()),
            Err(row) => Err(SettingId(row)),
        }
    }
}

sentences!(LineError {
    Self::Framing => "framing error: check the baud rate and the wiring";
    Self::Noise => "noise on the line: check its ground and shield";
    Self::Overrun => "overrun: bytes were read too late";
    Self::Parity => "parity error: check the line's settings";
    Self::Read => "the UART returned an error";
});

impl core::error::Error for LineError {}

sentences!(Line {
} {
    Self { baud, stop_bits: StopBits::One } => "{} baud, 8N1", baud;
    Self { baud, stop_bits: StopBits::Two } => "{} baud, 8N2", baud;
});
