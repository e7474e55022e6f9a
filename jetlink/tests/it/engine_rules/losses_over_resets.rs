//! Losses continue across resets.

use super::*;

/// "Losses continue over resets. The record keeps how long the source has been silent": a lower source that commands must not
/// keep a dead one's demand up.
#[test]
fn in_a_reset_loop_a_lower_source_that_streams_standby_does_not_hold_a_lost_demand() {
    for ecu in BOTH {
        let config = ecu.config();
        let mut scenario = flying(ecu, 90);
        both(&mut scenario, &[(run(90), Origin::Rc), (Command::Standby, Origin::Mavlink)], 2 * SECOND);
        // RC is silent from here on. 40 s of resets, 1 s apart.
        let mut last = Vec::new();
        for _ in 0..40 {
            scenario = scenario.reset(config);
            scenario.bench.frames();
            both(&mut scenario, &[(Command::Standby, Origin::Mavlink)], SECOND);
            last = runs_in(&scenario.sent());
        }
        assert!(
            last.iter().all(|tenths| *tenths == 0),
            "{ecu:?}: RC dead for 40 s, and run is sent at {last:?}"
        );
    }
}

/// A slow ramp and short lives: from the third reset on the demand is at the fail-safe throttle, because a ramp that continues only
/// while the node runs would have no stated end.
#[test]
fn from_the_third_reset_without_a_source_the_demand_is_at_the_fail_safe_throttle() {
    for ecu in BOTH {
        let config = ecu.with(|supervision| {
            supervision.loss.ramp = 100;
            supervision.loss.throttle = Throttle::from_tenths(100).unwrap();
        });
        let mut scenario = flying(ecu, 90);
        for reset in 1..=5 {
            scenario = scenario.reset(config);
            scenario.bench.frames();
            scenario.reports = Some(Reports::Running);
            scenario.pass_us(3 * SECOND / 2);
            let sent = runs_in(&scenario.sent());
            assert!(!sent.is_empty(), "{ecu:?}, reset {reset}");
            if reset >= 3 {
                assert!(sent.iter().all(|tenths| *tenths == 100), "{ecu:?}, reset {reset}: {sent:?}");
            }
        }
    }
}

/// "Losses continue over resets": a source that comes and goes is not in control, so its commands do not restart the time to standby
/// when the node is reset.
#[test]
fn a_reset_does_not_restart_the_time_to_standby_of_a_source_that_comes_and_goes() {
    /// Source timeout, hold, and `standby_after`, in s.
    const LOST_FOR: u64 = 1 + 1 + 20;
    for ecu in BOTH {
        let config = ecu.with(|supervision| supervision.loss.standby_after = Some(micros(20 * SECOND)));
        let story = |resets: bool, pause: u64, seconds: u64| {
            let mut scenario = Scenario::started_with(ecu, config, percent(50));
            scenario.fly_us(run(50), Origin::Rc, SECOND).pass_us(3 * SECOND);
            for second in 3..seconds {
                scenario.fly_us(run(50), Origin::Rc, SECOND - pause).pass_us(pause);
                if resets && second % 5 == 0 {
                    scenario = scenario.reset(config);
                    scenario.bench.frames();
                }
            }
            scenario.order()
        };
        for resets in [false, true] {
            assert!(matches!(story(resets, 700_000, LOST_FOR - 2), Order::Run(_)), "{ecu:?} {resets}");
            assert_eq!(story(resets, 700_000, LOST_FOR + 2), Order::Standby, "{ecu:?} {resets}");
            // The control: one that commands steadily is in control again.
            assert!(matches!(story(resets, 100_000, LOST_FOR + 10), Order::Run(_)), "{ecu:?} {resets}");
        }
    }
}

/// A source that was lost for a while and is received again is in control after 1 s, even if the node is reset every 1.3 s: that ends
/// the time for which it was lost.
#[test]
fn a_source_that_commands_again_in_a_reset_loop_ends_the_time_to_standby() {
    const LOOP_US: u64 = 1_300_000;
    for (ecu, recover_after) in BOTH.into_iter().flat_map(|ecu| [(ecu, SECOND), (ecu, 2 * SECOND)]) {
        let config = ecu.with(|supervision| {
            supervision.loss.standby_after = Some(micros(6 * SECOND));
            // Longer than the node runs: time received before a reset counts.
            supervision.recover_after = micros(recover_after);
        });
        for back in [true, false] {
            let mut scenario = Scenario::started_with(ecu, config, percent(50));
            scenario.reports = Some(Reports::Running);
            scenario.fly_us(run(50), Origin::Rc, SECOND).pass_us(3 * SECOND);
            for _ in 0..8 {
                scenario = scenario.reset(config);
                scenario.reports = Some(Reports::Running);
                scenario.bench.frames();
                match back {
                    true => scenario.fly_us(run(50), Origin::Rc, LOOP_US),
                    false => scenario.pass_us(LOOP_US),
                };
            }
            assert_eq!(scenario.order() == Order::Standby, !back, "{ecu:?} {recover_after} {back}");
        }
    }
}

/// The same if the node never runs long enough to receive it twice, and receives it only in every second boot. The control: a
/// source that is received only once does not regain control.
#[test]
fn a_source_that_is_received_once_between_resets_gets_back_in_control() {
    const LOOP_US: u64 = 170_000;
    for (ecu, every) in BOTH.into_iter().flat_map(|ecu| [(ecu, 1), (ecu, 2)]) {
        let config = ecu.config();
        for back in [true, false] {
            let mut scenario = Scenario::started_with(ecu, config, percent(50));
            scenario.reports = Some(Reports::Running);
            scenario.fly_us(run(50), Origin::Rc, SECOND).pass_us(3 * SECOND);
            for boot in 0..81 {
                scenario = scenario.reset(config);
                scenario.reports = Some(Reports::Running);
                scenario.bench.frames();
                scenario.pass_us(LOOP_US / 2);
                if back && boot % every == 0 || boot == 0 {
                    let _ = scenario.command_from(run(50), Origin::Rc);
                }
                scenario.pass_us(LOOP_US / 2);
            }
            assert_eq!(scenario.order() == Order::Standby, !back, "{ecu:?} {every} {back}");
            // Standby has no stages of loss.
            assert_eq!(scenario.telemetry().loss, jetlink::event::LossStage::None, "{ecu:?} {every} {back}");
        }
    }
}

/// A source that is received in every fourth boot of a loop of resets is never in control, but not silent either: no standby is sent.
#[test]
fn a_source_that_is_received_now_and_then_in_a_reset_loop_keeps_its_engine() {
    const LOOP_US: u64 = 85_000;
    // An AMT engine that nothing confirms loses its order with the serial delay time.
    let ecu = Ecu::Zk;
    let config = ecu.config();
    for commands in [true, false] {
        let mut scenario = Scenario::started_with(ecu, config, percent(50));
        scenario.reports = Some(Reports::Running);
        scenario.fly_us(run(50), Origin::Rc, SECOND).pass_us(2 * SECOND);
        let mut standby = false;
        for boot in 0..300 {
            scenario = scenario.reset(config);
            scenario.silent().pass_us(LOOP_US / 2);
            if commands && boot % 4 == 0 {
                let _ = scenario.command_from(run(50), Origin::Rc);
            }
            scenario.pass_us(LOOP_US / 2);
            standby |= scenario.order() == Order::Standby;
        }
        assert_eq!(standby, !commands, "{ecu:?} {commands}");
    }
}

/// The same with a lower source that commands 20 %.
#[test]
fn in_a_reset_loop_a_lower_source_that_runs_does_not_hold_a_lost_demand() {
    for ecu in BOTH {
        let config = ecu.config();
        let mut scenario = flying(ecu, 90);
        both(&mut scenario, &[(run(90), Origin::Rc), (run(20), Origin::Mavlink)], 2 * SECOND);
        let mut last = Vec::new();
        for _ in 0..40 {
            scenario = scenario.reset(config);
            scenario.bench.frames();
            both(&mut scenario, &[(run(20), Origin::Mavlink)], SECOND);
            last = runs_in(&scenario.sent());
        }
        assert!(
            last.iter().all(|tenths| *tenths <= 200),
            "{ecu:?}: RC dead for 40 s, and run is sent at {last:?}"
        );
    }
}

/// Brown-outs that follow one another, all sources silent: "Losses continue over resets", "from the third reset without a
/// source it resumes at the fail-safe stage".
#[test]
fn in_a_brown_out_loop_with_all_sources_silent_the_demand_falls_to_the_fail_safe() {
    for ecu in BOTH {
        let config = ecu.config();
        let mut scenario = flying(ecu, 90);
        scenario.reports = Some(Reports::Running);
        let mut last = Vec::new();
        for _ in 0..30 {
            let retained = scenario.bench.machine.record().without_start();
            let values = scenario.values;
            scenario = Scenario::after_reset(ecu, config, Some(retained));
            scenario.values = values;
            scenario.reports = Some(Reports::Running);
            scenario.introduce();
            if ecu == Ecu::Zk {
                scenario.bench.receive(&zk_frames::status(3, TURNING, [90, 0, 0]));
            }
            scenario.bench.frames();
            scenario.pass_us(SECOND);
            last = runs_in(&scenario.sent());
        }
        assert!(
            last.iter().all(|tenths| *tenths == 0),
            "{ecu:?}: no source has commanded for 30 s, and run is sent at {last:?}"
        );
    }
}

/// The reset loops, each ECU alone.
#[test]
fn zk_in_a_reset_loop_a_lower_source_that_streams_standby_does_not_hold_a_lost_demand() {
    let config = Ecu::Zk.config();
    let mut scenario = flying(Ecu::Zk, 90);
    both(&mut scenario, &[(run(90), Origin::Rc), (Command::Standby, Origin::Mavlink)], 2 * SECOND);
    let mut last = Vec::new();
    for _ in 0..40 {
        scenario = scenario.reset(config);
        scenario.bench.frames();
        both(&mut scenario, &[(Command::Standby, Origin::Mavlink)], SECOND);
        last = runs_in(&scenario.sent());
    }
    assert!(last.iter().all(|tenths| *tenths == 0), "{last:?}");
}

#[test]
fn zk_in_a_brown_out_loop_with_all_sources_silent_the_demand_falls_to_the_fail_safe() {
    let config = Ecu::Zk.config();
    let mut scenario = flying(Ecu::Zk, 90);
    let mut last = Vec::new();
    for _ in 0..30 {
        let retained = scenario.bench.machine.record().without_start();
        scenario = Scenario::after_reset(Ecu::Zk, config, Some(retained));
        scenario.reports = Some(Reports::Running);
        scenario.introduce();
        scenario.bench.receive(&zk_frames::status(3, TURNING, [90, 0, 0]));
        scenario.bench.frames();
        scenario.pass_us(SECOND);
        last = runs_in(&scenario.sent());
    }
    assert!(last.iter().all(|tenths| *tenths == 0), "{last:?}");
}

/// "From the third reset without a source it resumes at the fail-safe stage": a lower source that is present and commands nothing is
/// none.
#[test]
fn resets_count_only_without_the_source_in_control() {
    let config = Ecu::Zk.config();
    let mut scenario = flying(Ecu::Zk, 90);
    for _ in 0..4 {
        scenario = scenario.reset(config);
        both(&mut scenario, &[(Command::Present, Origin::Bench)], 3 * COMMAND_PERIOD_US);
    }
    zk_cycle(&mut scenario, 11, TURNING, 90, SECOND);
    let record = scenario.bench.machine.record();
    assert!(record.resets >= 3 || record.loss >= jetlink::event::LossStage::FailSafe, "{record:?}");
}

/// Three resets between two commands of a source that commands seldom bring the fail-safe stage. The source is not lost: its next command, within
/// its timeout, is in force at once, and a healthy engine is not shut down. The control: after its timeout, its run has ended.
#[test]
fn resets_between_two_commands_of_a_source_are_no_loss() {
    for (ecu, silent, lost) in BOTH.into_iter().flat_map(|ecu| [(ecu, 0, false), (ecu, 3 * SECOND, true)]) {
        let config = ecu.with(|supervision| {
            supervision.timeouts.rc = micros(3 * SECOND);
            supervision.return_within = micros(0);
            supervision.loss.hold = micros(10 * SECOND);
            supervision.loss.standby_after = Some(micros(3 * SECOND));
        });
        let mut scenario = Scenario::started_with(ecu, config, percent(50));
        scenario.values.half_percents = 100;
        scenario.reports = Some(Reports::Running);
        scenario.fly_us(run(50), Origin::Rc, 2 * SECOND).pass_us(silent);
        for _ in 0..3 {
            scenario = scenario.reset(config);
            scenario.bench.frames();
            scenario.pass_us(360_000);
        }
        scenario.reports = Some(Reports::Running);
        scenario.pass_us(900_000);
        assert_eq!(scenario.order() == Order::Standby, lost, "{ecu:?}: {}", scenario.order());
        if lost {
            continue;
        }
        assert_eq!(scenario.tenths(), 0, "{ecu:?}: the fail-safe throttle");
        scenario.command(run(50)).ok();
        scenario.pass_us(2 * SECOND);
        assert_eq!((scenario.order(), scenario.tenths()), (Order::Run(percent(50)), 500), "{ecu:?}");
    }
}

/// "Consecutive resets without a source": one that commanded since the last reset ends the count, also if its order was given up since
/// and the engine was found again without it. The control: one that did not command.
#[test]
fn resets_count_anew_after_a_source_whose_order_was_given_up() {
    let config = Ecu::Amt.with(|supervision| {
        supervision.loss.hold = micros(12 * SECOND);
        supervision.loss.standby_after = Some(micros(3 * SECOND));
    });
    for commands in [true, false] {
        let mut scenario = Scenario::started_with(Ecu::Amt, config, percent(50));
        scenario = scenario.reset(config);
        scenario.bench.frames();
        let command = if commands { run(50) } else { Command::Present };
        scenario.reports(Reports::Running);
        scenario.fly_us(command, Origin::Rc, SECOND);
        // The ECU's serial delay time is 4 s.
        scenario.silent().pass_us(5 * SECOND);
        assert_eq!(scenario.order(), Order::Listen);
        scenario.values.half_percents = 100;
        scenario.reports(Reports::Running);
        assert!(matches!(scenario.order(), Order::Run(_)), "{}", scenario.order());
        for _ in 0..2 {
            scenario = scenario.reset(config);
            scenario.bench.frames();
            scenario.reports(Reports::Running);
        }
        assert_eq!(matches!(scenario.order(), Order::Run(_)), commands, "{}", scenario.order());
    }
}
