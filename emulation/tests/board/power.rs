//! The ECU powered before the board, the board before the ECU, and an ECU that restarts.

use crate::support::{on_each_board, others_are_well};
use emulation::{Image, Run, engines, turnaround};
use sim::amt::AmtEcu;
use sim::ecu::{MILLIS, SECOND};
use sim::line::Line;
use sim::zk::ZkEcu;

const AMT: &str = "SERIAL2";
const ZK: &str = "SERIAL5";

#[test]
fn a_board_that_is_powered_after_its_ecu_answers() {
    on_each_board(|board| {
        // The board gets power in the middle of a frame: 10.5 s is the start of one, in step with 125 ms.
        let [amt, zk] = [AMT, ZK].map(|port| engines::on(board, Image::Release, port).config().ecu());
        let report = Run::new(board, Image::Release)
            .engines()
            .ecu_since(AMT, Line::n1(2400), amt, 10_500 * MILLIS - 10 * MILLIS)
            .ecu_since(ZK, Line::n1(115_200), zk, 10 * SECOND)
            .until(3 * SECOND)
            .go();
        let stats = report.ecu::<AmtEcu>(AMT).stats;
        // The first whole frame comes at 10 ms, and one every 125 ms. The first two have to agree on what the ECU
        // obeys; from the second on, each is answered.
        let frames = report.wire(AMT).rx.iter().filter(|rx| rx.last).count();
        let replies = turnaround::of(&report, AMT).len();
        assert!(frames == 24 && replies == frames - 1, "{replies} replies to {frames} frames, {stats:?}");
        assert_eq!((stats.late, stats.unsolicited, stats.bad.total()), (0, 0, 0), "{stats:?}");
        assert!(report.when("left: ECU link up") < 250 * MILLIS, "{}", report.log_text());
        assert!(report.when("booster: ECU link up") < 60 * MILLIS, "{}", report.log_text());
        others_are_well(&report, &[AMT, ZK]);
    });
}

#[test]
fn an_ecu_that_is_powered_after_its_board_is_answered() {
    on_each_board(|board| {
        let report = Run::new(board, Image::Release)
            .engines()
            .at(1, |bench| {
                bench.power(AMT, false);
                bench.power(ZK, false);
            })
            .at(3 * SECOND, |bench| {
                bench.power(AMT, true);
                bench.power(ZK, true);
            })
            .until(6 * SECOND)
            .go();
        assert!(report.wire(AMT).tx[0].end > 3 * SECOND, "an AMT ECU gets no bytes before its first frame");
        assert!(report.when("left: ECU link lost") < 2 * SECOND);
        assert!(report.when("left: ECU link up") > 3 * SECOND);
        assert!(report.when("booster: ECU link up") > 3 * SECOND);
        let stats = report.ecu::<AmtEcu>(AMT).stats;
        assert_eq!((stats.late, stats.none, stats.unsolicited, stats.bad.total()), (0, 0, 0, 0), "{stats:?}");
        assert!(stats.frames.total() - stats.in_window <= 1, "{stats:?}");
        assert_eq!(report.ecu::<ZkEcu>(ZK).stats.bad.total(), 0);
        others_are_well(&report, &[AMT, ZK]);
    });
}

#[test]
fn an_ecu_that_restarts_gets_its_link_back() {
    on_each_board(|board| {
        let report = Run::new(board, Image::Release)
            .engines()
            .at(3 * SECOND, |bench| {
                bench.power(AMT, false);
                bench.power(ZK, false);
            })
            .at(5 * SECOND, |bench| {
                bench.power(AMT, true);
                bench.power(ZK, true);
            })
            .until(9 * SECOND)
            .go();
        for engine in ["left", "booster"] {
            let lost = report.when(&format!("{engine}: ECU link lost"));
            assert!((3 * SECOND..4200 * MILLIS).contains(&lost), "{engine} lost at {lost}");
            let again = report.lines(&format!("{engine}: ECU link up")).next_back().expect("up again").at;
            assert!((5 * SECOND..6 * SECOND).contains(&again), "{engine} up again at {again}");
        }
        assert_eq!(report.lines("left: ECU powered up").count(), 2);
        let stats = report.ecu::<AmtEcu>(AMT).stats;
        assert_eq!((stats.late, stats.unsolicited, stats.bad.total()), (0, 0, 0), "{stats:?}");
        assert!(stats.none <= 1 && stats.frames.total() - stats.in_window <= 2, "{stats:?}");
        others_are_well(&report, &[AMT, ZK]);
    });
}
