//! Changed settings, in the region of RAM (`memory/retained.x`) that start-up and bootloaders do not touch.

use jetlink_mavlink::retained_settings::SettingsMemory;

/// Space for about as many changes as a sixth of this.
pub const BYTES: usize = 248;

// SAFETY: the linker puts this section into RAM that start-up does not touch. Every bit pattern is a valid `SettingsMemory` (it is atomics
// throughout), and its content is only used with a right checksum.
#[unsafe(link_section = ".retained.settings")]
pub static SETTINGS: SettingsMemory<BYTES> = SettingsMemory::new();
