//! Boards whose part is tested in full on another board: their own pins, clocks and places in memory.

use crate::ardupilot::served;
use crate::support::{engines, line_errors_of, on_the_other_boards, others_are_well, symbol};
use emulation::{Image, Jump, Leftover, Run};
use sim::ecu::SECOND;

#[test]
fn every_engine_of_the_release_image_is_served() {
    on_the_other_boards(|board| {
        let symbol = |name| symbol(board, Image::Release, name);
        assert_eq!(symbol("__vector_table"), board.flash.start, "the part boots from there");
        assert_eq!((symbol("__sdata"), symbol("_stack_start")), (board.ram.start, board.ram.end));

        let report = Run::new(board, Image::Release).engines().until(10 * SECOND).go();
        others_are_well(&report, &[]);
        for engine in engines(&report) {
            assert_eq!(line_errors_of(&report, engine.name), (0, 0, 0));
        }
        assert!(!report.logged("ECU link lost") && !report.logged("not sent"), "{}", report.log_text());
        let first = &report.logs[0].text;
        assert!(first.contains(&format!(" on {}, last reset: power-on", board.title)), "{first}");
    });
}

#[test]
fn without_its_crystal_the_board_runs_on_the_chips_own_oscillator() {
    on_the_other_boards(|board| {
        let run = Run::new(board, Image::Release).engines().at(0, |bench| bench.break_crystal());
        let report = run.with_errors().until(2 * SECOND).go(); // which finds wrong baud rates
        assert!(report.logged("crystal not running, using the internal oscillator"));
        others_are_well(&report, &[]);
    });
}

#[test]
fn behind_its_bootloader_every_engine_is_served() {
    on_the_other_boards(|board| {
        let Some(start) = board.behind_bootloader else { return };
        let symbol = |name| symbol(board, Image::Ardupilot, name);
        assert_eq!(symbol("__vector_table"), start);
        assert!(symbol("__etext") < board.flash.end);
        served(board, Image::Ardupilot, Jump::New, &[]);
        served(board, Image::Ardupilot, Jump::New, &Leftover::ALL);
    });
}
