//! State that continues over a reset.

use super::*;
use jetlink::config::EngineConfig;
use jetlink::link::LinkRecord;

fn retained(order: Order) -> RetainedState {
    RetainedState::new(order, Origin::Rc).with(|state| state.armed = true)
}

/// A record after a loss of power, or of another engine: nothing of it starts or raises an engine.
#[test]
fn a_record_after_a_loss_of_power_starts_and_raises_nothing() {
    for ecu in BOTH {
        let config = ecu.config();
        let ours = config.fingerprint();
        for (order, ran, left) in [
            (Order::Run(percent(80)), true, Order::Listen),
            (Order::Run(percent(0)), false, Order::Listen),
            (Order::Pwm, true, Order::Pwm),
            (Order::Pwm, false, Order::Listen),
            (Order::Standby, false, Order::Standby),
            (Order::EmergencyStop, false, Order::EmergencyStop),
            (Order::Listen, true, Order::Listen),
        ] {
            let record = retained(order).with(|state| {
                state.ran = ran;
                state.link = LinkRecord::new(1);
                state.pump_open = true;
                state.limited = true;
            });
            let memory = RetainedMemory::new();
            memory.store(&record, ours);
            assert_eq!(memory.load(ours, Reset::Warm), Some(record), "{order:?}: the control");
            for (fingerprint, reset) in [(ours, Reset::PowerLost), (ours ^ 1, Reset::Warm)] {
                let record = memory.load(fingerprint, reset).expect("a whole record");
                assert_eq!((record.order, record.ran, record.armed), (left, ran, false), "{ecu:?} {order:?}");
                // It continues as ID 0.
                let left = if left == Order::Pwm { Order::Listen } else { left };
                assert!(record.link == LinkRecord::new(1) && record.pump_open && !record.limited);
                let mut scenario = Scenario::after_reset(ecu, config, Some(record));
                assert!(!scenario.telemetry().armed);
                assert_eq!(scenario.order(), left, "{ecu:?} {order:?}");
                // An engine at rest stays there, whatever streams.
                scenario.introduce();
                scenario.reports(Reports::Standby);
                scenario.fly_us(run(0), Origin::Rc, 5 * SECOND);
                let wire = if left == Order::EmergencyStop { Wire::Stop } else { Wire::Standby };
                assert_eq!(scenario.wire(), wire, "{ecu:?} {order:?}");
            }
        }
    }
}

/// An engine begins once: a second runner does not put a run in doubt. The control: a reset does.
#[test]
fn a_second_start_changes_nothing() {
    for ecu in BOTH {
        let mut scenario = flying(ecu);
        scenario.reports = Some(Reports::Running);
        scenario.fly_us(run(50), Origin::Rc, SECOND);
        let (order, now) = (scenario.order(), at_us(scenario.now_us()));
        let record = scenario.bench.machine.record();
        assert!(matches!(order, Order::Run(_)));
        for retained in [None, Some(record)] {
            scenario.bench.machine.restore(retained);
            scenario.bench.machine.start(now);
            assert_eq!(scenario.order(), order, "{ecu:?}");
            scenario.fly_us(run(50), Origin::Rc, SECOND);
            assert_eq!((scenario.order(), scenario.telemetry().in_doubt), (order, None), "{ecu:?}");
        }
        let after = Scenario::after_reset(ecu, ecu.config(), Some(record));
        assert!(matches!(after.order(), Order::Doubt(_)), "{ecu:?}: {}", after.order());
    }
}

/// While no order is in force, two reports decide: which show a running engine, and which do not.
#[test]
fn two_reports_decide_while_no_order_is_in_force() {
    let runs = Order::Run(percent(65));
    // Answered with that, but it may not rise.
    let held = Order::Doubt(percent(65));
    let table = [
        (Ecu::Amt, 0b01100, TURNING, runs),
        (Ecu::Amt, 0b01100, SLOW, Order::Listen),
        // Any other state with a shaft that turns is answered. A coasting shaft with a cleared start shows
        // neither.
        (Ecu::Amt, 0b00001, TURNING, Order::Listen),
        // A start continues as one: no demand before it runs.
        (Ecu::Amt, 0b00010, TURNING, Order::Run(percent(0))),
        // These may also be a start.
        (Ecu::Amt, 0b00100, TURNING, held),
        (Ecu::Amt, 0b01000, TURNING, held),
        (Ecu::Amt, 0b11111, TURNING, held),
        (Ecu::Amt, 0b11111, SLOW, Order::Listen),
        (Ecu::Amt, 0b00000, TURNING, Order::Standby),
        (Ecu::Amt, 0b00001, SLOW, Order::Standby),
        (Ecu::Amt, 0b00010, SLOW, Order::Standby),
        (Ecu::Zk, 11, TURNING, runs),
        (Ecu::Zk, 6, TURNING, runs),
        (Ecu::Zk, 11, SLOW, Order::Listen),
        (Ecu::Zk, 31, TURNING, Order::Listen),
        (Ecu::Zk, 1, TURNING, Order::Standby),
        (Ecu::Zk, 3, TURNING, Order::Standby),
        (Ecu::Zk, 13, TURNING, Order::Standby),
    ];
    for (ecu, state, rpm, second) in table {
        let mut scenario = Scenario::after_reset(ecu, ecu.config(), None);
        scenario.values.rpm = Some(rpm);
        scenario.introduce();
        if ecu == Ecu::Zk {
            for _ in 0..2 {
                scenario.bench.receive(&zk_frames::status(3, rpm, [65, 0, 0]));
            }
        }
        let mut frame = report(ecu, state, rpm);
        if ecu == Ecu::Amt {
            frame[4] = 130;
        }
        for expected in [Order::Listen, second] {
            receive(&mut scenario, &frame);
            assert_eq!(scenario.order(), expected, "{ecu:?} {state} {rpm}");
        }
    }
}

/// A ZK ECU reports its throttle in frames of their own. An engine that is found running resumes at the lower of the last two, so that
/// one odd report does not raise its demand.
#[test]
fn one_odd_throttle_does_not_raise_the_demand_of_an_engine_that_is_found() {
    for (throttles, resumed) in [
        (&[30, 30][..], Some(30)),
        (&[30, 100], Some(30)),
        (&[100, 30], Some(30)),
        (&[100, 30, 30, 31], Some(30)),
        (&[100], None),
        (&[], None),
    ] {
        let mut scenario = Scenario::after_reset(Ecu::Zk, Ecu::Zk.config(), None);
        scenario.values.rpm = Some(TURNING);
        scenario.introduce();
        for throttle in throttles {
            scenario.bench.receive(&zk_frames::status(3, TURNING, [*throttle, 0, 0]));
        }
        for _ in 0..2 {
            receive(&mut scenario, &report(Ecu::Zk, 11, TURNING));
        }
        let expected = resumed.map_or(Order::Listen, |resumed| Order::Run(percent(resumed)));
        assert_eq!(scenario.order(), expected, "{throttles:?}");
        if resumed.is_none() {
            // The second one decides, and after 3 s none is waited for.
            scenario.reports(Reports::Running);
            scenario.pass_us(4 * SECOND);
            assert!(matches!(scenario.order(), Order::Run(_)), "{throttles:?}: {}", scenario.order());
        }
    }
}

/// AMT-8: after a loss of power an ECU with error sets and a burning exhaust is answered run at its own demand, under the
/// stages of loss, only if the record shows that the engine ran.
#[test]
fn amt_8_after_a_loss_of_power_a_burning_engine_that_ran_resumes() {
    for (ran, egt, continues) in
        [(true, 500, true), (false, 500, false), (true, 26, false), (true, 299, false)]
    {
        let memory = RetainedMemory::new();
        let config = Ecu::Amt.config();
        memory.store(&retained(Order::Run(percent(90))).with(|state| state.ran = ran), config.fingerprint());
        let record = memory.load(config.fingerprint(), Reset::PowerLost);
        let mut scenario = Scenario::after_reset(Ecu::Amt, config, record);
        scenario.values = Values { egt_celsius: egt, fault: 1, half_percents: 120, ..scenario.values };
        scenario.reports = Some(Reports::Running);
        scenario.pass_us(FRAME_PERIOD_US);
        assert_eq!(scenario.sent(), [], "{ran} {egt}: one set is not enough");
        scenario.pass_us(FRAME_PERIOD_US);
        assert_eq!(scenario.sent(), if continues { vec![Wire::Run(600)] } else { vec![] }, "{ran} {egt}");
        if continues {
            assert_eq!(scenario.telemetry().loss, LossStage::Hold);
            scenario.pass_us(5 * SECOND);
            assert_eq!((scenario.wire(), scenario.telemetry().loss), (Wire::Run(0), LossStage::FailSafe));
        } else {
            scenario.pass_us(5 * SECOND);
            assert_eq!(scenario.sent(), [], "{ran} {egt}");
        }
    }
}

/// AMT-8: an exhaust that burned after the reset may fall, as it does after an acceleration: the replies continue. A fall as fast as
/// without a flame ends them.
#[test]
fn amt_8_after_a_reset_a_slow_fall_of_a_burning_exhaust_costs_no_reply() {
    for with_record in [true, false] {
        for (degrees_per_s, continues) in [(0, true), (8, true), (25, false)] {
            let config = Ecu::Amt.config();
            let memory = RetainedMemory::new();
            let record = retained(Order::Run(percent(60))).with(|state| state.ran = true);
            memory.store(&record, config.fingerprint());
            let reset = if with_record { Reset::Warm } else { Reset::PowerLost };
            let mut scenario =
                Scenario::after_reset(Ecu::Amt, config, memory.load(config.fingerprint(), reset));
            scenario.values = Values { egt_celsius: 600, fault: 1, half_percents: 120, ..scenario.values };
            scenario.reports = Some(Reports::Running);
            scenario.fly_us(run(60), Origin::Rc, SECOND);
            let from = scenario.now_us();
            let mut silent_us = 0;
            while scenario.now_us() < from + 8 * SECOND {
                let passed = i32::try_from((scenario.now_us() - from) / 1000).unwrap();
                scenario.values.egt_celsius = 600 - degrees_per_s * passed / 1000;
                scenario.sent();
                scenario.fly_us(run(60), Origin::Rc, SECOND / 4);
                let answered = scenario.sent().iter().any(|wire| matches!(wire, Wire::Run(_)));
                silent_us = if answered { 0 } else { silent_us + SECOND / 4 };
            }
            assert_eq!(silent_us == 0, continues, "{with_record} {degrees_per_s}: {silent_us} µs");
        }
    }
}

/// The record shows that an engine ran until standby, a stop or the end of its life.
#[test]
fn the_record_shows_whether_the_engine_ran() {
    let table: [(&str, Step, bool); 6] = [
        ("flying", |_| {}, true),
        (
            "in doubt",
            |s| {
                s.silent().fly_us(run(50), Origin::Rc, SECOND);
            },
            true,
        ),
        (
            "unconfirmed",
            |s| {
                s.silent().fly_us(run(50), Origin::Rc, 20 * SECOND);
            },
            true,
        ),
        (
            "standby",
            |s| {
                s.shut_down().unwrap();
            },
            false,
        ),
        (
            "stop",
            |s| {
                s.command(Command::EmergencyStop).unwrap();
            },
            false,
        ),
        (
            "at rest",
            |s| {
                s.reports(Reports::Cooling);
            },
            false,
        ),
    ];
    for ecu in BOTH {
        for (name, step, ran) in table {
            let mut scenario = flying(ecu);
            step(&mut scenario);
            assert_eq!(scenario.bench.machine.record().ran, ran, "{ecu:?} {name}");
        }
        let mut scenario = Scenario::ready(ecu, ecu.config());
        scenario.command(run(0)).unwrap();
        scenario.reports(Reports::Starting);
        assert!(!scenario.bench.machine.record().ran, "{ecu:?}: a start is no run");
    }
}

/// Resets in a row without a source are counted; one command ends the row. From the third the engine is resumed at the fail-safe
/// stage.
#[test]
fn resets_without_a_source_are_counted() {
    for ecu in BOTH {
        for source_back_after in [None, Some(1)] {
            let mut scenario = flying(ecu);
            for reset in 1..=3_u8 {
                scenario = scenario.reset(ecu.config());
                assert_eq!(scenario.bench.machine.record().resets, reset, "{ecu:?}");
                scenario.pass_us(3 * FRAME_PERIOD_US);
                if source_back_after == Some(reset) {
                    scenario.command(run(50)).unwrap();
                    assert_eq!(scenario.bench.machine.record().resets, 0, "{ecu:?}");
                    scenario = scenario.reset(ecu.config());
                    assert_eq!(scenario.bench.machine.record().resets, 1, "{ecu:?}");
                    break;
                }
            }
            scenario.pass_us(3 * FRAME_PERIOD_US);
            let expected = if source_back_after.is_none() { LossStage::FailSafe } else { LossStage::None };
            assert_eq!(scenario.telemetry().loss, expected, "{ecu:?} {source_back_after:?}");
        }
    }
}

/// A reset loop of any period: with a fresh source the engine stays at its demand, without one it comes to idle, and to
/// standby when nothing has been received for 10 s and more.
#[test]
fn reset_loop_of_any_period_does_not_hold_a_demand() {
    for ecu in BOTH {
        for period in [60_000, 110_000, 150_000, 200_000, 290_000, 500_000, 1_050_000, 2_000_000] {
            let mut scenario = flying(ecu);
            let mut total = 0;
            let mut before = 500;
            while total < 15 * SECOND {
                scenario.pass_us(period);
                total += period;
                for wire in scenario.sent() {
                    let Wire::Run(tenths) = wire else { continue };
                    // AMT counts in half percents.
                    assert!(tenths <= before + 4, "{ecu:?} {period}: {tenths} after {before}");
                    assert!(total < 5 * SECOND || tenths == 0, "{ecu:?} {period}: {tenths} after {total} µs");
                    before = tenths;
                }
                scenario = scenario.reset(ecu.config());
            }
            assert_eq!(scenario.order(), Order::Standby, "{ecu:?} {period}");
            // The control: the source commands after each reset, as soon as the engine is confirmed.
            let mut scenario = flying(ecu);
            // The demand that was sent is retained.
            scenario.fly_us(run(50), Origin::Rc, 4 * FRAME_PERIOD_US);
            for _ in 0..20 {
                scenario = scenario.reset(ecu.config());
                scenario.fly_us(run(50), Origin::Rc, period.max(110_000));
                assert_eq!(scenario.order(), Order::Run(percent(50)), "{ecu:?} {period}");
            }
        }
    }
}

/// A hand-over to PWM is resumed as ID 0, which leaves PWM in charge, until two reports say at rest: then standby. After a loss
/// of power as well: it can only preserve.
#[test]
fn zk_8_a_hand_over_resumes_as_id_0_after_a_reset() {
    let config = Ecu::Zk.config();
    for reset in [Reset::Warm, Reset::PowerLost] {
        let mut before = Scenario::ready(Ecu::Zk, config);
        before.command(Command::HandOverToPwm).unwrap();
        before.reports(Reports::Starting).reports(Reports::Running);
        let memory = RetainedMemory::new();
        memory.store(&before.bench.machine.record(), config.fingerprint());
        let mut scenario = Scenario::after_reset(Ecu::Zk, config, memory.load(config.fingerprint(), reset));
        scenario.reports = Some(Reports::Unknown);
        scenario.introduce();
        scenario.pass_us(9 * SECOND);
        assert_eq!(scenario.sent(), [], "{reset:?}");
        scenario.pass_us(51 * SECOND);
        // No source commands, and nothing ends it but the engine.
        assert_eq!(scenario.sent(), [], "{reset:?}: ID 0 only");
        scenario.reports(Reports::Running).pass_us(60 * SECOND);
        assert_eq!(scenario.sent(), [], "{reset:?}: it runs, and is not handed over again");
        scenario.silent();
        {
            receive(&mut scenario, &report(Ecu::Zk, 1, 0));
            assert_ne!(scenario.order(), Order::Standby);
            receive(&mut scenario, &report(Ecu::Zk, 1, 0));
            assert_eq!(scenario.order(), Order::Standby);
        }
    }
}

/// An engine that was handed over and never ran has not failed when a reset finds it at rest: the others keep their demand. One that
/// ran has.
#[test]
fn zk_8_an_engine_that_was_handed_over_and_never_ran_has_not_failed() {
    let config = Ecu::Zk.config();
    for ran in [false, true] {
        let mut before = Scenario::ready(Ecu::Zk, config);
        before.command(Command::HandOverToPwm).unwrap();
        if ran {
            before.reports(Reports::Starting).reports(Reports::Running).pass_us(SECOND);
        }
        let mut record = before.bench.machine.record();
        for reset in 1..=2 {
            let mut scenario = Scenario::after_reset(Ecu::Zk, config, Some(record));
            scenario.introduce();
            record = scenario.bench.machine.record();
            assert_eq!(record.ran, ran, "{reset}");
            if reset == 2 {
                scenario.reports(Reports::Standby).pass_us(SECOND);
                assert_eq!(scenario.order(), Order::Standby, "{ran}");
                assert_eq!(scenario.bench.machine.failed(), ran);
            }
        }
    }
}

/// A record contains the demand that was sent. The first command of its source after a reset does not count as a move of the
/// stick.
#[test]
fn the_first_demand_after_a_reset_rises_at_the_rate() {
    for ecu in BOTH {
        let config = ecu.config();
        let mut scenario = Scenario::started(ecu, percent(10));
        scenario.fly_us(run(10), Origin::Rc, SECOND);
        let mut scenario = scenario.reset(config);
        scenario.values.half_percents = 20;
        scenario.reports(Reports::Running);
        assert_eq!(scenario.order(), Order::Run(percent(10)), "{ecu:?}");
        scenario.command(run(80)).unwrap();
        let from = scenario.now_us();
        while scenario.order() != Order::Run(percent(80)) {
            let most = 100 + (scenario.now_us() - from) / 2_000 + 10;
            assert!(u64::from(scenario.tenths()) <= most, "{ecu:?}: {} of {most}", scenario.tenths());
            scenario.fly_us(run(80), Origin::Rc, FRAME_PERIOD_US);
        }
        assert!(scenario.now_us() >= from + 1_300_000, "{ecu:?}");
        // The stick is moved: no slew is set.
        scenario.command(run(100)).unwrap();
        assert_eq!(scenario.tenths(), 1000, "{ecu:?}");
    }
}

/// "Disarm ends a start that has not reached running, in doubt or not": also if it comes before the engine's task begins.
#[test]
fn a_disarm_before_the_engine_begins_ends_an_interrupted_start() {
    let config = Ecu::Amt.config();
    let starting = report(Ecu::Amt, amt_frames::STARTING, TURNING);
    let mut scenario = Scenario::ready(Ecu::Amt, config);
    scenario.command(run(0)).unwrap();
    for _ in 0..10 {
        receive(&mut scenario, &starting);
        scenario.command(run(0)).unwrap();
    }
    let record = scenario.bench.machine.record();
    for (command, left) in [(Command::Present, Order::Run(percent(0))), (Command::Disarm, Order::Standby)] {
        let mut machine = Engine::new(&config);
        machine.restore(Some(record));
        machine.command(at_us(0), command, Origin::Rc, true).unwrap();
        let mut scenario = Scenario::nothing_received(Ecu::Amt, config);
        machine.start(at_us(0));
        *scenario.bench.machine = machine;
        scenario.bench.drain();
        for _ in 0..4 {
            receive(&mut scenario, &starting);
        }
        assert_eq!(scenario.order(), left, "{command:?}");
    }
}

/// A start found after a reset continues where it was: unlike right after the order, rest no longer fits, and a gap puts it in doubt.
#[test]
fn amt_a_start_found_after_a_reset_is_under_way() {
    let config = Ecu::Amt.config();
    let starting = report(Ecu::Amt, amt_frames::STARTING, TURNING);
    let rest = report(Ecu::Amt, amt_frames::NO_CLEARANCE, 0);
    for (frame, sets, order) in [
        (&starting, 8, Order::Run(percent(0))),
        (&rest, 1, Order::Doubt(percent(0))),
        (&rest, 2, Order::Standby),
    ] {
        let mut scenario = Scenario::ready(Ecu::Amt, config);
        scenario.command(run(0)).unwrap();
        for _ in 0..4 {
            receive(&mut scenario, &starting);
        }
        let mut scenario = scenario.reset(config);
        // Two sets find it. No set has advanced it since.
        for _ in 0..2 {
            receive(&mut scenario, &starting);
        }
        assert_eq!(scenario.order(), Order::Run(percent(0)));
        for _ in 0..sets {
            receive(&mut scenario, frame);
        }
        assert_eq!(scenario.order(), order, "{sets} of {frame:?}");
    }
}

/// Without an order in force two reports that agree decide, and a gap separates them.
#[test]
fn a_gap_separates_the_reports_that_find_an_engine() {
    for ecu in BOTH {
        for (reports, order) in
            [(Reports::Running, Order::Run(percent(0))), (Reports::Stopped, Order::Standby)]
        {
            let mut scenario = Scenario::after_reset(ecu, ecu.config(), None);
            scenario.introduce();
            if ecu == Ecu::Zk {
                for _ in 0..2 {
                    scenario.bench.receive(&zk_frames::status(3, 0, [0, 0, 0]));
                }
            }
            let frame = ecu.frame(reports, scenario.values);
            for received in 0..2 {
                receive(&mut scenario, &frame);
                assert_eq!(scenario.order(), Order::Listen, "{ecu:?} {reports:?} {received}");
                scenario.silent().pass_us(gap(ecu) + 2 * FRAME_PERIOD_US);
            }
            receive(&mut scenario, &frame);
            receive(&mut scenario, &frame);
            assert_eq!(scenario.order(), order, "{ecu:?} {reports:?}");
        }
    }
}

/// Silence from before a brown-out counts: the time to standby does not begin again.
#[test]
fn silence_before_a_brown_out_counts_towards_standby() {
    for ecu in BOTH {
        // A source is silent from the end of its timeout on, and which one it was is not retained.
        let timeout = ecu.config().supervision.timeouts.longest().as_micros();
        let all_us = timeout + HOLD_US + RUN_OUT_US;
        for silent in [SECOND, 6 * SECOND] {
            let mut flight = flying(ecu);
            flight.reports = Some(Reports::Running);
            flight.fly_us(run(50), Origin::Rc, SECOND).pass_us(silent);
            let record = flight.bench.machine.record().without_start();
            let mut scenario = Scenario::after_reset(ecu, ecu.config(), Some(record));
            // Nothing is received from the ECU. Silence is retained in steps of 0.2 s.
            scenario.silent().pass_us(all_us - silent - 300_000);
            assert_eq!(scenario.order(), Order::Listen, "{ecu:?} {silent}");
            scenario.pass_us(600_000);
            assert_eq!(scenario.order(), Order::Standby, "{ecu:?} {silent}");
        }
    }
}

/// After a reset, an engine whose ECU is about to report that it runs, at 90 %.
fn found_at_90_percent(ecu: Ecu, config: EngineConfig, record: Option<RetainedState>) -> Scenario {
    let mut scenario = Scenario::after_reset(ecu, config, record);
    scenario.values.half_percents = 180;
    scenario.introduce();
    if ecu == Ecu::Zk {
        for _ in 0..2 {
            scenario.bench.receive(&zk_frames::status(3, TURNING, [90, 0, 0]));
        }
    }
    scenario.reports = Some(Reports::Running);
    scenario
}

/// An engine that is found running after a brown-out is lowered to where the stages of loss have come by then.
#[test]
fn silence_before_a_brown_out_lowers_the_engine_that_is_found() {
    for ecu in BOTH {
        for (silent, tenths) in [(300_000, 800..=900), (3 * SECOND, 300..=600)] {
            let mut flight = Scenario::started(ecu, percent(90));
            flight.reports = Some(Reports::Running);
            flight.fly_us(run(90), Origin::Rc, SECOND).pass_us(silent);
            let record = flight.bench.machine.record().without_start();
            let mut scenario = found_at_90_percent(ecu, ecu.config(), Some(record));
            scenario.pass_us(2 * FRAME_PERIOD_US);
            assert!(tenths.contains(&scenario.tenths()), "{ecu:?} {silent}: {}", scenario.tenths());
        }
    }
}

/// A source that waits to take over is received: resets that interrupt its wait do not end a run. Without it, they do.
#[test]
fn resets_while_a_source_waits_to_take_over_end_no_run() {
    for ecu in BOTH {
        let config = ecu.with(|rules| {
            rules.loss.standby_after = Some(Duration::from_secs(3));
            rules.takeover.within = Duration::from_secs(5);
        });
        for commands in [true, false] {
            let mut scenario = Scenario::started_with(ecu, config, percent(50));
            scenario.reports = Some(Reports::Running);
            let mut orders = Vec::new();
            for _ in 0..4 {
                for _ in 0..36 {
                    if commands {
                        scenario.fly_us(run(10), Origin::Mavlink, SECOND / 10);
                    } else {
                        scenario.pass_us(SECOND / 10);
                    }
                    orders.push(scenario.order());
                }
                scenario = scenario.reset(config);
                scenario.reports = Some(Reports::Running);
            }
            assert_eq!(orders.contains(&Order::Standby), !commands, "{ecu:?} {commands}");
            let last = orders.last().copied();
            assert_eq!(last == Some(Order::Run(percent(10))), commands, "{ecu:?} {commands}: {last:?}");
        }
    }
}

/// A source that waits to take over is the one that a reset finds in control: its wait does not restart, and its silence has its
/// own timeout.
#[test]
fn a_source_that_waits_to_take_over_is_in_control_after_a_reset() {
    const MAVLINK_TIMEOUT_US: u64 = SECOND;
    for ecu in BOTH {
        let config = ecu.with(|rules| rules.takeover.within = Duration::from_secs(20));
        for commands in [true, false] {
            let mut scenario = Scenario::started_with(ecu, config, percent(50));
            scenario.reports = Some(Reports::Running);
            scenario.fly_us(run(10), Origin::Mavlink, 3 * SECOND);
            assert_eq!(scenario.order(), Order::Run(percent(50)), "{ecu:?}: it waits");
            assert_eq!(scenario.bench.machine.record().origin, Origin::Mavlink, "{ecu:?}");
            let mut scenario = scenario.reset(config);
            scenario.reports = Some(Reports::Running);
            if commands {
                scenario.fly_us(run(10), Origin::Mavlink, SECOND);
                assert_eq!(scenario.order(), Order::Run(percent(10)), "{ecu:?}");
                continue;
            }
            scenario.pass_us(MAVLINK_TIMEOUT_US + HOLD_US - SECOND / 4);
            assert_eq!(scenario.telemetry().loss, LossStage::Hold, "{ecu:?}");
            scenario.pass_us(SECOND / 2);
            assert_eq!(scenario.telemetry().loss, LossStage::FailSafe, "{ecu:?}");
        }
    }
}

/// An engine is found while a source commands another demand, and falls silent before it has taken over: its stages of loss begin then.
#[test]
fn the_stages_of_loss_begin_with_a_source_that_was_there_when_its_engine_was_found() {
    for ecu in BOTH {
        let mut scenario = found_at_90_percent(ecu, ecu.config(), None);
        scenario.fly_us(run(10), Origin::Rc, SECOND);
        assert_eq!(scenario.telemetry().waiting, Some(Origin::Rc), "{ecu:?}");
        let lost = SECOND - COMMAND_PERIOD_US + SOURCE_TIMEOUT_US;
        scenario.pass_us(3 * SECOND);
        let expected = [(lost, LossStage::Hold), (lost + HOLD_US, LossStage::FailSafe)];
        assert_eq!(stages(&mut scenario), expected, "{ecu:?}");
    }
}

/// A hold that two resets interrupt lasts as long as without them, also where the record has no run and the engine was found in the hold.
#[test]
fn a_hold_does_not_begin_again_with_an_engine_that_is_found_in_it() {
    for ecu in BOTH {
        for second in [Reset::Warm, Reset::PowerLost] {
            let config = ecu.with(|rules| rules.loss.hold = Duration::from_secs(60));
            let mut scenario = Scenario::started_with(ecu, config, percent(90));
            scenario.reports = Some(Reports::Running);
            scenario.fly_us(run(90), Origin::Rc, SECOND).pass_us(30 * SECOND);
            let mut silent_us = 30 * SECOND;
            for reset in [Reset::PowerLost, second] {
                let record = scenario.bench.machine.record();
                let record = if reset == Reset::Warm { record } else { record.without_start() };
                scenario = found_at_90_percent(ecu, config, Some(record));
                scenario.pass_us(10 * SECOND);
                silent_us += 10 * SECOND;
                assert_eq!(scenario.telemetry().loss, LossStage::Hold, "{ecu:?} {reset:?}");
            }
            // The hold is over, with the steps in which a silence is retained.
            scenario.pass_us(63 * SECOND - silent_us);
            assert_eq!(scenario.telemetry().loss, LossStage::FailSafe, "{ecu:?} {second:?}");
        }
    }
}
