//! Test image only (feature `count`): the UARTs' registers are memory, and a timer sees when a transmitter is given a byte.

use super::hardware::{PORTS, Register};
use core::sync::atomic::{AtomicU32, Ordering};

/// In place of each UART's registers.
pub static REGISTERS: [[AtomicU32; 5]; PORTS.len()] =
    [const { [const { AtomicU32::new(0) }; 5] }; PORTS.len()];

/// Where they are. (The only registers that Rust knows of: as atomics, which anybody may write.)
pub const BASES: [Register; PORTS.len()] = [
    Register(REGISTERS[0][0].as_ptr()),
    Register(REGISTERS[1][0].as_ptr()),
    Register(REGISTERS[2][0].as_ptr()),
    Register(REGISTERS[3][0].as_ptr()),
];

/// When the transmitter was given a byte for the first time since somebody set this to 0.
pub static SPOKE: AtomicU32 = AtomicU32::new(0);

/// The timer's value; it counts down.
pub const TIMER_VALUE: Register = Register::at(0x4000_0004);

/// What the timer of the count shows, counted up.
pub fn now() -> u32 {
    !TIMER_VALUE.read()
}

/// The transmitter was given a byte.
pub fn spoke() {
    let _ = SPOKE.compare_exchange(0, now(), Ordering::Relaxed, Ordering::Relaxed);
}
