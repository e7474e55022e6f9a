//! Arm MPS2 with the AN500 FPGA image: a Cortex-M7 at 25 MHz and five UARTs, as in QEMU's machine
//! `mps2-an500`. Not for flight: it runs the firmware without hardware, with `cargo qemu`.
//!
//! Addresses and interrupts from Arm's application note AN500, registers from the Cortex-M System
//! Design Kit's technical reference manual (DDI 0479). Differences between QEMU and
//! the board are noted where they matter, and in `docs/qemu.md`.

mod clock;
#[cfg(feature = "count")]
pub mod count;
mod executor;
mod hardware;
#[cfg(feature = "count")]
mod memory_uart;
mod semihosting;
mod uart;

pub use self::hardware::PORTS;
use self::hardware::{CLOCK_HZ, Handler, Irq, Register};
use self::uart::Port;
use super::first::{self, Step};
use super::format::Format;
use super::state::{ENGINE_EXECUTOR, Oscillator, Ready, ResetCause};
use cortex_m_rt::exception;
use embassy_executor::SendSpawner;

#[cfg(feature = "trial")]
pub use self::semihosting::exit;
pub use self::{executor::Executor, uart::EcuPort};

/// Whether its UARTs can invert what they receive. They have neither parity nor two stop bits: no SBUS.
pub const INVERTS_RX: bool = false;

/// They have one.
pub const TWO_STOP_BITS: bool = false;

/// It has no outputs.
pub const OUTPUTS: &[&str] = &[];

/// It has no outputs.
pub const OUTPUTS_LOW_BEFORE: &[bool] = &[];

/// It has no outputs.
pub fn drive_output(_number: u8, _high: bool) {}

/// Without outputs nobody counts starts that failed.
pub mod starts {
    use super::super::state::ResetCause;
    use jetlink_rc::starts::FailedStarts;

    /// None has.
    pub fn begin(_cause: ResetCause) -> FailedStarts {
        FailedStarts::default()
    }

    /// Nobody counts.
    pub fn has_lived(_cut: impl IntoIterator<Item = bool>) {}
}

/// The board's name.
pub const NAME: &str = "QEMU mps2-an500";

/// The port of MAVLink.
pub const TELEMETRY_PORT: &str = "UART4";

// SAFETY: a register may be read and written from anywhere; it is not memory managed by Rust.
unsafe impl Sync for Register {}

/// The audio interface's interrupt, which nothing here uses: it runs the engines' executor.
const EXECUTOR_INTERRUPT: Irq = Irq(14);

/// `__pre_init` does nothing for this board.
pub(super) static FIRST: [Step; 1] = first::list(&[]);

/// Below the UARTs and SysTick, which keep their reset value 0.
const EXECUTOR_PRIORITY: u8 = 0x60;

unsafe extern "C" {
    /// The handler in `crash.rs`, under its cortex-m-rt name.
    fn DefaultHandler();
}

extern "C" fn engines() {
    // SAFETY: this is the executor's interrupt handler, and the interrupt is off until the executor
    // has started.
    unsafe { ENGINE_EXECUTOR.on_interrupt() }
}

/// The vector table behind the exceptions.
// SAFETY: cortex-m-rt's linker script requires the board's interrupts in this section and under this name.
#[unsafe(link_section = ".vector_table.interrupts")]
#[unsafe(no_mangle)]
static __INTERRUPTS: [Handler; 32] = {
    let mut table: [Handler; 32] = [DefaultHandler; 32];
    table[EXECUTOR_INTERRUPT.0 as usize] = engines;
    executor::bind(&mut table);
    uart::bind(&mut table);
    table
};

/// The board, ready for the firmware.
pub type Board = Ready<Led, Watchdog>;

/// Opens a port by its number, once. The one behind those of `PORTS` is that of MAVLink. `None`: there is no such port.
pub fn open(port: usize, format: Format) -> Option<EcuPort> {
    (port <= PORTS.len()).then(|| Port::open(port, format))
}

/// Does `first`, starts the clock. Call it once.
pub fn init(first: impl FnOnce(ResetCause)) -> Board {
    first(ResetCause::Unknown);
    super::stack::paint();
    clock::start();
    let mut core = defmt::unwrap!(cortex_m::Peripherals::take());
    // SAFETY: the executor's interrupt is still off, and no critical section relies on priorities.
    unsafe { core.NVIC.set_priority(EXECUTOR_INTERRUPT, EXECUTOR_PRIORITY) };
    Ready {
        reset_cause: ResetCause::Unknown, // QEMU does not implement the board's register for it
        oscillator: Oscillator::Crystal,
        led: Led(()),
        watchdog: Watchdog(()),
    }
}

/// Starts the executor for the engines' tasks. Call it once.
pub fn start_engine_executor() -> SendSpawner {
    ENGINE_EXECUTOR.start(EXECUTOR_INTERRUPT)
}

/// USERLED0. QEMU implements it, but only its trace shows it.
pub struct Led(());

impl Led {
    const LEDS: Register = Register::at(0x4002_8000);

    /// Turns the LED on or off.
    pub fn set(&mut self, lit: bool) {
        Self::LEDS.write(lit.into());
    }
}

/// The watchdog of the design kit. When its counter runs out, it raises the NMI; when it runs out
/// again, it resets.
pub struct Watchdog(());

impl Watchdog {
    const LOAD: Register = Register::at(0x4000_8000);
    const CONTROL: Register = Register::at(0x4000_8008);
    const CLEAR: Register = Register::at(0x4000_800C);
    const LOCK: Register = Register::at(0x4000_8C00);

    /// Unlocks the other registers for writing.
    const KEY: u32 = 0x1ACC_E551;

    /// Starts the watchdog, with 1 s to the NMI.
    pub fn start(&mut self) {
        Self::LOCK.write(Self::KEY);
        Self::LOAD.write(CLOCK_HZ);
        Self::CONTROL.write(0b11); // count and raise the NMI, then reset
        Self::LOCK.write(0);
    }

    /// Gives the firmware another second.
    pub fn feed(&mut self) {
        Self::LOCK.write(Self::KEY);
        Self::CLEAR.write(1); // counts from LOAD again
        Self::LOCK.write(0);
    }
}

#[exception]
unsafe fn NonMaskableInt() -> ! {
    super::crash::crash(|| defmt::error!("the watchdog was not fed, resetting"))
}
