//! The boards: pins, clocks, interrupts, the watchdog. Nothing above this layer names a register or
//! a pin.
//!
//! One feature chooses one board. A board is one file (`matek_h743.rs`, `pixracer.rs`) that says
//! which of its UARTs are ECU ports; what all boards share is here and in `port.rs`, what a family
//! of chips shares is in `stm32h7.rs` and `stm32f4.rs`. To add a board: that file, its lines below,
//! `memory/<board>.x` and the feature in `Cargo.toml`.

mod crash;
mod port;

#[cfg(feature = "board-matek-h743")]
mod matek_h743;
#[cfg(feature = "board-pixracer")]
mod pixracer;
#[cfg(feature = "board-pixracer")]
mod stm32f4;
#[cfg(feature = "board-matek-h743")]
mod stm32h7;

#[cfg(feature = "board-matek-h743")]
use {matek_h743 as chosen, stm32h7 as chip};
#[cfg(feature = "board-pixracer")]
use {pixracer as chosen, stm32f4 as chip};

pub use chip::reset_cause;
pub use chosen::{NAME, PORTS, TELEMETRY_PORT, init};
pub use port::EcuPort;

use embassy_executor::{InterruptExecutor, SendSpawner};
use embassy_stm32::{
    Peri,
    gpio::{Level, Output, Pin, Speed},
    interrupt::{InterruptExt, Priority},
    wdg::IndependentWatchdog,
};

/// The board, ready for the firmware.
pub struct Board {
    /// The ECU ports that were asked for, open.
    pub ports: [Option<EcuPort>; PORTS.len()],
    /// The status LED, dark.
    pub led: Led,
    /// The watchdog, not yet running.
    pub watchdog: Watchdog,
}

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

/// An LED that lights when its pin is low.
pub struct Led(Output<'static>);

impl Led {
    fn new(pin: Peri<'static, impl Pin>) -> Self {
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

    fn new(peripheral: Peri<'static, chip::Iwdg>) -> Self {
        Self(IndependentWatchdog::new(peripheral, Self::TIMEOUT_US))
    }

    /// Starts the watchdog.
    pub fn start(&mut self) {
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

/// Polls the engines' tasks from an interrupt, above thread mode and below the UARTs and the timer.
static ENGINE_EXECUTOR: InterruptExecutor = InterruptExecutor::new();

/// Starts the executor for the engines' tasks. To be called once.
pub fn start_engine_executor() -> SendSpawner {
    // UARTs and the timer have P0, embassy-stm32's default.
    chip::EXECUTOR_INTERRUPT.set_priority(Priority::P6);
    ENGINE_EXECUTOR.start(chip::EXECUTOR_INTERRUPT)
}
