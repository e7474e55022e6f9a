//! Ports of receivers of radio control: an ECU port on which nothing is sent, or the board's own socket (`boards/` has the boards with one).
//!
//! Behind a socket is a UART whose TX pin is something else. Embassy's buffered driver always takes TX, so the socket has a driver of its own:
//! Embassy sets the UART up to receive only, and the interrupt here takes its bytes.

use super::EcuPort;
use embedded_io_async::Read;
use jetlink::runner::LineErrors;

/// An open port that only receives.
pub struct ReceiverPort<R> {
    /// From the receiver. It wakes at each byte.
    pub rx: R,
    /// Line errors, counted in the UART's interrupt.
    pub errors: &'static LineErrors,
}

/// An ECU port with a receiver. TX stays at its idle level.
pub fn of_ecu_port(port: EcuPort) -> ReceiverPort<impl Read> {
    let EcuPort { rx, tx, errors, .. } = port;
    // Dropped, TX would float.
    let _open = core::mem::ManuallyDrop::new(tx);
    ReceiverPort { rx, errors }
}

#[cfg(board_socket)]
pub use self::socket::{on_interrupt, open_socket};

/// The board's socket for a receiver, if it has one. The number of its port is the one behind those of `PORTS`.
#[cfg(board_socket)]
pub const SOCKET: Option<&str> = Some(super::table::socket::NAME);
/// The board's socket for a receiver, if it has one.
#[cfg(not(board_socket))]
pub const SOCKET: Option<&str> = None;

/// Without a socket there is nothing to open.
#[cfg(not(board_socket))]
pub fn open_socket(_: super::Format) -> Option<ReceiverPort<&'static [u8]>> {
    None
}

#[cfg(board_socket)]
mod socket {
    use super::super::table::PORTS;
    use super::super::table::socket::{INVERTS_AT, REGISTERS, steal};
    use super::super::{Format, chip, port, stm32};
    use super::ReceiverPort;
    use core::sync::atomic::{AtomicBool, Ordering};
    use embassy_stm32::gpio::Level;
    use embassy_stm32::usart::UartRx;
    use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
    use embassy_sync::pipe::Pipe;
    use embedded_io_async::Read;
    use jetlink::line::LineError;
    use jetlink::runner::LineErrors;
    use jetlink_fw::config::RADIO;

    /// As many bytes as an ECU port has room for.
    type Bytes = Pipe<CriticalSectionRawMutex, 256>;

    static BYTES: Bytes = Bytes::new();
    static ERRORS: LineErrors = LineErrors::new();
    static IS_OPEN: AtomicBool = AtomicBool::new(false);

    /// Whether the image has a receiver there. All else of this file is left out of any other.
    const IN_USE: bool = match &RADIO {
        Some(radio) => match radio.uart() {
            Some(port) => port as usize == PORTS.len(),
            None => false,
        },
        None => false,
    };

    /// Opens the socket, once, and once the clocks run: 8 data bits. `inverted_rx` sets the inverter of the board. `None`: it was opened before.
    ///
    /// # Panics
    /// If the UART does not support this baud rate.
    pub fn open_socket(format: Format) -> Option<ReceiverPort<impl Read>> {
        if IS_OPEN.swap(true, Ordering::Relaxed) {
            return None;
        }
        // SAFETY: once, and `init` has taken all of them: nothing else uses them.
        let (uart, rx, inverter) = unsafe { steal() };
        let not_inverted = match INVERTS_AT {
            Level::High => Level::Low,
            Level::Low => Level::High,
        };
        stm32::hold(inverter, if format.inverted_rx { INVERTS_AT } else { not_inverted });
        // Behind the inverter the idle level is always high.
        let config = port::config(Format { inverted_rx: false, ..format });
        let uart = defmt::unwrap!(UartRx::new_blocking(uart, rx, config));
        // Dropped, it would be switched off.
        core::mem::forget(uart);
        chip::interrupt_at_each_byte(REGISTERS);
        Some(ReceiverPort { rx: &BYTES, errors: &ERRORS })
    }

    /// The UART's interrupt.
    pub fn on_interrupt() {
        if !IN_USE {
            return;
        }
        let (errors, byte) = chip::receive(REGISTERS);
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
}
