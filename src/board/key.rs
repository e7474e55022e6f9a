//! The key of MAVLink, in the region of RAM (`memory/retained.x`) that start-up and bootloaders do not touch.

use jetlink_mavlink::retained::KeyMemory;

// SAFETY: the linker puts this section into RAM that start-up does not touch. Every bit pattern is a valid `KeyMemory` (it is atomics
// throughout), and its content is only used with a right checksum.
#[unsafe(link_section = ".retained.key")]
pub static KEY: KeyMemory = KeyMemory::new();
