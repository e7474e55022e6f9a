//! For the self-test: what an STM32H743 reports about its chip, power, clocks, flash and option bytes (RM0433).

use crate::board::facts;
use embassy_stm32::pac::{DBGMCU, FLASH, PWR, RCC};

/// Size of the flash in KiB (RM0433, 61.2).
const FLASH_SIZE: *const u16 = 0x1FF1_E880 as *const u16;

/// Identity of the chip, its supply and its clocks.
pub fn chip() {
    let id = DBGMCU.idc().read().0;
    // SAFETY: read-only memory that every STM32H743 has, aligned.
    let size = unsafe { FLASH_SIZE.read_volatile() };
    facts::device(id, size);
    defmt::info!(
        "selftest: PWR CR3 {=u32:#010x}, CSR1 {=u32:#010x}, D3CR {=u32:#010x}",
        PWR.cr3().read().0,
        PWR.csr1().read().0,
        PWR.d3cr().read().0
    );
    defmt::info!(
        "selftest: RCC CR {=u32:#010x}, CFGR {=u32:#010x}, PLLCKSELR {=u32:#010x}, PLL1DIVR {=u32:#010x}, BDCR {=u32:#010x}",
        RCC.cr().read().0,
        RCC.cfgr().read().0,
        RCC.pllckselr().read().0,
        RCC.plldivr(0).read().0,
        RCC.bdcr().read().0
    );
}

/// The flash's wait states, and the option bytes.
pub fn memory() {
    let flash = FLASH.acr().read().0;
    defmt::info!(
        "selftest: flash ACR {=u32:#x}: {=u32} wait states, WRHIGHFREQ {=u32}",
        flash,
        flash & 0xF,
        flash >> 4 & 3
    );
    let options = FLASH.optsr_cur().read();
    let brown_out = ["off", "level 1", "level 2", "level 3"][usize::from(options.bor_lev() & 3)];
    let by_software = options.0 >> 4 & 1 == 1; // IWDG1_SW (RM0433, 4.9.8)
    facts::options("OPTSR", options.0, brown_out, options.rdp(), by_software);
}
