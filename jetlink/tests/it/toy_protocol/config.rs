//! Settings and service commands of a toy ECU.

use super::codec::FRAME_LEN;
use core::fmt;
use embassy_time::Duration;
use jetlink::ecu::vendor::VendorService;
use jetlink::line::{Line, Timing};
use jetlink::setting::settings;

settings! {
    /// Settings of a toy ECU.
    pub struct Config, "ecu.", AtRest {
        send_every: ms "TOY_SEND_EVERY" = 100 in 20..=500, "Time between two commands. The ECU stops its engine after 1 s without one.";
    }
}

impl Config {
    /// Defaults of the link's timing: up after two frames, because they carry no checksum; lost after 0.5 s, five frames.
    pub const TIMING: Timing = Timing { up_after: 2, lost_after: Duration::from_millis(500) };

    /// Checks the settings, and that a line can carry the protocol.
    pub const fn check(&self, line: Line) -> Result<(), Mistake> {
        if self.check_own().is_err() {
            return Err(Mistake::Setting);
        }
        let frame = line.time_of(FRAME_LEN as u32);
        if frame.as_ticks() > self.send_every.as_ticks() { Err(Mistake::LineTooSlow) } else { Ok(()) }
    }
}

/// Mistake in the configuration.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Mistake {
    /// A setting is out of its range.
    Setting,
    /// A command takes longer than the time between two.
    LineTooSlow,
}

impl Mistake {
    /// A sentence, for use in a constant.
    pub const fn message(self) -> &'static str {
        match self {
            Self::Setting => Config::SETTINGS[0].message,
            Self::LineTooSlow => "the line is too slow for a command in every send slot",
        }
    }
}

/// Service commands.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Service {
    /// Fills the fuel line.
    Prime,
}

impl VendorService for Service {
    fn moves_fuel(self) -> bool {
        match self {
            Self::Prime => true,
        }
    }

    fn needs_stopped_engine(self) -> bool {
        match self {
            Self::Prime => true,
        }
    }
}

impl fmt::Display for Service {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Prime => f.write_str("prime"),
        }
    }
}
