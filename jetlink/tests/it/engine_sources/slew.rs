//! Slew limits, reductions, and their reports.

use super::*;

/// Off by default; separate rates up and down, exact to the tick.
#[test]
fn slew_limits_are_exact_to_the_tick_and_off_by_default() {
    for ecu in BOTH {
        let mut scenario = Scenario::started(ecu, percent(20));
        scenario.command(run(80)).unwrap();
        assert_eq!(scenario.tenths(), 800, "off by default");

        let config = ecu.with(|s| {
            s.slew.up = Some(200);
            s.slew.down = Some(400);
            s.timeouts.rc = Duration::from_secs(60);
        });
        let mut scenario = Scenario::started_with(ecu, config, percent(20));
        scenario.pass_us(5 * SECOND);
        let from = scenario.now_us();
        scenario.command(run(80)).unwrap();
        assert_eq!(scenario.tenths(), 200);
        scenario.run_to_us(from + 1_500_000);
        assert!(scenario.tenths().abs_diff(500) <= 4, "{}", scenario.tenths());
        scenario.run_to_us(from + 3 * SECOND - 1);
        assert!(scenario.tenths() < 800);
        scenario.run_to_us(from + 3 * SECOND);
        assert_eq!(scenario.tenths(), 800, "{ecu:?}");
        assert_eq!(scenario.telemetry().commanded, Some(percent(80)));
        scenario.command(run(0)).unwrap();
        scenario.run_to_us(from + 5 * SECOND - 1);
        assert!(scenario.tenths() > 0);
        scenario.run_to_us(from + 5 * SECOND);
        assert_eq!((scenario.tenths(), scenario.wire()), (0, Wire::Run(0)), "{ecu:?}");
    }
    // For an rpm, the same share of the maximum: 20 % of 160 000 rpm per second.
    let config = Ecu::Zk.with(|s| {
        s.slew.up = Some(200);
        s.timeouts.rc = Duration::from_secs(60);
    });
    let mut scenario = Scenario::started_with(Ecu::Zk, config, rpm(ZK_IDLE));
    let from = scenario.now_us();
    scenario.command(Command::Run(rpm(ZK_IDLE + 64_000))).unwrap();
    scenario.run_to_us(from + 2 * SECOND - 1);
    assert_ne!(scenario.order(), Order::Run(rpm(ZK_IDLE + 64_000)));
    scenario.run_to_us(from + 2 * SECOND);
    assert_eq!(scenario.order(), Order::Run(rpm(ZK_IDLE + 64_000)));
}

/// A demand that rises after a take-over does so at `rise`, also where the slew is faster; at other times the slew applies.
#[test]
fn a_slew_that_is_faster_than_the_rise_applies_at_other_times() {
    for ecu in BOTH {
        let config = ecu.with(|s| s.slew.up = Some(1000));
        let mut scenario = Scenario::started_with(ecu, config, percent(20));
        scenario.fly_us(run(20), Origin::Rc, 5 * SECOND);
        scenario.fly_us(run(70), Origin::Rc, SECOND / 4);
        assert!((400..=460).contains(&scenario.tenths()), "{ecu:?}: {} at 100 % a second", scenario.tenths());
        scenario.fly_us(run(20), Origin::Rc, SECOND);
        // Another source takes over, after its wait of 2 s.
        scenario.fly_us(run(70), Origin::Emergency, 2 * SECOND + SECOND / 4);
        assert!((280..=330).contains(&scenario.tenths()), "{ecu:?}: {} at 50 % a second", scenario.tenths());
    }
}

/// A slow slew delays neither a stop nor standby, nor the fail-safe beyond its own ramp.
#[test]
fn slew_delays_no_stop_and_no_fail_safe() {
    for ecu in BOTH {
        let config = ecu.with(|s| {
            s.slew.up = Some(1000);
            s.slew.down = Some(10);
        });
        for (command, wire) in [(Command::EmergencyStop, Wire::Stop), (Command::Standby, Wire::Standby)] {
            let mut scenario = Scenario::started_with(ecu, config, percent(80));
            scenario.fly_us(run(80), Origin::Rc, 2 * SECOND);
            match command {
                Command::Standby => scenario.shut_down().unwrap(),
                command => scenario.command(command).unwrap(),
            };
            scenario.pass_us(2 * FRAME_PERIOD_US);
            assert_eq!(scenario.sent().last(), Some(&wire), "{ecu:?}");
        }
        let mut scenario = Scenario::started_with(ecu, config, percent(80));
        scenario.fly_us(run(80), Origin::Rc, 2 * SECOND);
        assert_eq!(scenario.tenths(), 800);
        // The last command came 100 ms ago. The ramp falls at 50 %/s.
        scenario.pass_us(SOURCE_TIMEOUT_US - COMMAND_PERIOD_US + SECOND + 1_600_000);
        assert_eq!(scenario.tenths(), 0, "{ecu:?}");
    }
}

/// Another engine of the group has failed: this is reported, and this engine is reduced only if so configured.
#[test]
fn the_failure_of_another_engine_is_reported_and_reduces_only_if_configured() {
    for ecu in BOTH {
        for (option, expected) in [(None, 800), (Some(600), 480), (Some(0), 0), (Some(1000), 800)] {
            let config = ecu.with(|s| s.when_other_fails = option);
            let mut scenario = Scenario::started_with(ecu, config, percent(80));
            scenario.bench.act(|engine, now| engine.other_failed(now, true));
            assert_eq!(scenario.bench.event_kinds(), [Event::OtherFailed(1)], "{ecu:?} {option:?}");
            scenario.fly_us(run(80), Origin::Rc, SECOND);
            assert_eq!((scenario.tenths(), scenario.wire()), (expected, Wire::Run(expected)), "{option:?}");
            assert_eq!(scenario.telemetry().commanded, Some(percent(80)));
            scenario.bench.act(|engine, now| engine.other_failed(now, false));
            assert_eq!(scenario.bench.event_kinds(), [Event::OtherFailed(0)]);
            // Back at 50 % a second.
            scenario.fly_us(run(80), Origin::Rc, SECOND);
            assert_eq!(scenario.tenths(), 800.min(expected + 500), "{option:?}");
            scenario.fly_us(run(80), Origin::Rc, SECOND);
            assert_eq!(scenario.tenths(), 800);
        }
    }
}

/// An engine counts as failed when it ran and stopped, or fell silent, without a command; until standby is commanded.
#[test]
fn an_engine_has_failed_when_it_stops_without_a_command() {
    for ecu in BOTH {
        let mut scenario = Scenario::started(ecu, percent(50));
        assert!(!scenario.bench.machine.failed());
        scenario.reports(Reports::Cooling);
        assert!(scenario.bench.machine.failed(), "{ecu:?}: it stopped");
        scenario.command(Command::Standby).unwrap();
        assert!(!scenario.bench.machine.failed());

        let mut scenario = Scenario::started(ecu, percent(50));
        scenario.silent().fly_us(run(50), Origin::Rc, 3 * SECOND);
        assert!(scenario.bench.machine.failed(), "{ecu:?}: it fell silent");
        scenario.reports(Reports::Running);
        assert!(!scenario.bench.machine.failed(), "{ecu:?}: it is back");

        for command in [Command::Standby, Command::EmergencyStop] {
            let mut scenario = Scenario::started(ecu, percent(50));
            match command {
                Command::Standby => scenario.shut_down().unwrap(),
                command => scenario.command(command).unwrap(),
            };
            scenario.reports(Reports::Cooling).pass_us(5 * SECOND);
            assert!(!scenario.bench.machine.failed(), "{ecu:?}: it was commanded");
        }
    }
}

/// An engine that fell silent has recovered when its life is confirmed: reports that show nothing are not enough.
#[test]
fn an_engine_that_fell_silent_recovers_when_its_life_is_confirmed() {
    for ecu in BOTH {
        let mut scenario = Scenario::started(ecu, percent(50));
        scenario.silent().fly_us(run(50), Origin::Rc, 3 * SECOND);
        for (reports, recovered) in [(Reports::Unknown, false), (Reports::Running, true)] {
            scenario.reports = Some(reports);
            scenario.fly_us(run(50), Origin::Rc, SECOND);
            assert_eq!(scenario.telemetry().link, LinkState::Up, "{ecu:?} {reports:?}");
            assert_eq!(scenario.telemetry().in_doubt.is_none(), recovered, "{ecu:?} {reports:?}");
            assert_eq!(scenario.bench.machine.failed(), !recovered, "{ecu:?} {reports:?}");
        }
    }
}

/// A fault beside "running" is no failure.
#[test]
fn zk_an_engine_that_runs_with_a_fault_has_not_failed() {
    let mut scenario = Scenario::started(Ecu::Zk, percent(50));
    scenario.values.fault = 1;
    scenario.reports(Reports::Running).fly_us(run(50), Origin::Rc, 5 * SECOND);
    assert!(scenario.telemetry().report.is_faulty());
    assert!(!scenario.bench.machine.failed());
}

/// A limit whose action is the fail-safe throttle holds it there until standby, whatever the source commands.
#[test]
fn a_limit_can_lower_the_throttle() {
    for ecu in BOTH {
        let config = ecu.with(|s| {
            s.limits.over_temperature =
                Limit { at: Some(Celsius::from_tenths(7000)), action: Action::FailSafe };
            s.loss.throttle = Throttle::from_percent(20).unwrap();
        });
        let mut scenario = Scenario::started_with(ecu, config, percent(80));
        scenario.values.egt_celsius = 720;
        scenario.fly_us(run(80), Origin::Rc, 200_000);
        scenario.values.egt_celsius = 500;
        scenario.fly_us(run(80), Origin::Rc, 3 * SECOND);
        assert_eq!((scenario.tenths(), scenario.wire()), (200, Wire::Run(200)), "{ecu:?}");
        scenario.fly_us(run(90), Origin::Rc, 10 * SECOND);
        assert_eq!(scenario.tenths(), 200);
        assert!(scenario.telemetry().limited, "{ecu:?}");

        // A reset does not lift it.
        let retained = Some(scenario.bench.machine.record());
        let mut scenario = Scenario::after_reset(ecu, config, retained);
        scenario.introduce();
        scenario.reports(Reports::Running);
        scenario.fly_us(run(90), Origin::Rc, 10 * SECOND);
        assert_eq!(scenario.tenths(), 200, "{ecu:?}");
        assert!(scenario.telemetry().limited);

        // Standby does.
        scenario.shut_down().unwrap();
        assert_eq!(scenario.wire(), Wire::Standby);
        assert!(!scenario.telemetry().limited);
        assert!(!scenario.bench.machine.record().limited);
    }
}

/// The reduction for an engine that failed is no slower than a fail-safe, whatever the slew, and does not wait for a
/// take-over.
#[test]
fn a_reduction_does_not_wait_for_a_take_over() {
    for ecu in BOTH {
        for taking_over in [false, true] {
            let config = ecu.with(|s| {
                s.when_other_fails = Some(100);
                s.slew.down = Some(10);
                s.takeover.within = Duration::from_secs(10);
            });
            let mut scenario = Scenario::started_with(ecu, config, percent(80));
            if taking_over {
                assert_eq!(scenario.command_from(run(90), Origin::Emergency), Ok(Accepted::Held));
            }
            scenario.bench.act(|engine, now| engine.other_failed(now, true));
            assert_eq!(scenario.telemetry().others_failed, 1);
            for _ in 0..20 {
                scenario.command(run(80)).unwrap();
                if taking_over {
                    scenario.command_from(run(90), Origin::Emergency).unwrap();
                }
                scenario.pass_us(COMMAND_PERIOD_US);
            }
            // 72 % at 50 % a second.
            assert_eq!(scenario.tenths(), 80, "{ecu:?} {taking_over}");
        }
    }
}

/// The reduction for an engine that failed also lowers a demand whose source is lost, below the fail-safe throttle: the thrust of the
/// others is no more balanced then. It does not rise when the other engine runs again.
#[test]
fn a_reduction_does_not_end_with_its_source() {
    for ecu in BOTH {
        for fails_after in [0, SECOND, 10 * SECOND] {
            let config = ecu.with(|s| {
                s.when_other_fails = Some(500);
                s.loss.throttle = Throttle::from_percent(40).unwrap();
            });
            let mut scenario = Scenario::started_with(ecu, config, percent(20));
            scenario.fly_us(run(20), Origin::Rc, 2 * SECOND).pass_us(fails_after);
            scenario.bench.act(|engine, now| engine.other_failed(now, true));
            scenario.pass_us(10 * SECOND);
            assert_eq!((scenario.tenths(), scenario.wire()), (100, Wire::Run(100)), "{ecu:?} {fails_after}");
            scenario.bench.act(|engine, now| engine.other_failed(now, false));
            scenario.pass_us(5 * SECOND);
            assert_eq!(scenario.tenths(), 100, "{ecu:?}");
        }
    }
}

/// A slew also applies to a demand of the other kind: it rises from what the ECU reports.
#[test]
fn a_slew_limits_a_demand_of_the_other_kind() {
    let config = Ecu::Zk.with(|s| s.slew.up = Some(100));
    let mut scenario = Scenario::started_with(Ecu::Zk, config, percent(0));
    scenario.values.rpm = Some(50_000);
    scenario.fly_us(run(0), Origin::Rc, SECOND);
    let wanted = Command::Run(rpm(ZK_MAX));
    scenario.command(wanted).unwrap();
    assert_eq!(scenario.order(), Order::Run(rpm(50_000)));
    scenario.fly_us(wanted, Origin::Rc, SECOND);
    // 10 % of 160 000 rpm.
    assert_eq!(scenario.order(), Order::Run(rpm(66_000)));
}

/// The active source is reported when it changes, also while the engine is at rest; the others wait for it.
#[test]
fn the_active_source_is_reported_in_standby() {
    for ecu in BOTH {
        let mut scenario = Scenario::with(ecu, ecu.config());
        scenario.reports(Reports::Standby);
        scenario.bench.events();
        scenario.fly_us(Command::Standby, Origin::Bench, SECOND);
        let rc_from = scenario.now_us();
        scenario.fly_us(run(50), Origin::Rc, SECOND);
        let answer = scenario.command_from(Command::Standby, Origin::Bench);
        assert_eq!(answer, Ok(Accepted::Behind(Origin::Rc)));
        assert_eq!(scenario.telemetry().active_source, Origin::Rc, "{ecu:?}");
        assert_eq!(active_sources(&mut scenario).last(), Some(&(rc_from, Origin::Rc)));
    }
}

/// A loss that ends in standby is reported until a source commands.
#[test]
fn standby_by_loss_is_reported_until_a_source_commands() {
    for ecu in BOTH {
        let config = ecu.with(|s| s.loss.standby_after = Some(Duration::from_secs(1)));
        let mut scenario = Scenario::started_with(ecu, config, percent(50));
        scenario.pass_us(10 * SECOND);
        let telemetry = scenario.telemetry();
        assert_eq!((telemetry.ordered.order, telemetry.loss), (Order::Standby, LossStage::Standby));
        scenario.fly_us(Command::Standby, Origin::Rc, 2 * SECOND);
        assert_eq!(scenario.telemetry().loss, LossStage::None, "{ecu:?}");
    }
}

/// An ECU that does not do what is ordered is reported after 3 s: a broken wire towards it. A short mismatch, or another state
/// of an engine at rest, is not reported.
#[test]
fn an_ecu_that_does_not_obey_is_reported() {
    let reported = |scenario: &mut Scenario| -> Vec<Event> {
        let events = scenario.bench.event_kinds().into_iter();
        events.filter(|event| matches!(event, Event::NotObeyed | Event::ObeyedAgain)).collect()
    };
    for ecu in BOTH {
        for command in [Command::EmergencyStop, Command::Standby] {
            let mut scenario = Scenario::started(ecu, percent(0));
            match command {
                Command::Standby => scenario.shut_down().unwrap(),
                command => scenario.command(command).unwrap(),
            };
            scenario.pass_us(3 * SECOND - 2 * FRAME_PERIOD_US);
            assert_eq!((reported(&mut scenario), scenario.telemetry().obeyed), (vec![], true));
            scenario.pass_us(3 * FRAME_PERIOD_US);
            assert_eq!(
                (reported(&mut scenario), scenario.telemetry().obeyed),
                (vec![Event::NotObeyed], false)
            );
            scenario.reports(Reports::Cooling);
            assert_eq!(reported(&mut scenario), [Event::ObeyedAgain], "{ecu:?} {command:?}");
        }
        // The control: it obeys late, but before that.
        let mut scenario = Scenario::started(ecu, percent(50));
        scenario.shut_down().unwrap();
        scenario.pass_us(2 * SECOND);
        scenario.reports(Reports::Standby).pass_us(20 * SECOND);
        assert_eq!(reported(&mut scenario), [], "{ecu:?}");
    }
    // The throttle of a running engine, within 10 %.
    for (half_percents, expected) in [(80, vec![]), (78, vec![Event::NotObeyed])] {
        let mut scenario = Scenario::started(Ecu::Amt, percent(50));
        scenario.values.half_percents = half_percents;
        scenario.fly_us(run(50), Origin::Rc, 5 * SECOND);
        assert_eq!(reported(&mut scenario), expected, "{half_percents}");
    }
}

/// Only of a running engine does the throttle have to be the ordered one: not in a start, and not while a service shuts it down.
#[test]
fn amt_13_another_throttle_is_obedience_in_a_start_and_in_a_shutdown() {
    let table: [(Reports, bool, bool); 3] =
        [(Reports::Starting, false, true), (Reports::Running, true, true), (Reports::Running, false, false)];
    for (reports, ctf, obeyed) in table {
        let mut scenario = if reports == Reports::Starting {
            let mut scenario = Scenario::ready(Ecu::Amt, Ecu::Amt.config());
            scenario.command(run(0)).unwrap();
            scenario
        } else {
            Scenario::started(Ecu::Amt, percent(0))
        };
        if ctf {
            scenario.command(Command::Service(Service::Amt(amt::config::Service::Ctf))).unwrap();
        }
        scenario.values.half_percents = 60;
        scenario.reports(reports).fly_us(run(0), Origin::Rc, 5 * SECOND);
        assert!(matches!(scenario.order(), Order::Run(_)), "{reports:?} {ctf}");
        assert_eq!(scenario.telemetry().obeyed, obeyed, "{reports:?} {ctf}");
        assert_eq!(scenario.bench.event_kinds().contains(&Event::NotObeyed), !obeyed, "{reports:?} {ctf}");
    }
}

/// A demand of the other kind that was never sent has no effect: the next one rises from the demand that the ECU has, whatever
/// throttle it last reported. The control: after one that was sent, only the ECU's report remains.
#[test]
fn a_demand_of_another_kind_that_was_not_sent_moves_nothing() {
    for sent in [false, true] {
        let config = Ecu::Zk.with(|rules| {
            rules.takeover.within = Duration::from_ticks(0);
            rules.loss.hold = Duration::from_ticks(0);
            rules.rise = 100;
        });
        let mut scenario = Scenario::started_with(Ecu::Zk, config, percent(50));
        scenario.reports = Some(Reports::Running);
        scenario.fly_us(run(50), Origin::Rc, 6 * SECOND);
        // Earlier reports.
        for _ in 0..2 {
            scenario.bench.receive(&zk_frames::status(3, TURNING, [80, 0, 0]));
        }
        // Between two slots.
        scenario.pass_us(FRAME_PERIOD_US / 2);
        let _ = scenario.command_from(run(50), Origin::Rc);
        scenario.pass_us(SOURCE_TIMEOUT_US - 10_000);
        let _ = scenario.command_from(Command::Run(rpm(90_000)), Origin::Bench);
        scenario.sent();
        scenario.pass_us(10_000 + if sent { FRAME_PERIOD_US } else { 0 });
        assert!(matches!(scenario.order(), Order::Run(Demand::Rpm(_))), "{sent}");
        let between: Vec<_> = scenario.sent().into_iter().filter(|wire| *wire == Wire::RpmControl).collect();
        assert_eq!(!between.is_empty(), sent, "{between:?}");
        scenario.command(run(90)).unwrap();
        scenario.pass_us(2 * FRAME_PERIOD_US);
        let throttle = scenario.tenths();
        if sent {
            assert!((800..=820).contains(&throttle), "{throttle}");
        } else {
            assert!((500..=520).contains(&throttle), "{throttle}");
        }
    }
}
