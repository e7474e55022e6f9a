//! A crystal that does not start, and one that stops in flight. The emulator starts every crystal and raises no NMI of
//! the clock security system: the first is turned off after each write that turns it on (`emulation/src/quirks.rs`), the
//! second is an NMI that a few instructions in RAM raise, in thread mode or in the interrupt that carries the engines.

use crate::support::{Led, Task, crash, hijack, on_each_board, others_are_well, symbol};
use emulation::board::Part;
use emulation::{Bench, Board, Fate, Image, Run};
use sim::ecu::{MILLIS, SECOND};

/// The firmware's log line at a start without its crystal.
pub const WITHOUT: &str = "crystal not running, using the internal oscillator";

#[test]
fn a_crystal_that_is_dead_at_a_reset_costs_no_engine() {
    on_each_board(|board| {
        let reset = 1500 * MILLIS;
        let report = Run::new(board, Image::Release)
            .engines()
            .at(SECOND, |bench| bench.break_crystal())
            .at(reset, |bench| bench.watchdog_runs_out())
            .resets(1)
            .with_errors()
            .until(4 * SECOND)
            .go(); // which finds wrong baud rates
        let boots: Vec<_> = report.lines("last reset: ").map(|log| log.at).collect();
        println!("{}: {boots:?}, reset {:?}", board.name, report.resets);
        assert!(
            report.logs.iter().all(|log| log.level != "error" || log.text == WITHOUT),
            "{}",
            report.log_text()
        );
        assert_eq!(report.lines(WITHOUT).count(), 1);
        // At most 0.1 s of trying, by the core's cycles.
        assert!(boots[1] - report.resets[0].0 < 105 * MILLIS, "{boots:?}");
        let again = report.lines("left: ECU link up").next_back().expect("up again").at;
        assert!((reset..reset + SECOND).contains(&again), "{again}");
    });
}

#[test]
fn a_crystal_that_is_dead_at_power_on_costs_no_engine() {
    on_each_board(|board| {
        let run = Run::new(board, Image::Release).engines().at(0, |bench| bench.break_crystal());
        let report = run.with_errors().until(2 * SECOND).go();
        assert!(report.logged(WITHOUT), "{}", report.log_text());
        others_are_well(&report, &[]);
    });
}

/// SysTick times the wait: as many cycles as the internal oscillator has in 0.1 s. The emulator counts them at the PLL's rate, whatever
/// clocks the core and however slowly it works.
#[test]
fn a_dead_crystal_is_given_a_tenth_of_a_second() {
    on_each_board(|board| {
        let internal = match board.part {
            Part::H743 => 64_000_000,
            Part::F427 => 16_000_000,
        };
        let run = Run::new(board, Image::Release).instructions_per_second(internal).with_errors();
        let run = run.at(0, |bench| bench.break_crystal()).record(board.clock_control);
        let report = run.until(300 * MILLIS).go_unchecked().0;
        let on = |write: &&emulation::Written| write.value >> 16 & 1 == 1;
        let tried = report.written.iter().find(on).expect("HSEON is set").at;
        let end = report.written.iter().find(|write| write.at > tried && !on(write));
        let took = end.expect("HSEON is cleared").at - tried;
        let tenth = internal / 10 * SECOND / board.core_hz;
        assert!((tenth..tenth + tenth / 100).contains(&took), "{}: {took} ns, not {tenth}", board.name);
    });
}

/// From here on the crystal has failed, and an NMI reports it when this task runs next.
pub fn stop_crystal(bench: &mut Bench<'_>, board: &Board, image: Image, task: Task) {
    bench.break_crystal();
    raise_alarm(bench, board, image, task);
}

/// movw r0, #0xED04; movt r0, #0xE000; mov.w r1, #0x80000000; str r1, [r0]; bx lr: NMIPENDSET in ICSR.
const RAISE_NMI: [u32; 4] = [0x5004_F64E, 0x0000_F2CE, 0x4100_F04F, 0x4770_6001];

/// An NMI reports that the crystal has stopped, when this task runs next.
fn raise_alarm(bench: &mut Bench<'_>, board: &Board, image: Image, task: Task) {
    let code = board.ram.start + 0x18000;
    for (i, word) in RAISE_NMI.into_iter().enumerate() {
        bench.set_word(code + 4 * i as u64, word);
    }
    hijack(bench, board, image, task, code);
}

#[test]
fn a_crystal_that_stops_resets_a_plain_image() {
    on_each_board(|board| {
        let stop = |bench: &mut Bench<'_>| stop_crystal(bench, board, Image::Release, Task::Engine);
        let run = Run::new(board, Image::Release).engines().at(1500 * MILLIS, stop).resets(1).with_errors();
        let report = run.until(4 * SECOND).go();
        assert_eq!(report.lines("the crystal has stopped, resetting").count(), 1, "{}", report.log_text());
        assert!(report.logged("last reset: software") && report.logged(WITHOUT));
        let again = report.lines("left: ECU link up").next_back().expect("up again").at;
        assert!(again > report.resets[0].0, "{}", report.log_text());
    });
}

/// A crystal that runs again after the reset is not used until the power has been off: it might reset the node repeatedly.
#[test]
fn a_crystal_that_comes_and_goes_is_left_alone_until_the_next_power_on() {
    on_each_board(|board| {
        let alarm = |bench: &mut Bench<'_>| raise_alarm(bench, board, Image::Release, Task::Engine);
        let run = Run::new(board, Image::Release).engines().at(1500 * MILLIS, alarm);
        let run = run.at(2500 * MILLIS, |bench| bench.watchdog_runs_out()).resets(2).with_errors();
        let report = run.until(4 * SECOND).go();
        assert_eq!(report.lines("last reset: ").count(), 3, "{}", report.log_text());
        assert_eq!(report.lines(WITHOUT).count(), 2, "{}", report.log_text());
        // The control: a power-on begins with the crystal.
        let first = report.lines("last reset: ").next().expect("a start").at;
        assert!(report.lines(WITHOUT).all(|log| log.at > first + SECOND));
    });
}

/// Behind an ArduPilot bootloader a reset would end in the bootloader, which waits for the crystal forever.
#[test]
fn a_crystal_that_stops_resets_no_image_behind_a_bootloader() {
    on_each_board(|board| {
        for task in [Task::Supervisor, Task::Engine] {
            let stop = move |bench: &mut Bench<'_>| stop_crystal(bench, board, Image::Ardupilot, task);
            let run = Run::new(board, Image::Ardupilot).engines().at(1500 * MILLIS, stop).with_errors();
            let (report, complaints) = run.until(4 * SECOND).go_unchecked();
            // The firmware started twice without a reset, and the bytes being sent at that moment took longer.
            let expected =
                |complaint: &String| complaint.ends_with("2 times") || complaint.contains(" at 15");
            assert!(complaints.iter().all(expected), "{task:?} {complaints:?} {}", report.log_text());
            assert!(
                complaints.iter().any(|complaint| complaint.ends_with("last reset\" 2 times")),
                "{task:?}"
            );
            for (port, wire) in report.wires() {
                let byte = board.port(port).byte_ns(wire.line());
                let later = wire.rx.iter().filter(|rx| rx.start > 2800 * MILLIS && rx.fate == Fate::Received);
                let wrong = later.clone().find(|rx| ((rx.end - rx.start) as f64 - byte).abs() > 2.0);
                assert!(later.count() > 20 && wrong.is_none(), "{task:?} {port} {wrong:?}");
            }
            assert!(report.resets.is_empty() && report.logged(WITHOUT));
            let again = report.lines("left: ECU link up").next_back().expect("up again").at;
            assert!((1500 * MILLIS..2800 * MILLIS).contains(&again), "{task:?} {}", report.log_text());
        }
    });
}

/// A crash after that does not reset it either: the bootloader would wait for the crystal, so the image starts again without a reset.
#[test]
fn a_crash_without_a_crystal_resets_no_image_behind_a_bootloader() {
    on_each_board(|board| {
        let stop = |bench: &mut Bench<'_>| stop_crystal(bench, board, Image::Ardupilot, Task::Supervisor);
        let report = Run::new(board, Image::Ardupilot)
            .engines()
            .at(SECOND, stop)
            .at(2500 * MILLIS, |bench| crash(bench, board, Image::Ardupilot))
            .with_errors()
            .until(4500 * MILLIS)
            .go_unchecked()
            .0;
        assert!(report.resets.is_empty(), "{:?}\n{}", report.resets, report.log_text());
        assert_eq!(report.lines("has no handler, resetting").count(), 1, "{}", report.log_text());
        // The retained state is as good as after a reset: a running engine continues with its order.
        let causes: Vec<_> =
            report.lines("last reset: ").map(|log| log.text.rsplit_once(": ").expect("a cause").1).collect();
        assert_eq!(causes, ["power-on", "restart", "restart"], "{}", report.log_text());
        let crashed = report.when("has no handler, resetting");
        let again = report.lines("left: ECU link up").next_back().expect("up again").at;
        assert!(again > crashed, "{}", report.log_text());
        assert!(report.faults.is_empty());
    });
}

/// The worst moment: a fault is being handled when the crystal stops, so the NMI comes on top of the HardFault. Only a return
/// ends an exception, and the start returns from all of them.
#[test]
fn crystal_that_stops_while_a_fault_is_handled_resets_no_image_behind_a_bootloader() {
    on_each_board(|board| {
        for task in [Task::Supervisor, Task::Engine] {
            // The handler of faults begins in RAM: it raises the NMI, as the crystal would, and waits.
            let code = board.ram.start + 0x18000;
            let table = symbol(board, Image::Ardupilot, "__vector_table");
            let vector = [code as u16 | 1, (code >> 16) as u16];
            let fault = move |bench: &mut Bench<'_>| {
                bench.break_crystal();
                for (i, word) in RAISE_NMI.into_iter().enumerate() {
                    bench.set_word(code + 4 * i as u64, word);
                }
                bench.set_word(code + 0x40, 0xDE00_DE00); // udf: an undefined instruction
                hijack(bench, board, Image::Ardupilot, task, code + 0x40);
            };
            let run = Run::new(board, Image::Ardupilot).engines().patch(table + 0x0C, vector.to_vec());
            let report = run.at(1500 * MILLIS, fault).with_errors().until(3 * SECOND).go_unchecked().0;
            assert!(report.resets.is_empty(), "{task:?} {:?}\n{}", report.resets, report.log_text());
            let causes: Vec<_> = report
                .lines("last reset: ")
                .map(|log| log.text.rsplit_once(": ").expect("a cause").1)
                .collect();
            assert_eq!(causes, ["power-on", "restart"], "{task:?}\n{}", report.log_text());
            let again = report.lines("left: ECU link up").next_back().expect("up again").at;
            assert!((1500 * MILLIS..2800 * MILLIS).contains(&again), "{task:?} {}", report.log_text());
        }
    });
}

/// Telemetry, the log (every second) and the LED show it.
#[test]
fn a_missing_crystal_is_logged_every_second() {
    on_each_board(|board| {
        let led = Led::of(board);
        let run = |dead: bool| {
            let run = Run::new(board, Image::Release).engines().with_errors().until(3900 * MILLIS);
            let run = run.record(led.register).at(0, move |bench| {
                if dead {
                    bench.break_crystal();
                }
            });
            let report = run.go();
            let flashes = led.lit(&report).into_iter().filter(|at| *at > 2950 * MILLIS);
            (report.lines("board: no crystal").count(), flashes.count())
        };
        assert_eq!(run(false), (0, 1), "{}", board.name);
        assert_eq!(run(true), (3, 5), "{}", board.name);
    });
}

/// The emulator's clock security system raises no NMI, so the test checks its bit (19 of RCC_CR on both chips): set once the
/// crystal clocks the core, and never without a crystal.
#[test]
fn the_clock_security_system_watches_a_crystal_that_runs() {
    on_each_board(|board| {
        for dead in [false, true] {
            let run = Run::new(board, Image::Release).engines().with_errors().record(board.clock_control);
            let run = run.at(0, move |bench| {
                if dead {
                    bench.break_crystal();
                }
            });
            let report = run.until(500 * MILLIS).go();
            let on = |value: u64| value >> 19 & 1 == 1;
            let written: Vec<_> =
                report.written.iter().filter(|write| write.register == board.clock_control).collect();
            let last = written.last().expect("RCC_CR is written");
            assert_eq!(on(last.value), !dead, "{}: {:#x}", board.name, last.value);
            assert_eq!(written.iter().any(|write| on(write.value)), !dead, "{}", board.name);
        }
    });
}
