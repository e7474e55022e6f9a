//! What happens when the firmware fails: it logs the location and resets. A node that is back in milliseconds is better
//! for an engine than one that hangs.

use core::sync::atomic::{AtomicBool, Ordering};

use cortex_m::peripheral::SCB;

#[cfg(feature = "stm32")]
use super::{chip, early::end, wait, watchdog};
use cortex_m_rt::{ExceptionFrame, exception};

/// The compiler does not see what comes next, as that may panic, too: in a circle it would keep the messages of all panics, which nothing reads,
/// and what formats them.
#[panic_handler]
fn panic(info: &core::panic::PanicInfo) -> ! {
    core::hint::black_box(panicked as fn(Option<&core::panic::Location<'_>>) -> !)(info.location())
}

#[inline(never)]
fn panicked(at: Option<&core::panic::Location>) -> ! {
    crash(|| match at {
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

/// Logs and resets, because the firmware has failed.
pub fn crash(log: impl FnOnce()) -> ! {
    cortex_m::interrupt::disable();
    #[cfg(feature = "stm32")]
    if jetlink_fw::config::OUTPUTS.is_some() {
        super::starts::crash();
    }
    reset(log)
}

/// Logs and resets, on command, or because of something that the firmware has no part in: this start has not failed.
pub fn leave(log: impl FnOnce()) -> ! {
    cortex_m::interrupt::disable();
    #[cfg(feature = "stm32")]
    if jetlink_fw::config::OUTPUTS.is_some() {
        super::starts::leave();
    }
    reset(log)
}

fn reset(log: impl FnOnce()) -> ! {
    // A crash inside the logger would come back here through the logger's own panic: log only once.
    static LOGGED: AtomicBool = AtomicBool::new(false);
    if !LOGGED.swap(true, Ordering::Relaxed) {
        log();
        #[cfg(feature = "stm32")]
        if cortex_m::peripheral::DCB::is_debugger_attached() {
            let_probe_fetch_log();
        }
    }
    end()
}

/// 0.1 s, for the probe to fetch the log from RAM. It feeds the watchdog, so that the reset is the firmware's own.
#[cfg(feature = "stm32")]
fn let_probe_fetch_log() {
    for _ in 0..100 {
        watchdog::feed();
        wait::until(chip::core_hz() / 1000, || false);
    }
}

/// Ends the firmware with a reset.
#[cfg(not(feature = "stm32"))]
fn end() -> ! {
    SCB::sys_reset()
}
