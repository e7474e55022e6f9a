//! Storage in the F-RAM of a board, by SPI. It is blocking, in thread mode: 32 bytes are under way for 50 µs, and no interrupt waits.

use super::chip;
use embassy_stm32::gpio::{Level, Output, Pin, Pull, Speed};
use embassy_stm32::mode::Blocking;
use embassy_stm32::spi::{self, Instance, MisoPin, MosiPin, SckPin, Spi};
use embassy_stm32::{Peri, time::mhz};
use embedded_hal::spi::{ErrorType, Operation, SpiDevice};
use jetlink_mavlink::fram::{Fram, NotUsed, identify};
use jetlink_mavlink::store::Found;

/// Time for the supply of the chip, which a reset turns off, to rise, and for the chip to start (FM25V01A: 250 µs), in ms.
const STARTS_WITHIN: u32 = 10;

/// The storage of the settings.
pub type Storage = Fram<Device>;

/// The storage in an F-RAM.
///
/// # Errors
/// Damaged if its chip cannot be used: settings may be in it. Empty if it is not known, or does not answer: there may be none.
pub fn storage_in(mut device: Device) -> Result<Storage, Found> {
    let mut tries = 0;
    while identify(&mut device).is_err() && tries < STARTS_WITHIN {
        tries += 1;
        cortex_m::asm::delay(chip::core_hz() / 1000);
    }
    let why = match Fram::find(device) {
        Ok((fram, chip)) => {
            defmt::info!("settings: in an F-RAM of {=u16} KiB", chip.kib);
            return Ok(fram);
        }
        Err(why) => why,
    };
    match why {
        NotUsed::Unknown(id) => defmt::warn!("settings: unknown F-RAM, ID {=[u8]:02x}", id),
        NotUsed::Protected => defmt::warn!("settings: F-RAM write-protected by its pin"),
        NotUsed::Bus => defmt::warn!("settings: F-RAM bus error"),
    }
    Err(if why.may_have_settings() { Found::Damaged } else { Found::Empty })
}

/// The bus with the chip, which nothing else uses, and the pin that selects it.
pub struct Device {
    spi: Spi<'static, Blocking, spi::mode::Master>,
    select: Output<'static>,
}

impl Device {
    /// On these pins: SCK, MOSI, MISO and the one that selects.
    pub fn new<T: Instance>(
        spi: Peri<'static, T>,
        (sck, mosi, miso): (
            Peri<'static, impl SckPin<T>>,
            Peri<'static, impl MosiPin<T>>,
            Peri<'static, impl MisoPin<T>>,
        ),
        select: Peri<'static, impl Pin>,
    ) -> Self {
        let select = Output::new(select, Level::High, Speed::Low);
        let mut config = spi::Config::default();
        // As ArduPilot has it, but for the clock: 10.5 MHz on an F427, 12.5 MHz on an H743. The slowest chip takes 30 MHz.
        config.mode = spi::MODE_3;
        config.frequency = mhz(10);
        config.gpio_speed = Speed::Medium;
        // Without a chip it reads as ones.
        config.miso_pull = Pull::Up;
        Self { spi: Spi::new_blocking(spi, sck, mosi, miso, config), select }
    }
}

impl core::fmt::Debug for Device {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str("Device")
    }
}

impl ErrorType for Device {
    type Error = spi::Error;
}

impl SpiDevice for Device {
    fn transaction(&mut self, operations: &mut [Operation<'_, u8>]) -> Result<(), spi::Error> {
        // Not selected for 0.1 µs between two commands.
        cortex_m::asm::delay(chip::core_hz() / 10_000_000);
        self.select.set_low();
        let done = operations.iter_mut().try_for_each(|operation| match operation {
            Operation::Read(bytes) => self.spi.blocking_read(bytes),
            Operation::Write(bytes) => self.spi.blocking_write(bytes),
            Operation::Transfer(into, from) => self.spi.blocking_transfer(into, from),
            Operation::TransferInPlace(bytes) => self.spi.blocking_transfer_in_place(bytes),
            Operation::DelayNs(ns) => {
                cortex_m::asm::delay(chip::core_hz() / 1_000_000 * (*ns / 1000 + 1));
                Ok(())
            }
        });
        self.select.set_high();
        done
    }
}
