//! What the status LED of a node shows, and when its buzzer beeps: one table, for firmware and README.

use embassy_time::Duration;

/// What the status LED shows, from the least urgent to the most urgent: with several engines, the most urgent of them.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Debug, Default)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum Indication {
    /// Every engine is at rest and disarmed.
    #[default]
    AtRest,
    /// An engine is armed.
    Armed,
    /// An engine turns, or is ordered to.
    Running,
    /// The source in control is lost.
    SourceLost,
    /// An emergency stop is latched.
    StopLatched,
    /// An engine or the board needs attention.
    Fault,
}

/// Flashes in each second.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Pattern {
    /// Number.
    pub flashes: u8,
    /// Time for which the LED is lit in each.
    pub lit: Duration,
}

impl Pattern {
    /// Time for which the LED is dark after each flash, at least.
    pub const DARK: Duration = Duration::from_millis(100);
    const SHORT: Duration = Duration::from_millis(50);
    const LONG: Duration = Duration::from_millis(300);

    const fn short(flashes: u8) -> Self {
        Self { flashes, lit: Self::SHORT }
    }

    const fn long(flashes: u8) -> Self {
        Self { flashes, lit: Self::LONG }
    }

    /// Whether its flashes are long ones.
    pub fn is_long(self) -> bool {
        self.lit == Self::LONG
    }
}

impl Indication {
    /// All of them.
    pub const ALL: [Self; 6] =
        [Self::AtRest, Self::Armed, Self::Running, Self::SourceLost, Self::StopLatched, Self::Fault];

    /// How the LED flashes.
    pub const fn pattern(self) -> Pattern {
        match self {
            Self::AtRest => Pattern::short(1),
            Self::Armed => Pattern::short(2),
            Self::Running => Pattern::short(3),
            Self::SourceLost => Pattern::long(1),
            Self::StopLatched => Pattern::long(2),
            Self::Fault => Pattern::short(5),
        }
    }

    /// Whether a buzzer beeps with the LED, at the length of its flashes. At rest, and while all engines run as they should, it is silent.
    pub const fn beeps(self) -> bool {
        match self {
            Self::AtRest | Self::Running => false,
            Self::Armed | Self::SourceLost | Self::StopLatched | Self::Fault => true,
        }
    }

    /// What it means, for people.
    pub const fn meaning(self) -> &'static str {
        match self {
            Self::AtRest => "all is well, every engine is at rest and disarmed",
            Self::Armed => "an engine is armed",
            Self::Running => "an engine turns, or is ordered to run",
            Self::SourceLost => "the source in control is lost: the engine goes through the stages of loss",
            Self::StopLatched => "an emergency stop is latched",
            Self::Fault => {
                "fault: the crystal does not run (the log says so at the start and every second), the stored settings are damaged (the log says so at the start), or an engine needs attention: its link is not up, it is in doubt whether it runs, a limit has lowered its demand, its ECU reports a fault or does not follow its orders, or nothing can be sent to it"
            }
        }
    }
}
