//! Starts of the firmware that failed, in memory that survives a reset: what bounds them is `jetlink_rc::starts`. Only images with outputs use
//! it.

use super::retained::RetainedWord;
use super::state::ResetCause;
use embassy_time::{Duration, Instant};
use jetlink_rc::starts::{Ended, FailedStarts};

/// Time of failed starts in a row, and the valves that are closed for it.
// SAFETY: the linker puts this section into RAM that start-up does not touch. Every bit pattern is valid, and only a word with its
// inverse is used.
#[unsafe(link_section = ".retained.failed")]
static FAILED: RetainedWord = RetainedWord::new();

/// Time of the crash that ended the start before, in ms and one; 0: there was none. Or [`LEFT`].
// SAFETY: as above.
#[unsafe(link_section = ".retained.crashed")]
static CRASHED: RetainedWord = RetainedWord::new();

/// The firmware ended, and had not failed: [`leave`].
const LEFT: u32 = u32::MAX;

/// A start begins. Returns what failed before it. Call it once, before the clock runs.
pub fn begin(cause: ResetCause) -> FailedStarts {
    let noted = CRASHED.get().unwrap_or(0);
    CRASHED.set(0);
    // Behind an ArduPilot bootloader, everything that is noted also ends by the watchdog.
    let ended = match (noted, cause) {
        (LEFT, _) => Ended::Otherwise,
        (1.., _) => Ended::Crashed(Duration::from_millis(u64::from(noted - 1))),
        (0, ResetCause::Watchdog | ResetCause::WindowWatchdog) => Ended::Hung,
        (0, _) => Ended::Otherwise,
    };
    let failed = FailedStarts::retained(FAILED.get()).after(ended);
    FAILED.set(failed.number());
    failed
}

/// This start has not failed; which valves stay closed for earlier ones.
pub fn has_lived(cut: impl IntoIterator<Item = bool>) {
    let number = FailedStarts::lived(cut).number();
    if FAILED.get() != Some(number) {
        FAILED.set(number);
    }
}

/// The firmware crashes. May be called from anywhere.
#[expect(clippy::disallowed_methods, reason = "how long it lived")]
pub fn crash() {
    // Before the clock runs it says 0.
    let ms = u32::try_from(Instant::now().as_millis()).unwrap_or(u32::MAX);
    CRASHED.set(ms.saturating_add(1).min(LEFT - 1));
}

/// The firmware ends, and has not failed: a command, the supply or the crystal ends it. May be called from anywhere.
pub fn leave() {
    CRASHED.set(LEFT);
}
