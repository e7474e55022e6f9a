//! The emulated board's ports, registers and interrupts.

use cortex_m::{interrupt::InterruptNumber, peripheral::NVIC};

/// The ECU ports by number, from 0. QEMU's n-th `-serial` is UARTn.
pub const PORTS: [&str; 4] = ["UART0", "UART1", "UART2", "UART3"];

/// Number of its UARTs: those of the ECUs, then the one of MAVLink.
pub const UARTS: usize = PORTS.len() + 1;

/// Clock of the core and of all its buses.
pub const CLOCK_HZ: u32 = 25_000_000;

/// A 32-bit register.
#[derive(Clone, Copy)]
pub struct Register(pub *mut u32);

impl Register {
    pub const fn at(address: usize) -> Self {
        Self(address as *mut u32)
    }

    /// The register at this offset in bytes.
    pub const fn next(self, offset: usize) -> Self {
        Self(self.0.wrapping_byte_add(offset))
    }

    pub fn read(self) -> u32 {
        // SAFETY: private to this board, whose files make registers from its memory map only; each
        // is 32 bits wide, aligned, and never the address of a Rust object.
        unsafe { self.0.read_volatile() }
    }

    pub fn write(self, value: u32) {
        // SAFETY: as in `read`; no register used here makes the hardware touch memory.
        unsafe { self.0.write_volatile(value) }
    }
}

/// An interrupt of this board.
#[derive(Clone, Copy)]
pub struct Irq(pub u16);

// SAFETY: all are defined in this board's files and below 32, the number that the board has.
unsafe impl InterruptNumber for Irq {
    fn number(self) -> u16 {
        self.0
    }
}

/// An interrupt's handler.
pub type Handler = unsafe extern "C" fn();

/// Triggers an interrupt.
pub fn pend(irq: Irq) {
    NVIC::pend(irq);
}

/// Enables an interrupt.
pub fn unmask(irq: Irq) {
    // SAFETY: no critical section relies on masks of single interrupts.
    unsafe { NVIC::unmask(irq) }
}
