//! What the engine may not forget over a reset, nor when an order is given up.

use super::*;

/// Flies, receives nothing for 10 s under a source that commands run, so that the order is given up, and is reset: not at all, warm, or by a
/// loss of power that the RAM survives.
fn given_up(reset: Option<Reset>) -> Scenario {
    let mut scenario = flying(Ecu::Amt);
    scenario.values.egt_celsius = 26;
    scenario.silent().fly_us(run(50), Origin::Rc, 10 * SECOND);
    assert_eq!(scenario.order(), Order::Listen);
    match reset {
        None => scenario,
        Some(reset) => after(&scenario, reset),
    }
}

const RESETS: [Option<Reset>; 3] = [None, Some(Reset::Warm), Some(Reset::PowerLost)];

/// The ECU has stopped the engine of an order that was given up. A hot exhaust beside its error sets is no evidence, and the states that a start
/// and a flight have in common are answered with the throttle of the set. The control: a running engine is found.
#[test]
fn an_order_that_was_given_up_stays_so_over_a_reset() {
    for reset in RESETS {
        for cools_per_s in [0, 10, 40] {
            let mut scenario = given_up(reset);
            for i in 0..200 {
                receive_faults(&mut scenario, 600 - cools_per_s * i / 20);
            }
            assert_eq!(runs(&mut scenario), 0, "{reset:?} {cools_per_s} °C/s");
        }
        for state in [0b00100, 0b01000, 0b11111] {
            let mut scenario = given_up(reset);
            for _ in 0..100 {
                let mut frame = report(Ecu::Amt, state, TURNING);
                frame[4] = 20;
                receive(&mut scenario, &frame);
                let _ = scenario.command(run(90));
            }
            assert!(matches!(scenario.order(), Order::Doubt(_)), "{reset:?} {state:#b}");
            assert!(scenario.sent().iter().all(|wire| *wire == Wire::Run(100)), "{reset:?} {state:#b}");
        }
        let mut scenario = given_up(reset);
        for _ in 0..20 {
            scenario.reports(Reports::Running);
            let _ = scenario.command(run(90));
        }
        assert!(matches!(scenario.order(), Order::Run(_)), "{reset:?}: {}", scenario.order());
    }
}

/// In a loop of resets, too; and an engine that flew before a loss of power has been stopped by its ECU once that got no reply for its serial
/// delay. The control: before that, a hot exhaust shows that it runs.
#[test]
fn a_hot_exhaust_shows_nothing_after_the_serial_delay() {
    let mut scenario = flying(Ecu::Amt);
    scenario.silent();
    for _ in 0..6 {
        scenario.pass_us(900_000);
        scenario = scenario.reset(Ecu::Amt.config());
        scenario.silent();
    }
    (0..5).for_each(|_| receive_faults(&mut scenario, 600));
    assert_eq!(runs(&mut scenario), 0);
    for (silent, answered) in [(0, true), (3 * SECOND, true), (4 * SECOND, false)] {
        let record = flying(Ecu::Amt).bench.machine.record().without_start();
        let mut scenario = Scenario::after_reset(Ecu::Amt, Ecu::Amt.config(), Some(record));
        scenario.silent().pass_us(silent);
        (0..5).for_each(|_| receive_faults(&mut scenario, 600));
        assert_eq!(runs(&mut scenario) > 0, answered, "{silent} µs");
    }
}

/// After error sets only a set that reports running is answered: also when the node was reset since, or the order was given up.
#[test]
fn after_faults_only_running_is_answered_over_a_reset_and_after_an_order_was_given_up() {
    for reset in [false, true] {
        for state in [0b00010, 0b00100, 0b01000, 0b11111] {
            let mut scenario = with_faults(2 * SECOND, 1, run(50), |_| 500);
            if reset {
                scenario = scenario.reset(Ecu::Amt.config());
            }
            scenario.sent();
            let until = scenario.now_us() + 10 * SECOND;
            while scenario.now_us() < until {
                let _ = scenario.command(run(50));
                let mut frame = report(Ecu::Amt, state, TURNING);
                frame[4] = 100;
                receive(&mut scenario, &frame);
            }
            assert_eq!(runs(&mut scenario), 0, "{reset} {state:#b}");
        }
        let mut scenario = with_faults(2 * SECOND, 1, run(50), |_| 500);
        if reset {
            scenario = scenario.reset(Ecu::Amt.config());
        }
        scenario.sent();
        scenario.values.fault = 0;
        scenario.reports(Reports::Running).reports(Reports::Running);
        assert!(runs(&mut scenario) > 0, "{reset}: the control");
    }
}

/// After two reports of start clearance no error set is answered, over a reset either. The control: without them they are.
#[test]
fn error_sets_after_start_clearance_are_not_answered_over_a_reset() {
    for (clearances, resets) in [(4, 0), (4, 1), (0, 0), (0, 1)] {
        let mut scenario = with_faults(2 * SECOND, 1, run(50), |_| 500);
        for _ in 0..clearances {
            let _ = scenario.command(run(50));
            receive(&mut scenario, &report(Ecu::Amt, 0b00001, TURNING));
        }
        for _ in 0..resets {
            scenario = scenario.reset(Ecu::Amt.config());
        }
        scenario.sent();
        for _ in 0..6 {
            let _ = scenario.command(run(50));
            receive_faults(&mut scenario, 500);
        }
        assert_eq!(runs(&mut scenario) > 0, clearances == 0, "{clearances} {resets}");
    }
}

/// A thermocouple that fails at a plausible cold value, in one step, ends no run, over a reset either. The control: one that cools down does.
#[test]
fn a_thermocouple_that_failed_costs_no_engine_over_a_reset() {
    for reset in [false, true] {
        for (fails, order) in [(true, Order::Doubt(percent(50))), (false, Order::Standby)] {
            let egt = |t: u64| match t {
                t if t <= SECOND => 500,
                _ if fails => 26,
                t => (500 - (t - SECOND) as i32 / 8_000).max(26),
            };
            let mut scenario = with_faults(6 * SECOND, 1, run(50), egt);
            if reset {
                scenario = scenario.reset(Ecu::Amt.config());
            }
            scenario.fly_us(run(50), Origin::Rc, 3 * SECOND);
            assert_eq!(scenario.order(), order, "{reset} {fails}");
        }
    }
}

/// A longer `recover_after` does not take control from a source that was lost once and has long been back.
#[test]
fn a_longer_recover_after_leaves_a_source_in_control() {
    for ecu in BOTH {
        let mut scenario = flying(ecu);
        scenario.reports = Some(Reports::Running);
        scenario.pass_us(3 * SECOND);
        scenario.fly_us(run(50), Origin::Rc, 20 * SECOND);
        let mut config = ecu.config().supervision;
        config.recover_after = Duration::from_secs(60);
        scenario.bench.act(|engine, now| engine.configure(now, &config)).unwrap();
        scenario.fly_us(run(50), Origin::Rc, 5 * SECOND);
        assert_eq!(scenario.order(), Order::Run(percent(50)), "{ecu:?}");
        // The control: it counts from its next loss on.
        scenario.pass_us(3 * SECOND);
        scenario.fly_us(run(50), Origin::Rc, 20 * SECOND);
        assert_eq!(scenario.order(), Order::Run(percent(0)), "{ecu:?}");
    }
}

/// Error sets while no order is in force, or right after a loss of power: when the fault clears, only "running" is answered. The control: two sets
/// of running.
#[test]
fn after_faults_without_an_order_only_running_is_answered() {
    type Begin = fn() -> Scenario;
    let table: [(&str, i32, Begin); 4] = [
        ("given up", 150, || given_up(None)),
        ("after a loss of power", 150, || after_power_loss()),
        ("after a loss of power, and its exhaust burns", 600, || after_power_loss()),
        ("without a record", 150, || Scenario::nothing_received(Ecu::Amt, Ecu::Amt.config())),
    ];
    for (name, egt, begin) in table {
        for sets in [2, 3, 40] {
            let begun = || {
                let mut scenario = begin();
                scenario.silent();
                (0..sets).for_each(|_| receive_faults(&mut scenario, egt));
                scenario
            };
            for state in COMMON_STATES {
                assert_eq!(highest(&mut begun(), state, 100), None, "{name}, {sets} error sets, {state:#b}");
            }
            assert!(highest(&mut begun(), 0b01100, 100).is_some(), "{name}, {sets} error sets");
        }
    }
}

/// After a loss of power a single error set, among sets of an engine that idles in another state than running, is no fault: those after it are
/// answered. The control: two error sets.
#[test]
fn one_error_set_after_a_loss_of_power_costs_no_reply() {
    for state in [0b00100, 0b01000, 0b11111] {
        let answered = |sets: usize| {
            let mut scenario = after_power_loss();
            receive(&mut scenario, &hot(state));
            (0..sets).for_each(|_| receive_faults(&mut scenario, 600));
            scenario.sent();
            (0..40).for_each(|_| receive(&mut scenario, &hot(state)));
            runs(&mut scenario)
        };
        assert_eq!([1, 2].map(answered), [40, 0], "{state:#b}");
    }
}

/// The ECU starts an engine, whose shaft still turns, after its order was given up: on an order that nobody means any more, as the engine flew. The
/// control: a node without a record, for which it may be its own start.
#[test]
fn a_start_after_an_order_was_given_up_is_not_answered() {
    for reset in RESETS {
        assert_eq!(highest(&mut given_up(reset), 0b00010, 100), None, "{reset:?}");
    }
    let mut scenario = Scenario::nothing_received(Ecu::Amt, Ecu::Amt.config());
    assert!(highest(&mut scenario, 0b00010, 100).is_some());
}

fn after_power_loss() -> Scenario {
    after(&flying(Ecu::Amt), Reset::PowerLost)
}

/// The ECU reports "running" and its own switch at standby or stop: it shuts the engine down, and the shaft turns yet. A node without an order does
/// not take that for an engine that somebody wants to run. The control: its switch is at run.
#[test]
fn an_engine_that_its_ecu_shuts_down_is_not_found_running() {
    let amt: [(u8, bool); 3] =
        [(amt_frames::AUTO_STOP, false), (amt_frames::EMERGENCY, false), (amt_frames::RUN, true)];
    for (switch, found) in amt {
        for mut scenario in [given_up(None), Scenario::nothing_received(Ecu::Amt, Ecu::Amt.config())] {
            scenario.silent();
            for _ in 0..40 {
                let mut frame = amt_frames::normal(0b01100, switch, 60);
                frame[4] = 120;
                receive(&mut scenario, &frame);
            }
            assert_eq!(runs(&mut scenario) > 0, found, "AMT, switch {switch}");
        }
    }
    for (switch, found) in [(1, false), (0, false), (2, true)] {
        let mut scenario = Scenario::with(Ecu::Zk, Ecu::Zk.config());
        scenario.silent();
        for _ in 0..40 {
            receive(&mut scenario, &zk_frames::status(1, TURNING, [11, switch << 5, 76]));
            receive(&mut scenario, &zk_frames::status(3, TURNING, [60, 0, 0]));
        }
        assert_eq!(runs(&mut scenario) > 0, found, "ZK, switch {switch}");
    }
}

/// Whether error sets get a reply whose exhaust cannot be read.
fn answers_without_an_exhaust(scenario: &mut Scenario) -> bool {
    scenario.sent();
    for _ in 0..8 {
        scenario.values = Values { fault: 0b1000, half_percents: 100, egt_celsius: -50, rpm: None };
        let frame = scenario.ecu.frame(Reports::Running, scenario.values);
        receive(scenario, &frame);
    }
    runs(scenario) > 0
}

/// Nothing is received from a reset on, for three frames: a gap, as without the reset. Error sets without an exhaust that can be read get no
/// reply then. The control: the ECU is received at once.
#[test]
fn amt_8_a_silence_that_begins_with_a_reset_is_a_gap() {
    for (silence, answered) in [(3 * SECOND, false), (0, true)] {
        for reset in [false, true] {
            let mut scenario = flying(Ecu::Amt);
            if reset {
                scenario = scenario.reset(Ecu::Amt.config());
            }
            scenario.silent().fly_us(run(50), Origin::Rc, silence);
            assert_eq!(answers_without_an_exhaust(&mut scenario), answered, "{silence} us, reset: {reset}");
        }
    }
}

/// Damaged sets at the expected times are no gap after a reset, either. The control: nothing at all.
#[test]
fn amt_8_damaged_sets_after_a_reset_are_no_gap() {
    for (damaged, answered) in [(true, true), (false, false)] {
        let mut scenario = flying(Ecu::Amt).reset(Ecu::Amt.config());
        scenario.silent();
        for _ in 0..20 {
            let _ = scenario.command(run(50));
            scenario.pass_us(FRAME_PERIOD_US);
            if damaged {
                scenario.bench.machine.line_error(LineError::Framing);
                scenario.bench.receive(&report(Ecu::Amt, 0b01100, TURNING));
            }
        }
        assert_eq!(answers_without_an_exhaust(&mut scenario), answered, "damaged: {damaged}");
    }
}

/// A set with this state, a turning shaft and an exhaust of 600 °C.
fn hot(state: u8) -> Vec<u8> {
    let mut frame = report(Ecu::Amt, state, TURNING).to_vec();
    (frame[3], frame[4]) = (141, 20);
    frame
}

/// What an ECU has reported of a hot engine does not change what is known of it: one that flew has failed, one that was found in idle calibration is
/// answered beside a hot exhaust, and another state ends what start clearance withheld. The control: without a reset.
#[test]
fn a_reset_takes_start_clearance_for_no_more_than_it_is() {
    for resets in [false, true] {
        let again = |scenario: Scenario| if resets { after(&scenario, Reset::Warm) } else { scenario };
        let mut scenario = with_faults(2 * SECOND, 0, run(50), |_| 600);
        scenario.silent();
        (0..3).for_each(|_| receive(&mut scenario, &hot(0b00001)));
        let mut scenario = again(scenario);
        (0..6).for_each(|_| receive(&mut scenario, &report(Ecu::Amt, 0, 0)));
        assert_eq!((scenario.order(), scenario.bench.machine.failed()), (Order::Standby, true), "{resets}");

        let mut scenario = with_faults(2 * SECOND, 0, run(50), |_| 600);
        scenario.silent();
        (0..2).for_each(|_| receive(&mut scenario, &hot(0b00001)));
        let mut scenario = after(&scenario, Reset::Warm);
        (0..5).for_each(|_| receive(&mut scenario, &hot(0b01000)));
        let mut scenario = again(scenario);
        runs(&mut scenario);
        for _ in 0..10 {
            let _ = scenario.command(run(50));
            receive_faults(&mut scenario, 600);
        }
        assert!(runs(&mut scenario) > 0, "{resets}");

        let mut scenario = Scenario::nothing_received(Ecu::Amt, Ecu::Amt.config());
        for _ in 0..40 {
            let _ = scenario.command(run(10));
            receive(&mut scenario, &hot(0b01000));
        }
        let mut scenario = again(scenario);
        for _ in 0..20 {
            let _ = scenario.command(run(10));
            receive_faults(&mut scenario, 600);
        }
        assert!(runs(&mut scenario) > 0, "{resets}");
    }
}

/// One odd switch among those of an ECU that shuts its engine down finds no running engine, nor do its error sets with a hot exhaust. The control: one
/// odd switch among those at run costs a set.
#[test]
fn one_odd_switch_neither_finds_nor_loses_an_engine() {
    for (first, others, found) in [
        (amt_frames::RUN, amt_frames::AUTO_STOP, false),
        (amt_frames::EMERGENCY, amt_frames::AUTO_STOP, false),
        (amt_frames::AUTO_STOP, amt_frames::RUN, true),
    ] {
        let mut scenario = Scenario::nothing_received(Ecu::Amt, Ecu::Amt.config());
        for i in 0..20 {
            receive(&mut scenario, &amt_frames::normal(0b01100, if i == 0 { first } else { others }, 60));
        }
        assert_eq!(runs(&mut scenario) >= 16, found, "{first} {others}");
        assert!(found || runs(&mut scenario) == 0, "{first} {others}");
    }
    for (switch, answered) in [(amt_frames::AUTO_STOP, false), (amt_frames::RUN, true)] {
        let mut scenario = after_power_loss();
        scenario.silent();
        for _ in 0..10 {
            let mut frame = amt_frames::normal(0b01100, switch, 60);
            frame[3] = 141;
            receive(&mut scenario, &frame);
        }
        runs(&mut scenario);
        (0..3).for_each(|_| receive_faults(&mut scenario, 600));
        assert_eq!(runs(&mut scenario) > 0, answered, "error sets after switch {switch}");
    }
}
