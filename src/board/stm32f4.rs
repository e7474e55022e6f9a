//! What boards with an STM32F427 share: the names and registers that differ from one family of
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
pub type Iwdg = peripherals::IWDG;

/// An interrupt of a peripheral that no board uses (CAN2): it carries the engines' executor.
pub const EXECUTOR_INTERRUPT: Interrupt = Interrupt::CAN2_SCE;

#[interrupt]
unsafe fn CAN2_SCE() {
    // SAFETY: this is the executor's interrupt handler, and the interrupt is off until the executor
    // has started.
    unsafe { ENGINE_EXECUTOR.on_interrupt() }
}

/// Which error flags of a UART are up. Leaves them as they are: only a read of the data register after
/// this one clears them.
pub fn line_errors(uart: Usart) -> [(bool, LineError); 4] {
    let status = uart.sr().read();
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
    RCC.apb1enr().modify(|w| w.set_pwren(true));
    PWR.cr1().modify(|w| w.set_dbp(true));
    while !PWR.cr1().read().dbp() {}
    RTC.bkpr(0).write(|w| w.set_bkp(word));
}

/// Why the chip was reset. Clears the flags, so only the first call after a reset knows.
pub fn reset_cause() -> ResetCause {
    let flags = RCC.csr().read();
    RCC.csr().modify(|w| w.set_rmvf(true));
    // Several flags are set at once (the pin's always, for the chip drives the pin): most telling
    // first.
    match () {
        () if flags.porrstf() => ResetCause::PowerOn,
        () if flags.borrstf() => ResetCause::BrownOut,
        () if flags.wdgrstf() => ResetCause::Watchdog,
        () if flags.wwdgrstf() => ResetCause::WindowWatchdog,
        () if flags.sftrstf() => ResetCause::Software,
        () if flags.lpwrrstf() => ResetCause::LowPower,
        () if flags.padrstf() => ResetCause::Pin,
        () => ResetCause::Unknown,
    }
}
