//! Steps before Embassy starts the clocks, and right after: the pins of the ports, the watchdog, the word for the bootloader, the
//! crystal. The first of them are made before the RAM is initialised.
//!
//! Embassy's `init` waits without a timeout for the crystal, the PLL, the regulator and the LSI. If the crystal failed in
//! flight, the node would hang in its next start. So the watchdog runs before anything waits, and the crystal is tested
//! here with a timeout; without it, the node runs on the internal oscillator.

use super::first::Step;
use super::retained::RetainedWord;
use super::state::{Oscillator, ResetCause};
use super::{chip, watchdog};
use core::sync::atomic::{AtomicBool, Ordering};
use embassy_stm32::pac::{gpio::Gpio, iwdg::vals::Pr};

/// What is known before the clocks run.
#[derive(Clone, Copy)]
pub struct Early {
    /// Why the chip was reset.
    pub cause: ResetCause,
    /// Source of the clocks.
    pub oscillator: Oscillator,
}

/// Set while the node runs without its crystal.
static WITHOUT_CRYSTAL: AtomicBool = AtomicBool::new(false);

/// Makes a pin an input with a pull-up (PUPDR, then MODER).
///
/// An idle line is high. After a reset TX floats, and some bootloaders drive it low, which an ECU reads as a break. They may
/// also drive RX low, against the ECU's transmitter.
pub const fn pull_up(gpio: Gpio, pin: usize) -> [Step; 2] {
    let [field, pulled_up] = [0b11 << (2 * pin), 0b01 << (2 * pin)];
    [Step::modify(gpio.as_ptr(), 0x0C, field, pulled_up), Step::modify(gpio.as_ptr(), 0x00, field, 0)]
}

/// The request to an ArduPilot bootloader, if there is one. It comes before the watchdog: after a reset from then on, the
/// bootloader starts the firmware again at once.
#[cfg(feature = "ardupilot-bootloader")]
pub const REQUEST_TO_BOOTLOADER: &[Step] = super::ardupilot::REQUEST;
#[cfg(not(feature = "ardupilot-bootloader"))]
pub const REQUEST_TO_BOOTLOADER: &[Step] = &[];

/// Call this first, before `embassy_stm32::init`, and say whether an external clock replaces the crystal. Does `first` before
/// anything else, on the oscillator that runs.
pub fn begin(bypass: bool, first: impl FnOnce(ResetCause)) -> Early {
    let cause = chip::reset_cause();
    #[cfg(feature = "ardupilot-bootloader")]
    let cause = if take_restart() && cause == ResetCause::Unknown { ResetCause::Restart } else { cause };
    first(cause);
    // `__pre_init` has started the watchdog. Now 2.0 s at 32 kHz; 1.4 s to 3.9 s on an F427, 2.0 s to 2.2 s on an H743, by the LSI's
    // range (17 to 47 kHz, DS9405, table 42; 29.4 to 33.6 kHz, DS12110, table 146). The start takes some milliseconds, and
    // 0.1 s more without a crystal.
    watchdog::watch(Pr::from_bits(2), 0xFFF);
    super::stack::paint();
    let crystal = chip::start_crystal(bypass, !has_stopped(cause));
    #[cfg(feature = "selftest")]
    let crystal = crystal && !super::selftest::wants_internal_oscillator();
    let oscillator = if crystal { Oscillator::Crystal } else { Oscillator::Internal };
    WITHOUT_CRYSTAL.store(oscillator == Oscillator::Internal, Ordering::Relaxed);
    // Still on the internal oscillator, at a speed that the flash supports at any voltage.
    chip::wait_for_supply(watchdog::feed);
    chip::before_init();
    Early { cause, oscillator }
}

/// Call this right after `embassy_stm32::init`.
pub fn finish(early: Early) {
    // Again: `init` may have reset the backup domain, which holds the word.
    #[cfg(feature = "ardupilot-bootloader")]
    super::ardupilot::start_at_once();
    if early.oscillator == Oscillator::Crystal {
        chip::watch_crystal();
    }
    chip::speed_up();
    chip::watch_supply();
}

/// Ends the firmware. A plain image: by a reset.
#[cfg(not(feature = "ardupilot-bootloader"))]
pub fn end() -> ! {
    cortex_m::peripheral::SCB::sys_reset()
}

/// Ends the firmware. Behind an ArduPilot bootloader: by the watchdog, because after any other reset some bootloaders wait
/// 5 s for an upload. Without a crystal: not by a reset at all, because the bootloader would wait for the crystal forever.
#[cfg(feature = "ardupilot-bootloader")]
pub fn end() -> ! {
    if WITHOUT_CRYSTAL.load(Ordering::Relaxed) {
        restart();
    }
    super::ardupilot::start_at_once();
    watchdog::watch(Pr::from_bits(0), 0);
    loop {
        cortex_m::asm::nop();
    }
}

/// `RESTARTED` from a restart to the next start. No reset flag reports a restart, and retained state is as valid as after a
/// reset.
// SAFETY: the linker puts this section into RAM that start-up does not touch. Every bit pattern is valid, and only one is
// used, when no flag indicates that the RAM may have lost power.
#[cfg(feature = "ardupilot-bootloader")]
#[unsafe(link_section = ".retained.restart")]
static RESTART: RetainedWord = RetainedWord::new();

#[cfg(feature = "ardupilot-bootloader")]
const RESTARTED: u32 = 0x7E57_A27D;

/// Whether this start is a restart. Call it once.
#[cfg(feature = "ardupilot-bootloader")]
fn take_restart() -> bool {
    let restarted = RESTART.get() == Some(RESTARTED);
    RESTART.set(0);
    restarted
}

/// Jumps to the image's first instruction. May be called from anywhere.
#[cfg(feature = "ardupilot-bootloader")]
pub fn restart() -> ! {
    RESTART.set(RESTARTED);
    // SAFETY: `Reset` and `__pre_init` (start.rs) make no assumptions: they leave the handler that this may be called in,
    // set the stack and initialise the memory. No code continues after this.
    unsafe { core::arch::asm!("cpsid i", "b Reset", options(noreturn)) }
}

/// `HAS_STOPPED` if the crystal has stopped since power-on: an intermittent crystal would otherwise reset the node again and
/// again.
// SAFETY: the linker puts this section into RAM that start-up does not touch. Every bit pattern is valid, and only one is
// used, when no flag indicates that the RAM may have lost power.
#[unsafe(link_section = ".retained.crystal")]
static STOPPED: RetainedWord = RetainedWord::new();

const HAS_STOPPED: u32 = 0xC2_57_A1_0F;

/// Whether the crystal has stopped since power-on.
fn has_stopped(cause: ResetCause) -> bool {
    if matches!(cause, ResetCause::PowerOn | ResetCause::BrownOut) {
        STOPPED.set(0);
    }
    STOPPED.get() == Some(HAS_STOPPED)
}

/// Records that the crystal has stopped, so that the next start does not use it.
pub fn crystal_has_stopped() {
    chip::clear_crystal_alarm();
    STOPPED.set(HAS_STOPPED);
}
