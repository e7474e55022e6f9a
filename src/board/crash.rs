//! What happens when the firmware fails: it logs the location and resets. A node that is back in milliseconds is better
//! for an engine than one that hangs.

use core::sync::atomic::{AtomicBool, Ordering};

use cortex_m::peripheral::{DCB, SCB};

#[cfg(feature = "stm32")]
use super::early::end;
use cortex_m_rt::{ExceptionFrame, exception};

#[panic_handler]
fn panic(info: &core::panic::PanicInfo) -> ! {
    crash(|| match info.location() {
        Some(at) => defmt::error!("panic at {=str}:{=u32}, resetting", at.file(), at.line()),
        None => defmt::error!("panic, resetting"),
    })
}

#[exception]
unsafe fn HardFault(frame: &ExceptionFrame) -> ! {
    // SAFETY: a read of two status registers of the core.
    let (cfsr, hfsr) = unsafe { ((*SCB::PTR).cfsr.read(), (*SCB::PTR).hfsr.read()) };
    crash(|| {
        defmt::error!(
            "hard fault at {=u32:#010x}, called from {=u32:#010x}, CFSR {=u32:#010x}, HFSR {=u32:#010x}, resetting",
            frame.pc(),
            frame.lr(),
            cfsr,
            hfsr
        )
    })
}

#[exception]
unsafe fn DefaultHandler(interrupt: i16) {
    crash(|| defmt::error!("interrupt {=i16} has no handler, resetting", interrupt))
}

/// Logs and resets.
pub fn crash(log: impl FnOnce()) -> ! {
    cortex_m::interrupt::disable();
    // A crash inside the logger would come back here through the logger's own panic: log only once.
    static LOGGED: AtomicBool = AtomicBool::new(false);
    if !LOGGED.swap(true, Ordering::Relaxed) {
        log();
        if DCB::is_debugger_attached() {
            // About 0.1 s, for the probe to fetch the log from RAM.
            cortex_m::asm::delay(20_000_000);
        }
    }
    end()
}

/// Ends the firmware with a reset.
#[cfg(not(feature = "stm32"))]
fn end() -> ! {
    SCB::sys_reset()
}
