//! One type for all inputs, so that the code behind it is the same for each.

use crate::channels::Channels;
use crate::crsf::Crsf;
use crate::pwm::Pwm;
use crate::sbus::Sbus;
use embassy_time::Instant;

/// An input of radio control.
#[derive(Clone, Debug)]
pub enum Input {
    /// SBUS.
    Sbus(Sbus),
    /// CRSF.
    Crsf(Crsf),
    /// Servo pulses.
    Pwm(Pwm),
}

impl Input {
    /// Takes bytes of a UART up to the end of one frame, and returns how many it took, with the valid values. A pulse
    /// input takes and ignores all of them.
    pub fn receive(&mut self, now: Instant, bytes: &[u8]) -> (usize, Option<Channels>) {
        match self {
            Self::Sbus(sbus) => sbus.receive(now, bytes),
            Self::Crsf(crsf) => crsf.receive(now, bytes),
            Self::Pwm(_) => (bytes.len(), None),
        }
    }

    /// Takes a fault that the UART reported. CRSF ignores it: its frames have a checksum.
    pub fn line_error(&mut self) {
        if let Self::Sbus(sbus) = self {
            sbus.line_error();
        }
    }

    /// Takes a pulse of a timer, as [`Pwm::pulse`] does.
    pub fn pulse(&mut self, now: Instant, number: u8, width: u32, period: u32) -> Option<Channels> {
        match self {
            Self::Pwm(pwm) => pwm.pulse(now, number, width, period),
            Self::Sbus(_) | Self::Crsf(_) => None,
        }
    }
}
