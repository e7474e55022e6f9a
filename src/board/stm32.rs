//! What boards with an STM32 share: LED, watchdog, the engines' executor. They log over RTT.

use super::{ENGINE_EXECUTOR, chip, early};
use defmt_rtt as _; // the logger
use embassy_executor::SendSpawner;
use embassy_stm32::{
    Peri,
    gpio::{Level, Output, Pin, Speed},
    interrupt::{InterruptExt, Priority},
    pac::iwdg::vals::Pr,
};

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
/// but a reset stops it. It runs since the first instructions of the firmware (early.rs).
pub struct Watchdog(Peri<'static, chip::Iwdg>);

impl Watchdog {
    /// Of the chip.
    pub fn new(peripheral: Peri<'static, chip::Iwdg>) -> Self {
        Self(peripheral)
    }

    /// From here on, 1.0 s by the nominal oscillator without a feed mean a reset.
    pub fn start(&mut self) {
        early::watch(Pr::from_bits(1), 3999);
    }

    /// Gives the firmware another second.
    pub fn feed(&mut self) {
        let _only_one = &mut self.0;
        early::feed();
    }
}

/// Starts the executor for the engines' tasks. To be called once.
pub fn start_engine_executor() -> SendSpawner {
    // UARTs and the timer have P0, embassy-stm32's default.
    chip::EXECUTOR_INTERRUPT.set_priority(Priority::P6);
    ENGINE_EXECUTOR.start(chip::EXECUTOR_INTERRUPT)
}
