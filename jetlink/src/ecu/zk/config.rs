//! Settings and service commands of a ZK ECU.

use super::codec::{AccelerationCurve, Action, Control, IgnitionPumpVoltage, Rate};
use crate::ecu::vendor::{LineMistake, VendorMistake, VendorService};
use crate::line::{Line, Timing};
use crate::sentence::sentences;
use crate::setting::settings;
use crate::units::Whole;
use embassy_time::Duration;

settings! {
    /// Settings of a ZK ECU.
    pub struct Config, "ecu.", AtRest {
        split_switch: yes_no "ZK_SPLIT_SWITCH" = 0 in 0..=1, "Carry the switch in ID 6 and the throttle in ID 1 (mode 2), on ECUs that know it. Otherwise both go in ID 1 (mode 1), until an rpm is commanded (mode 3).";
    }
    groups {
        /// Status rate; also the cadence of the commands (ZK-11).
        rate: Rate = Rate::Hz20;
    }
}

impl Config {
    /// Defaults of the link's timing: up after one frame, because it carries a CRC; lost after 0.5 s, ten frames at 20 Hz.
    pub const TIMING: Timing = Timing { up_after: 1, lost_after: Duration::from_millis(500) };

    /// The settings do not name an engine.
    pub(crate) const fn identity(self) -> u8 {
        0
    }

    /// Its own parts of the wiring.
    pub(crate) const fn wired(self) -> [u8; 1] {
        [self.rate.hz() as u8]
    }

    /// Sets them from the wiring.
    pub(crate) fn wire(&mut self, [hz]: [u8; 1]) {
        if let Some(rate) = Rate::ALL.into_iter().find(|rate| rate.hz() == hz.into()) {
            self.rate = rate;
        }
    }

    /// Checks that a line can carry the status rate.
    pub(crate) const fn check(&self, line: Line) -> Result<(), Mistake> {
        if self.rate.fits(line) { Ok(()) } else { Err(Mistake::RateTooFast) }
    }
}

/// Mistake in the configuration of a ZK ECU.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[non_exhaustive]
pub enum Mistake {
    /// The status rate does not fit the line (ZK-11).
    RateTooFast,
}

impl Mistake {
    /// A sentence, for use in a constant.
    pub const fn message(self) -> &'static str {
        match self {
            Self::RateTooFast => {
                "the line is too slow for the status rate: 20 Hz needs 2400 baud, 50 Hz 4800, 100 Hz 9600"
            }
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
            Self::RateTooFast => Some(LineMistake::TooSlow),
        }
    }
}

/// Service commands of a ZK ECU.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Service {
    /// Control ID 2.
    Action(Action),
    /// Unlock, then control ID 4; confirmed by status ID 5.
    IgnitionPump(IgnitionPumpVoltage),
    /// Unlock, then control ID 5; confirmed by status ID 5.
    Curve(AccelerationCurve),
}

impl Service {
    pub(super) const fn control(self) -> Control {
        match self {
            Self::Action(action) => Control::Action(action),
            Self::IgnitionPump(voltage) => Control::IgnitionPump(voltage),
            Self::Curve(curve) => Control::Curve(curve),
        }
    }

    pub(super) const fn needs_unlock(self) -> bool {
        matches!(self, Self::IgnitionPump(_) | Self::Curve(_))
    }
}

impl VendorService for Service {
    fn needs_stopped_engine(self) -> bool {
        !matches!(self, Self::Action(Action::Rate20Hz | Action::Rate50Hz | Action::Rate100Hz))
    }

    fn moves_fuel(self) -> bool {
        matches!(
            self,
            Self::Action(
                Action::Drain
                    | Action::TestGlowPlug
                    | Action::TestMainValve
                    | Action::TestIgnitionValve
                    | Action::TestPump
                    | Action::OpenPump
            )
        )
    }

    fn closes_pump(self) -> bool {
        self == Self::Action(Action::ClosePump)
    }
}

sentences!(Service {
    Self::IgnitionPump(_) => "ignition pump voltage";
    Self::Curve(_) => "acceleration curve";
} {
    Self::Action(action) => "action {}", Whole(action.code().into());
});
