//! What happens before Embassy starts the clocks, and right after: the TX pins, the watchdog, the bootloader's word, the crystal.
//!
//! Embassy's `init` waits without an end for the crystal, the PLL, the regulator and the LSI. A crystal that died in
//! flight would leave a node that hangs in the first start after that. So the watchdog runs before anything waits, and
//! the crystal is tried here, with an end; without it the node runs on the chip's own oscillator.

use super::retained::RetainedWord;
use super::state::{Oscillator, ResetCause};
use super::{chip, watchdog};
use core::sync::atomic::{AtomicBool, Ordering};
use embassy_stm32::pac::{
    gpio::{
        Gpio,
        vals::{Moder, Pupdr},
    },
    iwdg::vals::Pr,
};

/// What is known before the clocks run.
#[derive(Clone, Copy)]
pub struct Early {
    /// Why the chip was reset.
    pub cause: ResetCause,
    /// What the clocks are to be made from.
    pub oscillator: Oscillator,
}

/// Set while the node runs without its crystal.
static WITHOUT_CRYSTAL: AtomicBool = AtomicBool::new(false);

/// To be called first, before `embassy_stm32::init`, with the TX and RX pins of every ECU port, and whether an external clock
/// comes in place of a crystal.
pub fn begin(tx: &[(Gpio, usize)], rx: &[(Gpio, usize)], bypass: bool) -> Early {
    // A line that is not driven rests high. After a reset TX floats, and some bootloaders drive it low, which an ECU
    // takes for a break. They may drive RX low, too, against the ECU's own transmitter.
    chip::clock_gpio();
    for &(port, pin) in tx.iter().chain(rx) {
        port.pupdr().modify(|w| w.set_pupdr(pin, Pupdr::PULL_UP));
        port.moder().modify(|w| w.set_moder(pin, Moder::INPUT));
    }
    #[cfg(feature = "selftest")]
    super::selftest::look_at_tx(tx);
    // A probe that halts the core must not be answered by a reset.
    chip::freeze_watchdog_while_halted();
    // Before the watchdog: what it ends from here on, the bootloader lets start again.
    #[cfg(feature = "ardupilot-bootloader")]
    super::ardupilot::start_at_once();
    // 2.0 s at 32 kHz; 1.4 s to 3.9 s on an F427, 2.0 s to 2.2 s on an H743, by the LSI's
    // range (17 to 47 kHz, DS9405, table 42; 29.4 to 33.6 kHz, DS12110, table 146). The start takes some milliseconds, and
    // 0.1 s more without a crystal.
    watchdog::watch(Pr::from_bits(2), 0xFFF);
    super::stack::paint();
    let cause = chip::reset_cause();
    #[cfg(feature = "ardupilot-bootloader")]
    let cause = if take_restart() && cause == ResetCause::Unknown { ResetCause::Restart } else { cause };
    let crystal = chip::start_crystal(bypass, !has_stopped(cause));
    #[cfg(feature = "selftest")]
    let crystal = crystal && !super::selftest::wants_internal_oscillator();
    let oscillator = if crystal { Oscillator::Crystal } else { Oscillator::Internal };
    WITHOUT_CRYSTAL.store(oscillator == Oscillator::Internal, Ordering::Relaxed);
    // Still on the chip's own oscillator, whose speed the flash allows at any voltage.
    chip::wait_for_supply(watchdog::feed);
    chip::before_init();
    Early { cause, oscillator }
}

/// To be called right after `embassy_stm32::init`.
pub fn finish(early: Early) {
    // Again: `init` may have reset what holds the word.
    #[cfg(feature = "ardupilot-bootloader")]
    super::ardupilot::start_at_once();
    if early.oscillator == Oscillator::Crystal {
        chip::watch_crystal();
    }
    chip::speed_up();
    chip::watch_supply();
}

/// Ends the firmware. A plain image by a reset.
#[cfg(not(feature = "ardupilot-bootloader"))]
pub fn end() -> ! {
    cortex_m::peripheral::SCB::sys_reset()
}

/// Ends the firmware. Behind an ArduPilot bootloader by the watchdog: after any other reset some bootloaders wait 5 s
/// for an upload. And without a crystal not by a reset at all: the bootloader waits for it without an end.
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

/// `RESTARTED` from a restart to the next start: no flag of a reset reports one, and what is retained is as good as
/// after any other.
// SAFETY: the linker puts this section into RAM that start-up leaves as it is. Every bit pattern is valid, and only one
// is used, where no flag says that the RAM may have been without power.
#[cfg(feature = "ardupilot-bootloader")]
#[unsafe(link_section = ".retained.restart")]
static RESTART: RetainedWord = RetainedWord::new();

#[cfg(feature = "ardupilot-bootloader")]
const RESTARTED: u32 = 0x7E57_A27D;

/// Whether this start is a restart. To be called once.
#[cfg(feature = "ardupilot-bootloader")]
fn take_restart() -> bool {
    let restarted = RESTART.get() == Some(RESTARTED);
    RESTART.set(0);
    restarted
}

/// Goes back to the image's first instruction, from wherever this is called.
#[cfg(feature = "ardupilot-bootloader")]
pub fn restart() -> ! {
    RESTART.set(RESTARTED);
    // SAFETY: `Reset` and `__pre_init` (start.rs) rely on nothing: they leave the handler that this may be called in,
    // set the stack and initialise the memory. Nothing runs on after this.
    unsafe { core::arch::asm!("cpsid i", "b Reset", options(noreturn)) }
}

/// `HAS_STOPPED` if the crystal has stopped since the power came on: one that comes and goes would otherwise reset the node
/// over and over.
// SAFETY: the linker puts this section into RAM that start-up leaves as it is. Every bit pattern is valid, and only one
// is used, where no flag says that the RAM may have been without power.
#[unsafe(link_section = ".retained.crystal")]
static STOPPED: RetainedWord = RetainedWord::new();

const HAS_STOPPED: u32 = 0xC2_57_A1_0F;

/// Whether the crystal has stopped since the power came on.
fn has_stopped(cause: ResetCause) -> bool {
    if matches!(cause, ResetCause::PowerOn | ResetCause::BrownOut) {
        STOPPED.set(0);
    }
    STOPPED.get() == Some(HAS_STOPPED)
}

/// Notes for the next start that the crystal has stopped: it then does without.
pub fn crystal_has_stopped() {
    chip::clear_crystal_alarm();
    STOPPED.set(HAS_STOPPED);
}
