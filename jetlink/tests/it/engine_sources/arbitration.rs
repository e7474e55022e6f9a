//! Which source is in control.

use super::*;

/// The highest fresh source is in control; lower ones change nothing, and their answer names it.
#[test]
fn the_highest_fresh_source_is_in_control() {
    for ecu in BOTH {
        for lower in [Origin::Mavlink, Origin::Bench] {
            let mut scenario = Scenario::started(ecu, percent(50));
            for (command, answer) in [
                (run(20), Accepted::Behind(Origin::Rc)),
                (Command::Standby, Accepted::RepeatStandby),
                (Command::Standby, Accepted::Behind(Origin::Rc)),
            ] {
                assert_eq!(scenario.command_from(command, lower), Ok(answer), "{command:?}");
            }
            assert_eq!((scenario.order(), scenario.wire()), (Order::Run(percent(50)), Wire::Run(500)));
            assert_eq!(scenario.telemetry().active_source, Origin::Rc);
            assert_eq!(scenario.bench.event_kinds(), [], "{ecu:?}");
            // A single action cannot wait.
            let service = match ecu {
                Ecu::Amt => Service::Amt(amt::config::Service::Ctf),
                Ecu::Zk => Service::Zk(zk::config::Service::Action(zk::codec::Action::Rate50Hz)),
            };
            for command in [Command::HandOverToPwm, Command::Service(service)] {
                assert_eq!(scenario.command_from(command, lower), Err(Rejected::Behind(Origin::Rc)));
            }
            scenario.pass_us(5 * SECOND);
            assert!(scenario.sent().iter().all(|wire| matches!(wire, Wire::Run(_))), "{ecu:?}");
        }
        // A higher one takes over.
        let mut scenario = Scenario::started(ecu, percent(50));
        scenario.command_from(run(52), Origin::Emergency).unwrap();
        assert_eq!(scenario.telemetry().active_source, Origin::Emergency);
        // 2 % at 50 % a second.
        scenario.pass_us(40_000);
        let telemetry = scenario.telemetry();
        assert_eq!(
            (telemetry.active_source, telemetry.ordered.order),
            (Origin::Emergency, Order::Run(percent(52)))
        );
        assert_eq!(scenario.command(run(50)), Ok(Accepted::Behind(Origin::Emergency)));
    }
}

/// Each source has its own timeout, to the tick.
#[test]
fn each_source_has_its_own_timeout() {
    let limits = [
        (Origin::Emergency, 300_000),
        (Origin::Rc, 450_000),
        (Origin::Mavlink, 1_200_000),
        (Origin::Bench, 700_001),
    ];
    for ecu in BOTH {
        for (origin, limit) in limits {
            let config = ecu.with(|s| {
                s.timeouts.emergency = micros(300_000);
                s.timeouts.rc = micros(450_000);
                s.timeouts.mavlink = micros(1_200_000);
                s.timeouts.bench = micros(700_001);
            });
            let mut scenario = Scenario::ready(ecu, config);
            scenario.pass_us(5 * SECOND);
            // A source that was silent first has to be received for 1 s.
            scenario.fly_us(Command::Standby, origin, SECOND + COMMAND_PERIOD_US);
            assert_eq!(scenario.command_from(run(0), origin), Ok(Accepted::InForce));
            scenario.reports(Reports::Starting);
            scenario.command_from(run(0), origin).unwrap();
            scenario.reports(Reports::Running);
            scenario.command_from(run(40), origin).unwrap();
            let last = scenario.now_us();
            scenario.run_to_us(last + limit - 1);
            assert_eq!(scenario.telemetry().loss, LossStage::None, "{ecu:?} {origin:?}");
            scenario.run_to_us(last + limit);
            let telemetry = scenario.telemetry();
            assert_eq!(
                (telemetry.loss, telemetry.active_source),
                (LossStage::Hold, origin),
                "{ecu:?} {origin:?}"
            );
            assert_eq!(telemetry.source_last_rx, Some(at_us(last)));
        }
    }
}

/// A source takes over at once within 5000 rpm of the rpm in force, and another one waits.
#[test]
fn taking_over_an_rpm_is_bumpless() {
    for (wanted, answer) in [
        (54_900, Accepted::InForce),
        (45_100, Accepted::InForce),
        (55_100, Accepted::Held),
        (44_900, Accepted::Held),
    ] {
        let mut scenario = Scenario::started(Ecu::Zk, rpm(50_000));
        assert_eq!(
            scenario.command_from(Command::Run(rpm(wanted)), Origin::Emergency),
            Ok(answer),
            "{wanted}"
        );
        scenario.fly_us(Command::Run(rpm(wanted)), Origin::Emergency, SECOND / 2);
        let held = answer == Accepted::Held;
        assert_eq!(scenario.order(), Order::Run(rpm(if held { 50_000 } else { wanted })), "{wanted}");
    }
}

/// A source far from the throttle in force takes over only when it comes within the band, or has waited.
#[test]
fn taking_over_is_bumpless() {
    for ecu in BOTH {
        // Close from the start: it takes over at once.
        for close in [45, 50, 55] {
            let mut scenario = Scenario::started(ecu, percent(50));
            let answer = scenario.command_from(run(close), Origin::Emergency);
            assert_eq!(answer, Ok(Accepted::InForce), "{close}");
            assert_eq!(active_sources(&mut scenario), [(scenario.now_us(), Origin::Emergency)]);
            // Down at once, up at 50 % a second.
            assert_eq!(scenario.tenths(), 500.min(u16::from(close) * 10), "{ecu:?}");
            scenario.pass_us(COMMAND_PERIOD_US);
            assert_eq!(scenario.order(), Order::Run(percent(close)), "{ecu:?}");
        }
        // Far: it waits, and the throttle in force stays, until it has come close.
        for (far, close) in [(90, 55), (10, 45)] {
            let mut scenario = Scenario::started(ecu, percent(50));
            assert_eq!(scenario.command_from(run(far), Origin::Emergency), Ok(Accepted::Held));
            scenario.fly_us(run(far), Origin::Emergency, SECOND);
            assert_eq!((scenario.order(), scenario.wire()), (Order::Run(percent(50)), Wire::Run(500)));
            let telemetry = scenario.telemetry();
            assert_eq!(
                (telemetry.active_source, telemetry.waiting),
                (Origin::Rc, Some(Origin::Emergency)),
                "{ecu:?}"
            );
            scenario.command_from(run(close), Origin::Emergency).unwrap();
            assert_eq!(scenario.telemetry().waiting, None);
            assert_eq!(active_sources(&mut scenario), [(scenario.now_us(), Origin::Emergency)]);
            scenario.pass_us(COMMAND_PERIOD_US);
            assert_eq!(scenario.order(), Order::Run(percent(close)));
            scenario.command_from(run(far), Origin::Emergency).unwrap();
            assert_eq!(scenario.order(), Order::Run(percent(far)), "it is in control now");
        }
        // Far, and stays far: it takes over after the wait, to the tick.
        let mut scenario = Scenario::started(ecu, percent(50));
        let from = scenario.now_us();
        scenario.fly_us(run(90), Origin::Emergency, 2 * SECOND - 1);
        assert_eq!(scenario.tenths(), 500);
        scenario.run_to_us(from + 2 * SECOND);
        assert_eq!((scenario.tenths(), scenario.telemetry().active_source), (500, Origin::Emergency));
        assert_eq!(active_sources(&mut scenario), [(from + 2 * SECOND, Origin::Emergency)]);
        // 40 % at 50 % a second.
        scenario.fly_us(run(90), Origin::Emergency, 800_000 - 1);
        assert!((880..900).contains(&scenario.tenths()), "{}", scenario.tenths());
        scenario.run_to_us(from + 2_800_000);
        assert_eq!((scenario.tenths(), scenario.wire()), (900, Wire::Run(900)));
        // The band to its edge, in tenths.
        for (demand, takes) in [(550, true), (551, false), (450, true), (449, false)] {
            let mut scenario = Scenario::started(ecu, percent(50));
            scenario.command_from(Command::Run(tenths(demand)), Origin::Emergency).unwrap();
            assert_eq!(scenario.telemetry().active_source == Origin::Emergency, takes, "{ecu:?} {demand}");
        }
    }
    // A throttle and an rpm are never close.
    let mut scenario = Scenario::started(Ecu::Zk, percent(50));
    assert_eq!(scenario.command_from(Command::Run(rpm(80_000)), Origin::Emergency), Ok(Accepted::Held));
    scenario.fly_us(Command::Run(rpm(80_000)), Origin::Emergency, 2 * SECOND - FRAME_PERIOD_US);
    assert_eq!(scenario.order(), Order::Run(percent(50)));
    // From the 12 000 rpm that the ECU reports, at 50 % of 160 000 rpm a second.
    scenario.fly_us(Command::Run(rpm(80_000)), Origin::Emergency, FRAME_PERIOD_US + 850_000);
    assert_eq!(scenario.order(), Order::Run(rpm(80_000)));
}

/// A higher source that falls silent before it has taken over leaves the one in control unchanged, even if that one was lost in
/// flight before. If that one was silent meanwhile, it has to take over again.
#[test]
fn a_source_that_stayed_is_obeyed_when_a_higher_one_has_left() {
    for ecu in BOTH {
        for (lost_before, stays) in [(false, true), (true, true), (false, false), (true, false)] {
            let mut scenario = Scenario::started(ecu, percent(50));
            if lost_before {
                scenario.pass_us(10 * SECOND);
                scenario.fly_us(run(50), Origin::Rc, 6 * SECOND);
            }
            assert_eq!((scenario.tenths(), scenario.telemetry().waiting), (500, None));
            // Longer than a short gap of one source, and too short for a take-over by the other.
            for millis in (0..1_800).step_by(100) {
                if (300..1_400).contains(&millis) {
                    scenario.command_from(run(90), Origin::Emergency).unwrap();
                    assert_eq!(scenario.telemetry().waiting, Some(Origin::Emergency));
                }
                if stays {
                    scenario.command(run(if millis < 300 { 50 } else { 20 })).unwrap();
                }
                scenario.pass_us(100_000);
            }
            // Before the wait of the higher one would have ended.
            scenario.fly_us(run(20), Origin::Rc, 200_000);
            let expected = if stays { Accepted::InForce } else { Accepted::Held };
            let answer = scenario.command(run(20));
            assert_eq!(answer, Ok(expected), "{ecu:?}, lost before: {lost_before}, stays: {stays}");
            assert_eq!(scenario.tenths() == 200, stays, "{}", scenario.tenths());
        }
    }
}

/// When the source in control falls silent, the next one that commands takes over in the same way: no stage of loss.
#[test]
fn the_next_source_takes_over_from_one_that_is_lost() {
    for ecu in BOTH {
        let mut scenario = Scenario::started(ecu, percent(50));
        let last = scenario.now_us();
        scenario.fly_us(run(30), Origin::Mavlink, SOURCE_TIMEOUT_US + 2 * SECOND - 1);
        assert_eq!((scenario.tenths(), scenario.telemetry().active_source), (500, Origin::Rc), "{ecu:?}");
        scenario.run_to_us(last + SOURCE_TIMEOUT_US + 2 * SECOND);
        assert_eq!(
            (scenario.tenths(), scenario.telemetry().active_source),
            (300, Origin::Mavlink),
            "{ecu:?}"
        );
        assert_eq!(stages(&mut scenario), []);
    }
}

/// A source that waits to take over while the stages of loss run leaves no deadline behind: the bench panics if
/// the engine's next wake is in the past.
#[test]
fn a_source_that_waits_while_another_is_lost_leaves_no_deadline_behind() {
    for ecu in BOTH {
        for standby_after in [None, Some(micros(SECOND))] {
            let config = ecu.with(|s| s.loss.standby_after = standby_after);
            let mut scenario = Scenario::started_with(ecu, config, percent(50));
            let last = scenario.now_us();
            scenario.pass_us(SOURCE_TIMEOUT_US + 300_000);
            assert_eq!(scenario.telemetry().loss, LossStage::Hold);
            let back = scenario.now_us();
            scenario.fly_us(run(10), Origin::Mavlink, 3 * SECOND);
            assert_eq!(scenario.tenths(), 100, "{ecu:?}");
            let stages = stages(&mut scenario);
            assert_eq!(
                stages,
                [(last + SOURCE_TIMEOUT_US, LossStage::Hold), (back + 2 * SECOND, LossStage::None)]
            );
        }
    }
}

/// A refused command of the source in control, or of a higher one, neither changes the throttle nor keeps it fresh.
#[test]
fn a_refused_demand_changes_nothing() {
    for ecu in BOTH {
        let impossible = Command::Run(rpm(100_000));
        let why = match ecu {
            Ecu::Amt => Rejected::NoSpeedControl,
            Ecu::Zk => Rejected::NeedsVersion { needed: 4, known: Some(3) },
        };
        for origin in [Origin::Rc, Origin::Emergency, Origin::Bench] {
            let mut scenario = Scenario::started(ecu, percent(50));
            scenario.introduce_version(3);
            let last = scenario.now_us();
            for _ in 0..4 {
                assert_eq!(scenario.command_from(impossible, origin), Err(why), "{ecu:?} {origin:?}");
                assert_eq!(scenario.order(), Order::Run(percent(50)), "{ecu:?} {origin:?}");
                scenario.pass_us(COMMAND_PERIOD_US);
            }
            assert_eq!(scenario.wire(), Wire::Run(500));
            assert_eq!(
                stages(&mut scenario),
                [(last + SOURCE_TIMEOUT_US, LossStage::Hold)],
                "{ecu:?} {origin:?}"
            );
        }
    }
}

/// Standby of the source in control is obeyed at its second command within the timeout, to the tick. A single one changes
/// nothing, and does not become standby later.
#[test]
fn standby_is_obeyed_at_the_second_command() {
    for ecu in BOTH {
        for (between, obeyed) in
            [(0, true), (COMMAND_PERIOD_US, true), (SOURCE_TIMEOUT_US, true), (SOURCE_TIMEOUT_US + 1, false)]
        {
            let mut scenario = Scenario::started(ecu, percent(50));
            assert_eq!(scenario.command(Command::Standby), Ok(Accepted::RepeatStandby));
            assert_eq!(scenario.order(), Order::Run(percent(50)));
            scenario.pass_us(between);
            assert_eq!(scenario.order(), Order::Run(percent(50)), "{ecu:?} {between}");
            let expected = if obeyed { Accepted::InForce } else { Accepted::RepeatStandby };
            assert_eq!(scenario.command(Command::Standby), Ok(expected), "{between}");
            let ordered = scenario.telemetry().ordered;
            if obeyed {
                assert_eq!((ordered.order, ordered.origin), (Order::Standby, Origin::Rc));
                assert_eq!(scenario.wire(), Wire::Standby, "{ecu:?}");
            } else {
                assert_eq!((ordered.order, scenario.wire()), (Order::Run(percent(50)), Wire::Run(500)));
            }
        }
        // Another command between the two cancels the first.
        let mut scenario = Scenario::started(ecu, percent(50));
        for _ in 0..20 {
            assert_eq!(scenario.command(Command::Standby), Ok(Accepted::RepeatStandby));
            scenario.command(run(50)).unwrap();
            scenario.pass_us(COMMAND_PERIOD_US);
        }
        assert_eq!(scenario.wire(), Wire::Run(500), "{ecu:?}");
    }
}

/// The same applies to the standby of a source above the one in control, whether it commanded before or not.
#[test]
fn two_standbys_of_a_higher_source_shut_down() {
    for ecu in BOTH {
        for before in [None, Some(run(50))] {
            // At its timeout it is lost.
            for between in [0, COMMAND_PERIOD_US, SOURCE_TIMEOUT_US - 1] {
                let mut scenario = Scenario::started(ecu, percent(50));
                if let Some(command) = before {
                    scenario.command_from(command, Origin::Emergency).unwrap();
                }
                let active_source = scenario.telemetry().active_source;
                assert_eq!(
                    scenario.command_from(Command::Standby, Origin::Emergency),
                    Ok(Accepted::RepeatStandby)
                );
                assert_eq!(
                    (scenario.order(), scenario.telemetry().active_source),
                    (Order::Run(percent(50)), active_source)
                );
                scenario.pass_us(between);
                let answer = scenario.command_from(Command::Standby, Origin::Emergency);
                assert_eq!(answer, Ok(Accepted::InForce), "{ecu:?} {before:?} {between}");
                let ordered = scenario.telemetry().ordered;
                assert_eq!((ordered.order, ordered.origin), (Order::Standby, Origin::Emergency));
                assert_eq!(scenario.wire(), Wire::Standby, "{ecu:?}");
            }
        }
    }
}
