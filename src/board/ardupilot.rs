//! For boards that keep their ArduPilot bootloader: what it looks for in an application before it starts one,
//! and what it wants to be told afterwards.

use super::chip;
use super::chosen::APJ_BOARD_ID;

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

/// "The firmware is well" (Tools/AP_Bootloader, RTC_BOOT_FWOK). Without it some bootloaders stay in the bootloader
/// after a reset by the watchdog: the last thing wanted with an engine running.
const FIRMWARE_OK: u32 = 0xB009_3A26;

/// Tells the bootloader that the firmware is well. To be called before the watchdog is started.
pub fn firmware_is_well() {
    chip::write_backup_register(FIRMWARE_OK);
}
