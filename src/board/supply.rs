//! The supply voltage by the divider of the board (`boards/`), for ECUs that report none.

#[cfg(board_divider)]
pub use self::adc::Supply;

/// Whether the board has a divider that this firmware can read.
pub const IS_THERE: bool = cfg!(board_divider);

/// Without a divider there is nothing to read.
#[cfg(not(board_divider))]
pub struct Supply;

#[cfg(not(board_divider))]
impl Supply {
    /// Nothing to begin.
    pub const fn begin() -> Self {
        Self
    }

    /// Nothing to read.
    pub const fn millivolts(&mut self) -> u32 {
        0
    }
}

#[cfg(board_divider)]
mod adc {
    use super::super::table::divider::{Pin, TENTHS};
    use embassy_stm32::Peri;
    use embassy_stm32::adc::{Adc, AdcConfig, Averaging, Resolution, SampleTime, VREF_DEFAULT_MV};
    use embassy_stm32::peripherals::ADC1;

    /// Highest number of the converter: 16 bits, and the mean of 16 samples.
    const FULL: u64 = 0xFFFF;

    /// The converter and its pin.
    pub struct Supply {
        adc: Adc<'static, ADC1>,
        pin: Peri<'static, Pin>,
    }

    impl Supply {
        /// Starts the converter. It takes 11 ms, most of them the calibration of its linearity: 165 010 clocks at 16 MHz. Thread mode waits for
        /// it. Call it once.
        pub fn begin() -> Self {
            // SAFETY: the table of the board reserves the pin, `init` takes it and leaves it as it is after a reset; nothing else uses the
            // converter.
            let (adc, pin) = unsafe { (ADC1::steal(), Pin::steal()) };
            let (resolution, averaging) = (Some(Resolution::BITS16), Some(Averaging::Samples16));
            let config = AdcConfig { resolution, averaging };
            Self { adc: Adc::new_with_config(adc, config), pin }
        }

        /// The supply voltage now, in mV. It takes 16 conversions of 73 clocks, some 70 µs at 16 MHz.
        pub fn millivolts(&mut self) -> u32 {
            let raw = self.adc.blocking_read(&mut self.pin, SampleTime::CYCLES64_5);
            let millivolts = u64::from(raw) * u64::from(VREF_DEFAULT_MV) * u64::from(TENTHS) / (FULL * 10);
            u32::try_from(millivolts).unwrap_or(u32::MAX)
        }
    }
}
