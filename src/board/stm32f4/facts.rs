//! For the self-test: what an STM32F427 says of its own chip, power, clocks, flash and option bytes (RM0090).

use embassy_stm32::pac::{DBGMCU, FLASH, PWR, RCC};

/// Size of the flash in KiB (RM0090, 39.2).
const FLASH_SIZE: *const u16 = 0x1FFF_7A22 as *const u16;

/// Which chip this is, and how it is supplied and clocked.
pub fn chip() {
    let id = DBGMCU.idcode().read().0;
    // SAFETY: read-only memory that every STM32F427 has, aligned.
    let size = unsafe { FLASH_SIZE.read_volatile() };
    defmt::info!(
        "selftest: device {=u32:#05x}, revision {=u32:#06x}, {=u16} KiB of flash",
        id & 0xFFF,
        id >> 16,
        size
    );
    defmt::info!("selftest: PWR CR {=u32:#010x}, CSR {=u32:#010x}", PWR.cr1().read().0, PWR.csr1().read().0);
    defmt::info!(
        "selftest: RCC CR {=u32:#010x}, CFGR {=u32:#010x}, PLLCFGR {=u32:#010x}, BDCR {=u32:#010x}",
        RCC.cr().read().0,
        RCC.cfgr().read().0,
        RCC.pllcfgr().read().0,
        RCC.bdcr().read().0
    );
}

/// The flash's wait states and accelerator, and the option bytes.
pub fn memory() {
    let flash = FLASH.acr().read();
    defmt::info!(
        "selftest: flash ACR {=u32:#x}: {=u32} wait states, prefetch {=bool}, instruction cache {=bool}, data cache {=bool}",
        flash.0,
        flash.0 & 0xF,
        flash.prften(),
        flash.icen(),
        flash.dcen()
    );
    let options = FLASH.optcr().read();
    defmt::info!(
        "selftest: option bytes OPTCR {=u32:#010x}: brown-out {=str}, read protection {=u8:#x}, watchdog by {=str}",
        options.0,
        ["level 3", "level 2", "level 1", "off"][usize::from(options.bor_lev() & 3)],
        options.rdp(),
        if options.wdg_sw() { "software" } else { "hardware" }
    );
}
