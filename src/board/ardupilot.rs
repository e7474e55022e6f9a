//! For boards that keep their ArduPilot bootloader: what it checks in an application before it starts it, and what has
//! to be left for it before a reset.

use super::chip;
use super::first::Step;

/// The bootloader's ID of the board (APJ_BOARD_ID), from the board's table (build.rs).
const APJ_BOARD_ID: u16 = include!(concat!(env!("OUT_DIR"), "/apj_board_id.rs"));

/// ArduPilot's `app_descriptor` (libraries/AP_CheckFirmware/AP_CheckFirmware.h). Bootloaders that check their
/// application find it by its first eight bytes. `cargo image` fills in the two checksums and the size.
///
/// ```text
/// signature·8 | crc1·4 | crc2·4 | image size·4 | git hash·4 | version major, minor | board id·2 | reserved·8
/// ```
#[used]
static APP_DESCRIPTOR: [u8; 36] = {
    let mut descriptor = [0; 36];
    let signature = [0x40, 0xA2, 0xE4, 0xF1, 0x64, 0x68, 0x91, 0x06];
    let mut i = 0;
    while i < signature.len() {
        descriptor[i] = signature[i];
        i += 1;
    }
    let [low, high] = APJ_BOARD_ID.to_le_bytes();
    descriptor[26] = low;
    descriptor[27] = high;
    let mut i = 28;
    while i < descriptor.len() {
        descriptor[i] = 0xFF;
        i += 1;
    }
    descriptor
};

/// "Start the application at once" (RTC_BOOT_FAST in ArduPilot's hwdef/common/stm32_util.h), which the bootloader
/// reads and clears after a reset. Without it, the bootloader waits 5 s for an upload, unless the watchdog caused the reset.
///
/// Not RTC_BOOT_FWOK (0xB009 3A26): bootloaders with CAN need that one to start an application after a watchdog reset. None
/// of the boards here has such a bootloader (hwdef-bl.dat), and all others ignore it.
const START_AT_ONCE: u32 = 0xB007_0002;

/// Requests that the bootloader starts the application at once after the next reset.
pub const REQUEST: &[Step] = &chip::write_backup_register(START_AT_ONCE);

/// Makes the request now.
pub fn start_at_once() {
    for step in REQUEST {
        // SAFETY: registers of the backup domain and its clocks, which nothing else writes at the same time: this runs right after
        // Embassy's `init`, or when the firmware ends.
        unsafe { step.perform() }
    }
}
