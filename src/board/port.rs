//! Serial ports, of the ECUs, of MAVLink and of a receiver of radio control: a buffered UART that hands over every byte as it arrives, and counts line errors.
//!
//! `BufferedUart` only logs framing, noise and overrun errors. So a second handler,
//! [`BeforeDriver`], runs on the same interrupt *before* the driver's own (`bind_interrupts!` calls
//! handlers in the order written) and counts the error flags that are set. It reads the status
//! register and writes none:
//!
//! - On the H7 the flags stay set until the driver clears them through ICR.
//! - On the F4 a read of the status register followed by a read of the data register clears the
//!   flags; the driver does both next. A read of the status alone clears nothing.
//!
//! The hardware raises these flags together with an interrupt that is enabled anyway (RXNEIE: a byte
//! was received or lost), and the driver clears every flag that was counted before the interrupt
//! returns: each error is counted once, and consecutive lost bytes are counted once. The H7's driver enables
//! the UART's FIFO; the flags are then those of the byte at its head. An error that is raised between
//! the two reads, a few dozen ns, is not counted; its byte is still received.
//!
//! A third handler, [`AfterDriver`], runs last. Both take the ends of transmissions from the F4's driver, see `TransmissionEnd` there.

use super::chip::{self, TransmissionEnd, Transmitter};
use super::format::Format;
use core::marker::PhantomData;
use core::sync::atomic::{AtomicU32, Ordering};
use embassy_stm32::{
    interrupt::typelevel::Handler,
    pac::usart::Usart,
    usart::{BufferedUart, BufferedUartRx, Config, ConfigError, Instance, Parity},
};
use jetlink::line::StopBits;
use jetlink::link::MAX_TRANSMISSION;
use jetlink::runner::{LineErrors, Runner};
use jetlink_fw::config::{ENGINES, RADIO};

/// An open port.
pub struct EcuPort {
    /// From the ECU, the autopilot or the receiver.
    pub rx: BufferedUartRx<'static>,
    /// To it.
    pub tx: Transmitter,
    /// Line errors, counted in the UART's interrupt.
    pub errors: &'static LineErrors,
    /// Its format.
    format: Format,
    /// Its number, and that of its buffers.
    number: (usize, usize),
    /// Reopens it.
    driver: Driver,
}

/// The driver of the port of a number, with buffers for sending and receiving; `None`: there is none. The port must not be open.
pub type Driver = unsafe fn(usize, &'static mut [u8], &'static mut [u8], Format) -> Option<Opened>;

/// A driver, or what is wrong with its configuration, and what its interrupt keeps.
pub type Opened = (Result<BufferedUart<'static>, ConfigError>, &'static State);

impl EcuPort {
    /// Runs an engine on this port. If the transmitter is stuck, the port is closed and reopened, which discards waiting bytes.
    pub async fn serve(mut self, runner: Runner<'static>) -> ! {
        loop {
            let Self { rx, tx, errors, format, number, driver } = self;
            runner.run_until_stuck(rx, tx, errors).await;
            defmt::error!("transmitter stuck, reopening its port");
            // SAFETY: both halves were moved into the run, which is over and has dropped them: the driver is closed.
            self = defmt::unwrap!(unsafe { open_at(driver, number, format) });
        }
    }
}

/// Most bytes of one write.
const WRITE: usize = if jetlink_mavlink::runner::WRITE > 6 * MAX_TRANSMISSION {
    jetlink_mavlink::runner::WRITE
} else {
    6 * MAX_TRANSMISSION
};

/// Number of the ECU ports (build.rs), which is that of the board's socket for a receiver as a port.
const ECU_PORTS: u8 = env!("JETLINK_PORTS").as_bytes()[0] - b'0';

/// Port of a receiver, if it uses a UART.
const RECEIVER: Option<u8> = match &RADIO {
    Some(radio) => radio.uart(),
    None => None,
};

/// Whether a receiver is on the board's socket for it.
#[cfg(board_socket)]
pub const SOCKET_IN_USE: bool = RECEIVER.is_some() && !HAS_RECEIVER;

/// Whether a receiver is on one of these ports, and not on the board's socket for it.
const HAS_RECEIVER: bool = match RECEIVER {
    Some(port) => port < ECU_PORTS,
    None => false,
};

/// Ports that are opened: of the engines, of MAVLink, of a receiver, and of an ECU that is played.
const OPEN: usize = ENGINES.len() + 1 + HAS_RECEIVER as usize + cfg!(feature = "play-ecu") as usize;

/// The buffers of the open ports. A port without an engine has none.
static mut BUFFERS: [Buffers; OPEN] = [const { Buffers::new() }; OPEN];

/// The buffers of both directions of a UART.
struct Buffers {
    /// Room for more than 1 s of an ECU at 2400 baud, 44 ms at 57 600 baud, 20 ms at 115 200 baud; of a receiver's frames for 140 ms
    /// of SBUS and 39 ms of CRSF, at the usual 14 ms and 4 ms.
    rx: [u8; 256],
    /// A write without enough room would wait forever (embassy-stm32 0.6.0).
    tx: [u8; WRITE],
}

impl Buffers {
    /// Empty.
    const fn new() -> Self {
        Self { rx: [0; 256], tx: [0; _] }
    }
}

/// What the interrupt of a UART keeps, besides the driver.
pub struct State {
    /// Its line errors.
    errors: LineErrors,
    /// Of the last transmission.
    end: TransmissionEnd,
}

impl State {
    /// Of a UART that was not opened yet.
    pub const fn new() -> Self {
        Self { errors: LineErrors::new(), end: TransmissionEnd::new() }
    }
}

/// A UART that can be an ECU port; [`ecu_uarts!`] implements it.
pub trait EcuUart: Instance {
    /// Its registers.
    const REGISTERS: Usart;

    /// What its interrupt keeps.
    fn state() -> &'static State;
}

/// Interrupt handler that counts line errors. It must come before the driver's own.
pub struct BeforeDriver<T>(PhantomData<T>);

impl<T: EcuUart> Handler<T::Interrupt> for BeforeDriver<T> {
    unsafe fn on_interrupt() {
        for (raised, error) in chip::line_errors(T::REGISTERS) {
            if raised {
                T::state().errors.count(error);
            }
        }
        T::state().end.before_driver(T::REGISTERS);
    }
}

/// Interrupt handler that must come after the driver's own.
pub struct AfterDriver<T>(PhantomData<T>);

impl<T: EcuUart> Handler<T::Interrupt> for AfterDriver<T> {
    unsafe fn on_interrupt() {
        T::state().end.after_driver(T::REGISTERS);
    }
}

/// Turns UARTs into ECU ports: binds their interrupts to the three handlers in their order (as `Irqs`), and gives each its state.
macro_rules! ecu_uarts {
    ($($uart:ident),* $(,)?) => {
        embassy_stm32::bind_interrupts!(struct Irqs {
            $($uart =>
                $crate::board::port::BeforeDriver<embassy_stm32::peripherals::$uart>,
                embassy_stm32::usart::BufferedInterruptHandler<embassy_stm32::peripherals::$uart>,
                $crate::board::port::AfterDriver<embassy_stm32::peripherals::$uart>;)*
        });

        $(impl $crate::board::port::EcuUart for embassy_stm32::peripherals::$uart {
            const REGISTERS: embassy_stm32::pac::usart::Usart = embassy_stm32::pac::$uart;

            fn state() -> &'static $crate::board::port::State {
                static STATE: $crate::board::port::State = $crate::board::port::State::new();
                &STATE
            }
        })*
    };
}
pub(super) use ecu_uarts;

/// The ports that were opened, a bit each.
static OPENED: AtomicU32 = AtomicU32::new(0);

/// Opens a port by its number for the first time, in the next place of the buffers. `None`: there is no such port, it was opened before, or more
/// are open than the image has buffers for.
pub fn open_once(driver: Driver, port: usize, format: Format) -> Option<EcuPort> {
    let opened = OPENED.load(Ordering::Relaxed);
    let bit = 1_u32.checked_shl(u32::try_from(port).ok()?)?;
    let place = opened.count_ones() as usize;
    if opened & bit != 0 || place >= OPEN {
        return None;
    }
    OPENED.store(opened | bit, Ordering::Relaxed);
    // SAFETY: each port is opened here once, in a place of its own.
    unsafe { open_at(driver, (port, place), format) }
}

/// Opens a port, in this place of the buffers: 8 data bits.
///
/// # Safety
///
/// Neither the UART nor another port of this place may be open.
///
/// # Panics
///
/// If the UART does not support this baud rate, or there are no such buffers.
unsafe fn open_at(driver: Driver, number: (usize, usize), format: Format) -> Option<EcuPort> {
    let (port, place) = number;
    assert!(place < OPEN);
    // SAFETY: the place is one of the array, and the caller guarantees that no open port holds its buffers. Nothing else names them.
    let buffers = unsafe { &mut *(&raw mut BUFFERS).cast::<Buffers>().add(place) };
    // SAFETY: the caller guarantees that the UART is not open.
    let (uart, state) = unsafe { driver(port, &mut buffers.tx, &mut buffers.rx, format) }?;
    let (tx, rx) = defmt::unwrap!(uart).split();
    Some(EcuPort { rx, tx: state.end.transmitter(tx), errors: &state.errors, format, number, driver })
}

/// How a driver is configured. Inlined where it is used: what is the same for all formats is then known for each driver.
#[inline(always)]
pub fn config(format: Format) -> Config {
    let mut config = Config::default();
    config.baudrate = format.baud;
    config.stop_bits = match format.stop_bits {
        StopBits::One => embassy_stm32::usart::StopBits::STOP1,
        StopBits::Two => embassy_stm32::usart::StopBits::STOP2,
    };
    // Wake the reader at each byte. Without this it wakes on the idle line, a whole byte time
    // later.
    config.eager_reads = Some(1);
    // An open input must be high, like an idle line.
    config.rx_pull = embassy_stm32::gpio::Pull::Up;
    // Nothing else is not 8N1 or 8N2, or is inverted.
    if RECEIVER.is_some() {
        if format.even_parity {
            config.parity = Parity::ParityEven;
        }
        if format.inverted_rx {
            config.rx_pull = embassy_stm32::gpio::Pull::Down;
            chip::invert_rx(&mut config);
        }
    }
    config
}
