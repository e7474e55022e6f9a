//! The processor, with another watch of the guard below the stack that makes it faster.
//!
//! While the MPU is on, translated code leads to no other translated code, but back to the emulator after every few instructions, and
//! every access to memory is checked individually: a run takes about twice as long. The firmware uses the MPU for one region without
//! access, the guard below its stack (`src/board/guard.rs`). So once the guard is armed, the MPU is turned off, and the pages of the
//! guard are routed to the bus. An instruction that is about to access one of them turns the MPU on again, for good, and is then
//! executed: it faults as on the part. An exception whose registers would be saved in the guard ends in a bus fault there, in place of
//! a fault of the MPU: the firmware makes a hard fault of either. Code in the guard would be executed.
#![allow(unsafe_code)]

use core::ops::Range;
use rigless::emulator::{
    Access, Checked, CoreBus, DataModel, Error, Exit, HostCall, InterruptLine, Processor,
    ProcessorConstructor, Queued,
};
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
/// Field AP of RASR. 0: no access.
const ACCESS: u64 = 0b111 << 24;
const ENABLED: u64 = 1;

/// Makes the part's processor with this watch of the guard.
pub fn with_guard(processor: ProcessorConstructor) -> ProcessorConstructor {
    Arc::new(move |endian| Ok(Box::new(Cpu { part: processor(endian)?, watch: Watch::Unarmed })))
}

/// Who watches the guard, since the last reset.
#[derive(Clone, Debug, PartialEq, Eq)]
enum Watch {
    /// Nobody: the firmware has not armed it.
    Unarmed,
    /// The bus, at these addresses.
    Bus(Range<u64>),
    /// The MPU: the guard was hit.
    Mpu,
}

#[derive(Debug)]
struct Cpu {
    part: Box<dyn Processor>,
    watch: Watch,
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

    /// Once the guard is armed, the bus watches it in place of the MPU.
    fn lift(&mut self) {
        let Some(guard) = self.guard() else { return };
        self.write(CTRL, 0);
        self.pages(&guard).for_each(|page| self.part.ask(Queued::Route(page)));
        self.watch = Watch::Bus(guard);
    }

    /// The bus watches the guard no longer.
    fn release(&mut self, guard: &Range<u64>) {
        self.pages(guard).for_each(|page| self.part.ask(Queued::Unroute(page)));
    }

    /// The addresses of these pages.
    fn pages(&self, memory: &Range<u64>) -> impl Iterator<Item = u64> + use<> {
        memory.clone().step_by(self.part.page_size() as usize)
    }
}

/// The bus of a stretch, on which nothing may access the guard.
struct Guarded<'a> {
    bus: &'a mut dyn CoreBus,
    guard: &'a Range<u64>,
    /// Something was about to access it.
    hit: bool,
}

impl Guarded<'_> {
    fn hits(&mut self, access: &Access) -> bool {
        let hit = self.guard.contains(&access.address);
        self.hit |= hit;
        hit
    }
}

impl CoreBus for Guarded<'_> {
    /// An exception's registers: an instruction's access to the guard has been stopped before.
    fn access(&mut self, access: Access, from_code: bool) -> Option<u64> {
        if self.hits(&access) { None } else { self.bus.access(access, from_code) }
    }

    fn stops_before(&mut self, access: &Access) -> bool {
        self.hits(access) || self.bus.stops_before(access)
    }

    // The run handles everything else.

    fn time(&self, instructions: u64) -> VirtualNanos {
        self.bus.time(instructions)
    }

    fn queued(&mut self) -> Vec<Queued> {
        self.bus.queued()
    }

    fn carry_on(&mut self, instructions: u64, event: Option<VirtualNanos>) -> Option<u32> {
        self.bus.carry_on(instructions, event)
    }

    fn acknowledge(&mut self, line: InterruptLine, instructions: u64) -> Option<u64> {
        self.bus.acknowledge(line, instructions)
    }

    fn read_checked(&mut self, access: Access, report: bool) -> Option<Checked> {
        self.bus.read_checked(access, report)
    }

    fn write_checked(&mut self, access: Access) -> Option<bool> {
        self.bus.write_checked(access)
    }

    fn send_trace(&mut self, bytes: &[u8]) {
        self.bus.send_trace(bytes);
    }
}

impl Processor for Cpu {
    fn run(&mut self, budget: u32, bus: &mut dyn CoreBus) -> (Exit, u64) {
        let Watch::Bus(guard) = &self.watch else {
            let ran = self.part.run(budget, bus);
            if self.watch == Watch::Unarmed {
                self.lift();
            }
            return ran;
        };
        let guard = guard.clone();
        let mut guarded = Guarded { bus, guard: &guard, hit: false };
        let (exit, count) = self.part.run(budget, &mut guarded);
        if !guarded.hit {
            return (exit, count);
        }
        self.release(&guard);
        self.write(CTRL, ON);
        self.watch = Watch::Mpu;
        // The instruction has not been executed: the next stretch begins with it.
        (if exit == Exit::Halted { Exit::Returned } else { exit }, count)
    }

    fn reset(&mut self) {
        if let Watch::Bus(guard) = core::mem::replace(&mut self.watch, Watch::Unarmed) {
            self.release(&guard);
        }
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
