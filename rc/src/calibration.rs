//! Calibration of the stick: its end points are the shortest and the longest pulse seen.

use crate::channels::Pulse;
use crate::settings::SPAN;

/// Why a calibration did not begin or end.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[non_exhaustive]
pub enum CalibrationError {
    /// The engine turns, or is ordered to. A calibration in progress has ended.
    EngineTurns,
    /// No calibration was begun.
    NotBegun,
    /// The stick was not moved from end to end.
    TooShort,
}

impl CalibrationError {
    /// What to do.
    pub const fn text(self) -> &'static str {
        match self {
            Self::EngineTurns => "stop the engine first",
            Self::NotBegun => "begin a calibration first",
            Self::TooShort => "move the stick from one end to the other and try again",
        }
    }
}

impl core::fmt::Display for CalibrationError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str(self.text())
    }
}

#[cfg(feature = "defmt")]
impl defmt::Format for CalibrationError {
    fn format(&self, f: defmt::Formatter<'_>) {
        defmt::write!(f, "{}", self.text());
    }
}

impl core::error::Error for CalibrationError {}

/// A calibration in progress.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Calibration {
    ends: Option<(Pulse, Pulse)>,
}

impl Calibration {
    pub fn see(&mut self, pulse: Pulse) {
        let (low, high) = self.ends.unwrap_or((pulse, pulse));
        self.ends = Some((low.min(pulse), high.max(pulse)));
    }

    /// The end points in µs.
    pub fn ends(&self) -> Result<(u16, u16), CalibrationError> {
        match self.ends {
            Some((low, high)) if high.us() - low.us() >= SPAN => Ok((low.us(), high.us())),
            _ => Err(CalibrationError::TooShort),
        }
    }
}
