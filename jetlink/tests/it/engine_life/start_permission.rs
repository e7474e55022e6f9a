//! A start is a permission, used once.

use super::*;

/// Any refusal uses up the permission: when its reason is gone, the same stream of run starts nothing. Standby does.
#[test]
fn a_refused_start_does_not_happen_later() {
    let table: [(&str, Step, Interlock, Step); 6] = [
        ("fault", |s| s.values.fault = 1, Interlock::Fault, |s| s.values.fault = 0),
        (
            "hot",
            |s| s.values.egt_celsius = 300,
            Interlock::TooHot(Celsius::from_tenths(0)),
            |s| s.values.egt_celsius = 26,
        ),
        ("egt", |s| s.values.egt_celsius = -50, Interlock::EgtUnknown, |s| s.values.egt_celsius = 26),
        (
            "cooling",
            |s| s.reports = Some(Reports::Cooling),
            Interlock::NotStandby,
            |s| s.reports = Some(Reports::Standby),
        ),
        (
            "limit",
            |s| s.values.rpm = Some(3_000),
            Interlock::Limit(LimitKind::OverSpeed),
            |s| s.values.rpm = None,
        ),
        ("above idle", |_| {}, Interlock::NotIdle, |_| {}),
    ];
    for ecu in BOTH {
        for (name, wrong, interlock, right) in table {
            // A shaft that turns is cooling to an AMT ECU.
            if ecu == Ecu::Amt && name == "limit" {
                continue;
            }
            let config = ecu.with(|s| {
                s.limits.over_speed = Limit { at: Some(Rpm::new(2_500)), action: Action::Standby };
            });
            let mut scenario = Scenario::ready(ecu, config);
            wrong(&mut scenario);
            scenario.pass_us(4 * FRAME_PERIOD_US);
            scenario.command(Command::Standby).unwrap();
            let command = if interlock == Interlock::NotIdle { run(50) } else { run(0) };
            let Err(Rejected::Start(why)) = scenario.command(command) else { panic!("{ecu:?} {name}") };
            assert_eq!(core::mem::discriminant(&why), core::mem::discriminant(&interlock), "{ecu:?} {name}");
            right(&mut scenario);
            for _ in 0..50 {
                scenario.pass_us(COMMAND_PERIOD_US);
                assert_eq!(scenario.command(run(0)), Err(Rejected::StandbyFirst), "{ecu:?} {name}");
            }
            assert_eq!(scenario.wire(), Wire::Standby);
            scenario.command(Command::Standby).unwrap();
            assert_eq!(scenario.command(run(0)), Ok(Accepted::InForce), "{ecu:?} {name}: the control");
        }
    }
}

/// A run of a source that is not in control uses its permission up: it starts nothing once the source above falls silent.
#[test]
fn a_run_behind_another_source_uses_the_permission_up() {
    for ecu in BOTH {
        for behind in [false, true] {
            let mut scenario = Scenario::ready(ecu, ecu.config());
            scenario.command(Command::Standby).unwrap();
            scenario.command_from(Command::Standby, Origin::Mavlink).unwrap();
            if behind {
                scenario.command_from(run(0), Origin::Mavlink).unwrap();
            }
            let continues = if behind { run(0) } else { Command::Standby };
            scenario.fly_us(continues, Origin::Mavlink, 4 * SECOND);
            assert_eq!((scenario.order(), scenario.wire()), (Order::Standby, Wire::Standby));
            let starts = if behind { Err(Rejected::StandbyFirst) } else { Ok(Accepted::InForce) };
            assert_eq!(scenario.command_from(run(0), Origin::Mavlink), starts, "{ecu:?}");
        }
    }
}

/// Events that use up a permission, and events that do not.
#[test]
fn a_permission_is_used_up_as_documented() {
    let table: [(&str, Step, bool); 10] = [
        ("nothing", |_| {}, false),
        (
            "disarm and arm",
            |s| {
                s.command_from(Command::Disarm, Origin::Bench).unwrap();
                s.command(Command::Arm).unwrap();
            },
            true,
        ),
        (
            "present",
            |s| {
                s.command(Command::Present).unwrap();
            },
            true,
        ),
        (
            "shut down",
            |s| {
                s.command_from(Command::ShutDown, Origin::Bench).unwrap();
            },
            true,
        ),
        (
            "stop, release and arm",
            |s| {
                s.command_from(Command::EmergencyStop, Origin::Bench).unwrap();
                s.command_from(Command::ReleaseStop, Origin::Bench).unwrap();
                s.command(Command::Disarm).unwrap();
                s.command(Command::Arm).unwrap();
            },
            true,
        ),
        (
            "another source changes to standby",
            |s| {
                s.command_from(Command::Standby, Origin::Mavlink).unwrap();
            },
            true,
        ),
        (
            "another source repeats standby",
            |s| {
                // It did so before, and continues.
                s.command_from(Command::Standby, Origin::Mavlink).unwrap();
                s.command(Command::Standby).unwrap();
                s.pass_us(COMMAND_PERIOD_US);
                s.command_from(Command::Standby, Origin::Mavlink).unwrap();
            },
            false,
        ),
        (
            "the same source repeats standby",
            |s| {
                s.command(Command::Standby).unwrap();
            },
            false,
        ),
        (
            "a present source above",
            |s| {
                s.command_from(Command::Present, Origin::Emergency).unwrap();
            },
            false,
        ),
        (
            "a release of no stop",
            |s| {
                s.command(Command::ReleaseStop).unwrap();
            },
            false,
        ),
    ];
    for ecu in BOTH {
        for (name, step, used_up) in table {
            let mut scenario = Scenario::ready(ecu, ecu.config());
            step(&mut scenario);
            let answer = scenario.command(run(0));
            assert_eq!(answer == Ok(Accepted::InForce), !used_up, "{ecu:?} {name}: {answer:?}");
            if used_up {
                scenario.fly_us(run(0), Origin::Rc, 3 * SECOND);
                assert_eq!(scenario.command(run(0)), Err(Rejected::StandbyFirst), "{ecu:?} {name}");
                assert_eq!(scenario.wire(), Wire::Standby);
            }
        }
    }
}

/// One permission is one start: an engine that went out is not started by the stream that started it.
#[test]
fn a_permission_is_used_once() {
    for ecu in BOTH {
        for far in [Reports::Starting, Reports::Running] {
            let mut scenario = Scenario::ready(ecu, ecu.config());
            scenario.command(run(0)).unwrap();
            scenario.reports(Reports::Starting).reports(far).reports(Reports::Standby);
            assert_eq!(scenario.order(), Order::Standby, "{ecu:?} {far:?}");
            scenario.fly_us(run(0), Origin::Rc, 200 * SECOND);
            assert_eq!((scenario.order(), scenario.wire()), (Order::Standby, Wire::Standby));
            scenario.command(Command::Standby).unwrap();
            assert_eq!(scenario.command(run(0)), Ok(Accepted::InForce), "{ecu:?}: the control");
        }
    }
}

/// It is the source's own: standby of one and run of another do not start the engine.
#[test]
fn a_permission_belongs_to_one_source() {
    for ecu in BOTH {
        for commands_standby in [true, false] {
            let mut scenario = Scenario::ready(ecu, ecu.config());
            // RC is switched off; MAVLink has streamed below it.
            for _ in 0..30 {
                let command = if commands_standby { Command::Standby } else { run(0) };
                let _ = scenario.command_from(command, Origin::Mavlink);
                scenario.pass_us(COMMAND_PERIOD_US);
            }
            let expected = if commands_standby { Ok(Accepted::InForce) } else { Err(Rejected::StandbyFirst) };
            assert_eq!(
                scenario.command_from(run(0), Origin::Mavlink),
                expected,
                "{ecu:?} {commands_standby}"
            );
        }
    }
}

/// The end of a life, or a person's stop, ends what its sources intended, but not what they commanded: a source whose last word was run
/// changes to standby with its next one.
#[test]
fn after_the_end_of_a_life_the_first_standby_of_its_source_is_a_change() {
    let ends: [Step; 2] = [
        |s| {
            s.reports(Reports::Standby);
        },
        |s| {
            s.command_from(Command::ShutDown, Origin::Bench).unwrap();
            s.reports(Reports::Standby);
        },
    ];
    for (ecu, ends) in BOTH.into_iter().flat_map(|ecu| ends.map(|ends| (ecu, ends))) {
        for standby_before in [false, true] {
            let mut scenario = Scenario::started(ecu, percent(50));
            ends(&mut scenario);
            assert_eq!(scenario.order(), Order::Standby, "{ecu:?}: the life is over, and RC is still fresh");
            if standby_before {
                scenario.command(Command::Standby).unwrap();
            }
            let behind = Ok(Accepted::Behind(Origin::Rc));
            assert_eq!(scenario.command_from(Command::Standby, Origin::Mavlink), behind, "{ecu:?}");
            scenario.command(Command::Standby).unwrap();
            // RC is switched off.
            scenario.pass_us(SOURCE_TIMEOUT_US);
            let expected = if standby_before { Ok(Accepted::InForce) } else { Err(Rejected::StandbyFirst) };
            assert_eq!(scenario.command_from(run(0), Origin::Mavlink), expected, "{ecu:?} {standby_before}");
        }
    }
}

/// Armed, in standby under a steady stream of RC, and its start waits for another engine; until when.
fn start_waits(ecu: Ecu) -> (Scenario, u64) {
    let mut scenario = Scenario::ready(ecu, ecu.config());
    scenario.fly_us(Command::Standby, Origin::Rc, 2 * SECOND);
    scenario.others_allow_start = false;
    assert_eq!(scenario.command(run(0)), Ok(Accepted::StartWaits));
    let until = scenario.now_us() + 180 * SECOND;
    assert_eq!(scenario.telemetry().start_waits_until, Some(at_us(until)), "{ecu:?}");
    scenario.bench.events();
    (scenario, until)
}

/// The wait is over as of now, and the same stream starts nothing when the other engine is done.
fn assert_wait_is_over(scenario: &mut Scenario) {
    assert_eq!(scenario.telemetry().start_waits_until, None);
    let other = Rejected::Start(Interlock::OtherStarting);
    assert!(scenario.bench.event_kinds().contains(&Event::CommandRejected(other, Origin::Rc)));
    scenario.others_allow_start = true;
    scenario.fly_us(run(0), Origin::Rc, 3 * SECOND);
    assert_eq!((scenario.order(), scenario.wire()), (Order::Standby, Wire::Standby));
}

/// A start that waits for another engine: telemetry shows until when. It goes with its source's next command, and never after
/// that time; to the tick.
#[test]
fn a_start_waits_for_the_gap_between_two_starts() {
    for ecu in BOTH {
        let (mut scenario, until) = start_waits(ecu);
        let left = until - 1 - scenario.now_us();
        scenario.fly_us(run(0), Origin::Rc, left);
        assert_eq!(
            scenario.telemetry().start_waits_until,
            Some(at_us(until)),
            "{ecu:?}: not again with each command"
        );
        scenario.others_allow_start = true;
        assert_eq!(scenario.command(run(0)), Ok(Accepted::InForce), "{ecu:?}");

        let (mut scenario, until) = start_waits(ecu);
        let left = until - scenario.now_us();
        scenario.fly_us(run(0), Origin::Rc, left);
        assert_wait_is_over(&mut scenario);
    }
}

/// The wait ends when its source is lost, to the tick, also if that comes back at once.
#[test]
fn a_start_waits_for_as_long_as_its_source_is_fresh() {
    for ecu in BOTH {
        let (mut scenario, until) = start_waits(ecu);
        let last = scenario.now_us();
        scenario.run_to_us(last + SOURCE_TIMEOUT_US - 1);
        assert_eq!(scenario.telemetry().start_waits_until, Some(at_us(until)), "{ecu:?}");
        scenario.run_to_us(last + SOURCE_TIMEOUT_US);
        assert_wait_is_over(&mut scenario);
    }
}

/// And when another source is in control, also for a moment.
#[test]
fn a_start_waits_for_as_long_as_its_source_is_in_control() {
    for ecu in BOTH {
        let (mut scenario, _) = start_waits(ecu);
        let _ = scenario.command_from(run(0), Origin::Emergency);
        assert_wait_is_over(&mut scenario);
    }
}

/// When it goes everything is checked again, and a refusal uses the permission up.
#[test]
fn a_start_that_waited_needs_every_interlock() {
    for ecu in BOTH {
        for (step, why) in [
            ((|s| s.values.egt_celsius = 300) as Step, "hot"),
            (|s| s.values.fault = 1, "fault"),
            (|s| s.reports = Some(Reports::Cooling), "not in standby"),
        ] {
            let (mut scenario, _) = start_waits(ecu);
            step(&mut scenario);
            scenario.pass_us(2 * FRAME_PERIOD_US);
            scenario.others_allow_start = true;
            let answer = scenario.command(run(0));
            assert!(matches!(answer, Err(Rejected::Start(_))), "{ecu:?} {why} {answer:?}");
            (scenario.values.egt_celsius, scenario.values.fault) = (26, 0);
            scenario.reports(Reports::Standby);
            scenario.fly_us(run(0), Origin::Rc, 3 * SECOND);
            assert_eq!(scenario.command(run(0)), Err(Rejected::StandbyFirst), "{ecu:?} {why}");
        }
        // Arming and idle too.
        for command in [Command::Disarm, run(50)] {
            let (mut scenario, _) = start_waits(ecu);
            let _ = scenario.command(command);
            assert_eq!(scenario.telemetry().start_waits_until, None, "{ecu:?} {command:?}");
            scenario.command(Command::Arm).unwrap();
            scenario.others_allow_start = true;
            assert_eq!(scenario.command(run(0)), Err(Rejected::StandbyFirst), "{ecu:?} {command:?}");
        }
    }
}

/// After an emergency stop the engine is disarmed, and a source that has commanded arm all along has to command disarm first.
#[test]
fn arming_after_a_stop_needs_a_change() {
    // The source that commanded "arm" before the stop, the one while it was latched, the one after its release.
    for (before, latched, after, answer) in [
        (Origin::Rc, None, Origin::Rc, Err(Rejected::DisarmFirst)),
        (Origin::Rc, None, Origin::Bench, Ok(Accepted::InForce)),
        (Origin::Rc, Some(Origin::Bench), Origin::Bench, Err(Rejected::DisarmFirst)),
        (Origin::Bench, Some(Origin::Rc), Origin::Rc, Err(Rejected::DisarmFirst)),
        (Origin::Bench, None, Origin::Rc, Ok(Accepted::InForce)),
    ] {
        for ecu in BOTH {
            let mut scenario = Scenario::with(ecu, ecu.config());
            scenario.reports(Reports::Standby).pass_us(2 * SECOND);
            scenario.command_from(Command::Arm, before).unwrap();
            scenario.command_from(Command::EmergencyStop, Origin::Bench).unwrap();
            assert!(!scenario.telemetry().armed);
            if let Some(origin) = latched {
                assert_eq!(scenario.command_from(Command::Arm, origin), Err(Rejected::StopLatched));
            }
            scenario.command_from(Command::ReleaseStop, Origin::Bench).unwrap();
            assert!(!scenario.telemetry().armed);
            for _ in 0..3 {
                assert_eq!(
                    scenario.command_from(Command::Arm, after),
                    answer,
                    "{ecu:?} {before:?} {latched:?}"
                );
                assert_eq!(scenario.telemetry().armed, answer.is_ok());
            }
            scenario.command_from(Command::Disarm, after).unwrap();
            assert_eq!(scenario.command_from(Command::Arm, after), Ok(Accepted::InForce), "{ecu:?}");
        }
    }
}
