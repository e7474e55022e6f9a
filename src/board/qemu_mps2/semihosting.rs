//! Semihosting: the log, and the end of a trial. QEMU serves these calls; on a board without a
//! debugger, each one would cause a fault.
//!
//! The logger of the crate `defmt-semihosting` makes one call for each byte of a frame, with all
//! interrupts off. This one makes one call for each frame.

use core::arch::asm;
use core::cell::UnsafeCell;
use critical_section::RestoreState;
use heapless::Vec;

const OPEN: usize = 0x01;
const WRITE: usize = 0x05;
#[cfg(any(feature = "trial", feature = "count"))]
const EXIT_EXTENDED: usize = 0x20;

/// Calls QEMU.
///
/// # Safety
///
/// `arguments` must be those that `operation` requires, including the targets of any pointers.
unsafe fn call(operation: usize, arguments: &[usize]) -> usize {
    let mut result = operation;
    // SAFETY: guaranteed by the caller. The call takes r0 and r1 and returns r0; nothing else changes.
    unsafe { asm!("bkpt 0xAB", inout("r0") result, in("r1") arguments.as_ptr(), options(nostack)) };
    result
}

/// Ends QEMU with this exit status.
#[cfg(any(feature = "trial", feature = "count"))]
pub fn exit(status: u8) -> ! {
    const APPLICATION_EXIT: usize = 0x20026;
    // SAFETY: this operation takes a reason and a number.
    unsafe { call(EXIT_EXTENDED, &[APPLICATION_EXIT, status.into()]) };
    loop {
        cortex_m::asm::wfi();
    }
}

/// Opens QEMU's console.
fn open_console() -> usize {
    const NAME: &[u8] = b":tt\0";
    const FOR_WRITING: usize = 4;
    // SAFETY: this operation takes a name that ends in 0, a mode, and the name's length without
    // the 0.
    unsafe { call(OPEN, &[NAME.as_ptr() as usize, FOR_WRITING, NAME.len() - 1]) }
}

fn write(handle: usize, bytes: &[u8]) {
    // SAFETY: this operation takes a handle that was opened, bytes and their number, and reads them.
    unsafe { call(WRITE, &[handle, bytes.as_ptr() as usize, bytes.len()]) };
}

#[defmt::global_logger]
struct Logger;

struct State {
    encoder: defmt::Encoder,
    restore: RestoreState,
    console: Option<usize>,
    frame: Vec<u8, 1024>,
}

struct Shared(UnsafeCell<State>);

// SAFETY: all code that uses the state holds the critical section that `acquire` took.
unsafe impl Sync for Shared {}

static STATE: Shared = Shared(UnsafeCell::new(State {
    encoder: defmt::Encoder::new(),
    restore: RestoreState::invalid(),
    console: None,
    frame: Vec::new(),
}));

impl State {
    fn encode(&mut self, encode: impl FnOnce(&mut defmt::Encoder, &mut dyn FnMut(&[u8]))) {
        let frame = &mut self.frame;
        // A frame that is too long is cut off, which its decoder reports.
        encode(&mut self.encoder, &mut |bytes| {
            let _ = frame.extend_from_slice(bytes);
        });
    }
}

// SAFETY: `acquire` takes a critical section, and `release` ends it; defmt calls them in pairs, and
// `write` in between.
unsafe impl defmt::Logger for Logger {
    fn acquire() {
        // SAFETY: `release` ends it.
        let restore = unsafe { critical_section::acquire() };
        // SAFETY: inside the critical section. A panic inside a frame would call this again, but it
        // has no other way to log, and resets afterwards.
        let state = unsafe { &mut *STATE.0.get() };
        state.restore = restore;
        state.frame.clear();
        state.encode(|encoder, write| encoder.start_frame(write));
    }

    unsafe fn flush() {}

    unsafe fn release() {
        // SAFETY: between `acquire` and `release`, inside the critical section.
        let state = unsafe { &mut *STATE.0.get() };
        state.encode(|encoder, write| encoder.end_frame(write));
        let console = *state.console.get_or_insert_with(open_console);
        write(console, &state.frame);
        // SAFETY: the state that `acquire` got; what follows no longer uses ours.
        unsafe { critical_section::release(state.restore) };
    }

    unsafe fn write(bytes: &[u8]) {
        // SAFETY: between `acquire` and `release`, inside the critical section.
        let state = unsafe { &mut *STATE.0.get() };
        state.encode(|encoder, write| encoder.write(bytes, write));
    }
}
