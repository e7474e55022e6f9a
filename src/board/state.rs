//! State that every board reports at the start, and the executor of the engines' tasks.

use embassy_executor::InterruptExecutor;
use jetlink::engine::retained::Reset;

/// Cause of the last reset, according to the chip's flags.
#[derive(Clone, Copy, PartialEq, Eq)]
#[cfg_attr(not(feature = "stm32"), expect(dead_code, reason = "QEMU has none"))]
pub enum ResetCause {
    /// Power-on.
    PowerOn,
    /// The supply sagged.
    BrownOut,
    /// The independent watchdog was not fed. Behind an ArduPilot bootloader also after a panic or a fault.
    Watchdog,
    /// The window watchdog, which this firmware does not use.
    WindowWatchdog,
    /// Software reset: a panic or a fault, unless a debugger requested it.
    Software,
    /// A low-power mode was entered against the option bytes.
    LowPower,
    /// The reset pin: a button or a debug probe.
    Pin,
    /// No reset: the firmware jumped to its first instruction, because the crystal had stopped.
    #[cfg(feature = "ardupilot-bootloader")]
    Restart,
    /// No flag is set.
    Unknown,
}

impl ResetCause {
    /// Its text in the log.
    pub fn text(self) -> defmt::Str {
        match self {
            Self::PowerOn => defmt::intern!("power-on"),
            Self::BrownOut => defmt::intern!("brown-out"),
            Self::Watchdog => defmt::intern!("watchdog"),
            Self::WindowWatchdog => defmt::intern!("window watchdog"),
            Self::Software => defmt::intern!("software"),
            Self::LowPower => defmt::intern!("low power"),
            Self::Pin => defmt::intern!("reset pin"),
            #[cfg(feature = "ardupilot-bootloader")]
            Self::Restart => defmt::intern!("restart"),
            Self::Unknown => defmt::intern!("not known"),
        }
    }

    /// Retained state that may be used after it. Without a flag, for example because a bootloader cleared them, power may have
    /// been lost.
    pub fn retained(self) -> Reset {
        match self {
            Self::Watchdog | Self::WindowWatchdog | Self::Software | Self::LowPower | Self::Pin => {
                Reset::Warm
            }
            #[cfg(feature = "ardupilot-bootloader")]
            Self::Restart => Reset::Warm,
            Self::PowerOn | Self::BrownOut | Self::Unknown => Reset::PowerLost,
        }
    }
}

/// Source of the clocks.
#[derive(Clone, Copy, PartialEq, Eq, defmt::Format)]
pub enum Oscillator {
    /// The board's crystal, or an external clock in its place.
    Crystal,
    /// The internal oscillator: the crystal does not run.
    Internal,
}

/// Polls the engines' tasks from an interrupt, above thread mode and below the UARTs and the timer.
pub static ENGINE_EXECUTOR: InterruptExecutor = InterruptExecutor::new();

/// A board that is ready for the firmware, with its own types of LED and watchdog. Its ports are not open yet.
pub struct Ready<Led, Watchdog> {
    /// Cause of the last reset.
    pub reset_cause: ResetCause,
    /// Source of its clocks.
    pub oscillator: Oscillator,
    /// The status LED, off.
    pub led: Led,
    /// The watchdog.
    pub watchdog: Watchdog,
}
