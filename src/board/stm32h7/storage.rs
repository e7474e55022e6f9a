//! Storage in the last two sectors of bank 2 (RM0433, 4). Code is in bank 1 (`boards/`), which is read on while bank 2 is written or
//! erased.
//!
//! Embassy's asynchronous flash writes and erases. It clears the error flags by writing to SR, which an H7 ignores (RM0433, 4.9.26): one error
//! would refuse every later write. So the flags are cleared here, through CCR.
//!
//! A word that a power cut tore has two wrong bits: to read it is a bus fault, which is masked here (Armv7-M, B1.5.5: BFHFNMIGN).

use cortex_m::peripheral::SCB;
use embassy_stm32::flash::{Async, Flash, InterruptHandler};
use embassy_stm32::{bind_interrupts, pac, peripherals};
use embedded_storage_async::nor_flash::{ErrorType, NorFlash, NorFlashErrorKind, ReadNorFlash};
use jetlink_mavlink::store::Found;

bind_interrupts!(struct Irqs {
    FLASH => InterruptHandler;
});

/// Offset of the storage in the flash.
const OFFSET: u32 = 0x1C_0000;
/// Where the flash is.
const BASE: u32 = 0x0800_0000;
const SECTOR: usize = 128 * 1024;
/// A word of the flash, which has one checksum.
const WORD: usize = 32;
/// Of CCR: a bus fault of a load is ignored where FAULTMASK is set.
const BFHFNMIGN: u32 = 1 << 8;

/// The storage of the settings.
pub struct Storage(Flash<'static, Async>);

impl core::fmt::Debug for Storage {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str("Storage")
    }
}

/// The storage of this board. Call it once.
pub fn storage() -> Result<Storage, Found> {
    // SAFETY: called once, and nothing else uses the flash's registers.
    let flash = unsafe { peripherals::FLASH::steal() };
    Ok(Storage(Flash::new(flash, Irqs)))
}

/// Clears the flags of bank 2. True: there was an error that no checksum corrects.
fn clear_flags() -> bool {
    let bank = pac::FLASH.bank(1);
    let flags = bank.sr().read();
    bank.ccr().write(|w| {
        w.set_clr_eop(true);
        w.set_clr_wrperr(true);
        w.set_clr_pgserr(true);
        w.set_clr_strberr(true);
        w.set_clr_incerr(true);
        w.set_clr_operr(true);
        w.set_clr_rdperr(true);
        w.set_clr_rdserr(true);
        w.set_clr_sneccerr(true);
        w.set_clr_dbeccerr(true);
    });
    flags.dbeccerr()
}

/// Reads a word of the flash; `None` if it is unreadable.
fn read_word(address: u32) -> Option<[u8; WORD]> {
    clear_flags();
    let mut word = [0; WORD];
    // SAFETY: loads from the flash, where there is no Rust object, and registers of the core. Between the two CPS no exception is taken
    // but the NMI, for less than 1 µs.
    unsafe {
        let scb = &*SCB::PTR;
        core::arch::asm!("cpsid f", options(nomem, nostack));
        scb.ccr.modify(|ccr| ccr | BFHFNMIGN);
        cortex_m::asm::dsb();
        cortex_m::asm::isb();
        for (bytes, at) in word.as_chunks_mut().0.iter_mut().zip((address..).step_by(4)) {
            *bytes = (at as *const u32).read_volatile().to_le_bytes();
        }
        cortex_m::asm::dsb();
        scb.ccr.modify(|ccr| ccr & !BFHFNMIGN);
        cortex_m::asm::dsb();
        cortex_m::asm::isb();
        core::arch::asm!("cpsie f", options(nomem, nostack));
    }
    (!clear_flags()).then_some(word)
}

impl ErrorType for Storage {
    type Error = NorFlashErrorKind;
}

impl ReadNorFlash for Storage {
    const READ_SIZE: usize = 1;

    async fn read(&mut self, at: u32, bytes: &mut [u8]) -> Result<(), NorFlashErrorKind> {
        let mut at = BASE + OFFSET + at;
        let mut rest = bytes;
        while !rest.is_empty() {
            let within = at as usize % WORD;
            let word = read_word(at - within as u32).ok_or(NorFlashErrorKind::Other)?;
            let count = rest.len().min(WORD - within);
            let (now, later) = rest.split_at_mut(count);
            now.copy_from_slice(&word[within..within + count]);
            at += count as u32;
            rest = later;
        }
        Ok(())
    }

    fn capacity(&self) -> usize {
        2 * SECTOR
    }
}

impl NorFlash for Storage {
    const WRITE_SIZE: usize = WORD;
    const ERASE_SIZE: usize = SECTOR;

    async fn erase(&mut self, from: u32, to: u32) -> Result<(), NorFlashErrorKind> {
        clear_flags();
        let erased = self.0.erase(OFFSET + from, OFFSET + to).await;
        clear_flags();
        erased.map_err(|_| NorFlashErrorKind::Other)
    }

    async fn write(&mut self, at: u32, bytes: &[u8]) -> Result<(), NorFlashErrorKind> {
        clear_flags();
        let written = self.0.write(OFFSET + at, bytes).await;
        clear_flags();
        written.map_err(|_| NorFlashErrorKind::Other)
    }
}

impl jetlink_mavlink::store::Flash for Storage {}
