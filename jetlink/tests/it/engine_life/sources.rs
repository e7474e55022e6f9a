//! When standby takes two commands, and the meaning of a source that is present.

use super::*;
use bench::by_hand::at_us;
use jetlink::engine::Engine;

/// Two commands of a slow source count within two of its own periods, to the tick, if that is longer than its timeout.
#[test]
fn two_standbys_of_a_slow_source_count_within_two_of_its_periods() {
    for ecu in BOTH {
        for (period, between, counts) in [
            (800_000, 1_600_000, true),
            (800_000, 1_600_001, false),
            (400_000, 1_000_000, true),
            (400_000, 1_000_001, false),
        ] {
            let mut scenario = Scenario::with(ecu, ecu.config());
            scenario.reports(Reports::Standby).pass_us(2 * SECOND);
            let fly = |scenario: &mut Scenario, command, times| {
                for _ in 0..times {
                    let _ = scenario.command_from(command, Origin::Mavlink);
                    scenario.pass_us(period);
                }
            };
            scenario.command(Command::Arm).unwrap();
            fly(&mut scenario, Command::Standby, 4);
            fly(&mut scenario, run(0), 1);
            scenario.reports = Some(Reports::Starting);
            fly(&mut scenario, run(0), 1);
            scenario.reports = Some(Reports::Running);
            fly(&mut scenario, run(50), 6);
            assert_eq!(scenario.tenths(), 500, "{ecu:?}");
            let first = scenario.command_from(Command::Standby, Origin::Mavlink);
            assert_eq!(first, Ok(Accepted::RepeatStandby));
            scenario.pass_us(between);
            assert!(matches!(scenario.order(), Order::Run(_)), "{ecu:?}: a command that stays alone is none");
            let answer = scenario.command_from(Command::Standby, Origin::Mavlink);
            let expected = if counts { Accepted::InForce } else { Accepted::RepeatStandby };
            assert_eq!(answer, Ok(expected), "{ecu:?} {period} {between}");
            assert_eq!(scenario.order() == Order::Standby, counts);
        }
    }
}

/// One explicit order of a person shuts an engine down, whoever is in control, and permits no start. Streams do not bring it
/// back.
#[test]
fn an_explicit_shutdown_counts_at_once_from_any_source() {
    for ecu in BOTH {
        for origin in Origin::SOURCES {
            let mut scenario = flying(ecu);
            assert_eq!(scenario.command_from(Command::ShutDown, origin), Ok(Accepted::InForce));
            let ordered = scenario.telemetry().ordered;
            assert_eq!((ordered.order, ordered.origin), (Order::Standby, origin), "{ecu:?}");
            assert!(!scenario.bench.machine.failed());
            scenario.reports(Reports::Cooling).reports(Reports::Standby);
            scenario.fly_us(run(0), origin, 5 * SECOND);
            assert_eq!(
                scenario.command_from(run(0), origin),
                Err(Rejected::StandbyFirst),
                "{ecu:?} {origin:?}"
            );
            scenario.fly_us(run(0), Origin::Rc, 5 * SECOND);
            assert_eq!(scenario.wire(), Wire::Standby);
        }
        // Not in place of a stop; also for an engine about which nothing is known yet.
        let mut scenario = flying(ecu);
        scenario.command(Command::EmergencyStop).unwrap();
        assert_eq!(scenario.command(Command::ShutDown), Err(Rejected::StopLatched));
        let mut scenario = Scenario::nothing_received(ecu, ecu.config());
        assert_eq!(scenario.command(Command::ShutDown), Ok(Accepted::InForce));
        scenario.reports(Reports::Running);
        assert_eq!((scenario.order(), scenario.wire()), (Order::Standby, Wire::Standby), "{ecu:?}");
    }
}

/// A lower source that streams standby ends a run that another began only when the fail-safe stage has lasted its time, to
/// the tick; not if the other source returns before.
#[test]
fn standby_of_a_lower_source_waits() {
    for ecu in BOTH {
        for (after, back_at) in [
            (5 * SECOND, None),
            (2 * SECOND, None),
            (5 * SECOND, Some(1_700_000)),
            (5 * SECOND, Some(4 * SECOND)),
        ] {
            let config = ecu.with(|s| s.loss.lower_standby_after = micros(after));
            let mut scenario = Scenario::started_with(ecu, config, percent(50));
            let last = scenario.now_us();
            let end = last + SOURCE_TIMEOUT_US + HOLD_US + after;
            let mut received = Ok(Accepted::InForce);
            while scenario.now_us() < end - COMMAND_PERIOD_US {
                received = scenario.command_from(Command::Standby, Origin::Mavlink);
                if back_at.is_some_and(|at| scenario.now_us() >= last + at) {
                    let _ = scenario.command(run(50));
                }
                scenario.pass_us(COMMAND_PERIOD_US);
                assert!(matches!(scenario.order(), Order::Run(_)), "{ecu:?} {after} {back_at:?}");
            }
            scenario.run_to_us(end - 1);
            assert!(matches!(scenario.order(), Order::Run(_)), "{ecu:?} {after}");
            assert!(received.is_ok());
            scenario.run_to_us(end);
            let ordered = scenario.telemetry().ordered;
            if back_at.is_none() {
                assert_eq!(
                    (ordered.order, ordered.origin),
                    (Order::Standby, Origin::Mavlink),
                    "{ecu:?} {after}"
                );
            } else {
                assert!(matches!(ordered.order, Order::Run(_)), "{ecu:?} {back_at:?}");
            }
        }
    }
}

/// A source that returns within the set time continues without a take-over, at the rate of a rise, to the tick. This applies
/// only to one that was steady before.
#[test]
fn a_short_gap_is_not_a_loss() {
    for ecu in BOTH {
        for (return_within, late, continues) in [
            (SECOND, SECOND - 1, true),
            (SECOND, SECOND, false),
            (0, 0, false),
            (3 * SECOND, 3 * SECOND - 1, true),
        ] {
            let config = ecu.with(|s| s.return_within = micros(return_within));
            let mut scenario = Scenario::started_with(ecu, config, percent(80));
            scenario.fly_us(run(80), Origin::Rc, SECOND);
            scenario.command(run(80)).unwrap();
            scenario.bench.events();
            let last = scenario.now_us();
            scenario.run_to_us(last + SOURCE_TIMEOUT_US + late);
            let expected = if continues { Accepted::InForce } else { Accepted::Held };
            let before = scenario.tenths();
            assert_eq!(scenario.command(run(80)), Ok(expected), "{ecu:?} {return_within} {late}");
            assert_eq!(scenario.tenths(), before, "no jump");
            let stage = scenario.telemetry().loss;
            assert_eq!(stage == LossStage::None, continues, "{ecu:?} {stage:?}");
            // At 50 % a second, from there on.
            scenario.fly_us(run(80), Origin::Rc, 500_000);
            let after = scenario.tenths();
            let expected = if continues { 800.min(before + 250) } else { before };
            assert!(after <= expected && (!continues || after + 10 >= expected), "{ecu:?} {before} {after}");
            // A second gap soon after the first: the stream was not steady.
            if continues {
                scenario.pass_us(SOURCE_TIMEOUT_US);
                assert_eq!(scenario.command(run(80)), Ok(Accepted::Held), "{ecu:?}");
            }
        }
    }
}

/// A source that is present and commands nothing: not in control, no demand held, never standby. From the source in control
/// it is silence from the first such command on.
#[test]
fn a_source_that_is_present_counts_as_silent() {
    for ecu in BOTH {
        // In control: the stages of loss begin at once, and repeating it does not restart them.
        let mut scenario = flying(ecu);
        let from = scenario.now_us();
        assert_eq!(scenario.command(Command::Present), Ok(Accepted::InForce));
        assert_eq!((scenario.telemetry().loss, scenario.order()), (LossStage::Hold, Order::Run(percent(50))));
        scenario.fly_us(Command::Present, Origin::Rc, 100 * SECOND);
        assert_eq!(stages(&mut scenario), [(from, LossStage::Hold), (from + HOLD_US, LossStage::FailSafe)]);
        assert_eq!(scenario.wire(), Wire::Run(0), "{ecu:?}: never standby");
        // Another source takes over from it as from a silent one.
        let mut scenario = flying(ecu);
        for _ in 0..40 {
            scenario.command(Command::Present).unwrap();
            let answer = scenario.command_from(run(48), Origin::Bench);
            assert_eq!(answer, Ok(Accepted::InForce), "{ecu:?}");
            scenario.pass_us(COMMAND_PERIOD_US);
        }
        assert_eq!((scenario.telemetry().active_source, scenario.wire()), (Origin::Bench, Wire::Run(480)));
        // Below or above the source in control it changes nothing.
        for origin in [Origin::Emergency, Origin::Bench] {
            let mut scenario = flying(ecu);
            for _ in 0..20 {
                scenario.command(run(50)).unwrap();
                let _ = scenario.command_from(Command::Present, origin);
                scenario.pass_us(COMMAND_PERIOD_US);
            }
            assert_eq!(
                (scenario.telemetry().active_source, scenario.wire()),
                (Origin::Rc, Wire::Run(500)),
                "{ecu:?}"
            );
            assert_eq!(scenario.bench.event_kinds(), []);
        }
        // It also counts as silent when nothing is in force yet: standby follows when the stages of loss have run out.
        let mut scenario = Scenario::nothing_received(ecu, ecu.config());
        assert_eq!(scenario.command(run(0)), Err(Rejected::Listening));
        scenario.pass_us(COMMAND_PERIOD_US);
        scenario.fly_us(Command::Present, Origin::Rc, HOLD_US + RUN_OUT_US - 1);
        assert_eq!(scenario.order(), Order::Listen, "{ecu:?}");
        scenario.pass_us(1);
        assert_eq!(scenario.order(), Order::Standby, "{ecu:?}");
        // It is not a standby: it does not permit a start.
        let mut scenario = Scenario::with(ecu, ecu.config());
        scenario.reports(Reports::Standby).pass_us(2 * SECOND);
        scenario.command(Command::Arm).unwrap();
        scenario.fly_us(Command::Present, Origin::Rc, 2 * SECOND);
        scenario.fly_us(run(0), Origin::Rc, 2 * SECOND);
        assert_eq!(scenario.command(run(0)), Err(Rejected::StandbyFirst), "{ecu:?}");
    }
}

/// While no order is in force, a lower source's standby stays without effect for as long as a higher source streams run, which is refused
/// but keeps that source in control.
#[test]
fn standby_behind_a_run_that_is_refused_ends_no_search() {
    for ecu in BOTH {
        for (higher, answer) in [(true, Accepted::Behind(Origin::Rc)), (false, Accepted::InForce)] {
            let mut scenario = Scenario::nothing_received(ecu, ecu.config());
            let mut last = None;
            for _ in 0..80 {
                if higher {
                    scenario.command(run(0)).unwrap_err();
                }
                last = Some(scenario.command_from(Command::Standby, Origin::Bench));
                scenario.pass_us(COMMAND_PERIOD_US);
            }
            assert_eq!(last, Some(Ok(answer)), "{ecu:?}");
            let order = if higher { Order::Listen } else { Order::Standby };
            assert_eq!(scenario.order(), order, "{ecu:?}");
        }
    }
}

/// Nothing is retained of the stream of a lost source after its timeout, also while a lower source is received: otherwise one stray command after
/// the next reset brings it back in control. The control: without the lower source.
#[test]
fn the_stream_of_a_lost_source_is_not_retained_beside_a_lower_source() {
    for ecu in BOTH {
        for lower in [Command::Present, Command::Standby] {
            let config = ecu.config();
            let fly = |scenario: &mut Scenario, commands: bool, micros: u64| {
                let end = scenario.now_us() + micros;
                while scenario.now_us() < end {
                    if commands {
                        let _ = scenario.command(run(3));
                    }
                    let _ = scenario.command_from(lower, Origin::Mavlink);
                    scenario.pass_us(COMMAND_PERIOD_US);
                }
            };
            let mut scenario = Scenario::started(ecu, percent(3));
            scenario.reports = Some(Reports::Running);
            fly(&mut scenario, true, 2 * SECOND);
            fly(&mut scenario, false, 3 * SECOND);
            // Shorter than it takes to be in control again.
            fly(&mut scenario, true, 900_000);
            assert_eq!(scenario.telemetry().loss, LossStage::FailSafe, "{ecu:?}");
            let mut scenario = scenario.reset(config);
            fly(&mut scenario, false, 2 * SECOND);
            assert_eq!(scenario.bench.machine.record().steady.as_millis(), 0, "{ecu:?} {lower:?}");
            let mut scenario = scenario.reset(config);
            fly(&mut scenario, false, 300_000);
            let _ = scenario.command(run(3));
            assert_eq!(scenario.telemetry().loss, LossStage::FailSafe, "{ecu:?} {lower:?}");
        }
    }
}

/// A source that is present without a command is silent, also while no order is in force: it does not begin the time to standby again.
#[test]
fn a_source_that_is_present_for_the_first_time_does_not_delay_standby_while_listening() {
    for ecu in BOTH {
        let mut scenario = Scenario::after_reset(ecu, ecu.config(), None);
        scenario.silent().pass_us(9 * SECOND);
        scenario.command_from(Command::Present, Origin::Mavlink).unwrap();
        scenario.pass_us(2 * SECOND);
        assert_eq!(scenario.order(), Order::Standby, "{ecu:?}");
    }
}

/// An engine that is found in flight has the stages of loss from then on, also where a source has only been present (seed 198): the
/// time before the node's start is no silence of that source.
#[test]
fn a_source_that_is_present_for_the_first_time_has_not_been_silent_before_the_start() {
    for ecu in BOTH {
        for present in [false, true] {
            let config = ecu.with(|s| s.loss.standby_after = Some(Duration::from_secs(10)));
            let mut scenario = Scenario::after_reset(ecu, config, None);
            scenario.silent().pass_us(600 * SECOND + FRAME_PERIOD_US / 2);
            let mut machine = Engine::new(&config);
            machine.restore(None);
            machine.start(at_us(scenario.now_us()));
            *scenario.bench.machine = machine;
            if present {
                scenario.command_from(Command::Present, Origin::Mavlink).unwrap();
            }
            scenario.introduce();
            scenario.reports(Reports::Running).pass_us(4 * SECOND);
            assert!(matches!(scenario.order(), Order::Run(_)), "{ecu:?}, {present}: {}", scenario.order());
        }
    }
}

/// A node without a record obeys a lower source's standby 6 s after its start, also where the highest source has only been present.
#[test]
fn a_highest_source_that_is_only_present_does_not_hasten_a_lower_standby() {
    for ecu in BOTH {
        for present in [false, true] {
            let config = ecu.config();
            let mut scenario = Scenario::after_reset(ecu, config, None);
            scenario.silent().pass_us(600 * SECOND + FRAME_PERIOD_US / 2);
            let mut machine = Engine::new(&config);
            machine.restore(None);
            let started = scenario.now_us();
            machine.start(at_us(started));
            *scenario.bench.machine = machine;
            if present {
                scenario.command_from(Command::Present, Origin::SOURCES[0]).unwrap();
            }
            let obeyed = loop {
                scenario.pass_us(SECOND / 10);
                let _ = scenario.command_from(Command::Standby, Origin::Bench);
                if scenario.order() == Order::Standby {
                    break scenario.now_us() - started;
                }
            };
            assert!((6 * SECOND..=7 * SECOND).contains(&obeyed), "{ecu:?}, {present}: after {obeyed} us");
        }
    }
}

/// Commands in bursts of 1 s, with gaps that are a little longer than the timeout of their source, beside the commands of another one.
fn bursts(
    scenario: &mut Scenario,
    (command, origin): (Command, Origin),
    other: Option<(Command, Origin)>,
    s: u64,
) {
    let end = scenario.now_us() + s * SECOND;
    let (mut next, mut sent) = (0, 0);
    while scenario.now_us() < end {
        if scenario.now_us() >= next {
            let _ = scenario.command_from(command, origin);
            sent += 1;
            let gap = if sent % 11 == 0 { SOURCE_TIMEOUT_US + 20_000 } else { COMMAND_PERIOD_US };
            next = scenario.now_us() + gap;
        }
        if let Some((command, origin)) = other {
            let _ = scenario.command_from(command, origin);
        }
        scenario.pass_us(20_000);
    }
}

/// A source that waits to take over waits once, also over its own short gaps: otherwise each gap would begin the wait anew, which holds the
/// demand of a source that is dead.
#[test]
fn a_wait_to_take_over_continues_over_short_gaps() {
    for ecu in BOTH {
        let dead = || {
            let mut scenario = flying(ecu);
            scenario.fly_us(run(90), Origin::Mavlink, 8 * SECOND);
            scenario
        };
        let mut scenario = dead();
        bursts(&mut scenario, (run(0), Origin::Rc), None, 5);
        assert_eq!(scenario.tenths(), 0, "{ecu:?}");
        // The same with "present" for 20 ms in place of each gap.
        let mut scenario = dead();
        for _ in 0..3 {
            scenario.fly_us(run(0), Origin::Rc, 1_900_000);
            scenario.fly_us(Command::Present, Origin::Rc, 20_000);
        }
        assert_eq!(scenario.tenths(), 0, "{ecu:?}");
        // A higher source takes over from one that is received, too.
        let mut scenario = dead();
        bursts(&mut scenario, (run(60), Origin::Rc), Some((run(90), Origin::Mavlink)), 5);
        assert_eq!(scenario.telemetry().active_source, Origin::Rc, "{ecu:?}");
        // The control: one that has been away for longer than a wait begins another one.
        let mut scenario = dead();
        scenario.fly_us(run(0), Origin::Rc, SECOND);
        scenario.fly_us(run(90), Origin::Mavlink, 5 * SECOND);
        let began = scenario.now_us();
        while scenario.tenths() == 900 {
            let _ = scenario.command_from(run(90), Origin::Mavlink);
            scenario.fly_us(run(0), Origin::Rc, COMMAND_PERIOD_US);
        }
        let waited = scenario.now_us() - began;
        // It was lost: 1 s until it is steady, and the wait.
        assert!((2_900_000..=3_200_000).contains(&waited), "{ecu:?}: {waited} us");
    }
}

/// Neither a lower source's standby nor the stages of loss of the source before end the flight of one that commands run in bursts.
#[test]
fn a_source_with_short_gaps_is_not_shut_down_while_it_waits() {
    for ecu in BOTH {
        for (standby_after, other) in
            [(None, Some((Command::Standby, Origin::Bench))), (Some(Duration::from_secs(10)), None)]
        {
            let config = ecu.with(|s| s.loss.standby_after = standby_after);
            let mut scenario = Scenario::started_with(ecu, config, percent(50));
            scenario.fly_us(run(90), Origin::Mavlink, 8 * SECOND);
            bursts(&mut scenario, (run(60), Origin::Rc), other, 40);
            assert!(matches!(scenario.order(), Order::Run(_)), "{ecu:?}: {}", scenario.order());
        }
    }
}
