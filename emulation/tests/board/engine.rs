//! Engines that start, run and resume after a reset, commanded by the demonstration image.
//!
//! The demonstration is silent for 5 s after a reset, then commands 10 s of standby, 180 s of idle, 15 s of 20 %.

use crate::support::{crash, engines, on_each_board, others_are_well, symbol};
use emulation::engines::Engine;
use emulation::{Bench, Board, Image, Report, Run};
use sim::amt::{AmtEcu, Ops};
use sim::any::Protocol;
use sim::ecu::{MILLIS, Nanos, SECOND};
use sim::turbine::Phase;
use sim::zk::{Sw, ZkCommand, ZkEcu};

/// What an ECU was ordered to do.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Sent {
    /// ZK only: nothing, but the node is present.
    Nothing,
    Standby,
    /// With this demand in 0.1 %.
    Run(u16),
}

/// What an ECU was ordered to do, and when.
fn sent(report: &Report, engine: &Engine) -> Vec<(Nanos, Sent)> {
    match engine.protocol() {
        Protocol::Amt => {
            let commands = report.ecu::<AmtEcu>(engine.port).commands.iter();
            let sent = commands.map(|(at, command)| match command.ops {
                Ops::AutoStop => (*at, Sent::Standby),
                Ops::Run => (*at, Sent::Run(5 * u16::from(command.throttle_half_percent))),
                other => panic!("{} was reported {other:?}", engine.name),
            });
            sent.collect()
        }
        Protocol::Zk => {
            let commands = report.ecu::<ZkEcu>(engine.port).commands.iter();
            let sent = commands.map(|(at, command)| match command {
                ZkCommand::Empty => (*at, Sent::Nothing),
                ZkCommand::Control { sw: Sw::Standby, .. } => (*at, Sent::Standby),
                ZkCommand::Control { sw: Sw::Run, throttle } => (*at, Sent::Run(*throttle)),
                ZkCommand::Switch { sw: Sw::Standby, .. } => (*at, Sent::Standby),
                // Throttle modes, not speed; and the queries and settings of a link that comes up.
                ZkCommand::Switch { sw: Sw::Run, factor: 0 } | ZkCommand::Action(_) => (*at, Sent::Nothing),
                other => panic!("{} was reported {other:?}", engine.name),
            });
            sent.collect()
        }
    }
}

fn phase(report: &Report, engine: &Engine) -> Phase {
    match engine.protocol() {
        Protocol::Amt => report.ecu::<AmtEcu>(engine.port).turbine().phase(),
        Protocol::Zk => report.ecu::<ZkEcu>(engine.port).turbine().phase(),
    }
}

#[test]
fn four_engines_start_one_after_the_other_and_run() {
    on_each_board(|board| {
        let report = Run::new(board, Image::Demo).quick_engines().until(56 * SECOND).go();
        let mut running = 0;
        for engine in engines(&report) {
            assert_eq!(phase(&report, &engine), Phase::Running, "{}", engine.name);
            assert_eq!(sent(&report, &engine).last().expect("commands").1, Sent::Run(0), "{}", engine.name);
            let start = report.when(&format!("{}: run, ", engine.name));
            assert!(start > running, "{} starts before the one before runs", engine.name);
            running = report.when(&format!("{}: ECU reports running", engine.name));
            println!(
                "{}: {} starts at {:.1} s, runs at {:.1} s",
                board.name,
                engine.name,
                start as f64 / 1e9,
                running as f64 / 1e9
            );
        }
        others_are_well(&report, &[]);
    });
}

/// Fills the memory that start-up does not clear with arbitrary bytes, as after a power-up.
fn scramble(bench: &mut Bench<'_>, board: &Board) {
    let mut word = 0x9E37_79B9_u32;
    let retained = symbol(board, Image::Demo, "__sretained")..symbol(board, Image::Demo, "__eretained");
    for at in retained.step_by(4) {
        word = word.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        bench.set_word(at, word);
    }
}

/// A reset that the run expects.
struct Reset {
    at: Nanos,
    /// The firmware's expected report.
    cause: &'static str,
}

/// While four engines run at 20 %: the watchdog bites; then the firmware crashes, some time within 250 ms; then
/// the reset button is pressed, and the RAM is arbitrary, as after a dip of the supply. Each comes before the hold of the life
/// before is over: no source commands, and a loss continues over a reset.
const RESETS: [Reset; 3] = [
    Reset { at: 200 * SECOND, cause: "watchdog" },
    Reset { at: 201_200 * MILLIS, cause: "software" },
    Reset { at: 202_200 * MILLIS, cause: "reset pin" },
];

#[test]
fn running_engines_resume_after_any_reset() {
    on_each_board(|board| {
        let report = Run::new(board, Image::Demo)
            .quick_engines()
            .at(RESETS[0].at, |bench| bench.watchdog_runs_out())
            .at(RESETS[1].at, move |bench| crash(bench, board, Image::Demo))
            .at(RESETS[2].at, move |bench| {
                scramble(bench, board);
                bench.press_reset();
            })
            .resets(3)
            .with_errors()
            .until(207 * SECOND)
            .go();

        let causes: Vec<_> =
            report.lines("last reset: ").map(|log| log.text.rsplit_once(": ").expect("a cause").1).collect();
        assert_eq!(causes, ["power-on", RESETS[0].cause, RESETS[1].cause, RESETS[2].cause]);
        for engine in engines(&report) {
            let sent = sent(&report, &engine);
            assert_eq!(phase(&report, &engine), Phase::Running, "{}", engine.name);
            let (_, before) = *sent.iter().rfind(|(at, _)| *at < report.resets[0].0).expect("commands");
            assert_eq!(before, Sent::Run(200), "{}", engine.name);
            for (reset, cause) in &report.resets {
                let after: Vec<_> =
                    sent.iter().filter(|(at, _)| (*reset..reset + SECOND).contains(at)).collect();
                let (first, _) = after.first().expect("commands after the reset");
                let (order, _) = after.iter().find(|(_, sent)| *sent != Sent::Nothing).expect("an order");
                println!(
                    "{}, {}, {cause:?}: first command {:.1} ms, first order {:.1} ms after the reset",
                    board.name,
                    engine.name,
                    (first - reset) as f64 / 1e6,
                    (order - reset) as f64 / 1e6
                );
                // No document states how long an AMT ECU waits for replies; 2 s here. A ZK ECU has to report running twice:
                // each of its nine status IDs comes round in 9 frames.
                let rounds = match engine.protocol() {
                    Protocol::Amt => 500 * MILLIS,
                    Protocol::Zk => 1100 * MILLIS,
                };
                assert!(order - reset < rounds, "{}: {} ms", engine.name, (order - reset) / MILLIS);
                // No source commands: the silence continues over the resets, so the demand is held after the first one and
                // falls after the others. It never rises.
                let mut highest = before;
                for (at, now) in after.iter().filter(|(_, sent)| *sent != Sent::Nothing) {
                    let (Sent::Run(most), Sent::Run(now)) = (highest, *now) else {
                        panic!("{} after {cause:?} was reported {now:?} at {at}", engine.name);
                    };
                    assert!(now <= most, "{} after {cause:?}: {now} after {most}", engine.name);
                    assert!(*reset != report.resets[0].0 || now == 200, "{}: {now}", engine.name);
                    highest = Sent::Run(now);
                }
            }
            // No source commands: the demand is held for a time, then falls to idle, and the engine still runs.
            let (_, last) = sent.iter().rfind(|(_, sent)| *sent != Sent::Nothing).expect("orders");
            assert_eq!(*last, Sent::Run(0), "{}", engine.name);
            assert!(sent.iter().all(|(at, sent)| *at < report.resets[0].0 || *sent != Sent::Standby));
            // Up to its first line, 2.3 ms after a reset, the firmware logs nothing: what is read with that are earlier lines,
            // which are still in the log's buffer.
            let old =
                |at: u64| report.resets.iter().any(|(reset, _)| (*reset..*reset + 3 * MILLIS).contains(&at));
            let events = report.events(engine.name);
            let resumed = events.iter().filter(|(at, event)| event.starts_with("resumed") && !old(*at));
            assert_eq!(resumed.count(), 3);
            if engine.protocol() == Protocol::Amt {
                let stats = report.ecu::<AmtEcu>(engine.port).stats;
                assert_eq!((stats.late, stats.serial_delay_stops), (0, 0), "{stats:?}");
                println!("{}, {}: {} frames in all without a reply", board.name, engine.name, stats.none);
            }
        }
    });
}

#[test]
fn a_reset_without_a_running_engine_ends_in_standby() {
    on_each_board(|board| {
        let reset = 3 * SECOND;
        let report = Run::new(board, Image::Release)
            .engines()
            .at(reset, |bench| bench.watchdog_runs_out())
            .resets(1)
            .until(6 * SECOND)
            .go();
        assert!(report.logged("last reset: watchdog") && !report.logged("resumed"), "{}", report.log_text());
        for engine in engines(&report) {
            let sent = sent(&report, &engine);
            assert!(
                sent.iter().all(|(_, sent)| matches!(sent, Sent::Standby | Sent::Nothing)),
                "{}",
                engine.name
            );
            let (at, _) =
                sent.iter().find(|(at, sent)| *at > reset && *sent == Sent::Standby).expect("standby");
            // Two reports have to agree; a ZK ECU's comes round every 0.45 s.
            assert!(at - reset < 1_200 * MILLIS, "{} at {at}", engine.name);
        }
    });
}
