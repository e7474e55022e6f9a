//! A serial line's settings and the exact time that bytes take on it.

use crate::ecu::Nanos;

/// Number of stop bits at the end of a byte.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StopBits {
    /// 8N1: ten bits on the line for each byte.
    One,
    /// 8N2: eleven bits on the line for each byte.
    Two,
}

/// Baud rate, stop bits and parity; always 8 data bits. ECUs have no parity (ZK-12, AMT-1), SBUS has it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Line {
    /// Bits per second.
    pub baud: u32,
    /// Number of stop bits sent.
    pub stop_bits: StopBits,
    /// Even parity, instead of none.
    pub even_parity: bool,
}

impl Line {
    /// 8N1 at this baud rate.
    pub const fn n1(baud: u32) -> Self {
        Self { baud, stop_bits: StopBits::One, even_parity: false }
    }

    /// 8N2 at this baud rate.
    pub const fn n2(baud: u32) -> Self {
        Self { baud, stop_bits: StopBits::Two, even_parity: false }
    }

    /// 8N1 or 8N2, by the bits on the line for each byte: 10 or 11.
    ///
    /// # Panics
    /// With any other number of bits.
    pub fn with_bits(baud: u32, bits_per_byte: u32) -> Self {
        match bits_per_byte {
            10 => Self::n1(baud),
            11 => Self::n2(baud),
            other => panic!("{other} bits for each byte: no ECU has such a line"),
        }
    }

    /// 8E2 at this baud rate.
    pub const fn e2(baud: u32) -> Self {
        Self { even_parity: true, ..Self::n2(baud) }
    }

    /// Bits on the line for one byte: start bit, 8 data bits, parity, stop bits.
    pub const fn bits_per_byte(self) -> u64 {
        let parity = if self.even_parity { 1 } else { 0 };
        match self.stop_bits {
            StopBits::One => 10 + parity,
            StopBits::Two => 11 + parity,
        }
    }

    /// The time of `n` bytes sent back to back, from the first start bit to the end of the last
    /// stop bit. The total is rounded once, so that long runs do not accumulate an error.
    pub fn byte_ns(self, n: u64) -> Nanos {
        let baud = u128::from(self.baud.max(1));
        let bits = u128::from(n) * u128::from(self.bits_per_byte());
        let ns = (bits * 1_000_000_000 + baud / 2) / baud;
        u64::try_from(ns).unwrap_or(u64::MAX)
    }

    /// Whether a receiver configured like `self` understands a sender configured like `other`.
    ///
    /// Half a bit of error over the nine and a half bits that are sampled is 5 %; the usual rule
    /// leaves 3 % for the difference of the two clocks. A receiver only checks the first stop bit, so
    /// the number of stop bits need not agree.
    pub fn understands(self, other: Line) -> bool {
        let (a, b) = (u64::from(self.baud), u64::from(other.baud));
        a.abs_diff(b) * 100 <= a.max(b) * 3
    }
}

/// The line of an engine in the terms of the simulation: anything with `baud` and `bits_per_byte()`. A macro, because this crate does
/// not know the library, and the library with a toy protocol (`toy/`) has another type for it.
#[macro_export]
macro_rules! line_of {
    ($line:expr) => {{
        let line = $line;
        $crate::line::Line::with_bits(line.baud, line.bits_per_byte())
    }};
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bytes_take_the_times_that_the_amt_document_prints() {
        // "Time per byte 4,16 msec", "20,8 ms" for the five bytes of a control message.
        let line = Line::n1(2400);
        assert_eq!(line.byte_ns(1), 4_166_667);
        assert_eq!(line.byte_ns(5), 20_833_333);
        assert_eq!(line.byte_ns(6), 25_000_000);
    }

    #[test]
    fn stop_bits_and_parity_take_their_time() {
        assert_eq!(Line::n1(9600).byte_ns(7), 7_291_667); // 70 bits (ZK-11)
        assert_eq!(Line::n2(9600).byte_ns(7), 8_020_833); // 77 bits
        assert_eq!(Line::n1(115_200).byte_ns(1), 86_806);
        assert_eq!(Line::e2(100_000).byte_ns(25), 3_000_000); // a frame of SBUS
    }

    #[test]
    fn rounding_errors_do_not_accumulate() {
        for baud in [2400, 4800, 9600, 19_200, 38_400, 57_600, 115_200, 230_400] {
            assert_eq!(Line::n1(baud).byte_ns(u64::from(baud)), 10_000_000_000);
            assert_eq!(Line::n2(baud).byte_ns(u64::from(baud)), 11_000_000_000);
        }
    }

    #[test]
    fn extremes_do_not_panic() {
        assert_eq!(Line::n1(0).byte_ns(1), 10_000_000_000);
        assert_eq!(Line::n1(1).byte_ns(u64::MAX), u64::MAX);
    }

    #[test]
    fn only_like_baud_rates_understand_each_other() {
        assert!(Line::n1(9600).understands(Line::n2(9600)));
        assert!(Line::n1(115_200).understands(Line::n1(113_636)));
        assert!(!Line::n1(9600).understands(Line::n1(4800)));
        assert!(!Line::n1(9600).understands(Line::n1(10_000)));
    }
}
