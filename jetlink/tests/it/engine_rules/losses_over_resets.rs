//! Losses continue across resets.

use super::*;

/// "Losses go on over resets. The record keeps how long the source has been silent": a lower source that speaks must not
/// keep a dead one's demand up.
#[test]
fn in_a_reset_loop_a_lower_source_that_streams_standby_does_not_hold_a_lost_demand() {
    for ecu in BOTH {
        let config = ecu.config();
        let mut scenario = flying(ecu, 90);
        both(&mut scenario, &[(run(90), Origin::Rc), (Command::Standby, Origin::Mavlink)], 2 * SECOND);
        // RC is dead from here on. 40 s of resets 1 s apart.
        let mut last = Vec::new();
        for _ in 0..40 {
            scenario = scenario.reset(config);
            scenario.bench.frames();
            both(&mut scenario, &[(Command::Standby, Origin::Mavlink)], SECOND);
            last = runs_in(&scenario.sent());
        }
        assert!(
            last.iter().all(|tenths| *tenths == 0),
            "{ecu:?}: RC dead for 40 s, and the wire says run at {last:?}"
        );
    }
}

/// A slow ramp and short lives: from the third reset on the demand is at the fail-safe throttle, because a ramp that goes on only
/// while the node runs would come to no stated end.
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
            scenario.says = Some(Says::Running);
            scenario.pass_us(3 * SECOND / 2);
            let sent = runs_in(&scenario.sent());
            assert!(!sent.is_empty(), "{ecu:?}, reset {reset}");
            if reset >= 3 {
                assert!(sent.iter().all(|tenths| *tenths == 100), "{ecu:?}, reset {reset}: {sent:?}");
            }
        }
    }
}

/// The same with a lower source that asks for 20 %.
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
            "{ecu:?}: RC dead for 40 s, and the wire says run at {last:?}"
        );
    }
}

/// Brown-outs that follow one another, all sources silent: "Losses go on over resets", "from the third reset without a
/// source it resumes at the fail-safe stage".
#[test]
fn in_a_brown_out_loop_with_all_sources_silent_the_demand_falls_to_the_fail_safe() {
    for ecu in BOTH {
        let config = ecu.config();
        let mut scenario = flying(ecu, 90);
        scenario.says = Some(Says::Running);
        let mut last = Vec::new();
        for _ in 0..30 {
            let kept = scenario.bench.machine.record().without_start();
            let values = scenario.values;
            scenario = Scenario::after_reset(ecu, config, Some(kept));
            scenario.values = values;
            scenario.says = Some(Says::Running);
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
            "{ecu:?}: nobody has spoken for 30 s, and the wire says run at {last:?}"
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
        let kept = scenario.bench.machine.record().without_start();
        scenario = Scenario::after_reset(Ecu::Zk, config, Some(kept));
        scenario.says = Some(Says::Running);
        scenario.introduce();
        scenario.bench.receive(&zk_frames::status(3, TURNING, [90, 0, 0]));
        scenario.bench.frames();
        scenario.pass_us(SECOND);
        last = runs_in(&scenario.sent());
    }
    assert!(last.iter().all(|tenths| *tenths == 0), "{last:?}");
}

/// "From the third reset without a source it resumes at the fail-safe stage": a lower source that is present and wants nothing is
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
