//! ECU ports: a buffered UART that hands over every byte as it arrives, and counts line errors.
//!
//! `BufferedUart` only logs framing, noise and overrun errors. So a second handler,
//! [`LineMonitor`], runs on the same interrupt *before* the driver's own (`bind_interrupts!` calls
//! handlers in the order written) and counts the error flags that are set. It reads the status
//! register and writes none:
//!
//! - On the H7 the flags stay set until the driver clears them through ICR.
//! - On the F4 a read of the status register followed by a read of the data register clears the
//!   flags; the driver does both next. A read of the status alone clears nothing.
//!
//! The hardware raises these flags together with an interrupt that is enabled anyway (RXNEIE: a byte
//! was received or lost), and the driver clears every flag that the monitor saw before the interrupt
//! returns: each error counts once, and consecutive lost bytes count once. The H7's driver enables
//! the UART's FIFO; the flags are then those of the byte at its head. An error that is raised between
//! the two reads, a few dozen ns, is not counted; its byte is still received.

use super::chip;
use core::marker::PhantomData;
use embassy_stm32::{
    Peri,
    interrupt::typelevel::{Binding, Handler},
    pac::usart::Usart,
    usart::{
        BufferedInterruptHandler, BufferedUart, BufferedUartRx, BufferedUartTx, Config, Instance, RxPin,
        TxPin,
    },
};
use jetlink::line::{Line, StopBits};
use jetlink::link::MAX_TRANSMISSION;
use jetlink::runner::{LineErrors, Runner};

/// An open ECU port.
pub struct EcuPort {
    /// From the ECU.
    pub rx: BufferedUartRx<'static>,
    /// To the ECU.
    pub tx: BufferedUartTx<'static>,
    /// Line errors, counted in the UART's interrupt.
    pub errors: &'static LineErrors,
    /// Its line.
    line: Line,
    /// Reopens it, see [`open`].
    open: unsafe fn(Line) -> EcuPort,
}

impl EcuPort {
    /// Runs an engine on this port. If the transmitter is stuck, the port is closed and reopened, which discards waiting bytes.
    pub async fn serve(mut self, runner: Runner<'static>) -> ! {
        loop {
            let Self { rx, tx, errors, line, open } = self;
            runner.run_until_stuck(rx, tx, errors).await;
            defmt::error!("nothing comes out of a transmitter: its port is opened anew");
            // SAFETY: both halves were moved into the run, which is over and has dropped them: the driver is closed.
            self = unsafe { open(line) };
        }
    }
}

/// The buffers of both directions of a UART.
pub struct Buffers {
    /// Room for more than 1 s of an ECU at 2400 baud, 20 ms at 115 200 baud.
    rx: [u8; 256],
    /// A write without enough room would wait forever (embassy-stm32 0.6.0).
    tx: [u8; 6 * MAX_TRANSMISSION],
}

impl Buffers {
    /// Empty.
    pub const fn new() -> Self {
        Self { rx: [0; 256], tx: [0; _] }
    }
}

/// A UART that can be an ECU port; [`ecu_uarts!`] implements it.
pub trait EcuUart: Instance {
    /// Its registers.
    const REGISTERS: Usart;

    /// Its counters of line errors.
    fn errors() -> &'static LineErrors;

    /// Its buffers.
    ///
    /// # Safety
    ///
    /// Nothing may hold a reference to them: the UART must not be open.
    unsafe fn buffers() -> &'static mut Buffers;
}

/// Interrupt handler that counts line errors. It must come before the driver's own.
pub struct LineMonitor<T>(PhantomData<T>);

impl<T: EcuUart> Handler<T::Interrupt> for LineMonitor<T> {
    unsafe fn on_interrupt() {
        for (raised, error) in chip::line_errors(T::REGISTERS) {
            if raised {
                T::errors().count(error);
            }
        }
    }
}

/// Turns UARTs into ECU ports: binds their interrupts to the monitor and then the driver (as `Irqs`),
/// and gives each its buffers and counters.
macro_rules! ecu_uarts {
    ($($uart:ident),* $(,)?) => {
        embassy_stm32::bind_interrupts!(struct Irqs {
            $($uart =>
                $crate::board::port::LineMonitor<embassy_stm32::peripherals::$uart>,
                embassy_stm32::usart::BufferedInterruptHandler<embassy_stm32::peripherals::$uart>;)*
        });

        $(impl $crate::board::port::EcuUart for embassy_stm32::peripherals::$uart {
            const REGISTERS: embassy_stm32::pac::usart::Usart = embassy_stm32::pac::$uart;

            fn errors() -> &'static jetlink::runner::LineErrors {
                static ERRORS: jetlink::runner::LineErrors = jetlink::runner::LineErrors::new();
                &ERRORS
            }

            unsafe fn buffers() -> &'static mut $crate::board::port::Buffers {
                static mut BUFFERS: $crate::board::port::Buffers = $crate::board::port::Buffers::new();
                // SAFETY: nothing else names it, and the caller guarantees that nothing holds it.
                unsafe { &mut *(&raw mut BUFFERS) }
            }
        })*
    };
}
pub(super) use ecu_uarts;

/// Opens a port: 8 data bits, no parity. `again` reopens it once it is closed.
///
/// # Safety
///
/// The UART must not be open.
///
/// # Panics
///
/// If the UART does not support this baud rate.
pub unsafe fn open<T: EcuUart>(
    line: Line,
    again: unsafe fn(Line) -> EcuPort,
    uart: Peri<'static, T>,
    rx: Peri<'static, impl RxPin<T>>,
    tx: Peri<'static, impl TxPin<T>>,
    irqs: impl Binding<T::Interrupt, LineMonitor<T>>
    + Binding<T::Interrupt, BufferedInterruptHandler<T>>
    + 'static,
) -> EcuPort {
    let mut config = Config::default();
    config.baudrate = line.baud;
    config.stop_bits = match line.stop_bits {
        StopBits::One => embassy_stm32::usart::StopBits::STOP1,
        StopBits::Two => embassy_stm32::usart::StopBits::STOP2,
    };
    // Wake the reader at each byte. Without this it wakes on the idle line, a whole byte time
    // later.
    config.eager_reads = Some(1);
    // An open input must be high, like an idle line.
    config.rx_pull = embassy_stm32::gpio::Pull::Up;

    // SAFETY: the caller guarantees that the UART is not open, and nothing else holds its buffers.
    let buffers = unsafe { T::buffers() };
    let uart =
        defmt::unwrap!(BufferedUart::new(uart, rx, tx, &mut buffers.tx, &mut buffers.rx, irqs, config));
    let (tx, rx) = uart.split();
    EcuPort { rx, tx, errors: T::errors(), line, open: again }
}
