//! The valve and the power, for each state of an engine: a snapshot of a real one, changed.

use crate::outputs::{Before, Change, Outputs, Valve, Why};
use crate::settings::OutputSettings;
use crate::wiring::{OutputConfig, OutputPin, PinLevel, check_board, check_outputs};
use embassy_time::{Duration, Instant};
use jetlink::channel::Channel;
use jetlink::command::{Demand, Order, Ordered, Origin};
use jetlink::config::EngineConfig;
use jetlink::ecu::zk::codec::Rate;
use jetlink::engine::retained::RetainedState;
use jetlink::line::Line;
use jetlink::report::{LinkState, Phase, Timed};
use jetlink::telemetry::Telemetry;
use jetlink::units::{Celsius, Rpm, Throttle};
use std::string::ToString;
use std::vec::Vec;

const CONFIG: EngineConfig = EngineConfig::zk("left", 0, Line::new(9600), Rate::Hz20);
const RUN: Order = Order::Run(Demand::Throttle(Throttle::IDLE));
const DOUBT: Order = Order::Doubt(Demand::Throttle(Throttle::IDLE));
const PHASES: [Phase; 7] = [
    Phase::Stopped,
    Phase::Standby,
    Phase::Cooling,
    Phase::Starting,
    Phase::Running,
    Phase::Service,
    Phase::Unknown,
];
const T0: Instant = Instant::from_secs(100);

/// A snapshot: the order, and the ECU's report.
fn snapshot(order: Order, phase: Option<Phase>, rpm: Option<u32>) -> Telemetry {
    let channel = Channel::new(&CONFIG, None);
    let mut telemetry = channel.handle().telemetry();
    telemetry.at = T0;
    telemetry.ordered = Ordered { order, origin: Origin::Rc };
    telemetry.stop_latched = order == Order::EmergencyStop;
    telemetry.link = LinkState::Up;
    telemetry.last_rx = Some(T0);
    telemetry.report.phase = phase.map(|phase| Timed::new(phase, T0));
    telemetry.report.rpm = rpm.map(|rpm| Timed::new(Rpm::new(rpm), T0));
    telemetry
}

/// Radio control orders standby, and the ECU reports these values now: the exhaust in °C.
fn in_standby(at: Instant, phase: Phase, rpm: Option<u32>, egt: Option<i16>) -> Telemetry {
    let mut telemetry = snapshot(Order::Standby, Some(phase), None);
    telemetry.at = at;
    telemetry.report.phase = Some(Timed::new(phase, at));
    telemetry.report.rpm = rpm.map(|rpm| Timed::new(Rpm::new(rpm), at));
    telemetry.report.egt = egt.map(|egt| Timed::new(Celsius::from_tenths(egt * 10), at));
    telemetry
}

fn before(record: Option<RetainedState>, has_failed: bool) -> Before {
    Before { record, has_failed, ..Before::default() }
}

fn outputs(valve: Valve) -> Outputs {
    let record = RetainedState::new(RUN, Origin::Rc);
    Outputs::new(OutputSettings::DEFAULT, before((valve == Valve::Open).then_some(record), false))
}

/// Effect of an update on a closed valve, and on an open one.
fn of(telemetry: &Telemetry) -> (Valve, Valve) {
    let after = |valve| {
        let mut outputs = outputs(valve);
        assert_eq!(outputs.valve(), valve);
        outputs.update(telemetry);
        outputs.valve()
    };
    (after(Valve::Closed), after(Valve::Open))
}

const CLOSES: (Valve, Valve) = (Valve::Closed, Valve::Closed);
const OPENS: (Valve, Valve) = (Valve::Open, Valve::Open);
const STAYS: (Valve, Valve) = (Valve::Closed, Valve::Open);

/// Every order with every phase, turning and not, with a link and without.
#[test]
fn valve_opens_for_run_closes_for_a_stop_and_in_standby_at_rest_and_otherwise_stays() {
    for order in [Order::EmergencyStop, Order::Standby, RUN, Order::Pwm, Order::Listen, DOUBT] {
        for phase in PHASES.map(Some).into_iter().chain([None]) {
            for rpm in [None, Some(0), Some(999), Some(1000), Some(60_000)] {
                for link in [LinkState::Up, LinkState::Lost, LinkState::Silent] {
                    let mut telemetry = snapshot(order, phase, rpm);
                    telemetry.link = link;
                    let turns = rpm.map(|rpm| rpm >= 1000);
                    let up = link == LinkState::Up;
                    let at_rest = matches!(phase, Some(Phase::Stopped | Phase::Standby | Phase::Cooling));
                    let expected = match order {
                        Order::EmergencyStop => CLOSES,
                        Order::Run(_) | Order::Pwm => OPENS,
                        Order::Standby if up && at_rest && turns != Some(true) => CLOSES,
                        Order::Listen | Order::Doubt(_)
                            if up && phase == Some(Phase::Running) && turns != Some(false) =>
                        {
                            OPENS
                        }
                        _ => STAYS,
                    };
                    assert_eq!(of(&telemetry), expected, "{order}, {phase:?}, {rpm:?} rpm, {link}");
                }
            }
        }
    }
}

#[test]
fn old_report_decides_nothing() {
    for (order, phase, rpm, fresh) in [
        (Order::Standby, Phase::Standby, 0, CLOSES),
        (Order::Listen, Phase::Running, 60_000, OPENS),
        (DOUBT, Phase::Running, 60_000, OPENS),
    ] {
        let mut telemetry = snapshot(order, Some(phase), Some(rpm));
        telemetry.at = T0 + Duration::from_secs(3);
        assert_eq!(of(&telemetry), fresh, "{order}");
        telemetry.at = T0 + Duration::from_millis(3001);
        assert_eq!(of(&telemetry), STAYS, "{order}");
    }
}

#[test]
fn permitted_service_opens_and_a_stop_closes_it() {
    let mut telemetry = snapshot(Order::Standby, Some(Phase::Standby), Some(0));
    assert_eq!(of(&telemetry), CLOSES, "without one");
    telemetry.fuel_service = true;
    assert_eq!(of(&telemetry), OPENS);
    telemetry.stop_latched = true;
    assert_eq!(of(&telemetry), CLOSES);
    // A test begun by another host is not ours.
    let service = snapshot(Order::Standby, Some(Phase::Service), Some(0));
    assert_eq!(of(&service), STAYS);
    // But one of ours ends for the valve with its permission, whatever the ECU does on its own clock.
    let mut outputs = outputs(Valve::Closed);
    let mut ours = service;
    ours.fuel_service = true;
    outputs.update(&ours);
    assert_eq!(outputs.valve(), Valve::Open);
    outputs.update(&service);
    assert_eq!(outputs.valve(), Valve::Closed);
    // The next order clears it: a standby of the node itself, in doubt, closes nothing in a later flight.
    outputs.update(&snapshot(RUN, Some(Phase::Running), Some(60_000)));
    assert_eq!(outputs.valve(), Valve::Open);
    let mut in_doubt = snapshot(Order::Standby, None, None);
    (in_doubt.ordered.origin, in_doubt.link) = (Origin::Node, LinkState::Lost);
    outputs.update(&in_doubt);
    assert_eq!(outputs.valve(), Valve::Open);
}

/// A reset during a start has closed the valve. When the start is found again, it gets no fuel, whoever takes it over: the engine is hot, and
/// its flame may be out.
#[test]
fn a_start_that_is_found_after_a_reset_gets_no_fuel_until_it_runs() {
    let standby = snapshot(Order::Standby, Some(Phase::Standby), Some(4000));
    let stop = snapshot(Order::EmergencyStop, Some(Phase::Standby), Some(4000));
    let listening = snapshot(Order::Listen, Some(Phase::Starting), Some(30_000));
    let mut start = snapshot(RUN, Some(Phase::Starting), Some(30_000));
    start.start_by = Some(T0 + Duration::from_secs(60));
    let mut nobodys = start;
    nobodys.ordered.origin = Origin::Node;
    let mut runs = start;
    runs.start_by = None;
    let after = |row: &[Telemetry]| {
        let mut outputs = outputs(Valve::Closed);
        row.iter().for_each(|telemetry| {
            outputs.update(telemetry);
        });
        outputs.valve()
    };
    for before in [standby, stop] {
        assert_eq!(after(&[before, start]), Valve::Open, "out of standby");
        assert_eq!(after(&[before, start, nobodys]), Valve::Open, "its source is lost");
        assert_eq!(after(&[before, listening, nobodys, start]), Valve::Closed, "found");
    }
    assert_eq!(of(&nobodys), STAYS, "found");
    assert_eq!(of(&start), STAYS, "found and taken over");
    assert_eq!(after(&[listening, nobodys, start]), Valve::Closed, "found and taken over");
    assert_eq!(after(&[nobodys, standby, start]), Valve::Open, "started again");
    assert_eq!(after(&[nobodys, start, runs]), Valve::Open, "it runs");
}

/// Time in ms until this snapshot closes an open valve, within 20 s.
fn closes_after(settings: OutputSettings, telemetry: &Telemetry) -> Option<u64> {
    let mut outputs = outputs(Valve::Open);
    outputs.settings = settings;
    let mut telemetry = *telemetry;
    (0..200).map(|tenth| tenth * 100).find(|ms| {
        telemetry.at = T0 + Duration::from_millis(*ms);
        let phase = telemetry.report.phase.map(|phase| phase.value);
        telemetry.report.phase = phase.map(|phase| Timed::new(phase, telemetry.at));
        telemetry.report.rpm = telemetry.report.rpm.map(|rpm| Timed::new(rpm.value, telemetry.at));
        outputs.update(&telemetry);
        outputs.valve() == Valve::Closed
    })
}

#[test]
fn standby_that_is_not_followed_closes_it_and_no_other_order_does() {
    let settings = OutputSettings::DEFAULT;
    let with = |order, origin, obeyed, link| {
        let mut telemetry = snapshot(order, Some(Phase::Running), Some(60_000));
        telemetry.ordered.origin = origin;
        (telemetry.obeyed, telemetry.link) = (obeyed, link);
        telemetry
    };
    let after = |order, origin, obeyed, link| closes_after(settings, &with(order, origin, obeyed, link));
    let (up, lost) = (LinkState::Up, LinkState::Lost);
    assert_eq!(after(Order::Standby, Origin::Rc, false, up), Some(5000));
    assert_eq!(after(Order::Standby, Origin::Node, false, up), Some(5000));
    // Nothing is received: a person's order counts, an order of the node in doubt does not.
    assert_eq!(after(Order::Standby, Origin::Mavlink, true, lost), Some(5000));
    assert_eq!(after(Order::Standby, Origin::Node, true, lost), None);
    // Nor does a match from before the link was lost.
    assert_eq!(after(Order::Standby, Origin::Node, false, lost), None);
    // Unless nothing has been received since the node started: the record of an engine that ran opened it.
    let mut silent = with(Order::Standby, Origin::Node, true, LinkState::Silent);
    silent.last_rx = None;
    assert_eq!(closes_after(settings, &silent), Some(5000));
    // An AMT ECU with error sets reports neither state nor switch.
    for (origin, expected) in [(Origin::Rc, Some(5000)), (Origin::Node, None)] {
        let mut faulted = with(Order::Standby, origin, true, up);
        faulted.report.phase = None;
        assert_eq!(closes_after(settings, &faulted), expected, "{origin}");
    }
    for order in [RUN, DOUBT, Order::Listen, Order::Pwm] {
        for link in [up, lost] {
            assert_eq!(after(order, Origin::Rc, false, link), None, "{order}, {link}");
        }
    }
    // The setting.
    let not_obeyed = with(Order::Standby, Origin::Rc, false, up);
    let longer = OutputSettings { not_obeyed: Some(Duration::from_secs(12)) };
    assert_eq!(closes_after(longer, &not_obeyed), Some(12_000));
    assert_eq!(closes_after(OutputSettings { not_obeyed: None }, &not_obeyed), None);
}

#[test]
fn wait_begins_again_when_the_order_is_followed_for_a_moment() {
    let mut outputs = outputs(Valve::Open);
    let mut telemetry = snapshot(Order::Standby, Some(Phase::Running), Some(60_000));
    for second in 0..60 {
        telemetry.at = T0 + Duration::from_secs(second);
        telemetry.report.phase = Some(Timed::new(Phase::Running, telemetry.at));
        telemetry.obeyed = second % 4 == 3;
        outputs.update(&telemetry);
    }
    assert_eq!(outputs.valve(), Valve::Open);
    telemetry.obeyed = false;
    for second in 60..67 {
        telemetry.at = T0 + Duration::from_secs(second);
        outputs.update(&telemetry);
    }
    assert_eq!(outputs.valve(), Valve::Closed);
}

/// The ECU echoes the switch as ordered, and the engine keeps running: shaft speed or exhaust show it after 8 s.
#[test]
fn an_engine_that_does_not_slow_down_in_standby_loses_its_fuel_and_one_that_does_keeps_it_until_it_is_at_rest()
 {
    let long = OutputSettings { not_obeyed: Some(Duration::from_secs(20)) };
    let standby = |rpm: fn(u64) -> Option<u32>, egt: fn(u64) -> Option<i16>, origin, settings| {
        let mut outputs = outputs(Valve::Open);
        outputs.settings = settings;
        (0..1200_u64).map(|tenth| tenth * 100).find(|&ms| {
            let at = T0 + Duration::from_millis(ms);
            let mut telemetry = in_standby(at, Phase::Running, rpm(ms), egt(ms));
            telemetry.ordered.origin = origin;
            outputs.update(&telemetry).into_iter().flatten().any(|change| {
                assert_eq!(change, Change::Valve(Valve::Closed, Why::KeepsRunning));
                true
            })
        })
    };
    let of = |rpm, egt| standby(rpm, egt, Origin::Rc, OutputSettings::DEFAULT);
    assert_eq!(of(|_| Some(60_000), |_| Some(600)), Some(8000));
    assert_eq!(of(|_| Some(60_000), |_| None), Some(8000), "by its shaft alone");
    assert_eq!(of(|_| None, |_| Some(600)), Some(8000), "by its exhaust alone");
    assert_eq!(standby(|_| Some(60_000), |_| Some(600), Origin::Node, OutputSettings::DEFAULT), Some(8000));
    // It falls only slowly, and the noise of its reports is not a fall.
    assert_eq!(of(|ms| Some(60_000 - ms as u32 / 10), |ms| Some(600 + (ms / 100 % 3) as i16)), Some(8000));
    assert_eq!(standby(|_| Some(60_000), |_| None, Origin::Rc, long), Some(23_000));
    assert_eq!(standby(|_| Some(60_000), |_| None, Origin::Rc, OutputSettings { not_obeyed: None }), None);
    // It slows down to the speed at which the starter cools it, and the exhaust temperature keeps falling.
    let down = |ms: u64| Some(60_000_u32.saturating_sub(ms as u32 * 5).max(4000));
    // Cold, and turned throughout.
    let cooled = of(down, |ms| Some((600 - (ms / 200) as i16).max(80)));
    assert!(cooled.is_some_and(|ms| ms > 104_000), "{cooled:?}");
    assert_eq!(
        of(|ms| Some(60_000_u32.saturating_sub(ms as u32 * 5)), |_| Some(600)),
        None,
        "a hot engine at rest"
    );
    assert_eq!(of(|_| None, |_| Some(100)), None, "cold, and no shaft speed is known");
    // It slows down at first, and stays there.
    assert_eq!(
        of(|ms| Some(60_000_u32.saturating_sub(ms as u32 * 5).max(40_000)), |_| Some(600)),
        Some(11_400)
    );
}

/// A starter that turns a turbine at a constant speed closes the valve of one that is no longer hot, without an alarm. A hot one may still run.
#[test]
fn a_valve_that_closes_while_the_ecu_cools_the_engine_is_not_an_alarm() {
    for (celsius, why) in
        [(130, Why::Cools), (200, Why::Cools), (201, Why::KeepsRunning), (-50, Why::KeepsRunning)]
    {
        let mut outputs = outputs(Valve::Open);
        let closed = (0..90_u64).find_map(|tenth| {
            let at = T0 + Duration::from_millis(tenth * 100);
            let telemetry = in_standby(at, Phase::Cooling, Some(4000), Some(celsius));
            outputs.update(&telemetry)[0].map(|change| (tenth * 100, change))
        });
        assert_eq!(closed, Some((8000, Change::Valve(Valve::Closed, why))), "{celsius} °C");
        assert_eq!(why.is_alarming(), celsius != 130 && celsius != 200);
    }
}

#[test]
fn an_engine_that_the_node_itself_stops_in_doubt_is_judged_by_its_state_alone() {
    for (phase, closes) in [(Some(Phase::Running), Some(8000)), (None, None)] {
        let mut telemetry = snapshot(Order::Standby, phase, Some(60_000));
        telemetry.ordered.origin = Origin::Node;
        assert_eq!(closes_after(OutputSettings::DEFAULT, &telemetry), closes, "{phase:?}");
    }
}

/// The firmware failed in repeated starts: the valve of an engine that ran is closed, and only a new start opens
/// it before the engine is at rest, because its flame is out.
#[test]
fn a_valve_that_was_closed_for_failed_starts_stays_closed_until_the_engine_is_at_rest() {
    let ran = RetainedState::new(RUN, Origin::Rc).with(|state| state.ran = true);
    let mut outputs = Outputs::new(OutputSettings::DEFAULT, before(Some(ran), true));
    assert_eq!((outputs.valve(), outputs.power(), outputs.is_cut()), (Valve::Closed, true, true));
    assert_eq!(outputs.restored()[0], Change::Valve(Valve::Closed, Why::FailedStarts));
    let mut service = snapshot(Order::Standby, Some(Phase::Running), Some(60_000));
    service.fuel_service = true;
    for telemetry in [
        snapshot(RUN, Some(Phase::Running), Some(60_000)),
        snapshot(DOUBT, Some(Phase::Running), Some(60_000)),
        snapshot(Order::Listen, Some(Phase::Running), Some(60_000)),
        // At rest, but somebody's order to run is in force.
        snapshot(RUN, Some(Phase::Stopped), Some(0)),
        service,
    ] {
        outputs.update(&telemetry);
        assert_eq!((outputs.valve(), outputs.is_cut()), (Valve::Closed, true), "{telemetry:?}");
    }
    outputs.update(&snapshot(Order::Standby, Some(Phase::Standby), Some(0)));
    assert!(!outputs.is_cut());
    outputs.update(&snapshot(RUN, Some(Phase::Standby), Some(0)));
    assert_eq!(outputs.valve(), Valve::Open, "a new start");
    // An ECU may turn a hot turbine for as long as it cools, and take a start meanwhile: that opens it. A start that was found after a
    // reset does not, and neither does an order without one.
    let cut = Outputs::new(OutputSettings::DEFAULT, before(Some(ran), true));
    let mut start = snapshot(RUN, Some(Phase::Standby), Some(4900));
    start.start_by = Some(start.at + Duration::from_secs(60));
    let mut found = start;
    found.ordered.origin = Origin::Node;
    let without = snapshot(RUN, Some(Phase::Standby), Some(4900));
    let standby = snapshot(Order::Standby, Some(Phase::Standby), Some(4900));
    let listening = snapshot(Order::Listen, Some(Phase::Starting), Some(4900));
    for (before, telemetry, valve) in [
        (standby, start, Valve::Open),
        (standby, found, Valve::Closed),
        (standby, without, Valve::Closed),
        (listening, found, Valve::Closed),
        (listening, start, Valve::Closed),
    ] {
        let mut outputs = cut;
        outputs.update(&before);
        assert!(outputs.is_cut());
        outputs.update(&telemetry);
        assert_eq!((outputs.valve(), outputs.is_cut()), (valve, valve == Valve::Closed), "{telemetry:?}");
    }
    // If no valve was to be open, nothing is cut.
    for record in [None, Some(RetainedState::new(Order::Standby, Origin::Rc))] {
        let outputs = Outputs::new(OutputSettings::DEFAULT, before(record, true));
        assert!(!outputs.is_cut() && outputs.valve() == Valve::Closed);
    }
}

/// Shut down and hot, an engine needs its starter: no record says so, only the power that it had.
#[test]
fn power_stays_as_it_was_over_a_reset() {
    let [left, right] = [0xABCD_EF01, 7];
    let shut_down = RetainedState::new(Order::Standby, Origin::Rc);
    let after = |record, power| {
        Outputs::new(OutputSettings::DEFAULT, Before { record: Some(record), power, ..Before::default() })
            .power()
    };
    for on in [true, false] {
        let number = Some(Before::number(left, on));
        assert_eq!(Before::power(left, number), Some(on));
        assert_eq!(
            [Before::power(right, number), Before::power(left, None)],
            [None; 2],
            "another engine's, or lost"
        );
        assert_eq!(after(shut_down, Before::power(left, number)), on);
        // A stop that is latched on an engine that has cooled.
        assert_eq!(after(RetainedState::new(Order::EmergencyStop, Origin::Rc), Some(on)), on);
        assert!(after(shut_down.with(|record| record.armed = true), Some(on)));
    }
    assert!(!after(shut_down, None));
}

#[test]
fn every_change_has_its_reason_and_nothing_else_is_a_change() {
    let mut outputs = outputs(Valve::Closed);
    let mut reasons = |telemetry: &Telemetry| {
        let changes: Vec<_> = outputs.update(telemetry).into_iter().flatten().collect();
        assert_eq!(outputs.update(telemetry), [None; 2], "the same again");
        changes
    };
    let mut armed = snapshot(Order::Standby, Some(Phase::Standby), Some(0));
    armed.armed = true;
    assert_eq!(reasons(&armed), [Change::Power(true, Why::Armed)]);
    assert_eq!(reasons(&snapshot(RUN, None, None)), [Change::Valve(Valve::Open, Why::Ordered)]);
    let stop = snapshot(Order::EmergencyStop, Some(Phase::Running), Some(50_000));
    assert_eq!(reasons(&stop), [Change::Valve(Valve::Closed, Why::StopLatched)]);
    let mut cold = snapshot(Order::Standby, Some(Phase::Standby), Some(0));
    cold.report.egt = Some(Timed::new(Celsius::from_tenths(200), T0));
    assert_eq!(reasons(&cold), []);
    cold.report.egt = Some(Timed::new(Celsius::from_tenths(200), T0 + Duration::from_secs(3)));
    assert_eq!(reasons(&cold), [Change::Power(false, Why::Cold)]);
    let found = snapshot(Order::Listen, Some(Phase::Running), Some(50_000));
    assert_eq!(reasons(&found), [Change::Valve(Valve::Open, Why::Lives), Change::Power(true, Why::Busy)]);
    let mut deaf = snapshot(Order::Standby, Some(Phase::Running), Some(50_000));
    deaf.obeyed = false;
    assert_eq!(reasons(&deaf), []);
    deaf.at = T0 + Duration::from_secs(5);
    deaf.report.phase = Some(Timed::new(Phase::Running, deaf.at));
    let [change] = reasons(&deaf)[..] else { panic!() };
    assert_eq!(change, Change::Valve(Valve::Closed, Why::NotObeyed));
    assert!(change.why().is_alarming() && !Why::AtRest.is_alarming());
    assert_eq!(change.to_string(), "fuel valve closed: the ECU does not obey standby");
}

/// For every record: with an intact one of a running engine the valve is open before anything else, otherwise closed.
#[test]
fn after_a_reset_the_valve_is_open_only_for_an_engine_that_ran_under_an_order_to_run() {
    let after = |record: Option<RetainedState>| {
        let outputs = Outputs::new(OutputSettings::DEFAULT, before(record, false));
        (outputs.valve(), outputs.power())
    };
    assert_eq!(after(None), (Valve::Closed, false), "no record");
    for order in [Order::EmergencyStop, Order::Standby, RUN, Order::Pwm, Order::Listen, DOUBT] {
        for ran in [false, true] {
            for armed in [false, true] {
                let record = RetainedState::new(order, Origin::Rc).with(|state| {
                    state.ran = ran;
                    state.armed = armed;
                });
                let continues = ran && !matches!(order, Order::EmergencyStop | Order::Standby);
                let valve = if continues { Valve::Open } else { Valve::Closed };
                let power = armed || ran || order == Order::EmergencyStop;
                assert_eq!(after(Some(record)), (valve, power), "{order}, ran {ran}");
                // The part of it that survives a brown-out.
                let left = record.without_start();
                let power = ran || order == Order::EmergencyStop;
                assert_eq!(after(Some(left)), (valve, power), "{order}, ran {ran}, brown-out");
            }
        }
    }
}

#[test]
fn power_is_on_from_armed_until_cold_and_at_rest() {
    let mut outputs = outputs(Valve::Closed);
    let egt = |telemetry: &mut Telemetry, celsius: i16| {
        telemetry.report.egt = Some(Timed::new(Celsius::from_tenths(celsius * 10), T0));
    };
    let mut cold = snapshot(Order::Standby, Some(Phase::Standby), Some(0));
    egt(&mut cold, 20);
    outputs.update(&cold);
    assert!(!outputs.power(), "not armed");
    let mut armed = cold;
    armed.armed = true;
    outputs.update(&armed);
    assert!(outputs.power());
    // An emergency stop disarms; hot, turning, cooling, unknown or silent it stays on.
    let mut hot = cold;
    (hot.ordered.order, hot.stop_latched) = (Order::EmergencyStop, true);
    egt(&mut hot, 101);
    let mut turning = cold;
    turning.report.rpm = Some(Timed::new(Rpm::new(3000), T0));
    let mut cooling = cold;
    cooling.report.phase = Some(Timed::new(Phase::Cooling, T0));
    let mut unknown = cold;
    unknown.report.egt = None;
    let mut silent = cold;
    silent.link = LinkState::Lost;
    let mut old = cold;
    old.at = T0 + Duration::from_secs(4);
    for telemetry in [hot, turning, cooling, unknown, silent, old] {
        outputs.update(&telemetry);
        assert!(outputs.power(), "{telemetry:?}");
    }
    // After a reset that lost the arming, the power returns only while the engine starts, runs or cools.
    let mut running = turning;
    running.report.phase = Some(Timed::new(Phase::Running, T0));
    egt(&mut cooling, 300);
    for (telemetry, power) in
        [(cooling, true), (running, true), (hot, false), (turning, false), (silent, false)]
    {
        let mut restarted = Outputs::new(OutputSettings::DEFAULT, before(None, false));
        restarted.update(&telemetry);
        assert_eq!(restarted.power(), power, "{telemetry:?}");
    }
    // An order to run switches it on, whatever the ECU reports.
    for (order, power) in
        [(RUN, true), (DOUBT, true), (Order::Pwm, true), (Order::Listen, false), (Order::Standby, false)]
    {
        let mut restarted = Outputs::new(OutputSettings::DEFAULT, before(None, false));
        restarted.update(&snapshot(order, None, None));
        assert_eq!(restarted.power(), power, "{order}");
    }
    let mut stopped = cold;
    (stopped.ordered.order, stopped.stop_latched) = (Order::EmergencyStop, true);
    egt(&mut stopped, 100);
    outputs.update(&stopped);
    assert!(outputs.power(), "a single report");
    stopped.at = T0 + Duration::from_secs(3);
    outputs.update(&stopped);
    assert!(outputs.power(), "the same report");
    stopped.report.egt = Some(Timed::new(Celsius::from_tenths(1000), stopped.at));
    outputs.update(&stopped);
    assert!(!outputs.power());
}

/// A start may be shorter than the time between two reports: only later reports show that the engine is cold.
#[test]
fn cold_reports_from_before_an_order_to_run_do_not_count_after_it() {
    // Ten reports a second of an engine at rest, run in one of these orders: when the power goes off, in ms.
    let off_after = |run_at: u64| {
        let mut outputs = outputs(Valve::Closed);
        (0..1000_u64).map(|tenth| tenth * 100).find(|&ms| {
            let order = if ms == run_at { RUN } else { Order::Standby };
            let mut telemetry = snapshot(order, Some(Phase::Standby), Some(0));
            telemetry.at = T0 + Duration::from_millis(ms);
            telemetry.armed = ms == 0;
            // Each is 50 ms old.
            let reported = telemetry.at - Duration::from_millis(50);
            telemetry.report.phase = Some(Timed::new(Phase::Standby, reported));
            telemetry.report.rpm = Some(Timed::new(Rpm::new(0), reported));
            telemetry.report.egt = Some(Timed::new(Celsius::from_tenths(200), reported));
            outputs.update(&telemetry);
            !outputs.power()
        })
    };
    assert_eq!(off_after(u64::MAX), Some(3100), "none is ordered");
    assert_eq!(off_after(2000), Some(5200));
}

/// The starter cools a hot turbine: power once removed is never restored.
#[test]
fn odd_report_of_a_cold_exhaust_leaves_starter_and_ignition_their_power() {
    // Ten reports a second, in °C: when the power goes off, in ms.
    let off_after = |egt: &dyn Fn(u64) -> i16| {
        let record = RetainedState::new(Order::EmergencyStop, Origin::Rc);
        let mut outputs = Outputs::new(OutputSettings::DEFAULT, before(Some(record), false));
        (0..1000_u64).map(|tenth| tenth * 100).find(|&ms| {
            let mut telemetry = snapshot(Order::EmergencyStop, Some(Phase::Stopped), Some(0));
            telemetry.at = T0 + Duration::from_millis(ms);
            telemetry.report.phase = Some(Timed::new(Phase::Stopped, telemetry.at));
            telemetry.report.rpm = Some(Timed::new(Rpm::new(0), telemetry.at));
            telemetry.report.egt = Some(Timed::new(Celsius::from_tenths(egt(ms) * 10), telemetry.at));
            outputs.update(&telemetry);
            !outputs.power()
        })
    };
    assert_eq!(off_after(&|_| 100), Some(3000));
    assert_eq!(off_after(&|_| -40), Some(3000), "a winter's day");
    for odd in [20, 100, -50] {
        assert_eq!(off_after(&|ms| if ms == 5000 { odd } else { 600 }), None, "{odd} °C once");
        assert_eq!(off_after(&|ms| if ms % 3000 < 2900 { odd } else { 600 }), None, "{odd} °C with breaks");
    }
    assert_eq!(off_after(&|_| -41), None, "no exhaust is that cold");
    assert_eq!(off_after(&|_| 101), None);
    assert_eq!(off_after(&|ms| if ms < 20_000 { 600 } else { 90 }), Some(23_000));
}

#[test]
fn levels_follow_the_polarity_and_an_output_without_a_pin_is_not_driven() {
    let run = RetainedState::new(RUN, Origin::Rc).with(|state| state.armed = true);
    for (record, on) in [(None, false), (Some(run), true)] {
        let outputs = Outputs::new(OutputSettings::DEFAULT, before(record, false));
        let levels = |config: OutputConfig| config.levels(&outputs).collect::<Vec<_>>();
        for low in [false, true] {
            let [valve, power] = [3, 4].map(|number| OutputPin { number, low });
            let both = [3, 4].map(|number| PinLevel { number, high: on != low });
            assert_eq!(levels(OutputConfig::valve(valve).with_power(power)), both);
            assert_eq!(levels(OutputConfig::valve(valve)), both[..1]);
            assert_eq!(levels(OutputConfig::NONE.with_power(power)), both[1..]);
        }
        assert_eq!(levels(OutputConfig::NONE), []);
    }
}

/// True if the check panics, as it does while a firmware is compiled.
fn is_refused(check: impl FnOnce() + std::panic::UnwindSafe) -> bool {
    std::panic::catch_unwind(check).is_err()
}

#[test]
fn wrong_wiring_is_refused() {
    let config = |valve, power| OutputConfig::valve(valve).with_power(power);
    let [a, b, c] = [OutputPin::high(0), OutputPin::low(1), OutputPin::high(2)];
    let good = [config(a, b), OutputConfig::valve(c), OutputConfig::NONE];
    check_outputs(&good);
    check_board(&good, &[true, false, true]);
    assert!(is_refused(move || check_board(&good, &[false, false])), "the board has two");
    assert!(
        is_refused(move || check_board(&good, &[false, true, false])),
        "low energises, and low in the bootloader"
    );
    assert!(is_refused(|| check_outputs(&[config(a, a)])), "one pin for both");
    assert!(is_refused(|| check_outputs(&[config(a, b), OutputConfig::valve(b)])), "one pin for two engines");
    let settings = OutputSettings { not_obeyed: Some(Duration::from_millis(999)) };
    assert!(is_refused(move || check_outputs(&[OutputConfig { settings, ..OutputConfig::NONE }])));
}
