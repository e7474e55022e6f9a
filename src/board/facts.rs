//! For the self-test: the log lines about a chip that all families share. Each family's `facts.rs` reads the registers.

/// Identity of the chip: DBGMCU's word, and the flash size in KiB.
pub fn device(id: u32, flash: u16) {
    defmt::info!(
        "selftest: device {=u32:#05x}, revision {=u32:#06x}, {=u16} KiB of flash",
        id & 0xFFF,
        id >> 16,
        flash
    );
}

/// The option bytes: the register and its content, the level of the brown-out reset, the read protection, and whether hardware or
/// software starts the watchdog.
pub fn options(register: &str, word: u32, brown_out: &str, protection: u8, by_software: bool) {
    defmt::info!(
        "selftest: option bytes {=str} {=u32:#010x}: brown-out {=str}, read protection {=u8:#x}, watchdog by {=str}",
        register,
        word,
        brown_out,
        protection,
        if by_software { "software" } else { "hardware" }
    );
}
