//! Noise, missing stop bits and lost bytes on the line.

use crate::support::{line_errors_of, on_each_board, others_are_well};
use emulation::{Fate, Image, Run};
use sim::amt::AmtEcu;
use sim::ecu::SECOND;
use sim::zk::ZkEcu;

const AMT: &str = "SERIAL2";
const ZK: &str = "SERIAL5";

#[test]
fn noise_and_framing_errors_are_counted_and_survived() {
    on_each_board(|board| {
        let report = Run::new(board, Image::Release)
            .engines()
            .at(2 * SECOND, |bench| {
                bench.framing(AMT, 20_000);
                bench.noise(ZK, 20_000);
            })
            .at(12 * SECOND, |bench| {
                bench.framing(AMT, 0);
                bench.noise(ZK, 0);
            })
            .until(20 * SECOND)
            .go();
        let (framing, noise, overruns) = line_errors_of(&report, "left");
        assert!((3..30).contains(&framing) && noise == 0 && overruns == 0, "{framing} {noise} {overruns}");
        let (framing, noise, overruns) = line_errors_of(&report, "booster");
        assert!((30..110).contains(&noise) && framing == 0 && overruns == 0, "{framing} {noise} {overruns}");

        // No damaged frame caused a command to the ECU, and from the end of the noise on, nothing is missed.
        let stats = report.ecu::<AmtEcu>(AMT).stats;
        assert_eq!((stats.bad.total(), stats.late), (0, 0), "{stats:?}");
        let commands = &report.ecu::<AmtEcu>(AMT).commands;
        assert!(
            commands
                .iter()
                .all(|(_, command)| command.ops == sim::amt::Ops::AutoStop
                    && command.throttle_half_percent == 0)
        );
        let clean = commands.iter().filter(|(at, _)| *at > 12_200_000_000).count();
        assert!((61..=63).contains(&clean), "{clean} replies in the last 7.8 s");
        assert_eq!(report.ecu::<ZkEcu>(ZK).stats.bad.total(), 0);
        others_are_well(&report, &[AMT, ZK]);
    });
}

#[test]
fn a_line_that_damages_every_byte_only_loses_its_link() {
    on_each_board(|board| {
        let report = Run::new(board, Image::Release)
            .engines()
            .at(2 * SECOND, |bench| {
                bench.framing(AMT, 1_000_000);
                bench.framing(ZK, 1_000_000);
            })
            .at(5 * SECOND, |bench| {
                bench.framing(AMT, 0);
                bench.framing(ZK, 0);
            })
            .until(8 * SECOND)
            .go();
        let damaged = |port| {
            let bytes = report.wire(port).rx.iter().filter(|rx| rx.fate == Fate::Received);
            bytes.filter(|rx| (2 * SECOND..5 * SECOND).contains(&rx.end)).count() as u32
        };
        for (engine, port) in [("left", AMT), ("booster", ZK)] {
            let (framing, ..) = line_errors_of(&report, engine);
            assert!(framing.abs_diff(damaged(port)) <= 1, "{engine}: {framing} of {}", damaged(port));
        }
        assert!(report.logged("booster: ECU link lost"));
        others_are_well(&report, &[AMT, ZK]);
    });
}

#[test]
fn lost_bytes_and_damaged_replies_cost_single_frames() {
    on_each_board(|board| {
        let mut run = Run::new(board, Image::Release).engines();
        for second in 2..12 {
            run = run.at(second * SECOND, |bench| {
                bench.drop_next(AMT);
                bench.drop_next(ZK);
            });
        }
        let report = run.at(SECOND, |bench| bench.garble("SERIAL3", 20_000)).until(15 * SECOND).go();
        assert_eq!(line_errors_of(&report, "left"), (0, 0, 0), "a byte that never came is no line error");
        let stats = report.ecu::<AmtEcu>(AMT).stats;
        assert!((1..=11).contains(&stats.none) && stats.late == 0 && stats.bad.total() == 0, "{stats:?}");
        let stats = report.ecu::<AmtEcu>("SERIAL3").stats;
        assert!(stats.framing_errors > 3 && stats.in_window > 80 && stats.late == 0, "{stats:?}");
        assert!(!report.logged("ECU link lost"), "{}", report.log_text());
        others_are_well(&report, &[AMT, "SERIAL3", ZK]);
    });
}
