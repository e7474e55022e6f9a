//! The watchdog, through its registers: it has to run before the RAM is initialised, and before Embassy's driver can.

use super::chip;
use super::first::Step;
use embassy_stm32::pac::iwdg::vals::{Key, Pr};

/// Starts the watchdog before the RAM is initialised: IWDG_KR. It counts down from 4095, four periods of its oscillator each,
/// as after a reset: 0.35 s to 0.96 s on an F427, 0.49 s to 0.56 s on an H743. One that runs already, by the option bytes or a
/// bootloader, is fed with its own timeout instead.
pub const START: [Step; 2] =
    [Step::write(chip::WATCHDOG.as_ptr(), 0, 0xAAAA), Step::write(chip::WATCHDOG.as_ptr(), 0, 0xCCCC)];

/// Changes the timeout: the watchdog counts down from `reload`, each count taking 4, 8, 16 … periods of its oscillator.
pub fn watch(prescaler: Pr, reload: u16) {
    let watchdog = chip::WATCHDOG;
    settled();
    watchdog.kr().write(|w| w.set_key(Key::ENABLE));
    watchdog.pr().write(|w| w.set_pr(prescaler));
    watchdog.rlr().write(|w| w.set_rl(reload));
    settled();
    feed();
}

/// Feeds the watchdog: the full timeout begins again.
pub fn feed() {
    chip::WATCHDOG.kr().write(|w| w.set_key(Key::RESET));
}

/// Waits until a new prescaler and reload value have reached the watchdog's clock domain; before that, further writes are
/// ignored, and a feed may load the old values.
///
/// The manuals say five periods of the LSI (RM0433, 45.4.4; RM0090, 21.4.4). ST's HAL allows six, times the prescaler
/// (HAL_IWDG_DEFAULT_TIMEOUT in `stm32h7xx_hal_iwdg.c` and `stm32f4xx_hal_iwdg.c`), as does this: 90 ms with the
/// largest prescaler, 256, which a bootloader may have set, and the slowest LSI, 17 kHz; 5.6 ms with the largest that this
/// firmware sets. The wait has a timeout, because a watchdog whose LSI does not run never gets ready: 0.1 s, and longer by as much
/// as `cortex_m::asm::delay` is, whose number of cycles is a lower limit (half as much again on a Cortex-M4, and the flash's
/// wait states). Being late does no harm here: without an LSI the watchdog does not count either.
fn settled() {
    let step = chip::core_hz() / 100_000; // 10 µs
    for _ in 0..10_000 {
        if chip::WATCHDOG.sr().read().0 == 0 {
            return;
        }
        cortex_m::asm::delay(step);
    }
}
