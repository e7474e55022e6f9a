//! Code shared by all boards with an STM32: LED, watchdog, the engines' executor. They log over RTT.

use super::state::ENGINE_EXECUTOR;
use super::{chip, watchdog};
use defmt_rtt as _; // the logger
use embassy_executor::SendSpawner;
use embassy_stm32::{
    Peri,
    gpio::{Flex, Level, Output, Pin, Speed},
    interrupt::{InterruptExt, Priority},
    pac::iwdg::vals::Pr,
};

/// How a pin drives its LED.
#[expect(dead_code, reason = "each board has one of them")]
pub enum Drive {
    /// High and low.
    PushPull,
    /// Low, or not at all.
    OpenDrain,
}

/// The status LED.
pub struct Led {
    pin: Flex<'static>,
    lit: Level,
}

impl Led {
    /// On this pin, off. It lights at the level `lit`.
    pub fn new(pin: Peri<'static, impl Pin>, lit: Level, drive: Drive) -> Self {
        let mut led = Self { pin: Flex::new(pin), lit };
        led.set(false);
        match drive {
            Drive::PushPull => led.pin.set_as_output(Speed::Low),
            Drive::OpenDrain => led.pin.set_as_input_output(Speed::Low),
        }
        led
    }

    /// Turns the LED on or off.
    pub fn set(&mut self, lit: bool) {
        self.pin.set_level(Level::from(lit == (self.lit == Level::High)));
    }
}

/// Drives a pin permanently.
#[allow(dead_code, reason = "not every board has such pins")]
pub fn hold(pin: Peri<'static, impl Pin>, level: Level) {
    core::mem::forget(Output::new(pin, level, Speed::Low)); // dropping it would release the pin
}

/// The independent watchdog: its own oscillator (LSI: 32 kHz; 17 to 47 kHz on an F427, 29.4 to 33.6 kHz on an
/// H743), and only a reset stops it. It has been running since the first instructions of the firmware (first.rs).
pub struct Watchdog(Peri<'static, chip::Iwdg>);

impl Watchdog {
    /// Of the chip.
    pub fn new(peripheral: Peri<'static, chip::Iwdg>) -> Self {
        Self(peripheral)
    }

    /// From here on, 1.0 s without a feed, by the nominal oscillator, causes a reset.
    pub fn start(&mut self) {
        watchdog::watch(Pr::from_bits(1), 3999);
    }

    /// Gives the firmware another second.
    pub fn feed(&mut self) {
        let _only_one = &mut self.0;
        watchdog::feed();
    }
}

/// Starts the executor for the engines' tasks. Call it once.
pub fn start_engine_executor() -> SendSpawner {
    // UARTs and the timer have P0, embassy-stm32's default.
    chip::EXECUTOR_INTERRUPT.set_priority(Priority::P6);
    ENGINE_EXECUTOR.start(chip::EXECUTOR_INTERRUPT)
}
