//! A wire is cut and mended.

use crate::support::{on_each_board, others_are_well};
use emulation::{Image, Run};
use sim::amt::AmtEcu;
use sim::ecu::{MILLIS, SECOND};
use sim::zk::ZkEcu;

const AMT: &str = "SERIAL2";
const ZK: &str = "SERIAL5";

#[test]
fn a_cut_wire_is_reported_and_so_is_its_return() {
    on_each_board(|board| {
        let report = Run::new(board, Image::Release)
            .engines()
            .at(3 * SECOND, |bench| {
                bench.cut(AMT, true);
                bench.cut(ZK, true);
            })
            .at(6 * SECOND, |bench| {
                bench.cut(AMT, false);
                bench.cut(ZK, false);
            })
            .until(10 * SECOND)
            .go();
        for (engine, limit) in [("left", 1000), ("booster", 500)] {
            let lost = report.when(&format!("{engine}: ECU link lost"));
            let silent = lost - 3 * SECOND;
            assert!(silent <= limit * MILLIS + 10 * MILLIS, "{engine}: reported after {silent} ns");
            let again = report.lines(&format!("{engine}: ECU link up")).next_back().expect("up again").at;
            assert!((6 * SECOND..6500 * MILLIS).contains(&again), "{engine}: up again at {again}");
        }
        let stats = report.ecu::<AmtEcu>(AMT).stats;
        // The cut lost 24 frames, plus or minus the frame or reply at either end.
        assert!((23..=26).contains(&stats.none) && stats.late == 0 && stats.unsolicited == 0, "{stats:?}");
        let zk = report.ecu::<ZkEcu>(ZK).stats;
        let silence = zk.intervals.max.expect("commands");
        assert!((2900 * MILLIS..3100 * MILLIS).contains(&silence), "{zk:?}");
        assert!(zk.bad.total() <= 1, "{zk:?}");
        others_are_well(&report, &[AMT, ZK]);
    });
}

#[test]
fn without_a_cut_no_link_is_lost() {
    on_each_board(|board| {
        let report = Run::new(board, Image::Release).engines().until(10 * SECOND).go();
        assert!(!report.logged("ECU link lost"), "{}", report.log_text());
        others_are_well(&report, &[]);
    });
}
