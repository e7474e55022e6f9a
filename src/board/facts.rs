//! For the self-test: the log lines about a chip that are the same for all. What to read is in each family's `facts.rs`.

/// Which chip this is: DBGMCU's word, and the size of its flash in KiB.
pub fn device(id: u32, flash: u16) {
    defmt::info!(
        "selftest: device {=u32:#05x}, revision {=u32:#06x}, {=u16} KiB of flash",
        id & 0xFFF,
        id >> 16,
        flash
    );
}

/// The option bytes: the register and what is in it, the level of the brown-out reset, the read protection, and who starts the
/// watchdog.
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
