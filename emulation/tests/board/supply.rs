//! The Pixracer's supply: an F427 without option bytes for it resets only far below what its flash needs at 168 MHz. The
//! emulator has the voltage detector, and no line from it to an interrupt: a few instructions in RAM pend that.

use crate::support::{Task, hijack};
use emulation::{Bench, Image, PIXRACER, Run};
use sim::ecu::{MILLIS, SECOND};

#[test]
fn a_start_waits_for_a_supply_that_the_flash_can_work_with() {
    let report = Run::new(&PIXRACER, Image::Release)
        .engines()
        .at(0, |bench| bench.supply(2800))
        // Longer than the watchdog waits.
        .at(2500 * MILLIS, |bench| bench.supply(2900))
        .at(2600 * MILLIS, |bench| bench.supply(3000))
        .until(4 * SECOND)
        .go();
    let hello = report.when("last reset: power-on");
    assert!((2600 * MILLIS..2612 * MILLIS).contains(&hello), "{hello}");
}

/// The supply falls to 2.8 V, and when the engines' task runs next, the detector's interrupt comes.
pub fn drop_supply(bench: &mut Bench<'_>, image: Image) {
    bench.supply(2800);
    // movw r0, #0xE200; movt r0, #0xE000; mov.w r1, #2; str r1, [r0]; bx lr: interrupt 1 in NVIC_ISPR.
    let code = PIXRACER.ram.start + 0x18000;
    for (i, word) in [0x2000_F24E, 0x0000_F2CE, 0x0102_F04F, 0x4770_6001].into_iter().enumerate() {
        bench.set_word(code + 4 * i as u64, word);
    }
    hijack(bench, &PIXRACER, image, Task::Engine, code);
}

#[test]
fn a_supply_that_falls_resets_and_the_next_start_waits() {
    let report = Run::new(&PIXRACER, Image::Release)
        .engines()
        .at(1500 * MILLIS, |bench| drop_supply(bench, Image::Release))
        .at(2 * SECOND, |bench| bench.supply(3300))
        .resets(1)
        .with_errors()
        .until(4 * SECOND)
        .go();
    assert_eq!(report.lines("the supply is below 2.84 V, resetting").count(), 1, "{}", report.log_text());
    let again = report.when("last reset: software");
    assert!((2 * SECOND..2012 * MILLIS).contains(&again), "{again}");
    assert!(report.lines("left: ECU link up").next_back().expect("up again").at > again);
}

/// No line leads from the emulator's detector to an interrupt, so the test checks the registers of that line: 2.84 V, rising
/// edge, a pending flag cleared, and only then enabled.
#[test]
fn the_detector_raises_an_interrupt_from_the_start_on() {
    const PWR_CR: u64 = 0x4000_7000;
    const EXTI: u64 = 0x4001_3C00;
    const IMR: u64 = EXTI;
    const RTSR: u64 = EXTI + 0x08;
    const PR: u64 = EXTI + 0x14;
    let run = Run::new(&PIXRACER, Image::Release).engines();
    let run = [PWR_CR, IMR, RTSR, PR].into_iter().fold(run, |run, register| run.record(register));
    let report = run.until(500 * MILLIS).go();
    let last = |register: u64, bits: u64| {
        let mut set = report.written.iter().filter(|write| write.register == register);
        let last = set.next_back().expect("it is written");
        assert_eq!(last.value & bits, bits, "{register:#x}: {:#x}", last.value);
        last.at
    };
    last(PWR_CR, 1 << 4 | 5 << 5);
    last(RTSR, 1 << 16);
    assert!(last(PR, 1 << 16) < last(IMR, 1 << 16));
}
