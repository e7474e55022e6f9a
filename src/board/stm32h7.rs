//! What boards with an STM32H743 share: the names and registers that differ from one family of
//! chips to another.

use super::{ENGINE_EXECUTOR, stm32::ResetCause};
use embassy_stm32::{
    interrupt, // the module and the attribute
    interrupt::Interrupt,
    pac::{RCC, usart::Usart},
    peripherals,
};
use jetlink::line::LineError;

/// The independent watchdog.
pub type Iwdg = peripherals::IWDG1;

/// An interrupt of a peripheral that no board uses (HDMI-CEC): it carries the engines' executor.
pub const EXECUTOR_INTERRUPT: Interrupt = Interrupt::CEC;

#[interrupt]
unsafe fn CEC() {
    // SAFETY: this is the executor's interrupt handler, and the interrupt is off until the executor
    // has started.
    unsafe { ENGINE_EXECUTOR.on_interrupt() }
}

/// Which error flags of a UART are up. Leaves them as they are.
pub fn line_errors(uart: Usart) -> [(bool, LineError); 4] {
    let status = uart.isr().read();
    [
        (status.fe(), LineError::Framing),
        (status.ne(), LineError::Noise),
        (status.ore(), LineError::Overrun),
        (status.pe(), LineError::Parity),
    ]
}

/// Writes a word to the first backup register, which a reset leaves alone.
#[cfg(feature = "ardupilot-bootloader")]
pub fn write_backup_register(word: u32) {
    use embassy_stm32::pac::{PWR, RTC};
    RCC.apb4enr().modify(|w| w.set_rtcapben(true));
    PWR.cr1().modify(|w| w.set_dbp(true));
    while !PWR.cr1().read().dbp() {}
    RTC.bkpr(0).write(|w| w.set_bkp(word));
}

/// Why the chip was reset. Clears the flags, so only the first call after a reset knows.
pub fn reset_cause() -> ResetCause {
    let flags = RCC.rsr().read();
    RCC.rsr().modify(|w| w.set_rmvf(true));
    // Several flags are set at once (the pin's always, for the chip drives the pin): most telling
    // first.
    match () {
        () if flags.porrstf() => ResetCause::PowerOn,
        () if flags.borrstf() => ResetCause::BrownOut,
        () if flags.iwdg1rstf() => ResetCause::Watchdog,
        () if flags.wwdg1rstf() => ResetCause::WindowWatchdog,
        () if flags.sftrstf() => ResetCause::Software,
        () if flags.lpwrrstf() => ResetCause::LowPower,
        () if flags.pinrstf() => ResetCause::Pin,
        () => ResetCause::Unknown,
    }
}
