//! Engine state that survives a reset, in a region of RAM (`memory/retained.x`) that start-up and bootloaders do not touch.

#[cfg(feature = "board-qemu-mps2")]
use super::qemu_mps2::PORTS;
#[cfg(feature = "stm32")]
use super::table::PORTS;
use jetlink::engine::retained::RetainedMemory;

/// The record of the engine on each port. Aligned to the 64-bit words of an H7's RAM, the unit of its ECC.
#[repr(C, align(8))]
pub struct Retained(pub [RetainedMemory; PORTS.len()]);

// SAFETY: the linker puts the section `.retained` into RAM that start-up does not touch. Every bit pattern is a valid
// `RetainedMemory` (it is atomics throughout), and its content is only used with a right checksum.
#[unsafe(link_section = ".retained")]
pub static RETAINED: Retained = Retained([const { RetainedMemory::new() }; PORTS.len()]);
