//! The boards: pins, clocks, interrupts, the watchdog. Nothing above this layer names a register or
//! a pin.
//!
//! One feature chooses one board. A board with an STM32 is data, in the package `boards`; `table.rs` turns that into code.
//! What all of them share is in `stm32.rs`, `early.rs` and `port.rs`, what a family of chips shares is in `stm32h7.rs` and
//! `stm32f4.rs`. `docs/porting.md` says how to add one.
//!
//! Every board gives `NAME`, `PORTS`, `TELEMETRY_PORT`, `init`,
//! `start_engine_executor` and the types [`EcuPort`], [`Executor`], [`Led`] and [`Watchdog`]; a board
//! with another chip than an STM32 brings all of them (`qemu_mps2.rs`).

#[cfg(feature = "ardupilot-bootloader")]
mod ardupilot;
mod crash;
#[cfg(feature = "stm32")]
mod early;
#[cfg(all(feature = "selftest", feature = "stm32"))]
mod facts;
pub mod guard;
#[cfg(feature = "stm32")]
mod port;
#[cfg(feature = "board-qemu-mps2")]
mod qemu_mps2;
pub mod retained;
#[cfg(all(feature = "selftest", feature = "stm32"))]
pub mod selftest;
pub mod stack;
mod start;
#[cfg(feature = "stm32")]
mod stm32;
#[cfg(feature = "stm32f4")]
mod stm32f4;
#[cfg(feature = "stm32h7")]
mod stm32h7;
#[cfg(feature = "stm32")]
mod table;

#[cfg(feature = "board-qemu-mps2")]
pub use qemu_mps2::*;
#[cfg(feature = "stm32f4")]
use stm32f4 as chip;
#[cfg(feature = "stm32h7")]
use stm32h7 as chip;
#[cfg(feature = "stm32")]
pub use {
    embassy_executor::Executor,
    port::EcuPort,
    stm32::{Led, Watchdog, start_engine_executor},
    table::{NAME, PORTS, TELEMETRY_PORT, init},
};

use embassy_executor::InterruptExecutor;
use jetlink::engine::retained::Reset;

/// Why the chip was reset last, as far as its flags tell.
#[derive(Clone, Copy, PartialEq, Eq, defmt::Format)]
#[cfg_attr(not(feature = "stm32"), expect(dead_code, reason = "QEMU tells none"))]
pub enum ResetCause {
    /// The power came on.
    PowerOn,
    /// The supply sagged.
    BrownOut,
    /// The independent watchdog was not fed. Behind an ArduPilot bootloader also a panic or a fault.
    Watchdog,
    /// The window watchdog, which this firmware does not use.
    WindowWatchdog,
    /// The firmware asked for it: a panic or a fault, if no debugger did.
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
    /// What of the retained state may be believed after it. Where the flags say nothing, as after a bootloader that clears
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

/// The board, ready for the firmware.
pub struct Board {
    /// Why it was reset.
    pub reset_cause: ResetCause,
    /// What its clocks are made from.
    pub oscillator: Oscillator,
    /// The ECU ports that were asked for, open.
    pub ports: [Option<EcuPort>; PORTS.len()],
    /// The status LED, dark.
    pub led: Led,
    /// The watchdog.
    pub watchdog: Watchdog,
}

/// Polls the engines' tasks from an interrupt, above thread mode and below the UARTs and the timer.
static ENGINE_EXECUTOR: InterruptExecutor = InterruptExecutor::new();
