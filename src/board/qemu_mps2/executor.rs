//! The executor of thread mode. Embassy's own sleeps with WFE, which QEMU does not implement as a sleep: it would occupy a
//! core of the host, and count every pass of an idle loop as work. This one sleeps with WFI.

use super::hardware::{Handler, Irq, unmask};
use core::sync::atomic::{AtomicBool, Ordering};
use embassy_executor::{Spawner, raw};

/// The touch screen's interrupt, which nothing here uses: it signals that a task was woken.
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
        // Called by embassy-executor when a task is woken: triggers this interrupt.
        Self(raw::Executor::new(usize::from(INTERRUPT.0) as *mut ()))
    }

    /// Runs forever.
    pub fn run(&'static mut self, init: impl FnOnce(Spawner)) -> ! {
        init(self.0.spawner());
        unmask(INTERRUPT);
        loop {
            // WFI also ends on a pending interrupt while interrupts are off, so none can be missed between the
            // check and the sleep.
            cortex_m::interrupt::disable();
            if !WOKEN.load(Ordering::Relaxed) {
                cortex_m::asm::wfi();
            }
            // SAFETY: outside of any critical section.
            unsafe { cortex_m::interrupt::enable() };
            if WOKEN.swap(false, Ordering::Relaxed) {
                // SAFETY: polled only here, so never reentrantly.
                unsafe { self.0.poll() };
            }
        }
    }
}
