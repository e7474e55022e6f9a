//! Engine state that survives a reset, in a region of RAM (`memory/retained.x`) that start-up and bootloaders do not touch.

#[cfg(feature = "board-qemu-mps2")]
use super::qemu_mps2::PORTS;
use super::retained::RetainedWord;
#[cfg(feature = "stm32")]
use super::table::PORTS;
use jetlink::engine::retained::RetainedMemory;
use jetlink_fw::config::ENGINES;

/// The record of the engine on each port. Aligned to the 64-bit words of an H7's RAM, the unit of its ECC.
#[repr(C, align(8))]
pub struct Retained(pub [RetainedMemory; PORTS.len()]);

// SAFETY: the linker puts the section `.retained` into RAM that start-up does not touch. Every bit pattern is a valid
// `RetainedMemory` (it is atomics throughout), and its content is only used with a right checksum.
#[unsafe(link_section = ".retained")]
pub static RETAINED: Retained = Retained([const { RetainedMemory::new() }; PORTS.len()]);

/// What each engine is wired to, as one number: it says on which port its record is, before any setting is read.
// SAFETY: as above; of a `RetainedWord` only one with its inverse is used.
#[unsafe(link_section = ".retained.wiring")]
pub static WIRING: [RetainedWord; ENGINES.len()] = [const { RetainedWord::new() }; ENGINES.len()];

/// Whether its starter and ignition have power, as one number ([`jetlink_rc::outputs::Before`]). Only images with outputs use it.
// SAFETY: as above.
#[unsafe(link_section = ".retained.power")]
pub static POWER: [RetainedWord; ENGINES.len()] = [const { RetainedWord::new() }; ENGINES.len()];

/// Ids of MAVLink and rate of the telemetry port that are in force, as one number ([`jetlink_mavlink::settings::Identity::packed`]).
// SAFETY: as above.
#[unsafe(link_section = ".retained.identity")]
pub static IDENTITY: RetainedWord = RetainedWord::new();
