//! Measures the depth of the stack. The RAM below it is painted; the lowest word without paint is the high-water mark.

use super::guard;
use cortex_m::register::msp;

/// Largest area painted, in bytes: painting takes time at every start, on the slow internal oscillator.
pub const MOST: u32 = 64 * 1024;

/// Area below the stack pointer that is not painted: a build without optimisation calls functions while it paints.
const MARGIN: u32 = 256;

/// The paint: not an address, an instruction in use or a small number.
const PAINT: u32 = 0xC5C5_C5C5;

unsafe extern "C" {
    /// Start of the stack (cortex-m-rt's linker script).
    static _stack_start: u32;
}

/// The first address above the stack.
fn top() -> u32 {
    &raw const _stack_start as u32
}

/// The lowest address that is painted, above the guard.
fn bottom() -> u32 {
    (top() - MOST).max(guard::end())
}

/// Paints again, so that the mark shows the depth from now on. In thread mode only.
pub fn paint() {
    let end = msp::read().saturating_sub(MARGIN);
    for at in (bottom()..end).step_by(4) {
        // SAFETY: RAM that the linker reserved for the stack, above the guard and below the part in use. An interrupt
        // in between uses some of it, and has finished with it before this continues.
        unsafe { (at as *mut u32).write_volatile(PAINT) }
    }
}

/// Depth of the stack since it was painted, in bytes. [`MOST`] means that or more.
pub fn deepest() -> u32 {
    // SAFETY: RAM that always exists and has no destructor, read as plain words. A write in the meantime only makes the
    // result slightly old.
    let painted = |at: &u32| unsafe { (*at as *const u32).read_volatile() } == PAINT;
    let touched = (bottom()..top()).step_by(4).find(|at| !painted(at));
    top() - touched.unwrap_or(top())
}
