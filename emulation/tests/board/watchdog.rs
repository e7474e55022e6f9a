//! The watchdog bites when a task stands still, and only then.

use crate::support::{on_each_board, others_are_well};
use emulation::{Image, Run};
use sim::ecu::{MILLIS, SECOND};

#[test]
fn it_bites_when_an_engines_task_stands_still() {
    on_each_board(|board| {
        let run = Run::new(board, Image::Wedge).engines().resets(1).with_errors().until(8 * SECOND);
        let report = run.go();
        let (at, cause) = report.resets[0];
        assert_eq!(format!("{cause:?}"), "Model(\"IWDG\")");
        // The task stands still from 5 s on, and the last food was given within 250 ms of that.
        assert!((5500 * MILLIS..6500 * MILLIS).contains(&at), "{at}");
        assert!(report.when("left: its runner is stuck") > 5 * SECOND);
        assert!(report.when("last reset: Watchdog") < at + 5 * MILLIS, "back at once");
        // And the engines are served again.
        let again = report.lines("left: LinkUp").next_back().expect("up again").at;
        assert!((at..at + SECOND).contains(&again), "{again}");
    });
}

#[test]
fn it_does_not_bite_while_all_is_well() {
    on_each_board(|board| {
        // Long enough for the wedged image to have been reset; resets fail a run by themselves.
        let report = Run::new(board, Image::Release).engines().until(8 * SECOND).go();
        assert!(report.resets.is_empty());
        others_are_well(&report, &[]);
    });
}

#[test]
fn a_silent_line_is_no_reason_to_bite() {
    on_each_board(|board| {
        let report = Run::new(board, Image::Release).until(5 * SECOND).go();
        assert!(report.resets.is_empty() && report.logged("left: LinkLost"));
    });
}
