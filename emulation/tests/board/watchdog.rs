//! The watchdog bites when a task hangs, and only then.

use crate::support::{on_each_board, others_are_well};
use emulation::board::Part;
use emulation::{Image, Run};
use sim::ecu::{MILLIS, SECOND};

#[test]
fn a_hanging_task_of_an_engine_resets_the_chip() {
    on_each_board(|board| {
        let run = Run::new(board, Image::Wedge).engines().resets(1).with_errors().until(8 * SECOND);
        let report = run.go();
        let (at, cause) = report.resets[0];
        assert_eq!(format!("{cause:?}"), "Model(\"IWDG\")");
        // The task hangs from 5 s on, and the watchdog was last fed within 250 ms of that.
        assert!((5500 * MILLIS..6500 * MILLIS).contains(&at), "{at}");
        assert!(report.when("left: its runner is stuck") > 5 * SECOND);
        assert!(report.when("last reset: watchdog") < at + 5 * MILLIS, "back at once");
        // And the engines are served again.
        let again = report.lines("left: ECU link up").next_back().expect("up again").at;
        assert!((at..at + SECOND).contains(&again), "{again}");
    });
}

#[test]
fn a_working_image_is_not_reset() {
    on_each_board(|board| {
        // Long enough for the wedged image to have been reset. A reset fails the run.
        let report = Run::new(board, Image::Release).engines().until(8 * SECOND).go();
        assert!(report.resets.is_empty());
        others_are_well(&report, &[]);
    });
}

#[test]
fn a_silent_line_resets_nothing() {
    on_each_board(|board| {
        let report = Run::new(board, Image::Release).until(5 * SECOND).go();
        assert!(report.resets.is_empty() && report.logged("left: ECU link lost"));
    });
}

/// A probe that halts the core must not be answered by a reset: the bit in DBGMCU comes before the watchdog. The part
/// itself then pauses the watchdog; nothing halts the core here.
#[test]
fn it_is_set_to_pause_while_a_probe_halts_the_core() {
    on_each_board(|board| {
        let (freeze, bit) = match board.part {
            Part::H743 => (0x5C00_1054, 18), // APB4FZ1, WDGLSD1 (RM0433, 60.5.8)
            Part::F427 => (0xE004_2008, 12), // APB1_FZ, DBG_IWDG_STOP (RM0090, 38.16.4)
        };
        let run = Run::new(board, Image::Release).engines().record(freeze).record(board.watchdog);
        let report = run.until(SECOND / 10).go();
        let frozen =
            report.written.iter().position(|write| write.register == freeze && write.value >> bit & 1 == 1);
        let started = report.written.iter().position(|write| write.register == board.watchdog);
        assert!(frozen.is_some() && frozen < started, "{:?}", report.written);
    });
}
