//! What every board has to say of itself at the start, and the executor of the engines' tasks.

use embassy_executor::InterruptExecutor;
use jetlink::engine::retained::Reset;

/// Why the chip was reset last, as far as its flags say.
#[derive(Clone, Copy, PartialEq, Eq, defmt::Format)]
#[cfg_attr(not(feature = "stm32"), expect(dead_code, reason = "QEMU has none"))]
pub enum ResetCause {
    /// The power came on.
    PowerOn,
    /// The supply sagged.
    BrownOut,
    /// The independent watchdog was not fed. Behind an ArduPilot bootloader also a panic or a fault.
    Watchdog,
    /// The window watchdog, which this firmware does not use.
    WindowWatchdog,
    /// The firmware requested it: a panic or a fault, if no debugger did.
    Software,
    /// A low-power mode was entered against the option bytes.
    LowPower,
    /// The reset pin: a button or a debug probe.
    Pin,
    /// None: the firmware went back to its first instruction, because it had lost its crystal.
    #[cfg(feature = "ardupilot-bootloader")]
    Restart,
    /// No flag is set.
    Unknown,
}

impl ResetCause {
    /// What of the retained state may be used after it. Where the flags say nothing, as after a bootloader that clears
    /// them, the power may have gone away.
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

/// What the clocks are made from.
#[derive(Clone, Copy, PartialEq, Eq, defmt::Format)]
pub enum Oscillator {
    /// The board's crystal, or the clock that comes in its place.
    Crystal,
    /// The chip's own oscillator: the crystal does not run.
    Internal,
}

/// Polls the engines' tasks from an interrupt, above thread mode and below the UARTs and the timer.
pub static ENGINE_EXECUTOR: InterruptExecutor = InterruptExecutor::new();

/// A board that is ready for the firmware, with its own types of ports, LED and watchdog.
pub struct Ready<Port, Led, Watchdog, const PORTS: usize> {
    /// Why it was reset.
    pub reset_cause: ResetCause,
    /// What its clocks are made from.
    pub oscillator: Oscillator,
    /// The requested ECU ports, open.
    pub ports: [Option<Port>; PORTS],
    /// The status LED, dark.
    pub led: Led,
    /// The watchdog.
    pub watchdog: Watchdog,
}
