//! Settings and service commands of an AMT ECU.

use super::codec::{CONTROL_LEN, EngineModel};
use crate::ecu::vendor::{LineMistake, VendorMistake, VendorService};
use crate::line::{Line, StopBits, Timing};
use crate::sentence::sentences;
use crate::setting::{SettingId, settings};
use embassy_time::Duration;

/// From the last stop bit of an ECU frame to the last stop bit of its reply (AMT-11).
pub const REPLY_WINDOW: Duration = Duration::from_millis(30);

settings! {
    /// Settings of an AMT ECU.
    pub struct Config, "ecu.", AtRest {
        start_throttle: throttle "AMT_START_THR" = 0 in 0..=1000, "Throttle sent with \"run\" until the ECU reports full operation: some ECUs require the stick up for a start (AMT-14).";
        reply_guard: us "AMT_GUARD" = 500 in 0..=30_000, "Time left free at the end of the reply window, for the difference between two clocks.";
        serial_delay: ms "AMT_SER_DELAY" = 4000 in 500..=60_000, "The ECU's serial delay time: without a reply in this time it stops its turbine on its own (AMT-12). After a longer silence of the ECU, nothing that was in force before is sent. Set it to the value set in the ECU.";
        half_idle: raw "AMT_HALF_IDLE" = 20 in 1..=254, "Half of the idle speed, in the raw unit of Data 2 (500 or 700 rpm, AMT-5), because the ECU gives no idle speed. An engine whose shaft turns slower is not running. 20 is 10 000 rpm of an Olympus, which idles at 36 000 rpm and lights at 6000 rpm.";
    }
    groups {
        /// Engine model, for scaling until the ECU reports its own, which takes precedence.
        engine: Option<EngineModel> = None;
    }
}

// `E1_AMT_ENGINE` has all of them.
const _: () = assert!(EngineModel::ALL.len() == 7);

impl Config {
    /// Defaults of the link's timing: up after two frames, because they carry no checksum; lost after 1 s, eight frames at 2400
    /// baud.
    pub const TIMING: Timing = Timing { up_after: 2, lost_after: Duration::from_secs(1) };

    /// Number of the engine, 0 if it is not known.
    pub(crate) const fn identity(self) -> u8 {
        match self.engine {
            Some(engine) => engine as u8 + 1,
            None => 0,
        }
    }

    /// Its own parts of the wiring.
    pub(crate) const fn wired(self) -> [u8; 1] {
        [self.identity()]
    }

    /// Sets them from the wiring.
    pub(crate) fn wire(&mut self, [engine]: [u8; 1]) {
        let place = usize::from(engine).checked_sub(1);
        self.engine = place.and_then(|place| EngineModel::ALL.get(place)).copied();
    }

    /// Checks the settings, and that a line can carry the protocol.
    pub(crate) const fn check(&self, line: Line) -> Result<(), Mistake> {
        if matches!(line.stop_bits, StopBits::Two) {
            return Err(Mistake::StopBits);
        }
        if self.reply_slack(line).is_none() {
            return Err(Mistake::NoReplyFits);
        }
        match self.check_own() {
            Ok(()) => Ok(()),
            Err(row) => Err(Mistake::Setting(SettingId(row))),
        }
    }

    /// Time for the first start bit of a reply, counted from the last stop bit of the ECU's frame.
    /// 9.1 ms less the guard at 2400 baud; `None` where a reply does not fit the window at all.
    #[inline(never)]
    pub const fn reply_slack(&self, line: Line) -> Option<Duration> {
        let needed = line.time_of(CONTROL_LEN as u32).as_ticks().saturating_add(self.reply_guard.as_ticks());
        if needed >= REPLY_WINDOW.as_ticks() {
            return None;
        }
        Some(Duration::from_ticks(REPLY_WINDOW.as_ticks() - needed))
    }
}

/// Mistake in the configuration of an AMT ECU.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[non_exhaustive]
pub enum Mistake {
    /// The line has two stop bits (AMT-1).
    StopBits,
    /// No reply fits the window: the guard is too long (AMT-11).
    NoReplyFits,
    /// This setting of [`Config::SETTINGS`] is out of its range.
    Setting(SettingId),
}

impl Mistake {
    /// A sentence, for use in a constant.
    pub const fn message(self) -> &'static str {
        match self {
            Self::StopBits => "invalid stop bits: an AMT line has one",
            Self::NoReplyFits => "the reply guard leaves no time for a reply: use a shorter one",
            Self::Setting(id) => id.message(Config::SETTINGS),
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
            Self::NoReplyFits | Self::Setting(_) => None,
        }
    }
}

/// Service commands of an AMT ECU.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Service {
    /// CTF: while running, the ECU stops the engine after its serial delay time. Refused unless the engine is ordered to
    /// run. Sent until standby or a stop is ordered; new demands do not call it off. Never used for a normal stop (AMT-13).
    Ctf,
}

impl VendorService for Service {
    fn needs_stopped_engine(self) -> bool {
        match self {
            Self::Ctf => false,
        }
    }
}

sentences!(Service {
    Self::Ctf => "CTF";
});
