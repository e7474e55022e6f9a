//! Interrupts that end the firmware: a crystal that has stopped, a supply that is too low.

#[cfg(any(feature = "stm32f4", not(feature = "ardupilot-bootloader")))]
use super::crash::leave;
use super::early;

/// The crystal has stopped: the clock security system has switched the core to the internal oscillator and raised this.
#[cortex_m_rt::exception]
unsafe fn NonMaskableInt() -> ! {
    early::crystal_has_stopped();
    // No log line here: the interrupted code may be in the middle of one. The next start logs the clock source.
    #[cfg(feature = "ardupilot-bootloader")]
    early::restart();
    #[cfg(not(feature = "ardupilot-bootloader"))]
    leave(|| defmt::error!("the crystal has stopped, resetting"))
}

/// The low-supply detector, which `stm32f4.rs` enables.
#[cfg(feature = "stm32f4")]
mod supply {
    use super::leave;
    use embassy_stm32::interrupt;

    #[interrupt]
    unsafe fn PVD() {
        leave(|| defmt::error!("the supply is below 2.84 V, resetting"))
    }
}
