//! For the self-test: what an STM32F427 reports about its chip, power, clocks, flash and option bytes (RM0090).

use crate::board::facts;
use embassy_stm32::pac::{DBGMCU, FLASH, PWR, RCC};

/// Size of the flash in KiB (RM0090, 39.2).
const FLASH_SIZE: *const u16 = 0x1FFF_7A22 as *const u16;

/// Identity of the chip, its supply and its clocks.
pub fn chip() {
    let id = DBGMCU.idcode().read().0;
    // SAFETY: read-only memory that every STM32F427 has, aligned.
    let size = unsafe { FLASH_SIZE.read_volatile() };
    facts::device(id, size);
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
    let brown_out = ["level 3", "level 2", "level 1", "off"][usize::from(options.bor_lev() & 3)];
    facts::options("OPTCR", options.0, brown_out, options.rdp(), options.wdg_sw());
}
