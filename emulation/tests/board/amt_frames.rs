//! Each kind of frame that an AMT ECU sends is answered.

use crate::support::{engines, no_window_missed, on_each_board};
use emulation::{Image, Run};
use sim::amt::{AmtEcu, error};
use sim::ecu::SECOND;

#[test]
fn set_up_normal_alternate_and_error_frames_are_answered() {
    on_each_board(|board| {
        let report = Run::new(board, Image::Release)
            .engines()
            .at(3 * SECOND, |bench| bench.ecu::<AmtEcu>("SERIAL2").set_errors(error::EGT))
            .at(5 * SECOND, |bench| bench.ecu::<AmtEcu>("SERIAL2").set_errors(0))
            .until(7 * SECOND)
            .go();
        let frames = report.ecu::<AmtEcu>("SERIAL2").stats.frames;
        assert!(frames.setup == 1 && frames.normal > 20 && frames.alternate > 2 && frames.error > 10);
        no_window_missed(&report, &engines(&report)[0]);
        // Each was also understood.
        assert!(report.logged("left: ECU powered up"));
        assert!(report.logged("left: ECU reports standby"));
        assert!(report.logged("left: ECU reports a fault: "));
    });
}
