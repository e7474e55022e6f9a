//! The limits: each is violated by two consecutive values, never by one, and reported with value and limit. For both ECUs.

use jetlink::command::{Accepted, Interlock, Order, Origin, Rejected};
use jetlink::engine::config::Limits;
use jetlink::event::Event;
use jetlink::limit::LimitKind;
use jetlink::limit::{Action, Limit};
use jetlink::units::{Celsius, Millivolts, Rpm, Throttle};

use crate::support::frames::{amt as amt_frames, zk as zk_frames};
use crate::support::scenario::{
    BOTH, COMMAND_PERIOD_US, Ecu, FRAME_PERIOD_US, Reports, SECOND, Scenario, TURNING, Values, Wire, percent,
    run,
};
use bench::by_hand::at_us;

/// A shaft that runs down after standby is not too slow, although the ECU reports a running engine a little longer; the control:
/// with the run in force it is.
#[test]
fn a_shaft_that_runs_down_after_standby_is_not_too_slow() {
    for ecu in BOTH {
        for (shut_down, expected) in [(true, vec![]), (false, vec![LimitKind::LowRpm])] {
            let mut scenario = running(ecu, |limits| limits.low_rpm = Limit::report(Rpm::new(11_000)));
            if shut_down {
                scenario.shut_down().unwrap();
                assert_eq!(scenario.order(), Order::Standby);
            }
            scenario.values.rpm = Some(10_000);
            if shut_down {
                scenario.pass_us(5 * FRAME_PERIOD_US);
            } else {
                scenario.fly_us(run(50), Origin::Rc, 5 * FRAME_PERIOD_US);
            }
            assert_eq!(scenario.limits(), expected, "{ecu:?}");
        }
    }
}

/// A scenario with an engine that runs at 50 % with these limits.
pub fn running(ecu: Ecu, change: impl FnOnce(&mut Limits)) -> Scenario {
    let config = ecu.with(|s| change(&mut s.limits));
    let mut scenario = Scenario::started_with(ecu, config, percent(50));
    scenario.fly_us(run(50), Origin::Rc, 10 * SECOND);
    assert_eq!(scenario.limits(), []);
    scenario
}

/// From now on its exhaust is hot: an AMT ECU with a fault shows no other sign of life (AMT-8).
pub fn burns(scenario: &mut Scenario) {
    scenario.values.egt_celsius = 500;
    scenario.fly_us(run(50), Origin::Rc, SECOND);
}

/// Events after some consecutive frames with these values, and then the engine's own values.
fn reported_after(scenario: &mut Scenario, frames: u32, values: Values) -> Vec<(LimitKind, i32, i32)> {
    let before = scenario.values;
    scenario.values = values;
    scenario.fly_us(run(50), Origin::Rc, u64::from(frames) * FRAME_PERIOD_US);
    scenario.values = before;
    scenario.fly_us(run(50), Origin::Rc, 2 * SECOND);
    scenario
        .violations()
        .into_iter()
        .map(|violation| (violation.kind, violation.value, violation.limit))
        .collect()
}

/// Two values in a row beyond a limit are reported, with both numbers; one is not; and a value at the limit never.
#[test]
fn a_limit_is_violated_by_two_consecutive_values() {
    use LimitKind::{LowRpm, OverSpeed, OverTemperature};
    type Change = fn(&mut Limits);
    let cases: [(Change, LimitKind, Values, Values, i32, i32); 3] = {
        let values = |rpm, egt| Values { rpm: Some(rpm), egt_celsius: egt, half_percents: 0, fault: 0 };
        [
            (
                |l| l.over_speed = Limit::report(Rpm::new(13_000)),
                OverSpeed,
                values(13_000, 26),
                values(13_500, 26),
                13_500,
                13_000,
            ),
            (
                |l| l.low_rpm = Limit::report(Rpm::new(11_000)),
                LowRpm,
                values(11_000, 26),
                values(10_500, 26),
                10_500,
                11_000,
            ),
            // AMT: 126 steps of 4.6 °C less 50 are 529.6, one more is 534.2.
            (
                |l| l.over_temperature = Limit::report(Celsius::from_tenths(5_300)),
                OverTemperature,
                values(TURNING, 530),
                values(TURNING, 535),
                5_350,
                5_300,
            ),
        ]
    };
    for ecu in BOTH {
        for (change, what, at, beyond, value, limit) in cases {
            // An AMT temperature comes in steps.
            let value = if ecu == Ecu::Amt && what == OverTemperature { 5_342 } else { value };
            for (frames, values, reported) in
                [(5, at, false), (1, beyond, false), (2, beyond, true), (40, beyond, true)]
            {
                let mut scenario = running(ecu, |limits| {
                    limits.hot_start = Limit::NONE;
                    limits.flame_out = Limit::NONE;
                    change(limits);
                });
                let expected = if reported { vec![(what, value, limit)] } else { vec![] };
                assert_eq!(
                    reported_after(&mut scenario, frames, values),
                    expected,
                    "{ecu:?} {what:?} {frames}"
                );
                // By default nothing is done.
                assert_eq!(scenario.order(), Order::Run(percent(50)));
            }
            // Reported again after a value within the limit.
            let mut scenario = running(ecu, change);
            assert_eq!(reported_after(&mut scenario, 4, beyond).len(), 1);
            assert_eq!(reported_after(&mut scenario, 4, beyond).len(), 1);
        }
    }
}

/// The time of an event is that of the second value.
#[test]
fn a_limit_is_reported_with_its_time() {
    for ecu in BOTH {
        let mut scenario = running(ecu, |l| l.over_speed = Limit::report(Rpm::new(13_000)));
        let values = Values { rpm: Some(14_000), ..scenario.values };
        let from = scenario.now_us();
        scenario.silent();
        for i in 1..=3 {
            scenario.bench.rx_at_us(from + i * 70_000, &ecu.frame(Reports::Running, values));
        }
        let violations = scenario.violations_at();
        assert_eq!(violations.len(), 1);
        assert_eq!(violations[0].0, from + 140_000, "{ecu:?}");
    }
}

/// Without a limit of our own, the ZK ECU's figures serve: 105 % of its maximum, 80 % of its idle while running.
#[test]
fn without_a_limit_the_engines_own_figures_apply() {
    let values = |rpm| Values { rpm: Some(rpm), egt_celsius: 26, half_percents: 0, fault: 0 };
    let quiet = |limits: &mut Limits| {
        limits.implausible = Limit::NONE;
        limits.flame_out = Limit::NONE;
    };
    for (rpm, reported) in [
        (168_000, vec![]),
        (168_010, vec![(LimitKind::OverSpeed, 168_010, 168_000)]),
        (4_000, vec![]),
        (3_990, vec![(LimitKind::LowRpm, 3_990, 4_000)]),
    ] {
        let mut scenario = running(Ecu::Zk, quiet);
        assert_eq!(reported_after(&mut scenario, 3, values(rpm)), reported, "{rpm}");
    }
    // A low speed at rest or during a start is no violation.
    let mut scenario = Scenario::ready(Ecu::Zk, Ecu::Zk.config());
    scenario.command(run(0)).unwrap();
    scenario.values.rpm = Some(1_000);
    scenario.reports = Some(Reports::Starting);
    scenario.fly_us(run(0), Origin::Rc, 3 * SECOND);
    assert_eq!(scenario.limits(), []);
}

/// A maximum of 0 is none: an engine is not shut down for it. The control: a maximum below its speed.
#[test]
fn a_reported_maximum_of_0_is_not_a_limit() {
    for (thousands, order) in [(0, Order::Run(percent(50))), (10, Order::Standby)] {
        let mut scenario = running(Ecu::Zk, |limits| limits.over_speed.action = Action::Standby);
        scenario.values.rpm = Some(14_000);
        for _ in 0..2 {
            scenario.bench.receive(&zk_frames::status(6, 14_000, [thousands, 0, 5 << 2]));
        }
        scenario.fly_us(run(50), Origin::Rc, 2 * FRAME_PERIOD_US);
        assert_eq!(scenario.order(), order, "{thousands} 000 rpm");
    }
}

/// Hot start: the temperature rises too fast while it starts, and only then.
#[test]
fn a_hot_start_is_a_fast_rise_of_temperature_in_a_start() {
    for ecu in BOTH {
        // °C per second, and whether that is reported: the default is 200.
        for (rate, reports, reported) in
            [(160, Reports::Starting, false), (320, Reports::Starting, true), (320, Reports::Running, false)]
        {
            let config = ecu.with(|s| s.limits.over_temperature = Limit::NONE);
            let mut scenario = Scenario::ready(ecu, config);
            scenario.command(run(0)).unwrap();
            scenario.reports(Reports::Starting).reports(reports);
            scenario.bench.events();
            for i in 0..40 {
                scenario.values.egt_celsius = 26 + rate * i / 20;
                if i % 2 == 0 {
                    let _ = scenario.command(run(0));
                }
                scenario.pass_us(FRAME_PERIOD_US);
            }
            let violations = scenario.violations();
            if reported {
                assert_eq!(violations.len(), 1, "{ecu:?} {rate}");
                assert_eq!((violations[0].kind, violations[0].limit), (LimitKind::HotStart, 200));
                // Soon after it exceeded the limit.
                assert!((201..=rate).contains(&violations[0].value), "{:?}", violations[0]);
            } else {
                assert_eq!(violations, [], "{ecu:?} {rate} {reports:?}");
            }
        }
        // One odd frame, hot or cold, at whatever phase of the sampling, is not a hot start.
        for odd in [1_000, -40] {
            for wait in 0..12 {
                let config = ecu.with(|s| s.limits.over_temperature = Limit::NONE);
                let mut scenario = Scenario::ready(ecu, config);
                scenario.command(run(0)).unwrap();
                scenario.values.egt_celsius = 400;
                scenario.reports(Reports::Starting).fly_us(
                    run(0),
                    Origin::Rc,
                    3 * SECOND + wait * FRAME_PERIOD_US,
                );
                scenario.bench.events();
                scenario.values.egt_celsius = odd;
                scenario.pass_us(FRAME_PERIOD_US);
                scenario.values.egt_celsius = 400;
                scenario.fly_us(run(0), Origin::Rc, 3 * SECOND);
                assert_eq!(scenario.limits(), [], "{ecu:?} {odd} {wait}");
            }
        }
    }
}

/// One odd shaft speed is not a flame-out, whatever its value, with or without a plausibility limit.
#[test]
fn one_odd_shaft_speed_is_not_a_flame_out() {
    for ecu in BOTH {
        for implausible in [Limit::NONE, Limit::report(150_000)] {
            for odd in [0, 10_000, 14_000, 60_000, 120_000] {
                for wait in 0..6 {
                    let mut scenario = running(ecu, |limits| {
                        limits.implausible = implausible;
                        limits.low_rpm = Limit::NONE;
                    });
                    scenario.fly_us(run(50), Origin::Rc, wait * FRAME_PERIOD_US);
                    let values = Values { rpm: Some(odd), ..scenario.values };
                    let reported = reported_after(&mut scenario, 1, values);
                    assert_eq!(reported, [], "{ecu:?} {odd} {wait}");
                }
            }
        }
    }
}

/// A change that no turbine makes is reported when it lasts for two frames; frames read late and all at once do not
/// count.
#[test]
fn a_change_that_no_turbine_makes_is_reported_after_two_frames() {
    for ecu in BOTH {
        let mut scenario = running(ecu, |limits| limits.flame_out = Limit::NONE);
        let values = Values { rpm: Some(60_000), ..scenario.values };
        assert_eq!(reported_after(&mut scenario, 1, values), [], "{ecu:?}: one odd frame");
        let mut scenario = running(ecu, |limits| limits.flame_out = Limit::NONE);
        let reported = reported_after(&mut scenario, 2, values);
        assert_eq!(reported[0].0, LimitKind::Implausible, "{ecu:?}");
        assert!(reported[0].1 > 150_000 && reported[0].2 == 150_000);
        // After a gap too, after two consistent speeds.
        let mut scenario = running(ecu, |limits| limits.flame_out = Limit::NONE);
        scenario.silent().fly_us(run(50), Origin::Rc, SECOND);
        scenario.reports(Reports::Running).fly_us(run(50), Origin::Rc, SECOND);
        scenario.values = values;
        scenario.fly_us(run(50), Origin::Rc, 2 * FRAME_PERIOD_US);
        assert_eq!(scenario.limits(), [LimitKind::Implausible], "{ecu:?}: after a gap");

        let mut scenario = running(ecu, |limits| limits.low_rpm = Limit::NONE);
        scenario.silent();
        let mut rpm = TURNING;
        for _ in 0..10 {
            let t = scenario.now_us() + 400_000;
            scenario.bench.run_to_us(t);
            for _ in 0..4 {
                rpm += 500;
                let values = Values { rpm: Some(rpm), ..scenario.values };
                scenario.bench.receive(&ecu.frame(Reports::Running, values));
            }
            scenario.command(run(50)).unwrap();
        }
        assert_eq!(scenario.limits(), [], "{ecu:?}");
    }
}

/// Supply voltage, off by default.
#[test]
fn a_low_supply_is_reported_where_a_limit_is_set() {
    for ecu in BOTH {
        let supply = |scenario: &mut Scenario| {
            let frame = match ecu {
                Ecu::Amt => amt_frames::alternate(0x06).to_vec(),
                Ecu::Zk => zk_frames::status(2, TURNING, [0, 100, 0]).to_vec(),
            };
            scenario.pass_us(10_000);
            scenario.bench.receive(&frame);
            scenario.telemetry().report.supply.and_then(|supply| supply.value.voltage).expect("a scale")
        };
        let mut scenario = running(ecu, |_| {});
        let is = supply(&mut scenario).get();
        supply(&mut scenario);
        assert_eq!(scenario.limits(), [], "{ecu:?}: not watched");
        for (limit, frames, reported) in [(is + 1, 1, 0), (is + 1, 2, 1), (is + 1, 9, 1), (is, 9, 0)] {
            let mut scenario = running(ecu, |l| l.supply_low = Limit::report(Millivolts::new(limit)));
            for _ in 0..frames {
                supply(&mut scenario);
            }
            assert_eq!(scenario.limits(), vec![LimitKind::SupplyLow; reported], "{ecu:?} {limit} {frames}");
        }
    }
}

/// A board's measured supply counts only for an ECU that reports none.
#[test]
fn the_supply_of_the_board_counts_where_the_ecu_reports_none() {
    for (reported, counts) in [(None, true), (Some(120), false)] {
        let measured = |scenario: &mut Scenario, millivolts: u32| {
            let now = at_us(scenario.now_us());
            scenario.bench.machine.board_supply(now, Millivolts::new(millivolts));
            scenario.pass_us(100_000);
        };
        let config = Ecu::Zk.with(|s| {
            s.start.supply_min = Some(Millivolts::new(10_500));
            s.limits.supply_low = Limit::report(Millivolts::new(10_000));
        });
        let mut scenario = Scenario::ready(Ecu::Zk, config);
        if let Some(tenths) = reported {
            scenario.bench.receive(&zk_frames::status(2, 0, [0, tenths, 0]));
        }
        measured(&mut scenario, 10_400);
        let low = Rejected::Start(Interlock::SupplyLow(Millivolts::new(10_400)));
        assert_eq!(scenario.start_refusals(run(0), Origin::Rc).contains(&low), counts);
        let shown = scenario.telemetry().supply.unwrap().value.get();
        assert_eq!(shown, if counts { 10_400 } else { 24_000 });
        measured(&mut scenario, 10_500);
        assert_eq!(scenario.start_refusals(run(0), Origin::Rc), []);
        // The limit needs two consecutive values, as for an ECU.
        for (millivolts, expected) in [(9900, 0), (10_100, 0), (9900, 0), (9900, usize::from(counts))] {
            measured(&mut scenario, millivolts);
            assert_eq!(scenario.limits(), vec![LimitKind::SupplyLow; expected], "{millivolts} mV");
        }
    }
}

/// A fault in two consecutive reports of the ECU; the event carries its number.
#[test]
fn a_fault_of_the_ecu_is_reported_after_two_reports_with_its_number() {
    for ecu in BOTH {
        for action in [Action::Report, Action::FailSafe, Action::Standby] {
            let mut scenario = running(ecu, |limits| limits.ecu_fault = action);
            burns(&mut scenario);
            let values = Values { fault: 2, ..scenario.values };
            assert_eq!(reported_after(&mut scenario, 1, values), [], "{ecu:?}: one odd frame");
            assert_eq!(scenario.order(), Order::Run(percent(50)), "{ecu:?} {action:?}");
            let reported = reported_after(&mut scenario, 5, values);
            assert_eq!(reported, [(LimitKind::EcuFault, 2, 0)], "{ecu:?} {action:?}");
            let expected = match action {
                Action::Report => Order::Run(percent(50)),
                Action::FailSafe => Order::Run(percent(0)),
                Action::Standby => Order::Standby,
            };
            assert_eq!(scenario.order(), expected, "{ecu:?}");
        }
    }
}

/// The actions: none by default, the fail-safe throttle on its ramp, standby at once, which a stream of run does not undo.
#[test]
fn each_limit_takes_its_action() {
    for ecu in BOTH {
        let limit = |action| Limit { at: Some(Rpm::new(13_000)), action };
        let mut scenario = running(ecu, |l| l.over_speed = limit(Action::Standby));
        scenario.values.rpm = Some(14_000);
        scenario.fly_us(run(50), Origin::Rc, 2 * FRAME_PERIOD_US);
        let ordered = scenario.telemetry().ordered;
        assert_eq!((ordered.order, ordered.origin), (Order::Standby, Origin::Node), "{ecu:?}");
        assert_eq!(scenario.command(run(50)), Err(Rejected::StandbyFirst));
        assert_eq!(scenario.wire(), Wire::Standby);

        let mut scenario = running(ecu, |l| l.over_speed = limit(Action::FailSafe));
        let from = scenario.now_us();
        scenario.values.rpm = Some(14_000);
        scenario.fly_us(run(50), Origin::Rc, 2 * FRAME_PERIOD_US);
        assert_eq!(scenario.limits(), [LimitKind::OverSpeed]);
        scenario.fly_us(run(50), Origin::Rc, 500_000);
        // 50 % a second.
        assert!((200..350).contains(&scenario.tenths()), "{ecu:?}: {}", scenario.tenths());
        scenario.fly_us(run(50), Origin::Rc, SECOND);
        assert_eq!((scenario.tenths(), scenario.wire()), (0, Wire::Run(0)), "{ecu:?}");
        assert!(scenario.now_us() > from);
        // A source that takes over does not lift it; standby and a new start do.
        assert!(matches!(scenario.command_from(run(1), Origin::Emergency), Ok(Accepted::InForce)));
        scenario.fly_us(run(70), Origin::Emergency, 5 * SECOND);
        assert_eq!(scenario.tenths(), 0);
        let reported: Vec<_> =
            scenario.bench.event_kinds().into_iter().filter(|e| matches!(e, Event::Limit(_))).collect();
        assert_eq!(reported, [], "it is reported once");
        scenario.shut_down_from(Origin::Emergency).unwrap();
        assert_eq!(scenario.order(), Order::Standby);
    }
}

/// At the fail-safe throttle of a limit, a lower demand of the source in control is obeyed, with a slew and without; a higher one
/// is not.
#[test]
fn a_lower_demand_is_obeyed_at_the_fail_safe_of_a_limit() {
    for ecu in BOTH {
        for down in [None, Some(100), Some(500), Some(900)] {
            let config = ecu.with(|s| {
                s.limits.over_speed = Limit { at: Some(Rpm::new(13_000)), action: Action::FailSafe };
                (s.loss.throttle, s.slew.down) = (Throttle::from_percent(25).unwrap(), down);
            });
            let mut scenario = Scenario::started_with(ecu, config, percent(50));
            scenario.fly_us(run(50), Origin::Rc, 10 * SECOND);
            scenario.values.rpm = Some(14_000);
            scenario.fly_us(run(50), Origin::Rc, 2 * SECOND);
            assert_eq!(scenario.tenths(), 250, "{ecu:?} {down:?}");
            scenario.fly_us(run(90), Origin::Rc, 2 * SECOND);
            assert_eq!(scenario.tenths(), 250, "{ecu:?} {down:?}");
            // As fast as the slew allows.
            let falls = down.map_or(100_000, |down: u16| 150 * SECOND / u64::from(down) + 200_000);
            scenario.fly_us(run(10), Origin::Rc, falls);
            assert_eq!(scenario.tenths(), 100, "{ecu:?} {down:?}");
            scenario.fly_us(run(20), Origin::Rc, 2 * SECOND);
            assert_eq!(scenario.tenths(), 100, "{ecu:?} {down:?}: it only falls");
            scenario.fly_us(run(0), Origin::Rc, falls);
            assert_eq!(scenario.tenths(), 0, "{ecu:?} {down:?}");
        }
    }
}

/// Above the fail-safe throttle of a limit, the faster of slew and ramp brings a lower demand.
#[test]
fn a_lower_demand_is_obeyed_on_the_way_to_the_fail_safe_of_a_limit() {
    for ecu in BOTH {
        for (down, expected) in [(None, 0..=50), (Some(900), 180..=290), (Some(50), 440..=490)] {
            let config = ecu.with(|s| {
                s.limits.over_speed = Limit { at: Some(Rpm::new(13_000)), action: Action::FailSafe };
                (s.slew.down, s.loss.ramp) = (down, 100);
            });
            let mut scenario = Scenario::started_with(ecu, config, percent(50));
            scenario.fly_us(run(50), Origin::Rc, 20 * SECOND);
            scenario.values.rpm = Some(14_000);
            scenario.fly_us(run(50), Origin::Rc, 2 * FRAME_PERIOD_US);
            scenario.fly_us(run(5), Origin::Rc, 300_000);
            assert!(expected.contains(&scenario.tenths()), "{ecu:?} {down:?}: {}", scenario.tenths());
        }
    }
}

/// A limit with an action refuses a start while it is exceeded; one that is only reported does not.
#[test]
fn a_violated_limit_refuses_a_start() {
    for (action, expected) in [
        (Action::Report, Ok(Accepted::InForce)),
        (Action::FailSafe, Err(Rejected::Start(Interlock::Limit(LimitKind::SupplyLow)))),
        (Action::Standby, Err(Rejected::Start(Interlock::Limit(LimitKind::SupplyLow)))),
    ] {
        let config =
            Ecu::Zk.with(|s| s.limits.supply_low = Limit { at: Some(Millivolts::new(12_000)), action });
        let mut scenario = Scenario::ready(Ecu::Zk, config);
        for _ in 0..3 {
            scenario.pass_us(FRAME_PERIOD_US);
            scenario.bench.receive(&zk_frames::status(2, 0, [50, 50, 0]));
        }
        assert_eq!(scenario.limits(), [LimitKind::SupplyLow]);
        assert_eq!(scenario.command(run(0)), expected, "{action:?}");
    }
}

/// The action of a limit is taken although it was violated before the engine was ordered to run: while the node listened
/// after a reset.
#[test]
fn a_limit_acts_after_a_reset() {
    for (faults_only, action) in [
        (false, Action::FailSafe),
        (false, Action::Standby),
        (true, Action::FailSafe),
        (true, Action::Standby),
    ] {
        for ecu in BOTH {
            // A ZK ECU also reports the engine's state with a fault.
            let config = ecu.with(|s| {
                s.limits.over_temperature = Limit { at: Some(Celsius::from_tenths(7000)), action };
                s.limits.ecu_fault = action;
            });
            let before = Scenario::started_with(ecu, config, percent(60));
            let mut scenario = before.reset(config);
            scenario.values.egt_celsius = if faults_only { 500 } else { 900 };
            scenario.values.fault = u8::from(faults_only) * 2;
            scenario.fly_us(run(60), Origin::Rc, 5 * SECOND);
            let expected = match action {
                Action::Standby => Order::Standby,
                // With faults in place of a state nothing shows that it runs: its exhaust is hot, and it is answered.
                _ if faults_only && ecu == Ecu::Amt => Order::Doubt(percent(0)),
                _ => Order::Run(percent(0)),
            };
            assert_eq!(scenario.order(), expected, "{ecu:?} {faults_only} {action:?}");
            assert_eq!(scenario.limits().len(), 1, "reported once");
            let wire = if action == Action::Standby { Wire::Standby } else { Wire::Run(0) };
            assert_eq!(scenario.wire(), wire, "{ecu:?} {faults_only} {action:?}");
        }
    }
}

/// An engine that its limit shut down has failed: the others are informed. An engine that never ran has not failed.
#[test]
fn an_engine_that_its_limit_shut_down_has_failed() {
    for ecu in BOTH {
        for (reports, failed) in [(Reports::Running, true), (Reports::Starting, false)] {
            let config = ecu.with(|s| s.limits.ecu_fault = Action::Standby);
            let mut scenario = Scenario::ready(ecu, config);
            scenario.command(run(0)).unwrap();
            scenario.reports(Reports::Starting);
            scenario.reports(reports);
            burns(&mut scenario);
            scenario.values.fault = 2;
            scenario.fly_us(run(50), Origin::Rc, SECOND);
            assert_eq!(scenario.order(), Order::Standby);
            assert_eq!(scenario.bench.machine.failed(), failed, "{ecu:?} {reports:?}");
            assert_eq!(scenario.telemetry().failed, failed);
        }
    }
}

/// The first shaft speed may be the odd one.
#[test]
fn one_odd_shaft_speed_after_a_reset_is_not_implausible() {
    let config = Ecu::Amt.with(|s| s.limits.implausible.action = Action::Standby);
    let before = Scenario::started_with(Ecu::Amt, config, percent(60));
    let mut scenario = before.reset(config);
    scenario.pass_us(FRAME_PERIOD_US / 2);
    scenario.odd(Reports::Running, Values { rpm: Some(120_000), ..scenario.values });
    scenario.fly_us(run(60), Origin::Rc, 2 * SECOND);
    assert_eq!((scenario.limits(), scenario.order()), (vec![], Order::Run(percent(60))));
    // The control: two of them are implausible.
    for _ in 0..2 {
        scenario.pass_us(1000);
        scenario.odd(Reports::Running, Values { rpm: Some(120_000), ..scenario.values });
    }
    assert_eq!(scenario.limits(), [LimitKind::Implausible]);
}

/// A slow change over a gap is no change that a turbine cannot make, and the one back from an odd speed is.
#[test]
fn one_odd_shaft_speed_after_a_gap_is_not_implausible() {
    for ecu in [Ecu::Amt, Ecu::Zk] {
        let config = ecu.with(|s| s.limits.implausible.action = Action::Standby);
        let mut scenario = Scenario::started_with(ecu, config, percent(60));
        scenario.silent().fly_us(run(60), Origin::Rc, 1_400_000);
        scenario.odd(Reports::Running, Values { rpm: Some(120_000), ..scenario.values });
        scenario.reports(Reports::Running);
        scenario.fly_us(run(60), Origin::Rc, 2 * SECOND);
        assert_eq!((scenario.limits(), scenario.order()), (vec![], Order::Run(percent(60))), "{ecu:?}");
        // The control: two of them without a gap are.
        for _ in 0..2 {
            scenario.pass_us(1000);
            scenario.odd(Reports::Running, Values { rpm: Some(120_000), ..scenario.values });
        }
        assert!(scenario.limits().contains(&LimitKind::Implausible), "{ecu:?}");
    }
}

/// An engine that runs with an exhaust that is too hot, and then gets this limit.
fn too_hot_and_then(ecu: Ecu, before: Action, then: Limit<Celsius>) -> Scenario {
    let limit = Limit { at: Some(Celsius::from_tenths(7000)), action: before };
    let mut config = ecu.with(|s| s.limits.over_temperature = limit);
    let mut scenario = Scenario::started_with(ecu, config, percent(50));
    scenario.fly_us(run(50), Origin::Rc, SECOND);
    scenario.values.egt_celsius = 750;
    scenario.fly_us(run(50), Origin::Rc, SECOND);
    assert_eq!(scenario.limits(), [LimitKind::OverTemperature]);
    config.supervision.limits.over_temperature = then;
    let now = at_us(scenario.now_us());
    scenario.bench.act(|engine, _| engine.configure(now, &config.supervision)).unwrap();
    scenario
}

/// A new action applies at once, also to a limit that is violated already.
#[test]
fn the_action_of_a_violated_limit_can_be_changed() {
    let limit = |action| Limit { at: Some(Celsius::from_tenths(7000)), action };
    for ecu in BOTH {
        for (action, order) in [
            (Action::Report, Order::Run(percent(50))),
            (Action::FailSafe, Order::Run(percent(0))),
            (Action::Standby, Order::Standby),
        ] {
            let mut scenario = too_hot_and_then(ecu, Action::Report, limit(action));
            scenario.fly_us(run(50), Origin::Rc, 3 * SECOND);
            assert_eq!(scenario.order(), order, "{ecu:?} {action:?}");
            assert_eq!(scenario.limits(), [], "{ecu:?} {action:?}: reported once");
        }
    }
}

/// A limit that is switched off while it is violated does not stay violated, and neither does one whose action is only a report
/// now; the control: with its action it refuses a start.
#[test]
fn a_violated_limit_can_be_switched_off() {
    let low = Millivolts::new(60_000);
    for ecu in BOTH {
        for (then, refused) in [
            (Limit { at: Some(low), action: Action::Standby }, true),
            (Limit { at: Some(low), action: Action::Report }, false),
            (Limit { at: None, action: Action::Standby }, false),
        ] {
            let mut config =
                ecu.with(|s| s.limits.supply_low = Limit { at: Some(low), action: Action::Standby });
            let mut scenario = Scenario::ready(ecu, config);
            // The board measures the supply where the ECU reports none.
            let measure = |scenario: &mut Scenario| {
                scenario.pass_us(COMMAND_PERIOD_US);
                let now = at_us(scenario.now_us());
                scenario.bench.act(|engine, _| engine.board_supply(now, Millivolts::new(12_000)));
            };
            measure(&mut scenario);
            measure(&mut scenario);
            assert_eq!(scenario.limits(), [LimitKind::SupplyLow]);
            config.supervision.limits.supply_low = then;
            let now = at_us(scenario.now_us());
            scenario.bench.act(|engine, _| engine.configure(now, &config.supervision)).unwrap();
            measure(&mut scenario);
            let answer = scenario.command(run(0));
            let expected = match refused {
                true => Err(Rejected::Start(Interlock::Limit(LimitKind::SupplyLow))),
                false => Ok(Accepted::InForce),
            };
            assert_eq!(answer, expected, "{ecu:?} {then:?}");
        }
    }
}
