//! An image with USB. The emulator has no USB controller, so this is what a board does whose controller does not answer: it says so within its
//! time, and serves everything else. Nothing of USB itself is shown.

use crate::support::{on_each_board, others_are_well};
use emulation::{Image, Report, Run};
use sim::ecu::{MILLIS, SECOND};

/// Clock, supply, version and readiness have 0.1 s each.
const DECIDED: u64 = 500 * MILLIS;

fn is_served_without_usb(report: &Report, why: &str) {
    let name = report.board.name;
    let off = report.lines("USB: off").next().unwrap_or_else(|| panic!("{name}: {}", report.log_text()));
    assert!(off.text.contains(why), "{name}: {}", off.text);
    assert!(off.at < DECIDED, "{name}: {} ns", off.at);
    assert!(!report.logged("MAVLink: USB, too"), "{name}");
    others_are_well(report, &[]);
    assert!(!report.logged("ECU link lost") && !report.logged("not sent"), "{}", report.log_text());
}

#[test]
fn controller_that_does_not_answer_leaves_usb_off_and_every_engine_is_served() {
    on_each_board(|board| {
        let report = Run::new(board, Image::Usb).engines().with_errors().until(5 * SECOND).go();
        is_served_without_usb(&report, "USB: off");
    });
}
