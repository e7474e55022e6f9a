//! Waits with a timeout, for where no executor runs: in the start and in a crash. SysTick times them; nothing else in these
//! images uses it, since Embassy's time driver has a timer of the chip.

use cortex_m::peripheral::{Peripherals, syst::SystClkSource};

/// Waits until `done`, but no longer than this number of cycles of the core, 16 million at most. Returns whether it is done.
///
/// Not `cortex_m::asm::delay`: its number is a lower limit. A pass of its loop takes 3 cycles and more on a Cortex-M4, and the
/// flash's wait states on top.
pub fn until(cycles: u32, done: impl Fn() -> bool) -> bool {
    // SAFETY: see above, nothing else uses SysTick; a crash in the middle of a wait does not return to it.
    let mut timer = unsafe { Peripherals::steal() }.SYST;
    timer.set_clock_source(SystClkSource::Core);
    timer.set_reload(cycles.saturating_sub(1));
    timer.clear_current();
    timer.enable_counter();
    let is_done = loop {
        if done() {
            break true;
        }
        if timer.has_wrapped() {
            break done();
        }
    };
    timer.disable_counter();
    is_done
}
