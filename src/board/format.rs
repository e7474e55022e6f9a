//! How a port is opened: the line of an ECU, of MAVLink, or of a receiver of radio control.

use jetlink::line::{Line, StopBits};
use jetlink_rc::config::RadioLine;

/// Settings of a UART: 8 data bits.
#[derive(Clone, Copy)]
pub struct Format {
    /// Bits per second.
    pub baud: u32,
    /// Stop bits.
    pub stop_bits: StopBits,
    /// Even parity, instead of none.
    pub even_parity: bool,
    /// RX is inverted: its idle level is low.
    pub inverted_rx: bool,
}

impl Format {
    /// Of an ECU or of MAVLink.
    pub const fn of_line(line: Line) -> Self {
        Self { baud: line.baud, stop_bits: line.stop_bits, even_parity: false, inverted_rx: false }
    }

    /// Of a receiver.
    pub const fn of_radio(line: RadioLine, inverted_rx: bool) -> Self {
        Self {
            baud: line.baud,
            stop_bits: if line.is_8e2 { StopBits::Two } else { StopBits::One },
            even_parity: line.is_8e2,
            inverted_rx,
        }
    }
}
