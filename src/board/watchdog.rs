//! The watchdog, through its registers: it has to run before Embassy's driver can.

use super::chip;
use embassy_stm32::pac::iwdg::vals::{Key, Pr};

/// Starts the watchdog, or changes the timeout of one that is running: it counts down from `reload`, each count taking 4, 8,
/// 16 … periods of its oscillator.
pub fn watch(prescaler: Pr, reload: u16) {
    let watchdog = chip::WATCHDOG;
    watchdog.kr().write(|w| w.set_key(Key::START));
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
/// firmware sets. The wait has a timeout, because a watchdog whose LSI does not run never gets ready.
fn settled() {
    let step = chip::core_hz() / 100_000; // 10 µs
    for _ in 0..10_000 {
        if chip::WATCHDOG.sr().read().0 == 0 {
            return;
        }
        cortex_m::asm::delay(step);
    }
}
