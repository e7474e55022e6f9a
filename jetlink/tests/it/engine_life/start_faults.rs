//! Faults during a start.

use super::*;

/// Two error sets end a start, whatever the exhaust reports: its ECU could start the engine again when the fault clears. One odd
/// set ends nothing.
#[test]
fn amt_8_two_error_sets_end_a_start() {
    for reports in [Reports::Standby, Reports::Starting] {
        for (sets, fault, egt, over) in
            [(1, 1, 26, false), (2, 1, 26, true), (2, 1 << 3, 26, true), (2, 1, 500, true)]
        {
            let mut scenario = Scenario::ready(Ecu::Amt, Ecu::Amt.config());
            assert_eq!(scenario.command(run(0)), Ok(Accepted::InForce));
            scenario.reports(reports);
            for i in 1..=20 {
                scenario.values.egt_celsius = 26 + (egt - 26) * i / 20;
                scenario.fly_us(run(0), Origin::Rc, FRAME_PERIOD_US);
            }
            scenario.bench.events();
            scenario.values.fault = fault;
            scenario.fly_us(run(0), Origin::Rc, sets * FRAME_PERIOD_US);
            let expected = if over { vec![End::FaultInStart] } else { vec![] };
            assert_eq!(ends(&mut scenario), expected, "{reports:?} {sets} sets, fault {fault}, {egt} °C");
            // It stays so when the fault clears.
            scenario.values.fault = 0;
            scenario.fly_us(run(0), Origin::Rc, 2 * SECOND);
            assert_eq!(
                scenario.order() == Order::Standby,
                over,
                "{reports:?} {sets} sets, fault {fault}, {egt} °C"
            );
        }
    }
}

/// A start that a reset has cut short continues as a start: the demand waits for running, its time is bounded, and two error sets
/// end it. One that had reached running before the reset is an engine in flight.
#[test]
fn amt_a_start_that_a_reset_cut_short_resumes_as_a_start() {
    for (reached, faults) in [(false, false), (false, true), (true, true)] {
        let config = Ecu::Amt.config();
        let mut scenario = Scenario::ready(Ecu::Amt, config);
        scenario.command(run(0)).unwrap();
        scenario.reports(Reports::Starting);
        if reached {
            scenario.reports(Reports::Running).fly_us(run(20), Origin::Rc, 2 * SECOND);
        }
        let mut scenario = scenario.reset(config);
        scenario.values.egt_celsius = 500;
        scenario.reports(Reports::Unknown).fly_us(run(20), Origin::Rc, SECOND);
        let order = if reached { Order::Doubt(percent(20)) } else { Order::Run(percent(0)) };
        assert_eq!(scenario.order(), order, "{reached}");
        if faults {
            scenario.values.fault = 1;
            scenario.fly_us(run(20), Origin::Rc, 2 * FRAME_PERIOD_US);
        } else {
            // The time of a start.
            scenario.fly_us(run(20), Origin::Rc, 116 * SECOND);
            assert_eq!(scenario.order(), order);
            scenario.fly_us(run(20), Origin::Rc, 4 * SECOND);
        }
        assert_eq!(scenario.order() == Order::Standby, !reached, "{reached} {faults}");
    }
}

/// Error sets after a reset in a start end it likewise, unless the engine may burn, and may have reached running since: the ECU would light
/// it once more when the fault clears, on the run from before the reset. An engine that had reached running continues in flight.
#[test]
fn amt_8_two_error_sets_after_a_reset_end_a_start() {
    let cold: Egt = |_| 64;
    let hot: Egt = |_| 500;
    // By 6 °C/s: what comes after the fuel ramp.
    let settles: Egt = |t| 540 - (t / 160_000) as i32;
    for (reached, egt, sets, order) in [
        (false, cold, 1, Order::Listen),
        (false, cold, 3, Order::Standby),
        (false, hot, 3, Order::Listen),
        (false, settles, 24, Order::Listen),
        (true, hot, 3, Order::Doubt(percent(0))),
    ] {
        let config = Ecu::Amt.config();
        let mut scenario = Scenario::ready(Ecu::Amt, config);
        scenario.command(run(0)).unwrap();
        scenario.reports(Reports::Starting);
        if reached {
            scenario.reports(Reports::Running).fly_us(run(0), Origin::Rc, 2 * SECOND);
        }
        let mut scenario = scenario.reset(config);
        scenario.values.fault = 1;
        let begin = scenario.now_us();
        for _ in 0..sets {
            scenario.values.egt_celsius = egt(scenario.now_us() - begin);
            scenario.fly_us(run(0), Origin::Rc, FRAME_PERIOD_US);
        }
        assert_eq!(scenario.order(), order, "{reached}, {} °C, {sets} sets", egt(0));
    }
}

/// A start is ended by one command of its source, even if it has been silent for longer than its timeout.
#[test]
fn one_standby_of_a_source_that_was_lost_ends_a_start() {
    for ecu in BOTH {
        for (reports, origin, ended) in [
            (Reports::Standby, Origin::Rc, true),
            (Reports::Starting, Origin::Rc, true),
            (Reports::Running, Origin::Rc, false),
            (Reports::Starting, Origin::Mavlink, true),
        ] {
            let mut scenario = Scenario::ready(ecu, ecu.config());
            scenario.command(run(0)).unwrap();
            scenario.reports(reports).pass_us(2 * SOURCE_TIMEOUT_US);
            let _ = scenario.command_from(Command::Standby, origin);
            assert_eq!(scenario.order() == Order::Standby, ended, "{ecu:?} {reports:?} {origin:?}");
        }
        // Below a source that is present it has no effect.
        let mut scenario = Scenario::ready(ecu, ecu.config());
        scenario.command(run(0)).unwrap();
        scenario.reports(Reports::Starting);
        assert_eq!(
            scenario.command_from(Command::Standby, Origin::Mavlink),
            Ok(Accepted::Behind(Origin::Rc))
        );
        assert_eq!(scenario.order(), Order::Run(percent(0)), "{ecu:?}");
    }
}

/// With error sets only a demand rises while the exhaust burns, and not while it cools, however slowly.
#[test]
fn amt_8_a_demand_does_not_rise_while_the_exhaust_cools() {
    let table: [(Egt, u16); 3] =
        [(|_| 500, 800), (|t| 500 - (t / 200_000) as i32, 500), (|t| 500 + (t / 200_000) as i32, 800)];
    for (egt, tenths) in table {
        let mut scenario = with_faults(10 * SECOND, 1, run(50), egt);
        let from = scenario.now_us();
        while scenario.now_us() < from + 10 * SECOND {
            scenario.values.egt_celsius = egt(10 * SECOND + scenario.now_us() - from);
            let _ = scenario.command(run(80));
            scenario.pass_us(FRAME_PERIOD_US);
        }
        assert_eq!(scenario.wire(), Wire::Run(tenths));
    }
}

/// A shaft that coasts beside a cleared start is no verdict; with an exhaust that does not burn it is, in two sets, before the
/// ECU can start the engine again.
#[test]
fn amt_start_clearance_with_a_cold_exhaust_ends_a_life() {
    for (egt, ended) in [(500, false), (26, true)] {
        let mut scenario = flying(Ecu::Amt);
        for i in 1..=40 {
            scenario.values.egt_celsius = 26 + (egt - 26) * i / 40;
            let _ = scenario.command(run(50));
            scenario.pass_us(FRAME_PERIOD_US);
        }
        for _ in 0..2 {
            scenario.command(run(50)).unwrap();
            let mut frame = report(Ecu::Amt, 0b00001, TURNING);
            frame[3] = u8::try_from((egt + 50) * 10 / 46).unwrap();
            receive(&mut scenario, &frame);
        }
        assert_eq!(scenario.order() == Order::Standby, ended, "{egt} °C");
        assert_eq!(ends(&mut scenario), if ended { vec![End::AtRest] } else { vec![] });
    }
}

/// Reports after a start was ordered, each with its state; what becomes of the order. The first report of starting ends the time in which
/// rest fits; cooling never fits, because the start needed standby. Two reports have to agree, and the reply to the first is no run (ZK).
#[test]
fn after_the_first_report_of_starting_rest_ends_a_start_and_cooling_always_does() {
    const COOLS: u8 = 12;
    let over = Some(End::AtRest);
    for (states, expected) in [
        (&[1, 1, 1, 1][..], None),
        (&[2, 1, 1], over),
        (&[1, 2, 1, 1], over),
        (&[2, 1, 2, 2], None),
        // A later stage than that of the engine is odd, and no earlier stage follows it.
        (&[5, 2, 2, 5, 5], None),
        (&[2, 2, 5, 5, 1, 1], over),
        (&[COOLS, COOLS], over),
        (&[1, 1, COOLS, COOLS], over),
        (&[COOLS, 1, 1], None),
        (&[1, COOLS, 1, COOLS, 1, 1], None),
    ] {
        let mut scenario = Scenario::ready(Ecu::Zk, Ecu::Zk.config());
        scenario.command(run(0)).unwrap();
        for state in states {
            let _ = scenario.command(run(0));
            receive(&mut scenario, &zk_frames::state(*state));
        }
        assert_eq!(ends(&mut scenario).first().copied(), expected, "{states:?}");
        assert_eq!(
            scenario.order() == Order::Standby,
            expected.is_some(),
            "{states:?}: {:?}",
            scenario.order()
        );
        // An odd report has changed nothing: the start is not in doubt.
        if expected.is_none() {
            assert_eq!(scenario.order(), Order::Run(percent(0)), "{states:?}");
        }
    }
    let mut scenario = Scenario::ready(Ecu::Amt, Ecu::Amt.config());
    scenario.command(run(0)).unwrap();
    scenario.reports(Reports::Standby);
    let values = scenario.values;
    assert_eq!((scenario.order(), ends(&mut scenario)), (Order::Run(percent(0)), vec![]), "AMT");
    scenario.odd(Reports::Starting, values);
    scenario.fly_us(run(0), Origin::Rc, 4 * FRAME_PERIOD_US);
    assert_eq!((scenario.order(), ends(&mut scenario)), (Order::Standby, vec![End::AtRest]), "AMT");
}

/// An ECU that fails to restart its engine (ZK 13) in the time of a start: the engine has failed. One that succeeds has not, and a start
/// that takes too long is no failure of an engine that ran.
#[test]
fn zk_an_engine_whose_ecu_cannot_restart_it_has_failed() {
    let minutes = |scenario: &mut Scenario, state: u8, demand: u8| {
        for _ in 0..3 * 60 * 20 {
            let _ = scenario.command(run(demand));
            receive(scenario, &zk_frames::status(1, 3_000, [state, 2 << 5, 76]));
        }
    };
    let mut scenario = flying(Ecu::Zk);
    minutes(&mut scenario, 13, 50);
    assert_eq!((scenario.order(), scenario.bench.machine.failed()), (Order::Standby, true), "it cannot");
    let mut scenario = flying(Ecu::Zk);
    for _ in 0..100 {
        let _ = scenario.command(run(50));
        receive(&mut scenario, &zk_frames::status(1, 3_000, [13, 2 << 5, 76]));
    }
    scenario.reports(Reports::Running);
    scenario.fly_us(run(50), Origin::Rc, 200 * SECOND);
    assert_eq!(
        (scenario.order(), scenario.bench.machine.failed()),
        (Order::Run(percent(50)), false),
        "it can"
    );
    let mut scenario = Scenario::ready(Ecu::Zk, Ecu::Zk.config());
    scenario.command(run(0)).unwrap();
    minutes(&mut scenario, 2, 0);
    assert_eq!((scenario.order(), scenario.bench.machine.failed()), (Order::Standby, false), "a start");
}

/// The time of a start is fixed when it is ordered. The event has that time, also if the ECU reports a start-up time of its own since.
#[test]
fn zk_a_start_that_times_out_is_reported_with_the_time_that_it_had() {
    let config = Ecu::Zk.with(|rules| rules.start.timeout = Duration::from_secs(20));
    for reported in [false, true] {
        let mut scenario = Scenario::ready(Ecu::Zk, config);
        scenario.command(run(0)).unwrap();
        scenario.reports(Reports::Starting);
        if reported {
            // 4 s.
            scenario.bench.receive(&zk_frames::status(8, TURNING, [5, 0, 40]));
            assert_eq!(scenario.telemetry().report.startup.unwrap().value, Duration::from_secs(4));
        }
        scenario.bench.events();
        scenario.fly_us(run(0), Origin::Rc, 21 * SECOND);
        let timeouts = scenario.violations().into_iter();
        let timeouts: Vec<_> = timeouts.map(|timeout| (timeout.kind, timeout.value, timeout.limit)).collect();
        assert_eq!(timeouts, [(LimitKind::StartTimeout, 20_000, 20_000)], "{reported}");
    }
}

/// A set that arrives when a timer is due, and before the node has handled it: the reply already has the order of after that time.
#[test]
fn amt_a_set_that_arrives_when_a_start_times_out_is_answered_with_standby() {
    for (before_us, wire) in [(1, Wire::Run(0)), (0, Wire::Standby)] {
        let config = Ecu::Amt.with(|rules| rules.start.timeout = Duration::from_secs(20));
        let mut scenario = Scenario::ready(Ecu::Amt, config);
        let over = scenario.now_us() + 20 * SECOND;
        scenario.command(run(0)).unwrap();
        scenario.reports = Some(Reports::Starting);
        scenario.fly_us(run(0), Origin::Rc, 20 * SECOND - FRAME_PERIOD_US / 2);
        scenario.sent();
        let set = Ecu::Amt.frame(Reports::Starting, scenario.values);
        scenario.bench.jump_to_us(over - before_us);
        scenario.bench.receive(&set);
        assert_eq!(scenario.sent(), [wire], "{before_us} us before");
    }
}
