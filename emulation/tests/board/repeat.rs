//! Two equal runs are the same, to the instruction; different runs are not.

use crate::support::on_each_board;
use emulation::{Board, Image, Run};
use sim::ecu::SECOND;

fn fingerprint(board: &'static Board, noise: u32) -> u64 {
    let run = Run::new(board, Image::AllPorts).engines().tap("SERIAL2").tap("SERIAL5");
    run.at(SECOND, move |bench| bench.noise("SERIAL5", noise)).until(4 * SECOND).go().fingerprint()
}

#[test]
fn two_runs_are_identical() {
    on_each_board(|board| {
        let first = fingerprint(board, 50_000);
        assert_eq!(first, fingerprint(board, 50_000));
        assert_ne!(first, fingerprint(board, 60_000), "a fingerprint that is always the same shows nothing");
    });
}
