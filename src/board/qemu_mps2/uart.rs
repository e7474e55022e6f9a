//! Ports on the design kit's UARTs: each has a one-byte buffer and an interrupt for either
//! direction, and always one stop bit.
//!
//! QEMU moves bytes as fast as its socket takes them. To behave like a real line, [`EcuTx::flush`]
//! waits until the last stop bit would have been sent at the port's baud rate. This is also right on
//! the board, whose UART has no flag for an empty shift register.

use super::hardware::{CLOCK_HZ, Handler, Irq, Register, UARTS, pend, unmask};
use crate::board::format::Format;
use core::cell::Cell;
use core::convert::Infallible;
use embassy_sync::blocking_mutex::{Mutex, raw::CriticalSectionRawMutex};
use embassy_sync::pipe::Pipe;
use embassy_sync::signal::Signal;
use embassy_time::{Duration, Instant, Timer};
use embedded_io_async::{ErrorType, Read, Write};
use jetlink::line::{Line, LineError, StopBits};
use jetlink::link::MAX_TRANSMISSION;
use jetlink::runner::{LineErrors, Runner};

/// Room for more than 1 s of an ECU at 2400 baud, 20 ms at 115 200 baud.
const RX_BUFFER: usize = 256;
const TX_BUFFER: usize = 6 * MAX_TRANSMISSION;

/// Registers, from a UART's first.
const DATA: usize = 0x00;
const STATE: usize = 0x04;
const CTRL: usize = 0x08;
const INTSTATUS: usize = 0x0C;
const BAUDDIV: usize = 0x10;

/// Of STATE.
const TX_FULL: u32 = 1 << 0;
const RX_FULL: u32 = 1 << 1;
const RX_OVERRUN: u32 = 1 << 3;
/// Of CTRL: transmitter and receiver with their interrupts.
const ENABLE: u32 = 0b1111;
/// Of INTSTATUS, to be written.
const TX_DONE: u32 = 1 << 0;
const RX_DONE: u32 = 1 << 1;

/// An open port.
pub struct EcuPort {
    /// From the ECU or the autopilot.
    pub rx: EcuRx,
    /// To it.
    pub tx: EcuTx,
    /// Line errors, counted in the UART's interrupt.
    pub errors: &'static LineErrors,
}

impl EcuPort {
    /// Runs an engine on this port.
    pub async fn serve(self, runner: Runner<'static>) -> ! {
        runner.run(self.rx, self.tx, self.errors).await
    }
}

/// Reads bytes as they arrive.
pub struct EcuRx(&'static Port);

/// Writes bytes.
pub struct EcuTx(&'static Port);

/// A UART, and the state that its interrupts and its two halves share.
pub struct Port {
    base: Register,
    rx_interrupt: Irq,
    tx_interrupt: Irq,
    received: Pipe<CriticalSectionRawMutex, RX_BUFFER>,
    to_send: Pipe<CriticalSectionRawMutex, TX_BUFFER>,
    /// The UART has taken the last byte.
    drained: Signal<CriticalSectionRawMutex, ()>,
    /// Duration of a byte on the line, and the time at which the last one has been sent.
    line: Mutex<CriticalSectionRawMutex, Cell<(Duration, Instant)>>,
    errors: LineErrors,
}

#[cfg(not(feature = "count"))]
const BASES: [Register; UARTS] = [
    Register::at(0x4000_4000),
    Register::at(0x4000_5000),
    Register::at(0x4000_6000),
    Register::at(0x4000_7000),
    Register::at(0x4000_9000),
];
#[cfg(feature = "count")]
use super::memory_uart::BASES;

static PORT: [Port; UARTS] = [
    Port::new(BASES[0], 0),
    Port::new(BASES[1], 2),
    Port::new(BASES[2], 4),
    Port::new(BASES[3], 18),
    Port::new(BASES[4], 20),
];

/// Writes the UARTs' interrupts into the vector table.
pub const fn bind(table: &mut [Handler; 32]) {
    const RECEIVE: [Handler; UARTS] = [receive::<0>, receive::<1>, receive::<2>, receive::<3>, receive::<4>];
    const TRANSMIT: [Handler; UARTS] =
        [transmit::<0>, transmit::<1>, transmit::<2>, transmit::<3>, transmit::<4>];
    let mut i = 0;
    while i < UARTS {
        table[PORT[i].rx_interrupt.0 as usize] = RECEIVE[i];
        table[PORT[i].tx_interrupt.0 as usize] = TRANSMIT[i];
        i += 1;
    }
}

extern "C" fn receive<const N: usize>() {
    PORT[N].receive();
}

extern "C" fn transmit<const N: usize>() {
    PORT[N].transmit();
}

impl Port {
    const fn new(base: Register, rx_interrupt: u16) -> Self {
        Self {
            base,
            rx_interrupt: Irq(rx_interrupt),
            tx_interrupt: Irq(rx_interrupt + 1),
            received: Pipe::new(),
            to_send: Pipe::new(),
            drained: Signal::new(),
            line: Mutex::new(Cell::new((Duration::MIN, Instant::MIN))),
            errors: LineErrors::new(),
        }
    }

    fn register(&self, offset: usize) -> Register {
        self.base.next(offset)
    }

    /// Opens a port: 8 data bits, no parity, one stop bit. Call it once for each.
    ///
    /// # Panics
    ///
    /// If the line has two stop bits, parity or an inverted RX, which this UART does not have.
    pub fn open(number: usize, format: Format) -> EcuPort {
        let Format { baud, stop_bits, even_parity, inverted_rx } = format;
        let line = Line { baud, stop_bits };
        defmt::assert!(
            stop_bits == StopBits::One && !even_parity && !inverted_rx,
            "UART{=usize} has one stop bit, no parity and no inversion",
            number
        );
        let port = &PORT[number];
        port.line.lock(|state| state.set((line.time_of(1), Instant::MIN)));
        port.register(BAUDDIV).write(CLOCK_HZ / line.baud);
        port.register(CTRL).write(ENABLE);
        unmask(port.rx_interrupt);
        unmask(port.tx_interrupt);
        EcuPort { rx: EcuRx(port), tx: EcuTx(port), errors: &port.errors }
    }

    /// The interrupt of the receiver.
    fn receive(&self) {
        self.register(INTSTATUS).write(RX_DONE);
        let state = self.register(STATE).read();
        if state & RX_OVERRUN != 0 {
            self.register(STATE).write(RX_OVERRUN);
            self.errors.count(LineError::Overrun);
        }
        if state & RX_FULL != 0 {
            let byte = self.register(DATA).read() as u8;
            if self.received.try_write(&[byte]).is_err() {
                self.errors.count(LineError::Overrun); // nobody reads
            }
        }
    }

    /// The interrupt of the transmitter: it has taken a byte, or a writer wants it to.
    #[expect(clippy::disallowed_methods, reason = "this UART has no flag for an idle line")]
    fn transmit(&self) {
        self.register(INTSTATUS).write(TX_DONE);
        let mut byte = [0];
        while self.register(STATE).read() & TX_FULL == 0 {
            if self.to_send.try_read(&mut byte).is_err() {
                return self.drained.signal(());
            }
            self.register(DATA).write(byte[0].into());
            #[cfg(feature = "count")]
            super::memory_uart::first_sent();
            self.line.lock(|line| {
                let (byte_time, free) = line.get();
                line.set((byte_time, free.max(Instant::now()) + byte_time));
            });
        }
    }

    /// Gives the receiver a byte, where its registers are memory.
    #[cfg(feature = "count")]
    pub fn put(number: usize, byte: u8) {
        let port = &PORT[number];
        port.register(DATA).write(byte.into());
        port.register(STATE).write(RX_FULL);
    }

    /// Triggers the interrupt of the receiver.
    #[cfg(feature = "count")]
    #[inline(always)]
    pub fn interrupt(number: usize) {
        pend(PORT[number].rx_interrupt);
    }

    fn is_drained(&self) -> bool {
        self.to_send.is_empty() && self.register(STATE).read() & TX_FULL == 0
    }
}

impl ErrorType for EcuRx {
    type Error = Infallible;
}

impl Read for EcuRx {
    async fn read(&mut self, buffer: &mut [u8]) -> Result<usize, Infallible> {
        Ok(self.0.received.read(buffer).await)
    }
}

impl ErrorType for EcuTx {
    type Error = Infallible;
}

impl Write for EcuTx {
    async fn write(&mut self, bytes: &[u8]) -> Result<usize, Infallible> {
        let count = self.0.to_send.write(bytes).await;
        pend(self.0.tx_interrupt);
        Ok(count)
    }

    /// Returns when the last stop bit has been sent.
    #[expect(clippy::disallowed_methods, reason = "this UART has no flag for an idle line")]
    async fn flush(&mut self) -> Result<(), Infallible> {
        while !self.0.is_drained() {
            self.0.drained.wait().await;
        }
        Timer::at(self.0.line.lock(Cell::get).1).await;
        Ok(())
    }
}
