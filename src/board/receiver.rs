//! Ports of receivers of radio control: an ECU port on which nothing is sent, or the board's own socket (`boards/` has the boards with one).
//!
//! Behind a socket is a UART whose TX pin is something else. Embassy's buffered driver always takes TX, so the socket has a driver of its own:
//! Embassy sets the UART up to receive only, and an interrupt takes its bytes (socket.rs).

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

/// Opens the socket, once, and once the clocks run: 8 data bits. `inverted_rx` sets the inverter of the board. `None`: it was opened before.
///
/// # Panics
/// If the UART does not support this baud rate.
#[cfg(board_socket)]
pub fn open_socket(format: super::Format) -> Option<ReceiverPort<impl Read>> {
    use super::table::socket::{INVERTS_AT, REGISTERS, steal};
    use super::{chip, port, socket, stm32};
    use embassy_stm32::gpio::Level;
    use embassy_stm32::usart::UartRx;

    let (rx, errors) = socket::open()?;
    // SAFETY: once, and `init` has taken all of them: nothing else uses them.
    let (uart, pin, inverter) = unsafe { steal() };
    let not_inverted = match INVERTS_AT {
        Level::High => Level::Low,
        Level::Low => Level::High,
    };
    stm32::hold(inverter, if format.inverted_rx { INVERTS_AT } else { not_inverted });
    // Behind the inverter the idle level is always high.
    let config = port::config(super::Format { inverted_rx: false, ..format });
    let uart = defmt::unwrap!(UartRx::new_blocking(uart, pin, config));
    // Dropped, it would be switched off.
    core::mem::forget(uart);
    chip::interrupt_at_each_byte(REGISTERS);
    Some(ReceiverPort { rx, errors })
}
