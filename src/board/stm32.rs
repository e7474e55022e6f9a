//! What boards with an STM32 share: causes of a reset, LED, watchdog, the engines' executor. They log over RTT.

use super::{ENGINE_EXECUTOR, chip};
use defmt_rtt as _; // the logger
use embassy_executor::SendSpawner;
use embassy_stm32::{
    Peri,
    gpio::{Level, Output, Pin, Speed},
    interrupt::{InterruptExt, Priority},
    wdg::IndependentWatchdog,
};
use jetlink::engine::keep::Reset;

/// Why the chip was reset last, as far as its flags tell.
#[derive(Clone, Copy, defmt::Format)]
pub enum ResetCause {
    /// The power came on.
    PowerOn,
    /// The supply sagged.
    BrownOut,
    /// The independent watchdog was not fed.
    Watchdog,
    /// The window watchdog, which this firmware does not use.
    WindowWatchdog,
    /// The firmware asked for it: a panic or a fault, if no debugger did.
    Software,
    /// A low-power mode was entered against the option bytes.
    LowPower,
    /// The reset pin: a button or a debug probe.
    Pin,
    /// No flag is set.
    Unknown,
}

/// What of the retained state may be believed after such a reset. Where the flags say nothing, as after a bootloader that
/// clears them, the power may have gone away.
pub fn retained(cause: ResetCause) -> Reset {
    match cause {
        ResetCause::Watchdog
        | ResetCause::WindowWatchdog
        | ResetCause::Software
        | ResetCause::LowPower
        | ResetCause::Pin => Reset::Warm,
        ResetCause::PowerOn | ResetCause::BrownOut | ResetCause::Unknown => Reset::PowerLost,
    }
}

/// An LED that lights when its pin is low.
pub struct Led(Output<'static>);

impl Led {
    /// On this pin, dark.
    pub fn new(pin: Peri<'static, impl Pin>) -> Self {
        Self(Output::new(pin, Level::High, Speed::Low))
    }

    /// Lights the LED, or puts it out.
    pub fn set(&mut self, lit: bool) {
        self.0.set_level(Level::from(!lit));
    }
}

/// The independent watchdog: its own oscillator (32 kHz, 17 to 47 kHz on a bad day), and nothing
/// but a reset stops it.
pub struct Watchdog(IndependentWatchdog<'static, chip::Iwdg>);

impl Watchdog {
    /// Without a feed for this long, in µs by the nominal oscillator, the chip is reset.
    const TIMEOUT_US: u32 = 1_000_000;

    /// Not yet running.
    pub fn new(peripheral: Peri<'static, chip::Iwdg>) -> Self {
        Self(IndependentWatchdog::new(peripheral, Self::TIMEOUT_US))
    }

    /// Starts the watchdog.
    pub fn start(&mut self) {
        #[cfg(feature = "ardupilot-bootloader")]
        super::ardupilot::firmware_is_well();
        self.0.unleash();
        // The counter starts from its reset value, 512 ms or less, whatever the timeout: load our
        // own.
        self.0.pet();
    }

    /// Gives the firmware another `TIMEOUT_US`.
    pub fn feed(&mut self) {
        self.0.pet();
    }
}

/// Starts the executor for the engines' tasks. To be called once.
pub fn start_engine_executor() -> SendSpawner {
    // UARTs and the timer have P0, embassy-stm32's default.
    chip::EXECUTOR_INTERRUPT.set_priority(Priority::P6);
    ENGINE_EXECUTOR.start(chip::EXECUTOR_INTERRUPT)
}
