//! What boards with an STM32F427 share: the names and registers that differ from one family of chips to another.

use embassy_stm32::{
    interrupt, // the module and the attribute
    interrupt::Interrupt,
    pac::{RCC, usart::Usart},
    peripherals,
};

use super::{ENGINE_EXECUTOR, ResetCause, port::LineFlags};

/// The independent watchdog.
pub type Iwdg = peripherals::IWDG;

/// An interrupt of a peripheral that no board uses (CAN2): it carries the engines' executor.
pub const EXECUTOR_INTERRUPT: Interrupt = Interrupt::CAN2_SCE;

#[interrupt]
unsafe fn CAN2_SCE() {
    // SAFETY: this is the executor's interrupt handler, and the interrupt is off until the executor has started.
    unsafe { ENGINE_EXECUTOR.on_interrupt() }
}

/// Reads the error flags of a UART and leaves them as they are: only a read of the data register after this one
/// would clear them.
pub fn line_flags(uart: Usart) -> LineFlags {
    let status = uart.sr().read();
    LineFlags {
        overrun: status.ore(),
        noise: status.ne(),
        framing: status.fe(),
        parity: status.pe(),
    }
}

/// Why the chip was reset. Clears the flags, so only the first call after a reset knows.
pub fn reset_cause() -> ResetCause {
    let flags = RCC.csr().read();
    RCC.csr().modify(|w| w.set_rmvf(true));
    // Several flags are set at once (the pin's always, for the chip drives the pin): most telling first.
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
