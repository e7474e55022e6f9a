//! Waits of the start that never end: for a PLL, for the regulator, for an oscillator. The watchdog ends them, so it has to
//! run before the first one; and the image must not wait for the watchdog's own oscillator.

use crate::support::{on_each_board, symbol};
use emulation::board::Part;
use emulation::{Bench, Bootloader, Image, Jump, Leftover, Run, Stuck, Written};
use sim::ecu::{MILLIS, SECOND};
use std::sync::mpsc;

/// 4096 counts of 16 periods of the LSI.
const WATCHDOG: u64 = 2048 * MILLIS;

/// RCC_CR and RCC_CFGR, PWR_CR and PWR_CR3 or PWR_D3CR: the registers of clocks and voltage that a start may wait for.
fn clocks(part: Part) -> [u64; 4] {
    match part {
        Part::H743 => [0x5802_4400, 0x5802_4410, 0x5802_480C, 0x5802_4818],
        Part::F427 => [0x4002_3800, 0x4002_3808, 0x4000_7000, 0x4000_7004],
    }
}

#[test]
fn watchdog_starts_before_the_ram_is_initialised_and_any_clock_is_touched() {
    on_each_board(|board| {
        let run = Run::new(board, Image::Release).engines().record(board.watchdog).watch("__pre_init_end");
        let run = clocks(board.part).into_iter().fold(run, |run, register| run.record(register));
        let report = run.until(SECOND / 10).go();
        let [(before_ram, _)] = report.passed[..] else { panic!("{}: {:?}", board.name, report.passed) };
        let starts = |write: &&Written| write.register == board.watchdog && write.value == 0xCCCC;
        let started = report.written.iter().find(starts).expect("the watchdog starts").at;
        let clocks = clocks(board.part);
        let touched = report.written.iter().find(|write| clocks.contains(&write.register));
        let touched = touched.expect("the clocks are set").at;
        assert!(started < before_ram && before_ram < touched, "{}: {:x?}", board.name, report.written);
        assert_eq!(report.written.iter().filter(starts).count(), 1, "{}", board.name);
    });
}

/// 4096 counts of 4 periods of the LSI, as a reset leaves it, behind a bootloader too.
#[test]
fn start_that_never_gets_to_the_ram_ends_in_a_reset_by_the_watchdog() {
    const LEFT_BY_RESET: u64 = 512 * MILLIS;
    on_each_board(|board| {
        for image in [Image::Release, Image::Ardupilot] {
            // b . in place of the return.
            let hang = (symbol(board, image, "__pre_init_end"), vec![0xE7FE]);
            let run = Run::new(board, image).instructions_per_second(8_000_000).patch(hang.0, hang.1);
            let report = run.until(700 * MILLIS).go_unchecked().0;
            let [(at, cause)] = &report.resets[..] else { panic!("{image:?}: {:?}", report.resets) };
            assert_eq!(format!("{cause:?}"), "Model(\"IWDG\")", "{} {image:?}", board.name);
            let expected = LEFT_BY_RESET..LEFT_BY_RESET + 10 * MILLIS;
            assert!(expected.contains(at), "{} {image:?}: {at}", board.name);
        }
    });
}

#[test]
fn wait_that_never_ends_ends_in_a_reset_by_the_watchdog() {
    on_each_board(|board| {
        let waits = match board.part {
            Part::H743 => [Stuck::Pll, Stuck::VoltageScale],
            Part::F427 => [Stuck::Pll, Stuck::OverDrive],
        };
        for stuck in waits {
            // A slow core, because it spins for 2 s.
            let run = Run::new(board, Image::Release).engines().instructions_per_second(8_000_000);
            let run = run.at(0, move |bench| bench.jam(stuck));
            let report = run.resets(1).until(WATCHDOG + 900 * MILLIS).go_unchecked().0;
            let name = board.name;
            let [(at, cause)] = &report.resets[..] else {
                panic!("{name} {stuck:?}: {:?}\n{}", report.resets, report.log_text());
            };
            assert_eq!(format!("{cause:?}"), "Model(\"IWDG\")", "{name} {stuck:?}");
            assert!((WATCHDOG..WATCHDOG + 50 * MILLIS).contains(at), "{name} {stuck:?}: {at}");
            // It hung, so it logged nothing; the next start succeeds.
            let first = &report.logs[0];
            assert!(first.at > *at && first.text.ends_with("last reset: watchdog"), "{}", report.log_text());
            assert!(report.logged("left: ECU link up"), "{name} {stuck:?}: {}", report.log_text());
        }
    });
}

/// The watchdog runs on the LSI: a wait for an LSI that is dead would never end. The emulator's LSI cannot fail while the
/// watchdog runs, so the test checks the request for it: bit 0 of RCC_CSR, for which Embassy would then wait.
#[test]
fn plain_image_does_not_request_the_lsi() {
    on_each_board(|board| {
        let control = match board.part {
            Part::H743 => 0x5802_4474,
            Part::F427 => 0x4002_3874,
        };
        let report = Run::new(board, Image::Release).engines().record(control).until(SECOND / 10).go();
        let enabled = report.written.iter().find(|write| write.register == control && write.value & 1 == 1);
        assert_eq!(enabled, None, "{}", board.name);
        assert!(report.logged("last reset: power-on"), "it started");
    });
}

/// Before a new prescaler has crossed over into the watchdog's clock another is ignored. At the clock that a reset leaves, and
/// with the largest prescaler, that is 48 ms by what ST's HAL allows.
#[test]
fn watchdog_gets_its_time_however_long_its_registers_take() {
    on_each_board(|board| {
        let (sender, receiver) = mpsc::channel();
        let look = move |bench: &mut Bench<'_>| {
            let registers = [4, 8, 12].map(|offset| bench.register(board.watchdog + offset));
            sender.send(registers).expect("the test waits");
        };
        let internal = match board.part {
            Part::H743 => 64_000_000,
            Part::F427 => 16_000_000,
        };
        let leaves = vec![Leftover::WatchdogCrossing];
        // The core stays at that clock here, also when the part would have its PLL: too slow for the engines, so the test checks
        // only the watchdog.
        let (report, _) = Run::new(board, Image::Release)
            .engines()
            .instructions_per_second(internal)
            .slow_watchdog()
            .bootloader(Bootloader { jump: Jump::New, leaves, decides: false })
            .at(SECOND, look)
            .until(SECOND + 1)
            .go_unchecked();
        // 4000 counts of 8 periods: 1 s; and nothing is on its way.
        assert_eq!(receiver.recv(), Ok([Some(1), Some(3999), Some(0)]), "{}", board.name);
        assert!(report.resets.is_empty(), "{}: {:?}", board.name, report.resets);
        assert!(report.logged("link"), "{}: {}", board.name, report.log_text());
    });
}
