//! What a lower source, or a stray command, may end.

use super::*;

/// "A lower source's streamed standby ends a run that another began only when the stages of loss have reached fail-safe and
/// a set time (default 5 s) has passed": after a brown-out, with nothing received of the ECU for a second.
#[test]
fn after_a_brown_out_a_lower_sources_standby_waits_for_the_stages_of_loss() {
    for ecu in BOTH {
        let mut scenario = flying(ecu, 60);
        both(&mut scenario, &[(run(60), Origin::Rc), (Command::Standby, Origin::Mavlink)], 2 * SECOND);
        let retained = scenario.bench.machine.record().without_start();
        assert!(retained.ran);
        let mut scenario = Scenario::after_reset(ecu, ecu.config(), Some(retained));
        // Nothing from the ECU yet; RC's receiver boots for 1.5 s.
        both(&mut scenario, &[(Command::Standby, Origin::Mavlink)], 15 * SECOND / 10);
        assert_ne!(scenario.order(), Order::Standby, "{ecu:?}: 1.5 s after the brown-out");
    }
}

/// "To shut an engine down takes two commands within that source's timeout": of the highest source, after a brown-out. The
/// emergency input is lower than nobody.
#[test]
fn after_a_brown_out_repeated_standby_of_the_highest_source_shuts_down() {
    for ecu in BOTH {
        let retained = flying(ecu, 60).bench.machine.record().without_start();
        let mut scenario = Scenario::after_reset(ecu, ecu.config(), Some(retained));
        scenario.values.half_percents = 120;
        scenario.reports = Some(Reports::Running);
        scenario.introduce();
        if ecu == Ecu::Zk {
            for _ in 0..2 {
                scenario.bench.receive(&zk_frames::status(3, TURNING, [60, 0, 0]));
            }
        }
        scenario.pass_us(12 * SECOND / 10);
        assert!(matches!(scenario.order(), Order::Run(_)), "{:?}", scenario.order());
        scenario.fly_us(Command::Standby, Origin::Emergency, SECOND);
        assert_eq!(scenario.order(), Order::Standby, "{ecu:?}: 10 commands of standby");
    }
}

/// "A single stray command of a lost stream does not": two, 5 s apart, of a source that was lost.
#[test]
fn two_stray_standbys_5_s_apart_shut_nothing_down() {
    let mut scenario = flying(Ecu::Zk, 60);
    // The wire from the ECU is cut; the source continues for 12 s.
    scenario.silent().fly_us(run(60), Origin::Rc, 12 * SECOND);
    scenario.pass_us(4 * SECOND);
    let _ = scenario.command(Command::Standby);
    scenario.pass_us(5 * SECOND);
    let _ = scenario.command(Command::Standby);
    assert_ne!(scenario.order(), Order::Standby);
}

/// Commands come before the runner begins: what RC's run was is in the record, and a lower source's standby does not end it.
#[test]
fn a_lower_sources_standby_before_the_runner_begins_ends_no_run() {
    let retained = flying(Ecu::Zk, 60).bench.machine.record();
    let config = Ecu::Zk.config();
    let mut engine = Engine::new(&config);
    engine.restore(Some(retained));
    for n in 1..20 {
        let _ = engine.command(at_us(n * COMMAND_PERIOD_US), Command::Standby, Origin::Mavlink, true);
    }
    engine.start(at_us(2 * SECOND), None);
    let order = engine.telemetry(at_us(2 * SECOND)).ordered.order;
    assert_ne!(order, Order::Standby, "the record: {retained:?}");
}
