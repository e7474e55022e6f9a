//! Runs that a lower source, or a stray command, may end.

use super::*;

/// "A lower source's streamed standby ends a run that another began only when the stages of loss have reached fail-safe and
/// a set time (default 5 s) has passed": after a brown-out, with nothing received from the ECU for 1 s.
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

/// "To shut an engine down takes two commands within that source's timeout": of the highest source, after a brown-out. No
/// source is above the emergency input.
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

/// Commands come before the runner begins: RC's run is in the record, and a lower source's standby does not end it.
#[test]
fn a_lower_sources_standby_before_the_runner_begins_ends_no_run() {
    let retained = flying(Ecu::Zk, 60).bench.machine.record();
    let config = Ecu::Zk.config();
    let mut engine = Engine::new(&config);
    engine.restore(Some(retained));
    for n in 1..20 {
        let _ = engine.command(at_us(n * COMMAND_PERIOD_US), Command::Standby, Origin::Mavlink, true);
    }
    engine.start(at_us(2 * SECOND));
    let order = engine.telemetry(at_us(2 * SECOND)).ordered.order;
    assert_ne!(order, Order::Standby, "the record: {retained:?}");
}

/// When the share for the demand beside a failed engine grows, the demand rises at the usual rate.
#[test]
fn a_demand_rises_at_its_rate_to_a_greater_share_beside_a_failed_engine() {
    let mut config = Ecu::Zk.config();
    config.supervision.when_other_fails = Some(300);
    let mut scenario = Scenario::started_with(Ecu::Zk, config, percent(100));
    scenario.bench.act(|engine, now| engine.other_failed(now, true));
    scenario.fly_us(run(100), Origin::Rc, 5 * SECOND);
    assert_eq!(scenario.tenths(), 300);
    config.supervision.when_other_fails = Some(1000);
    let now = at_us(scenario.now_us());
    scenario.bench.act(|engine, _| engine.configure(now, &config.supervision)).unwrap();
    assert_eq!(scenario.tenths(), 300, "at once");
    scenario.fly_us(run(100), Origin::Rc, SECOND);
    assert!((790..=810).contains(&scenario.tenths()), "50 % a second: {}", scenario.tenths());
    scenario.fly_us(run(100), Origin::Rc, SECOND);
    assert_eq!(scenario.tenths(), 1000);
}

/// Another ECU may be plugged in while the link is lost: the start-up time of the one before does not end its start.
#[test]
fn the_start_up_time_of_the_ecu_before_a_lost_link_is_forgotten() {
    let mut scenario = Scenario::nothing_received(Ecu::Zk, Ecu::Zk.config());
    let introduce = |scenario: &mut Scenario, version: u8, startup: u8| {
        for _ in 0..4 {
            scenario.bench.receive(&zk_frames::status(6, 0, [160, 0, version << 2]));
            scenario.bench.receive(&zk_frames::status(8, 0, [5, 0, startup]));
        }
    };
    introduce(&mut scenario, 5, 50);
    scenario.reports(Reports::Standby).pass_us(SECOND);
    assert!(scenario.telemetry().report.startup.is_some(), "the control: version 5 reports it");
    scenario.silent().pass_us(5 * SECOND);
    introduce(&mut scenario, 3, 0);
    scenario.reports(Reports::Standby).pass_us(2 * SECOND);
    assert_eq!(scenario.telemetry().report.startup, None, "version 3 does not");
    scenario.command(Command::Arm).unwrap();
    scenario.command(Command::Standby).unwrap();
    scenario.command(run(0)).unwrap();
    scenario.reports = Some(Reports::Starting);
    scenario.fly_us(run(0), Origin::Rc, 60 * SECOND);
    assert!(matches!(scenario.order(), Order::Run(_)), "{}", scenario.order());
}

/// A refused hand-over uses up the permission of its source, like a refused run: its later run does not start the engine. The
/// control: without the hand-over it does.
#[test]
fn a_refused_hand_over_uses_up_the_permission() {
    for hands_over in [true, false] {
        let mut scenario = Scenario::ready(Ecu::Zk, Ecu::Zk.config());
        let streams = [(Command::Standby, Origin::Rc), (Command::Standby, Origin::Mavlink)];
        both(&mut scenario, &streams, 2 * SECOND);
        if hands_over {
            let refused = scenario.command_from(Command::HandOverToPwm, Origin::Mavlink);
            assert_eq!(refused, Err(Rejected::Behind(Origin::Rc)));
        }
        scenario.pass_us(600_000);
        let answer = scenario.command_from(run(0), Origin::Mavlink);
        assert_eq!(answer.is_err(), hands_over, "{answer:?}");
        assert_eq!(matches!(scenario.order(), Order::Run(_)), !hands_over, "{}", scenario.order());
    }
}

/// A source that is present and commands nothing is silent, also over resets: a loop too short to listen ends in standby. The
/// control: one that commands a run prevents this.
#[test]
fn a_source_that_is_present_delays_no_standby_in_a_loop_of_resets() {
    let config = Ecu::Zk.config();
    for (command, ends) in [(None, true), (Some(Command::Present), true), (Some(run(80)), false)] {
        let mut scenario = Scenario::started(Ecu::Zk, percent(80));
        scenario.fly_us(run(80), Origin::Rc, 2 * SECOND);
        let mut record = scenario.bench.machine.record().without_start();
        let ended = (0..60).any(|_| {
            let mut after = Scenario::after_reset(Ecu::Zk, config, Some(record));
            after.pass_us(350_000);
            if let Some(command) = command {
                let _ = after.command(command);
            }
            after.pass_us(50_000);
            record = after.bench.machine.record();
            after.order() == Order::Standby
        });
        assert_eq!(ended, ends, "{command:?}");
    }
}
