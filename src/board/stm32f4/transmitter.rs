//! The sending half of an STM32F4's port, whose end of transmission the driver must not see.
//!
//! With the last byte of a transmission the driver enables an interrupt (TCIE) for its end (TC), and then clears TC by a
//! read-modify-write of the status register. The flags of that register are cleared by writing 0 (RM0090, 30.6.1), that of a received byte
//! among them: a byte that ended between the read and the write was lost, without an error (docs/boards-upstream.md).
//!
//! So TCIE is off while the driver's handler runs, and the handlers around it wait for TC. Nothing writes the status register:
//! a read of it and the next write of the data register, both by the driver, clear TC (RM0090, 30.6.1).

use core::future::poll_fn;
use core::sync::atomic::{AtomicBool, Ordering};
use core::task::Poll;
use embassy_stm32::pac::usart::Usart;
use embassy_stm32::usart::{BufferedUartTx, Error};
use embassy_sync::waitqueue::AtomicWaker;
use embedded_io_async::{ErrorType, Write};

/// Whether the last bit of the last transmission of a UART was sent.
pub struct TransmissionEnd {
    /// TCIE was set when the interrupt began.
    awaited: AtomicBool,
    /// All is sent.
    reached: AtomicBool,
    /// Who waits for it.
    waker: AtomicWaker,
}

impl TransmissionEnd {
    /// Of a UART that has sent nothing.
    pub const fn new() -> Self {
        Self { awaited: AtomicBool::new(false), reached: AtomicBool::new(true), waker: AtomicWaker::new() }
    }

    /// In the UART's interrupt, before the driver's handler: hides TCIE.
    pub fn before_driver(&self, uart: Usart) {
        let mut control = uart.cr1().read();
        if control.tcie() {
            control.set_tcie(false);
            uart.cr1().write_value(control);
            self.awaited.store(true, Ordering::Relaxed);
        }
    }

    /// In the UART's interrupt, after the driver's handler, which may have written the last byte or a new transmission's first one: either clears TC.
    pub fn after_driver(&self, uart: Usart) {
        let mut control = uart.cr1().read();
        if !control.tcie() && !self.awaited.load(Ordering::Relaxed) {
            return;
        }
        self.awaited.store(false, Ordering::Relaxed);
        let reached = uart.sr().read().tc();
        control.set_tcie(!reached);
        uart.cr1().write_value(control);
        if reached {
            self.reached.store(true, Ordering::Release);
            self.waker.wake();
        }
    }

    /// The sending half of a UART that was opened just now.
    pub fn transmitter(&'static self, driver: BufferedUartTx<'static>) -> Transmitter {
        self.reached.store(true, Ordering::Relaxed);
        Transmitter { driver, end: self }
    }
}

/// The sending half of a port. A write before the flush of the one before it is done can end that flush early.
pub struct Transmitter {
    /// Fills the data register.
    driver: BufferedUartTx<'static>,
    /// Of what it sends.
    end: &'static TransmissionEnd,
}

impl ErrorType for Transmitter {
    type Error = Error;
}

impl Write for Transmitter {
    async fn write(&mut self, bytes: &[u8]) -> Result<usize, Error> {
        self.end.reached.store(false, Ordering::Release);
        self.driver.write(bytes).await
    }

    /// Until the last stop bit is out.
    async fn flush(&mut self) -> Result<(), Error> {
        poll_fn(|context| {
            self.end.waker.register(context.waker());
            match self.end.reached.load(Ordering::Acquire) {
                true => Poll::Ready(()),
                false => Poll::Pending,
            }
        })
        .await;
        Ok(())
    }
}
