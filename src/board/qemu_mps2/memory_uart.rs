//! Test image only (feature `count`): the UARTs' registers are memory, and a timer records when a transmitter is given a byte.

use super::hardware::{Register, UARTS};
use core::sync::atomic::{AtomicU32, Ordering};

/// Replaces the registers of each UART.
pub static REGISTERS: [[AtomicU32; 5]; UARTS] = [const { [const { AtomicU32::new(0) }; 5] }; UARTS];

/// Their addresses. (The only registers that are Rust objects: atomics, which any code may write.)
pub const BASES: [Register; UARTS] = [
    Register(REGISTERS[0][0].as_ptr()),
    Register(REGISTERS[1][0].as_ptr()),
    Register(REGISTERS[2][0].as_ptr()),
    Register(REGISTERS[3][0].as_ptr()),
    Register(REGISTERS[4][0].as_ptr()),
];

/// Time at which the transmitter was given its first byte since this was set to 0.
pub static FIRST_SENT: AtomicU32 = AtomicU32::new(0);

/// The timer's value; it counts down.
pub const TIMER_VALUE: Register = Register::at(0x4000_0004);

/// The timer's value, converted to count up.
pub fn now() -> u32 {
    !TIMER_VALUE.read()
}

/// The transmitter was given a byte.
pub fn first_sent() {
    let _ = FIRST_SENT.compare_exchange(0, now(), Ordering::Relaxed, Ordering::Relaxed);
}
