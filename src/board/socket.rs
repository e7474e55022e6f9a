//! What the UART behind a board's socket for a receiver has received: its interrupt puts it here, its port takes it (receiver.rs).

use super::chip;
use super::port::SOCKET_IN_USE;
use core::sync::atomic::{AtomicBool, Ordering};
use embassy_stm32::pac::usart::Usart;
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::pipe::Pipe;
use jetlink::line::LineError;
use jetlink::runner::LineErrors;

/// As many bytes as an ECU port has room for.
pub type Bytes = Pipe<CriticalSectionRawMutex, 256>;

static BYTES: Bytes = Bytes::new();
static ERRORS: LineErrors = LineErrors::new();
static IS_OPEN: AtomicBool = AtomicBool::new(false);

/// What it receives from now on. `None`: it is open already.
pub fn open() -> Option<(&'static Bytes, &'static LineErrors)> {
    (!IS_OPEN.swap(true, Ordering::Relaxed)).then_some((&BYTES, &ERRORS))
}

/// The UART's interrupt. An image without a receiver there has nothing of it.
pub fn on_interrupt(uart: Usart) {
    if !SOCKET_IN_USE {
        return;
    }
    let (errors, byte) = chip::receive(uart);
    for (raised, error) in errors {
        if raised {
            ERRORS.count(error);
        }
    }
    // Nobody has read as many as there is room for.
    if byte.is_some_and(|byte| BYTES.try_write(&[byte]).is_err()) {
        ERRORS.count(LineError::Overrun);
    }
}
