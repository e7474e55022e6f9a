//! How deep the stack gets. The RAM below it is painted; the lowest word that is no longer paint is its high-water mark.

use super::guard;
use cortex_m::register::msp;

/// Most that is painted, in bytes: it costs time at every start, on the chip's own slow oscillator.
pub const MOST: u32 = 64 * 1024;

/// Left alone below the stack pointer: a build without optimisation calls functions while it paints.
const MARGIN: u32 = 256;

/// No address, no instruction that is used, no small number.
const PAINT: u32 = 0xC5C5_C5C5;

unsafe extern "C" {
    /// Where the stack begins (cortex-m-rt's linker script).
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

/// Forgets the mark: what is painted from here on shows how deep the stack gets from here on. In thread mode only.
pub fn paint() {
    let end = msp::read().saturating_sub(MARGIN);
    for at in (bottom()..end).step_by(4) {
        // SAFETY: RAM that the linker gave to the stack alone, above the guard and below all that is in use. An
        // interrupt in between uses some of it, and is done with it before this goes on.
        unsafe { (at as *mut u32).write_volatile(PAINT) }
    }
}

/// How many bytes deep the stack has been since it was painted. [`MOST`] means that or more.
pub fn deepest() -> u32 {
    // SAFETY: RAM that is always there and has no destructor, read as plain words. Whoever uses it meanwhile only makes
    // this a moment old.
    let painted = |at: &u32| unsafe { (*at as *const u32).read_volatile() } == PAINT;
    let touched = (bottom()..top()).step_by(4).find(|at| !painted(at));
    top() - touched.unwrap_or(top())
}
