//! Settings and service commands of a toy ECU.

use crate::ecu::vendor::{LineMistake, VendorMistake, VendorService};
use crate::line::{Line, StopBits, Timing};
use crate::sentence::sentences;
use crate::setting::{SettingId, settings};
use embassy_time::Duration;

settings! {
    /// Settings of a toy ECU.
    pub struct Config, "ecu.", AtRest {
        send_every: ms "TOY_SEND_EVERY" = 100 in 20..=500, "Time between two commands. The ECU stops its engine after 1 s without one.";
    }
    groups {
        /// Serial number of the engine.
        engine: u8 = 0;
    }
}

impl Config {
    /// Defaults of the link's timing: up after two frames, because they carry no checksum; lost after 0.5 s, five frames.
    pub const TIMING: Timing = Timing { up_after: 2, lost_after: Duration::from_millis(500) };

    /// The engine.
    pub(crate) const fn identity(self) -> u8 {
        self.engine
    }

    /// Its own parts of the wiring.
    pub(crate) const fn wired(self) -> [u8; 1] {
        [self.engine]
    }

    /// Sets them from the wiring.
    pub(crate) fn wire(&mut self, [engine]: [u8; 1]) {
        self.engine = engine;
    }

    /// Checks the settings, and that a line can carry the protocol.
    pub(crate) const fn check(&self, line: Line) -> Result<(), Mistake> {
        if let Err(row) = self.check_own() {
            return Err(Mistake::Setting(SettingId(row)));
        }
        if matches!(line.stop_bits, StopBits::Two) { Err(Mistake::StopBits) } else { Ok(()) }
    }
}

/// Mistake in the configuration.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Mistake {
    /// This setting of [`Config::SETTINGS`] is out of its range.
    Setting(SettingId),
    /// The line has two stop bits.
    StopBits,
}

impl Mistake {
    /// A sentence, for use in a constant.
    pub const fn message(self) -> &'static str {
        match self {
            Self::Setting(id) => id.message(Config::SETTINGS),
            Self::StopBits => "invalid stop bits: a toy line has one",
        }
    }
}

sentences!(Mistake {
} {
    mistake => "{}", mistake.message();
});

impl core::error::Error for Mistake {}

impl VendorMistake for Mistake {
    fn line(self) -> Option<LineMistake> {
        match self {
            Self::StopBits => Some(LineMistake::StopBits),
            Self::Setting(_) => None,
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

sentences!(Service {
    Self::Prime => "prime";
});
