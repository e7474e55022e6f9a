//! AMT with error sets only: the exhaust is the evidence.

use super::*;

/// Fate of the run.
#[derive(Clone, Copy, PartialEq, Debug)]
enum Run {
    /// It is answered with the demand.
    GoesOn,
    /// The life has ended.
    Over,
}

#[test]
fn amt_8_an_exhaust_without_combustion_ends_a_life() {
    use Run::{GoesOn, Over};
    let table: [(&str, u64, u8, Egt, Run); 12] = [
        ("burns", 30 * SECOND, 1, |_| 500, GoesOn),
        ("just above the limit", 30 * SECOND, 1, |_| 310, GoesOn),
        ("just below it", 200_000, 1, |_| 295, Over),
        ("cold", 200_000, 1, |_| 26, Over),
        ("falls by 20 °C a second, 2.5 s", 2_500_000, 1, |t| 700 - (t / 50_000) as i32, GoesOn),
        ("falls by 20 °C a second, 5 s", 5 * SECOND, 1, |t| 700 - (t / 50_000) as i32, Over),
        ("falls by 10 °C a second", 15 * SECOND, 1, |t| 700 - (t / 100_000) as i32, GoesOn),
        ("sensor faulty, cold", 30 * SECOND, 1 << 3, |_| 26, GoesOn),
        ("sensor open", 30 * SECOND, 1, |t| if t > 0 { -50 } else { 500 }, GoesOn),
        ("sensor shorted", 30 * SECOND, 1, |t| if t > 0 { 1_110 } else { 500 }, GoesOn),
        ("step down", 30 * SECOND, 1, |t| if t > SECOND { 26 } else { 500 }, GoesOn),
        ("one odd set", 30 * SECOND, 1, |t| if t / FRAME_PERIOD_US == 20 { 26 } else { 500 }, GoesOn),
    ];
    for (name, time, fault, egt, becomes) in table {
        let mut scenario = with_faults(time, fault, run(50), egt);
        let (order, wire) = match becomes {
            GoesOn => (Order::Doubt(percent(50)), Wire::Run(500)),
            Over => (Order::Standby, Wire::Standby),
        };
        assert_eq!(scenario.order(), order, "{name}");
        scenario.command(run(50)).ok();
        assert_eq!(scenario.wire(), wire, "{name}");
        let end = if becomes == Over { vec![End::NotBurning] } else { vec![] };
        assert_eq!(ends(&mut scenario), end, "{name}");
    }
}

/// Two consecutive reports end a life: one odd set at a time between error sets does not, while the exhaust is hot.
#[test]
fn amt_8_an_error_set_of_a_burning_engine_contradicts_a_report_of_rest() {
    let order = |sets: &[bool]| {
        let mut scenario = with_faults(SECOND, 1, run(50), |_| 500);
        let fault = scenario.ecu.frame(Reports::Stopped, scenario.values);
        let rest = scenario.ecu.frame(Reports::Stopped, Values { fault: 0, ..scenario.values });
        scenario.silent();
        for &odd in sets {
            let _ = scenario.command(run(50));
            scenario.pass_us(FRAME_PERIOD_US);
            scenario.bench.receive(if odd { &rest } else { &fault });
        }
        scenario.order()
    };
    assert_eq!(order(&[true, false, true, false, true, false]), Order::Doubt(percent(50)));
    assert_eq!(order(&[false, true, true, false]), Order::Standby, "two consecutive ones");
}

/// The fall that a lower demand causes is also expected after a reset, for as long as it would have been without one. A loop of
/// resets does not prolong it.
#[test]
fn amt_8_a_fall_after_a_lower_demand_is_expected_over_a_reset() {
    let fall = |t: u64| 700 - (t / 50_000) as i32;
    for (demand, resets, end) in [
        (run(20), 0, Wire::Run(200)),
        (run(20), 1, Wire::Run(200)),
        (run(20), 12, Wire::Standby),
        // The control: the same fall at the same demand.
        (run(50), 1, Wire::Standby),
    ] {
        let mut scenario = with_faults(SECOND / 2, 1, demand, fall);
        let mut now = SECOND / 2;
        let mut fly = |scenario: &mut Scenario, until: u64| {
            while now < until {
                now += FRAME_PERIOD_US;
                scenario.values.egt_celsius = fall(now);
                let _ = scenario.command(demand);
                scenario.pass_us(FRAME_PERIOD_US);
            }
        };
        for reset in 1..=resets {
            scenario = scenario.reset(Ecu::Amt.config());
            fly(&mut scenario, SECOND / 2 + reset * 2 * FRAME_PERIOD_US);
        }
        fly(&mut scenario, 4_900_000);
        let sent = scenario.sent();
        assert_eq!(sent.last(), Some(&end), "{demand:?} {resets}");
        fly(&mut scenario, 10 * SECOND);
        assert_eq!(scenario.sent().last(), Some(&Wire::Standby), "{demand:?} {resets}, for longer");
    }
}

/// The demand falls by a slow slew when the node is reset, and continues from there: the engine is neither sent the end of the way at once, nor
/// shut down for the fall that follows from that (906000302). The control: the source commands what it did before.
#[test]
fn a_demand_that_falls_by_its_slew_does_not_jump_down_at_a_reset() {
    let config = |ecu: Ecu| ecu.with(|rules| (rules.slew.up, rules.slew.down) = (None, Some(60)));
    for (ecu, to, fault, sent) in [
        (Ecu::Amt, 0, 1, 700..800),
        (Ecu::Amt, 0, 0, 700..800),
        (Ecu::Zk, 0, 0, 700..800),
        (Ecu::Zk, 80, 0, 800..801),
    ] {
        let mut scenario = Scenario::started_with(ecu, config(ecu), percent(80));
        scenario.reports = Some(Reports::Running);
        scenario.values.egt_celsius = 700;
        scenario.fly_us(run(80), Origin::Rc, 3 * SECOND);
        scenario.values.fault = fault;
        scenario.fly_us(run(80), Origin::Rc, SECOND);
        // Less than the noise of a stick.
        scenario.fly_us(run(to), Origin::Rc, SECOND / 4);
        scenario = scenario.reset(config(ecu));
        scenario.fly_us(run(to), Origin::Rc, SECOND);
        let run_in = |wire: Wire| if let Wire::Run(tenths) = wire { Some(tenths) } else { None };
        let first: Vec<u16> = scenario.sent().into_iter().filter_map(run_in).collect();
        assert!(
            !first.is_empty() && first.iter().all(|tenths| sent.contains(tenths)),
            "{ecu:?} {fault}: {first:?}"
        );
        let begin = scenario.now_us();
        while scenario.now_us() < begin + 4 * SECOND {
            scenario.values.egt_celsius = 700 - ((scenario.now_us() - begin) / 50_000) as i32;
            scenario.fly_us(run(to), Origin::Rc, FRAME_PERIOD_US);
        }
        assert_eq!(ends(&mut scenario), [], "{ecu:?} {fault}");
    }
}

/// A loop of resets ends an unconfirmed run after the serial delay, as one long silence does: by then the ECU has stopped its engine,
/// and could start it when the fault clears. So does a gap before a reset: the ECU may have restarted in it.
#[test]
fn amt_8_a_reset_ends_neither_the_serial_delay_nor_a_gap() {
    const EGT_FAULT: u8 = 1 << 3;
    const BEGIN_US: u64 = 45_000;
    /// At 8 sets a second, the rate that the node expects until it has measured another.
    const AMT_PERIOD_US: u64 = 125_000;
    // As the engine counts it: a reset takes 20 ms at least.
    const SERIAL_DELAY_RESETS: u64 = 4 * SECOND / 20_000;
    let table = [
        ("no silence", 0, 0, Some(Wire::Run(500))),
        ("a loop, shorter than the serial delay", 0, SERIAL_DELAY_RESETS / 5, Some(Wire::Run(500))),
        ("a loop that is longer", 0, SERIAL_DELAY_RESETS + 10, None),
        ("one missing frame, then a reset", 2 * AMT_PERIOD_US, 1, Some(Wire::Run(500))),
        ("four, then a reset", 5 * AMT_PERIOD_US, 1, None),
        ("four, then two resets", 5 * AMT_PERIOD_US, 2, None),
    ];
    for (name, silence, resets, sent) in table {
        let config = Ecu::Amt.config();
        let EcuConfig::Amt(amt) = config.ecu else { panic!("AMT") };
        assert_eq!(amt.serial_delay, micros(4 * SECOND));
        let mut scenario = with_faults(2 * SECOND, EGT_FAULT, run(50), |_| 500);
        let source = Origin::Rc;
        scenario.silent().fly_us(run(50), source, silence);
        for _ in 0..resets {
            scenario = scenario.reset(config);
            scenario.silent().fly_us(run(50), source, BEGIN_US);
        }
        scenario.reports = Some(Reports::Running);
        scenario.sent();
        scenario.fly_us(run(50), source, 10 * FRAME_PERIOD_US);
        let wires = scenario.sent();
        assert_eq!(wires.last().copied(), sent, "{name}: {wires:?}");
    }
}

/// Nothing is received, neither of the ECU nor of a source, and the node is reset each 0.9 s: the serial delay time passes all the same, and
/// the first set after it is not answered.
#[test]
fn amt_12_a_silence_without_any_input_continues_over_resets() {
    // The serial delay time is 4 s.
    for (resets, answered) in [(3, true), (5, false)] {
        let config = Ecu::Amt.config();
        let mut scenario = flying(Ecu::Amt);
        scenario.silent();
        for _ in 0..resets {
            scenario.pass_us(900_000);
            scenario = scenario.reset(config);
            scenario.silent();
        }
        scenario.reports = Some(Reports::Running);
        scenario.sent();
        scenario.pass_us(FRAME_PERIOD_US + FRAME_PERIOD_US / 2);
        assert_eq!(!scenario.sent().is_empty(), answered, "{resets} resets");
        // Two that agree are.
        scenario.pass_us(3 * FRAME_PERIOD_US);
        assert!(matches!(scenario.sent()[..], [.., Wire::Run(_)]), "{resets} resets");
    }
}

/// A fall within 5 s after a lower demand is what was commanded; after that it is not.
#[test]
fn amt_8_a_fall_after_a_lower_demand_is_not_a_flame_out() {
    let fall = |t: u64| 700 - (t / 50_000) as i32;
    for (demand, time, over) in [
        (run(20), 4_900_000, false),
        (run(20), 9 * SECOND, true),
        // The control: the same fall at the same demand.
        (run(50), 4_900_000, true),
    ] {
        let mut scenario = with_faults(time, 1, demand, fall);
        let expected = if over { vec![End::NotBurning] } else { vec![] };
        assert_eq!(ends(&mut scenario), expected, "{demand:?} {time}");
    }
}

/// A stick that goes down step by step excuses a cold exhaust for 15 s at most; one step excuses a fall for 5 s.
#[test]
fn amt_8_lower_demands_do_not_excuse_a_cold_exhaust_for_ever() {
    // It is below what burns from 2 s on.
    for (every, ends_by) in [(4 * SECOND, 17 * SECOND), (60 * SECOND, 5 * SECOND)] {
        let mut scenario = with_faults(2 * SECOND, 1, run(50), |_| 500);
        let begin = scenario.now_us();
        let mut fly_to = |end: u64| {
            while scenario.now_us() < begin + end {
                let now = scenario.now_us() - begin;
                // At the rate at which an exhaust cools.
                scenario.values.egt_celsius = 500 - (now / 10_000).min(400) as i32;
                let _ = scenario.command(run(47 - (now / every) as u8 * 3));
                scenario.pass_us(FRAME_PERIOD_US);
            }
            ends(&mut scenario)
        };
        assert_eq!(fly_to(ends_by - SECOND / 4), [], "every {every} µs");
        assert_eq!(fly_to(ends_by + SECOND / 4), [End::NotBurning], "every {every} µs");
    }
}

/// Only an exhaust below `burning_egt` uses up these 15 s: neither an ECU that reports a running engine, nor error sets with a hot
/// exhaust. The fall after a long way down with a slow slew is the one that was commanded, and no healthy engine is shut down for it
/// (814001857). The control: the same fall 6 s after that way.
#[test]
fn amt_8_a_hot_exhaust_uses_up_nothing_of_what_excuses_a_fall() {
    for (fault, later, over) in [(0, 0, false), (1, 0, false), (1, 6 * SECOND, true)] {
        let mut scenario = with_faults(2 * SECOND, fault, run(50), |_| 700);
        let mut demand = 50;
        for step in 0..24 * SECOND / FRAME_PERIOD_US {
            // 3 % less every 2 s.
            demand -= if step % 40 == 39 { 3 } else { 0 };
            let _ = scenario.command(run(demand));
            scenario.pass_us(FRAME_PERIOD_US);
        }
        assert_eq!(ends(&mut scenario), [], "{fault}: hot all the time");
        scenario.values.fault = 1;
        scenario.fly_us(run(demand), Origin::Rc, later);
        let begin = scenario.now_us();
        while scenario.now_us() < begin + 4_500_000 {
            scenario.values.egt_celsius = 700 - ((scenario.now_us() - begin) / 50_000) as i32;
            let _ = scenario.command(run(if later == 0 { 0 } else { demand }));
            scenario.pass_us(FRAME_PERIOD_US);
        }
        let expected = if over { vec![End::NotBurning] } else { vec![] };
        assert_eq!(ends(&mut scenario), expected, "{fault}, {later} µs later");
    }
}

/// Where the exhaust is not known the order continues under the stages of loss, and ends in standby when they have run out, to
/// the tick. Where it burns it continues at the fail-safe throttle.
#[test]
fn amt_8_without_a_source_only_a_burning_engine_continues_to_run() {
    // The hottest that an AMT ECU can report is about 1120 °C: a thermocouple that is broken.
    let table: [(u8, Egt, bool); 3] = [(1, |_| 500, true), (1 << 3, |_| 500, false), (1, |_| 1_110, false)];
    for (fault, egt, burns) in table {
        let mut scenario = with_faults(2 * SECOND, fault, run(50), egt);
        scenario.command(run(50)).unwrap();
        let last = scenario.now_us();
        scenario.run_to_us(last + SOURCE_TIMEOUT_US + HOLD_US + RUN_OUT_US - 1);
        assert_eq!(scenario.order(), Order::Doubt(percent(0)), "{fault}");
        scenario.pass_us(1);
        let expected = if burns { Order::Doubt(percent(0)) } else { Order::Standby };
        assert_eq!(scenario.order(), expected, "{fault}");
    }
}

/// One odd error set is no fault, also after an earlier one: a cold exhaust ends no life then.
#[test]
fn amt_8_one_odd_error_set_ends_no_life() {
    for odd in [1, 2] {
        let mut scenario = with_faults(2 * SECOND, 1, run(50), |_| 500);
        scenario.values.fault = 0;
        // The fault clears, and the exhaust is below what burns: an engine at low power.
        for i in 1..=100 {
            scenario.values.egt_celsius = 500 - 21 * i / 10;
            scenario.command(run(50)).unwrap();
            scenario.pass_us(FRAME_PERIOD_US);
        }
        scenario.fly_us(run(50), Origin::Rc, 2 * SECOND);
        assert_eq!(scenario.order(), Order::Run(percent(50)));
        scenario.values.fault = 1;
        for _ in 0..odd {
            scenario.command(run(50)).unwrap();
            scenario.pass_us(FRAME_PERIOD_US);
        }
        assert_eq!(scenario.order() == Order::Standby, odd == 2, "{odd}");
    }
}

/// When the fault clears, the reply to the first normal sets is run only where they report running, with a shaft that turns.
#[test]
fn amt_8_after_a_fault_run_is_sent_to_a_running_engine_only() {
    for (state, rpm, answered) in [
        (0b01100, TURNING, true),
        (0b00100, TURNING, false),
        (0b01000, TURNING, false),
        (0b11111, TURNING, false),
        (0b01100, SLOW, false),
        (0b00000, TURNING, false),
        (0b00001, 0, false),
        (0b00001, TURNING, false),
        (0b00010, SLOW, false),
        (0b00010, TURNING, false),
    ] {
        // Its sensor is broken, so that the exhaust reports nothing.
        let mut scenario = with_faults(2 * SECOND, 1 << 3, run(50), |_| 500);
        scenario.silent().pass_us(FRAME_PERIOD_US);
        scenario.command(run(50)).unwrap();
        scenario.sent();
        scenario.bench.receive(&report(Ecu::Amt, state, rpm));
        let expected = if answered { vec![Wire::Run(500)] } else { vec![] };
        assert_eq!(scenario.sent(), expected, "{state:#07b} {rpm}");
    }
}

/// No running engine is reported as cleared for a start. What has no state is not answered with run after two such reports, until
/// another state is reported: the shaft coasts, the exhaust is still hot, and an ECU may start its engine when the fault clears.
#[test]
fn amt_8_error_sets_after_two_reports_of_start_clearance_are_not_answered() {
    const FAULT: u8 = 0xFF;
    const DAMAGED: u8 = 0xFE;
    let clearance = amt_frames::CLEARANCE;
    let full = amt_frames::FULL_OPERATION;
    for (name, sets, answered) in [
        ("two", &[clearance, clearance, FAULT][..], false),
        ("two, for longer", &[clearance, clearance, FAULT, FAULT, FAULT, FAULT], false),
        ("two, then a damaged set", &[clearance, clearance, DAMAGED], false),
        ("two apart", &[clearance, DAMAGED, clearance, FAULT], false),
        ("one odd set", &[clearance, FAULT], true),
        ("one, then a damaged set", &[clearance, DAMAGED], true),
        ("one at a time", &[clearance, FAULT, clearance, FAULT], true),
        ("two, then running", &[clearance, clearance, full, FAULT], true),
        ("none", &[full, FAULT], true),
    ] {
        for before in [0, FRAME_PERIOD_US] {
            // After error sets, and without any before.
            let fault = u8::from(before > 0);
            let mut scenario = with_faults(SECOND + before, fault, run(50), |_| 500);
            let error_set = scenario.ecu.frame(Reports::Running, Values { fault: 1, ..scenario.values });
            scenario.silent();
            for &state in sets {
                let _ = scenario.command(run(50));
                scenario.pass_us(FRAME_PERIOD_US);
                scenario.sent();
                if state == DAMAGED {
                    scenario.bench.machine.line_error(LineError::Framing);
                }
                match state {
                    FAULT => scenario.bench.receive(&error_set),
                    DAMAGED => scenario.bench.receive(&report(Ecu::Amt, full, TURNING)),
                    state => scenario.bench.receive(&report(Ecu::Amt, state, TURNING)),
                }
            }
            assert_eq!(ends(&mut scenario), [], "{name}");
            let expected = if answered { vec![Wire::Run(500)] } else { vec![] };
            assert_eq!(scenario.sent(), expected, "{name}, {fault}");
        }
    }
}

/// Whose life is in doubt has reached running all the same: its demand shows, and the others of its group may start.
#[test]
fn an_engine_in_doubt_blocks_no_other_start() {
    for ecu in BOTH {
        let mut scenario = flying(ecu);
        assert!(matches!(scenario.telemetry().commanded, Some(Demand::Throttle(_))));
        scenario.silent().fly_us(run(50), Origin::Rc, 3 * SECOND);
        assert_eq!(scenario.telemetry().commanded, Some(percent(50)), "{ecu:?}");
        assert!(!scenario.bench.machine.blocks_other_starts(at_us(scenario.now_us() + 20 * SECOND)));
    }
}

/// Every end has its own text.
#[test]
fn each_end_of_a_run_has_its_name() {
    let ends = [
        End::PowerUp,
        End::AtRest,
        End::StartsAgain,
        End::GapInStart,
        End::NotBurning,
        End::FaultInStart,
        End::Unconfirmed,
    ];
    let names: std::collections::BTreeSet<_> = ends.map(End::name).into_iter().collect();
    assert_eq!(names.len(), ends.len());
    assert!(names.iter().all(|name| name.len() > 10));
}

/// A source whose rpm waits for the ECU's version is present: its run continues, and the stages of loss do not begin.
#[test]
fn a_source_whose_rpm_waits_for_the_version_is_not_lost() {
    let config = Ecu::Zk.config();
    let mut scenario = Scenario::started_with(Ecu::Zk, config, percent(50));
    // The line is cut for long enough that the version is forgotten, and comes back without it.
    scenario.silent().fly_us(run(50), Origin::Rc, 2 * SECOND);
    scenario.reports(Reports::Running).fly_us(run(50), Origin::Rc, SECOND);
    assert_eq!(scenario.order(), Order::Run(percent(50)));
    let waits = Rejected::NeedsVersion { needed: 4, known: None };
    assert_eq!(scenario.command(Command::Run(rpm(100_000))), Err(waits));
    scenario.bench.events();
    scenario.fly_us(Command::Run(rpm(100_000)), Origin::Rc, 5 * SECOND);
    assert_eq!(scenario.order(), Order::Run(percent(50)), "its throttle stays");
    assert_eq!(stages(&mut scenario), []);
}

/// "The exhaust is the evidence, taken without the EGT error bit ... not known: the order continues under the stages of loss, and
/// when they have run out it is standby." A watchdog reset of the node does not change that; a gap in the ECU's frames does, because
/// the ECU may have restarted.
#[test]
fn amt_8_after_a_reset_an_unreadable_exhaust_shuts_down_no_engine() {
    const EGT_FAULT: u8 = 1 << 3;
    let table: [(&str, u8, Egt, Option<u16>); 5] = [
        ("the ECU calls its sensor faulty", EGT_FAULT, |_| 500, Some(500)),
        ("with another fault", EGT_FAULT | 1, |_| 500, Some(500)),
        ("the sensor is open", 1, |_| -50, Some(500)),
        ("it burns", 1, |_| 500, Some(500)),
        ("it does not", 1, |_| 26, None),
    ];
    for (name, fault, egt, continues) in table {
        let mut scenario = with_faults(2 * SECOND, EGT_FAULT, run(50), |_| 500);
        (scenario.values.fault, scenario.values.egt_celsius) = (fault, egt(0));
        let config = Ecu::Amt.config();
        let mut after = scenario.reset(config);
        after.fly_us(run(50), Origin::Rc, 10 * SECOND);
        let sent = after.sent();
        let expected = continues.map_or(Wire::Standby, Wire::Run);
        assert!(sent.len() > 100 && sent.iter().all(|wire| *wire == expected), "{name}: {:?}", sent.last());
        // When all sources are silent, it ends: only a report of running confirms the life after a reset.
        after.pass_us(SOURCE_TIMEOUT_US + HOLD_US + RUN_OUT_US + SECOND);
        assert_eq!(after.wire(), Wire::Standby, "{name}");
        // The control: a gap, after which the ECU may be another one.
        if fault & EGT_FAULT != 0 {
            scenario.silent().fly_us(run(50), Origin::Rc, SECOND);
            scenario.reports = Some(Reports::Running);
            scenario.sent();
            scenario.fly_us(run(50), Origin::Rc, SECOND);
            assert_eq!(scenario.sent(), [], "{name}, after a gap");
        }
    }
}

/// Two error sets put a running engine in doubt, and one does not. A burning exhaust confirms the engine meanwhile, so that the
/// doubt begins with the first state after them; what else it was raised by keeps its begin.
#[test]
fn amt_8_the_doubt_of_error_sets_begins_when_the_exhaust_no_longer_confirms_the_engine() {
    const EGT_FAULT: u8 = 1 << 3;
    for (name, fault, gap_first, from_the_state) in [
        ("it burns", 1, false, true),
        ("its sensor is faulty", EGT_FAULT, false, false),
        ("after a gap", 1, true, false),
    ] {
        let mut scenario = with_faults(0, 0, run(50), |_| 500);
        assert_eq!(scenario.telemetry().in_doubt, None);
        let mut raised = None;
        if gap_first {
            scenario.silent().fly_us(run(50), Origin::Rc, gap(Ecu::Amt) + 2 * FRAME_PERIOD_US);
            raised = scenario.telemetry().in_doubt;
            assert!(raised.is_some());
        }
        scenario.values.fault = fault;
        let faulted = Ecu::Amt.frame(Reports::Running, scenario.values);
        receive(&mut scenario, &faulted);
        assert_eq!(scenario.telemetry().in_doubt, raised, "{name}: one set");
        receive(&mut scenario, &faulted);
        scenario.reports = Some(Reports::Running);
        let raised = scenario.telemetry().in_doubt;
        assert!(raised.is_some(), "{name}: two sets");
        scenario.fly_us(run(50), Origin::Rc, 2 * SECOND);
        assert_eq!(scenario.telemetry().in_doubt, raised, "{name}");
        scenario.values.fault = 0;
        let unnamed = Ecu::Amt.frame(Reports::Unknown, scenario.values);
        receive(&mut scenario, &unnamed);
        let expected = if from_the_state { Some(at_us(scenario.now_us())) } else { raised };
        assert_eq!(scenario.telemetry().in_doubt, expected, "{name}");
    }
}

/// The temperature of combustion is a setting, which takes effect with the next sets.
#[test]
fn amt_8_the_temperature_of_combustion_can_be_set_in_flight() {
    for (limit, order) in [(300, Order::Doubt(percent(50))), (400, Order::Standby)] {
        let mut scenario = with_faults(2 * SECOND, 1, run(50), |_| 350);
        assert_eq!(scenario.order(), Order::Doubt(percent(50)));
        let config = Ecu::Amt.with(|supervision| supervision.burning_egt = Celsius::from_tenths(limit * 10));
        let now = at_us(scenario.now_us());
        scenario.bench.act(|engine, _| engine.configure(now, &config.supervision)).unwrap();
        scenario.fly_us(run(50), Origin::Rc, 4 * FRAME_PERIOD_US);
        assert_eq!(scenario.order(), order, "{limit} °C");
    }
}

/// AMT-8: after a gap two error sets with a hot exhaust show that the engine burns, and the second one is answered. One is not
/// enough: what burned before the gap may have gone out. A cold exhaust is not answered.
#[test]
fn amt_8_after_a_gap_the_second_hot_error_set_is_answered() {
    for fault_before in [false, true] {
        for (egt, answered) in [(480, true), (100, false)] {
            let mut scenario = with_faults(2 * SECOND, u8::from(fault_before), run(50), |_| 480);
            scenario.values.half_percents = 100;
            scenario.fly_us(run(50), Origin::Rc, SECOND);
            scenario.silent().fly_us(run(50), Origin::Rc, SECOND);
            scenario.sent();
            scenario.values.fault = 1 << 1 | 1 << 2;
            scenario.values.egt_celsius = egt;
            let frame = Ecu::Amt.frame(Reports::Running, scenario.values);
            receive(&mut scenario, &frame);
            assert_eq!(scenario.sent(), [], "{fault_before} {egt}: the first one");
            receive(&mut scenario, &frame);
            let sent = scenario.sent();
            assert_eq!(sent.contains(&Wire::Run(500)), answered, "{fault_before} {egt}: {sent:?}");
        }
    }
}

/// After the order was given up, "started up", idle calibration and unnamed states are answered, but confirm nothing: the demand of its
/// source does not reach the engine before two sets report that it runs.
#[test]
fn amt_12_after_an_order_was_given_up_only_running_confirms() {
    for (state, runs) in [(0b00100, false), (0b01000, false), (0b11111, false), (0b01100, true)] {
        let mut scenario = flying(Ecu::Amt);
        scenario.silent().fly_us(run(50), Origin::Rc, 10 * SECOND);
        assert_eq!(scenario.order(), Order::Listen);
        for _ in 0..100 {
            let mut frame = report(Ecu::Amt, state, TURNING);
            frame[4] = 20;
            receive(&mut scenario, &frame);
            let _ = scenario.command(run(90));
        }
        let order = scenario.order();
        assert_eq!(matches!(order, Order::Run(_)), runs, "{state:#07b}: {order}");
        assert_eq!(scenario.telemetry().in_doubt.is_none(), runs, "{state:#07b}");
        let sent = scenario.sent();
        let highest = sent.iter().map(|wire| if let Wire::Run(tenths) = wire { *tenths } else { 0 }).max();
        assert_eq!(highest, Some(if runs { 900 } else { 100 }), "{state:#07b}");
    }
}

/// "A cold exhaust is excused for 5 s after a lower demand was sent": a demand that was rising, and falls back in a gap to the one that
/// was sent last, is no lower one.
#[test]
fn amt_8_a_demand_that_falls_back_in_a_gap_excuses_no_cold_exhaust() {
    for gap in [false, true] {
        let config = Ecu::Amt.with(|rules| rules.slew.up = Some(100));
        let mut scenario = Scenario::started_with(Ecu::Amt, config, percent(0));
        scenario.reports = Some(Reports::Running);
        let cool = |scenario: &mut Scenario, to: i32| {
            while scenario.values.egt_celsius > to {
                scenario.values.egt_celsius -= 5;
                scenario.fly_us(run(100), Origin::Rc, FRAME_PERIOD_US);
            }
        };
        scenario.values.egt_celsius = 400;
        scenario.fly_us(run(100), Origin::Rc, SECOND);
        cool(&mut scenario, 320);
        scenario.fly_us(run(100), Origin::Rc, SECOND / 2);
        if gap {
            scenario.silent().fly_us(run(100), Origin::Rc, 5 * FRAME_PERIOD_US + 400_000);
        }
        scenario.reports = Some(Reports::Running);
        // The flame is out, and the ECU does not know it yet.
        cool(&mut scenario, 280);
        scenario.values.fault = 1;
        scenario.sent();
        scenario.fly_us(run(100), Origin::Rc, 5 * FRAME_PERIOD_US);
        let sent = scenario.sent();
        assert_eq!(scenario.order(), Order::Standby, "gap {gap}: {sent:?}");
    }
}

/// An engine has failed when its ECU reports faults instead of a state, however hot its exhaust: nobody knows that it runs.
#[test]
fn amt_8_an_engine_has_failed_when_faults_replace_its_state() {
    for (fault, failed) in [(1, true), (0, false)] {
        let scenario = with_faults(10 * SECOND, fault, run(50), |_| 500);
        assert!(matches!(scenario.order(), Order::Run(_) | Order::Doubt(_)), "{fault}");
        assert_eq!(scenario.bench.machine.failed(), failed, "{fault}");
    }
}

/// While the ECU reports a running engine, a cold exhaust uses up nothing of the excuse of a lower demand, however long that goes down: error
/// sets find all of it. The control: the demand was lowered long before them.
#[test]
fn amt_8_a_cold_exhaust_beside_reports_of_running_uses_up_no_excuse() {
    for (held, flies) in [(0, true), (6 * SECOND, false)] {
        let mut scenario = Scenario::started(Ecu::Amt, percent(90));
        scenario.reports = Some(Reports::Running);
        // It warms up as an exhaust does.
        while scenario.values.egt_celsius < 400 {
            scenario.values.egt_celsius += 10;
            scenario.fly_us(run(90), Origin::Rc, FRAME_PERIOD_US);
        }
        for tenths_of_a_second in 0..200 {
            let lowered = run(90 - 4 * (tenths_of_a_second / 10));
            scenario.values.egt_celsius = 280.max(scenario.values.egt_celsius - 3);
            scenario.fly_us(lowered, Origin::Rc, SECOND / 10);
        }
        scenario.fly_us(run(14), Origin::Rc, held);
        scenario.values.fault = 1;
        scenario.fly_us(run(14), Origin::Rc, 2 * SECOND);
        assert_eq!(scenario.order() != Order::Standby, flies, "held for {held} us");
    }
}
