//! The executor of thread mode. Embassy's own sleeps with WFE, at which QEMU does not sleep: it would take a
//! core of the host for nothing, and count every turn of an idle loop as work. This one sleeps with WFI.

use super::hardware::{Handler, Irq, unmask};
use core::sync::atomic::{AtomicBool, Ordering};
use embassy_executor::{Spawner, raw};

/// The touch screen's, which nothing here uses: it says that a task was woken.
const INTERRUPT: Irq = Irq(15);

static WOKEN: AtomicBool = AtomicBool::new(false);

extern "C" fn woken() {
    WOKEN.store(true, Ordering::Relaxed);
}

/// Writes the executor's interrupt into the vector table.
pub const fn bind(table: &mut [Handler; 32]) {
    table[INTERRUPT.0 as usize] = woken;
}

/// Polls tasks in thread mode, like [`embassy_executor::Executor`].
pub struct Executor(raw::Executor);

impl Executor {
    /// Without tasks.
    pub fn new() -> Self {
        // What embassy-executor is to do when a task is woken: have this interrupt taken.
        Self(raw::Executor::new(usize::from(INTERRUPT.0) as *mut ()))
    }

    /// Runs for ever.
    pub fn run(&'static mut self, init: impl FnOnce(Spawner)) -> ! {
        init(self.0.spawner());
        unmask(INTERRUPT);
        loop {
            // WFI ends when an interrupt is pending, also while interrupts are off: none can come between the
            // look and the sleep.
            cortex_m::interrupt::disable();
            if !WOKEN.load(Ordering::Relaxed) {
                cortex_m::asm::wfi();
            }
            // SAFETY: outside of any critical section.
            unsafe { cortex_m::interrupt::enable() };
            if WOKEN.swap(false, Ordering::Relaxed) {
                // SAFETY: only here, so never from within itself.
                unsafe { self.0.poll() };
            }
        }
    }
}
