//! The checks of every run find the faults that they are meant to find.

use crate::support::{on_each_board, symbol};
use emulation::engines;
use emulation::{Board, Image, Run};
use sim::any::AnyEcu;
use sim::ecu::{MILLIS, SECOND};
use sim::line::Line;

fn complaints(run: Run) -> String {
    run.go_unchecked().1.join("\n")
}

/// The first engine's ECU on this line.
fn olympus(board: &'static Board, line: Line) -> AnyEcu {
    engines::on(board, Image::Release, "SERIAL2").config().on(line).ecu()
}

/// A run in which the handler of the first port's interrupt is replaced by other instructions.
fn with_broken_handler(board: &'static Board, halfwords: &[u16]) -> Run {
    let handler = symbol(board, Image::Release, &format!("{:?}", board.ports[0].uart).to_uppercase());
    // The first byte on that port comes at 500 ms.
    Run::new(board, Image::Release).engines().patch(handler, halfwords.to_vec()).until(520 * MILLIS)
}

#[test]
fn a_good_run_has_no_complaints() {
    on_each_board(|board| {
        assert_eq!(complaints(Run::new(board, Image::Release).engines().until(SECOND)), "");
    });
}

#[test]
fn a_wrong_baud_rate_is_found() {
    on_each_board(|board| {
        let ecu = olympus(board, Line::n1(4800));
        let run = Run::new(board, Image::Release).engines().ecu("SERIAL2", Line::n1(4800), ecu);
        let found = complaints(run.until(SECOND));
        assert!(found.contains("SERIAL2: the byte received at"), "{found}");
        assert!(found.contains("SERIAL2: no two bytes were sent back to back"), "{found}");
    });
}

#[test]
fn a_wrong_number_of_stop_bits_is_found() {
    on_each_board(|board| {
        let ecu = olympus(board, Line::n2(2400));
        let run = Run::new(board, Image::Release).engines().ecu("SERIAL2", Line::n2(2400), ecu);
        let found = complaints(run.until(SECOND));
        assert!(found.contains("SERIAL2: the byte sent after"), "{found}");
    });
}

#[test]
fn a_port_that_the_firmware_did_not_open_is_found() {
    on_each_board(|board| {
        let ecu = olympus(board, Line::n1(2400));
        let run = Run::new(board, Image::Release).engines().ecu("SERIAL6", Line::n1(2400), ecu);
        let found = complaints(run.until(SECOND));
        assert!(found.contains("SERIAL6: P"), "{found}");
    });
}

#[test]
fn an_access_to_nothing_is_found() {
    on_each_board(|board| {
        // movw r0, #0; movt r0, #0xDEAD; ldr r0, [r0]; bx lr
        let found = complaints(with_broken_handler(board, &[0xF240, 0x0000, 0xF6CD, 0x60AD, 0x6800, 0x4770]));
        assert!(found.contains("nothing is there"), "{found}");
    });
}

#[test]
fn a_fault_is_found_and_the_firmware_logs_its_place_and_resets() {
    on_each_board(|board| {
        // udf: an undefined instruction.
        let (report, complaints) = with_broken_handler(board, &[0xDE00]).go_unchecked();
        let complaints = complaints.join("\n");
        assert!(complaints.contains("a hard fault at"), "{complaints}");
        assert!(complaints.contains("resets expected"), "{complaints}");
        let handler = symbol(board, Image::Release, &format!("{:?}", board.ports[0].uart).to_uppercase());
        assert!(report.logged(&format!("hard fault at {handler:#010x}")), "{}", report.log_text());
        assert!(report.logged("last reset: software"), "{}", report.log_text());
    });
}

#[test]
fn an_unexpected_reset_is_found_and_an_expected_one_that_does_not_come() {
    on_each_board(|board| {
        let reset = || Run::new(board, Image::Release).engines().at(SECOND, |bench| bench.press_reset());
        assert!(complaints(reset().until(2 * SECOND)).contains("0 resets expected"));
        assert_eq!(complaints(reset().resets(1).until(2 * SECOND)), "");
        assert!(complaints(reset().resets(2).until(2 * SECOND)).contains("2 resets expected"));
    });
}
