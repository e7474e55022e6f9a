//! The processor, with additional MPU regions that only make it faster.
//!
//! Translated code accesses a page of memory directly only if an MPU region grants every access to it, or the MPU is off; every access
//! to another page is checked individually, which takes 40 to 50 % of the time of a run. The firmware has one region, the guard below
//! its stack (`src/board/guard.rs`), and leaves the rest to the default map, which grants every access to privileged code only. All of
//! the firmware is privileged. So once the guard is armed, the rest of flash and RAM gets regions that grant everything: the same
//! accesses fail, and each instruction takes the same time.
#![allow(unsafe_code)]

use core::ops::Range;
use rigless::emulator::{CoreBus, DataModel, Error, Exit, HostCall, Processor, ProcessorConstructor, Queued};
use rigless::soc::{Endian, Width};
use rigless::time::VirtualNanos;
use std::sync::Arc;

/// Registers of the MPU (Armv7-M, B3.5).
const TYPE: u64 = 0xE000_ED90;
const CTRL: u64 = 0xE000_ED94;
const RNR: u64 = 0xE000_ED98;
const RBAR: u64 = 0xE000_ED9C;
const RASR: u64 = 0xE000_EDA0;

/// On, with the default map outside the regions, for privileged code.
const ON: u64 = 1 << 2 | 1;
/// A region with every access granted, and code.
const FULL_ACCESS: u64 = 0b011 << 24;
/// Field AP of RASR. 0: no access.
const ACCESS: u64 = 0b111 << 24;
const ENABLED: u64 = 1;

/// Makes the part's processor with such regions in this memory.
pub fn with_regions(processor: ProcessorConstructor, memory: Vec<Range<u64>>) -> ProcessorConstructor {
    Arc::new(move |endian| {
        Ok(Box::new(Cpu { part: processor(endian)?, memory: memory.clone(), done: false }))
    })
}

#[derive(Debug)]
struct Cpu {
    part: Box<dyn Processor>,
    /// Flash and RAM.
    memory: Vec<Range<u64>>,
    /// The memory has its regions, until the next reset.
    done: bool,
}

impl Cpu {
    fn read(&mut self, register: u64) -> u64 {
        let value = self.part.debugger_access(None, register, Width::W32, VirtualNanos(0));
        value.expect("a register of the core")
    }

    fn write(&mut self, register: u64, value: u64) {
        self.part.debugger_access(Some(value), register, Width::W32, VirtualNanos(0));
    }

    /// How many regions the MPU has.
    fn regions(&mut self) -> u64 {
        self.read(TYPE) >> 8 & 0xFF
    }

    /// The guard, if the MPU is on with this one region.
    fn guard(&mut self) -> Option<Range<u64>> {
        if self.read(CTRL) != ON || self.read(RNR) != 0 {
            return None;
        }
        let (base, rasr) = (self.read(RBAR) & !0x1F, self.read(RASR));
        let alone = (1..self.regions()).all(|region| {
            self.write(RNR, region);
            self.read(RASR) & ENABLED == 0
        });
        self.write(RNR, 0);
        let size = 2 << (rasr >> 1 & 0x1F);
        (alone && rasr & (ACCESS | ENABLED) == ENABLED).then_some(base..base + size)
    }

    /// Gives the rest of the memory its regions, once the guard is armed.
    fn open(&mut self) {
        let Some(guard) = self.guard() else { return };
        let mut blocks = Vec::new();
        for memory in &self.memory {
            blocks.extend(aligned(memory.start..memory.end.min(guard.start.max(memory.start))));
            blocks.extend(aligned(memory.start.max(guard.end.min(memory.end))..memory.end));
        }
        assert!((blocks.len() as u64) < self.regions(), "{blocks:?}");
        for (region, block) in (1..).zip(blocks) {
            self.write(RNR, region);
            self.write(RBAR, block.start);
            let size = u64::from((block.end - block.start).ilog2() - 1);
            self.write(RASR, FULL_ACCESS | size << 1 | ENABLED);
        }
        self.write(RNR, 0);
        self.done = true;
    }
}

/// Splits addresses into blocks of a size that is a power of two, each at a multiple of its size.
fn aligned(range: Range<u64>) -> Vec<Range<u64>> {
    let (mut blocks, mut at) = (Vec::new(), range.start);
    while at < range.end {
        let most = 1 << (range.end - at).ilog2();
        let size = if at == 0 { most } else { most.min(1 << at.trailing_zeros()) };
        blocks.push(at..at + size);
        at += size;
    }
    blocks
}

impl Processor for Cpu {
    fn run(&mut self, budget: u32, bus: &mut dyn CoreBus) -> (Exit, u64) {
        let ran = self.part.run(budget, bus);
        if !self.done {
            self.open();
        }
        ran
    }

    fn reset(&mut self) {
        self.done = false;
        self.part.reset();
    }

    // The part handles everything else.

    fn retired(&self) -> u64 {
        self.part.retired()
    }

    fn ask(&mut self, queued: Queued) {
        self.part.ask(queued);
    }

    fn maps(&self, start: u64, length: u64) -> bool {
        self.part.maps(start, length)
    }

    fn page_size(&self) -> u64 {
        self.part.page_size()
    }

    unsafe fn map(&mut self, start: u64, length: u64, host: *mut u8, writable: bool) {
        // SAFETY: the caller's promise is the same, and the part's processor is dropped with this.
        unsafe { self.part.map(start, length, host, writable) };
    }

    fn boot(&mut self, table: u64, read: &dyn Fn(u64, Width) -> Option<u64>) {
        self.part.boot(table, read);
    }

    fn take_reset_request(&mut self) -> bool {
        self.part.take_reset_request()
    }

    fn next_event(&self) -> Option<VirtualNanos> {
        self.part.next_event()
    }

    fn on_event(&mut self, now: VirtualNanos) {
        self.part.on_event(now);
    }

    fn waiting(&self) -> bool {
        self.part.waiting()
    }

    fn pc(&self) -> u64 {
        self.part.pc()
    }

    fn add_breakpoint(&mut self, address: u64) -> bool {
        self.part.add_breakpoint(address)
    }

    fn remove_breakpoint(&mut self, address: u64) {
        self.part.remove_breakpoint(address);
    }

    fn pass_breakpoint(&mut self, address: u64) {
        self.part.pass_breakpoint(address);
    }

    fn data_model(&self) -> DataModel {
        self.part.data_model()
    }

    fn byte_order(&self, address: u64) -> Endian {
        self.part.byte_order(address)
    }

    fn save(&self) -> Vec<u8> {
        self.part.save()
    }

    fn load(&mut self, bytes: &[u8]) -> Result<(), Error> {
        self.part.load(bytes)
    }

    fn check_reads(&mut self, every: bool) {
        self.part.check_reads(every);
    }

    fn check_words(&mut self, words: &[u64]) {
        self.part.check_words(words);
    }

    fn host_call(&self, read: &mut dyn FnMut(u64, Width) -> Option<u64>) -> Option<HostCall> {
        self.part.host_call(read)
    }

    fn answer_host_call(&mut self, answer: Option<u64>) {
        self.part.answer_host_call(answer);
    }
}

#[cfg(test)]
mod tests {
    use super::aligned;

    #[test]
    fn blocks_of_a_region_are_aligned_to_their_size_and_cover_all_of_it() {
        assert_eq!(
            aligned(0x2401_0000..0x2408_0000),
            [0x2401_0000..0x2402_0000, 0x2402_0000..0x2404_0000, 0x2404_0000..0x2408_0000]
        );
        assert_eq!(aligned(0x2000_0000..0x2000_C000), [0x2000_0000..0x2000_8000, 0x2000_8000..0x2000_C000]);
        assert_eq!(aligned(0x2400_0000..0x2400_0000), []);
    }
}
