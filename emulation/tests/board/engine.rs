//! Engines that start and run, commanded by the demonstration image.

use crate::support::{on_each_board, others_are_well};
use emulation::{Image, Run};
use sim::amt::{AmtEcu, Ops};
use sim::ecu::{MILLIS, SECOND};
use sim::turbine::Phase;
use sim::zk::{Sw, ZkCommand, ZkEcu};

#[test]
fn four_engines_start_and_run() {
    on_each_board(|board| {
        let report = Run::new(board, Image::Demo).engines().until(95 * SECOND).go();
        for port in ["SERIAL2", "SERIAL3"] {
            let ecu = report.ecu::<AmtEcu>(port);
            assert_eq!(ecu.turbine().phase(), Phase::Running, "{port}");
            assert_eq!(ecu.commands.last().map(|(_, command)| command.ops), Some(Ops::Run));
        }
        for port in ["SERIAL4", "SERIAL5"] {
            assert_eq!(report.ecu::<ZkEcu>(port).turbine().phase(), Phase::Running, "{port}");
        }
        for engine in ["left", "right", "centre", "booster"] {
            assert!(report.logged(&format!("{engine}: Phase(Running)")), "{}", report.log_text());
        }
        others_are_well(&report, &[]);
    });
}

/// A reset in flight shuts the engines down at present. A firmware that goes on where it was fails this test;
/// then it is this test that has to change.
#[test]
fn at_present_a_reset_while_engines_run_shuts_them_down() {
    on_each_board(|board| {
        let report = Run::new(board, Image::Demo)
            .engines()
            .at(65 * SECOND, |bench| {
                assert_eq!(bench.ecu::<AmtEcu>("SERIAL2").turbine().phase(), Phase::Running);
                assert_eq!(bench.ecu::<ZkEcu>("SERIAL5").turbine().phase(), Phase::Running);
                bench.press_reset();
            })
            .resets(1)
            .until(68 * SECOND)
            .go();
        assert!(report.logged("last reset: Pin"), "{}", report.log_text());
        // The first thing each ECU hears after the reset is standby, soon, and never anything but an order that
        // the node meant.
        let after = |at: u64| at > 65 * SECOND;
        let left = report.ecu::<AmtEcu>("SERIAL2");
        let (at, first) = left.commands.iter().find(|(at, _)| after(*at)).expect("a reply after the reset");
        assert_eq!(first.ops, Ops::AutoStop);
        assert!(at - 65 * SECOND < 300 * MILLIS, "{at}");
        assert_eq!(left.stats.bad.total() + left.stats.late, 0, "{:?}", left.stats);
        let booster = report.ecu::<ZkEcu>("SERIAL5");
        let mut heard = booster.commands.iter().filter(|(at, _)| after(*at));
        let switch = heard.find_map(|(at, command)| match command {
            ZkCommand::Control { sw, .. } => Some((*at, *sw)),
            _ => None,
        });
        let (at, sw) = switch.expect("an order after the reset");
        assert_eq!(sw, Sw::Standby);
        assert!(at - 65 * SECOND < 100 * MILLIS, "{at}");
        assert_eq!(left.turbine().phase(), Phase::Cooling);
        assert_eq!(booster.turbine().phase(), Phase::Cooling);
    });
}
