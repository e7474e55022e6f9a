//! An image with USB. The emulator has no USB controller: its registers have the values that a reset leaves, and report a suspend forever. So
//! this tests a board whose controller responds with nonsense: it serves everything else. It does not test USB itself, nor that USB stays off
//! if the controller or its supply do not become ready.

use crate::support::{on_each_board, others_are_well};
use emulation::{Image, Run};
use sim::ecu::{MILLIS, SECOND};

/// Clock, supply, version and readiness have 0.1 s each.
const DECIDED: u64 = 500 * MILLIS;

/// Findings of a run about the registers of the controller and its clock, which are not modelled.
fn is_of_the_controller(complaint: &str) -> bool {
    let unmapped = ["unmapped at=0x5000", "unmapped at=0x4008"];
    let names = ["OTG", "CRS."];
    names.iter().chain(&unmapped).any(|of_it| complaint.contains(of_it))
}

#[test]
fn usb_controller_that_answers_nonsense_costs_no_engine_a_frame() {
    on_each_board(|board| {
        let run = Run::new(board, Image::Usb).engines().with_errors().until(3 * SECOND);
        let (report, complaints) = run.go_unchecked();
        let others: Vec<_> = complaints.iter().filter(|complaint| !is_of_the_controller(complaint)).collect();
        assert!(others.is_empty(), "{}: {others:?}\n{}", board.name, report.log_text());
        let found = report.lines("USB").next();
        let found = found.unwrap_or_else(|| panic!("{}: {}", board.name, report.log_text()));
        assert!(found.at < DECIDED, "{}: {} ns", board.name, found.at);
        others_are_well(&report, &[]);
        assert!(!report.logged("ECU link lost") && !report.logged("not sent"), "{}", report.log_text());
    });
}
