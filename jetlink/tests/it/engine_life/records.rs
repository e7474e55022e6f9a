//! The retained record, field by field: its contents in each situation, and after a second reset.

use super::*;
use crate::support::scenario::rpm;
use jetlink::ecu::{Service, zk};

fn record(scenario: &Scenario) -> RetainedState {
    scenario.bench.machine.record()
}

/// That an engine failed is retained, for the others of its group, until it runs again.
#[test]
fn a_failure_is_retained() {
    for ecu in BOTH {
        let mut scenario = flying(ecu);
        assert!(!record(&scenario).failed, "{ecu:?}");
        scenario.silent().fly_us(run(50), Origin::Rc, 2 * SECOND);
        assert!(record(&scenario).failed, "{ecu:?}");
        let mut scenario = scenario.reset(ecu.config());
        assert!(scenario.bench.machine.failed(), "{ecu:?}");
        scenario.reports(Reports::Running).fly_us(run(50), Origin::Rc, SECOND);
        assert!(!record(&scenario).failed, "{ecu:?}");
    }
}

/// A pump that a service may have opened is retained until its last frame to close it.
#[test]
fn an_open_pump_is_retained_until_it_is_closed() {
    let mut scenario = Scenario::ready(Ecu::Zk, Ecu::Zk.config());
    assert!(!record(&scenario).pump_open);
    scenario
        .command(Command::Service(Service::Zk(zk::config::Service::Action(zk::codec::Action::OpenPump))))
        .unwrap();
    scenario.pass_us(4 * FRAME_PERIOD_US);
    assert!(record(&scenario).pump_open, "open");
    scenario.command(Command::EmergencyStop).unwrap();
    assert!(record(&scenario).pump_open, "the frames that close it have not been sent");
    scenario.pass_us(5 * SECOND);
    assert!(!record(&scenario).pump_open, "closed");
}

/// ZK-9: that the switch was given by ID 6 is retained. After a reset with nothing received, standby also goes there; an ECU that was never
/// sent an ID 6 gets it by ID 1 alone.
#[test]
fn how_the_switch_was_given_is_retained() {
    for (demand, by_id6) in [(rpm(100_000), true), (percent(50), false)] {
        let scenario = Scenario::started(Ecu::Zk, demand);
        let mut scenario = Scenario::after_reset(Ecu::Zk, Ecu::Zk.config(), Some(record(&scenario)));
        scenario.silent().fly_us(Command::Standby, Origin::Rc, SECOND);
        assert_eq!(scenario.order(), Order::Standby, "{demand:?}");
        let frames = scenario.bench.bytes();
        let sent = |id: u8| frames.iter().any(|frame| frame[1] >> 4 == id);
        assert_eq!((sent(1), sent(6)), (true, by_id6), "{demand:?}: {frames:x?}");
    }
}

/// The demand in force is retained, even if it was lowered or is not reached yet.
#[test]
fn the_demand_that_is_retained_is_the_one_in_force() {
    let table: [(&str, Step, Order); 3] = [
        ("as commanded", |_| {}, Order::Run(percent(50))),
        (
            "a movement of the stick, before it is sent",
            |s| {
                s.command(run(90)).unwrap();
            },
            Order::Run(percent(50)),
        ),
        (
            "lowered by the loss of its source",
            |s| {
                s.pass_us(30 * SECOND);
            },
            Order::Run(percent(0)),
        ),
    ];
    for ecu in BOTH {
        // It has come to 50 %, and no frame has carried that yet.
        let rising = Scenario::risen(ecu, ecu.config(), percent(50));
        let Order::Run(Demand::Throttle(retained)) = record(&rising).order else { panic!("{ecu:?}") };
        assert!((300..500).contains(&retained.tenths()), "{ecu:?}: {retained:?}");
        for (name, step, order) in table {
            let mut scenario = flying(ecu);
            scenario.reports = Some(Reports::Running);
            scenario.fly_us(run(50), Origin::Rc, 2 * SECOND);
            step(&mut scenario);
            assert_eq!(record(&scenario).order, order, "{ecu:?}: {name}");
        }
    }
    // An rpm is retained as an rpm where the ECU holds it.
    let mut scenario = Scenario::started(Ecu::Zk, rpm(90_000));
    scenario.reports = Some(Reports::Running);
    scenario.fly_us(Command::Run(rpm(90_000)), Origin::Rc, 5 * SECOND);
    assert_eq!(record(&scenario).order, Order::Run(rpm(90_000)));
    assert_eq!(record(&scenario).origin, Origin::Rc);
}

/// Where no order is in force, silence and an interrupted start continue over a second reset.
#[test]
fn counts_without_an_order_continue_over_a_second_reset() {
    for ecu in BOTH {
        let config = ecu.config();
        let mut scenario = flying(ecu);
        scenario.reports = Some(Reports::Running);
        scenario.pass_us(2 * SECOND);
        let silence = |record: &RetainedState| (record.silent.as_millis(), record.all_silent.as_millis());
        let mut last = record(&scenario).without_start();
        for reset in 1..=3 {
            let before = silence(&last);
            let mut after = Scenario::after_reset(ecu, config, Some(last));
            after.silent().pass_us(SECOND);
            // Any input makes it read the time.
            after.bench.act(|engine, now| engine.other_failed(now, true));
            last = record(&after);
            let now = silence(&last);
            assert!(last.ran, "{ecu:?} {reset}");
            assert!((900..=1200).contains(&(now.0 - before.0)), "{ecu:?} {reset}: {before:?} {now:?}");
            assert!((900..=1200).contains(&(now.1 - before.1)), "{ecu:?} {reset}: {before:?} {now:?}");
        }
    }
    // A start of 3 s that was interrupted twice, 1 s later each time.
    let mut scenario = Scenario::ready(Ecu::Amt, Ecu::Amt.config());
    scenario.command(run(0)).unwrap();
    scenario.reports = Some(Reports::Starting);
    scenario.fly_us(run(0), Origin::Rc, 3 * SECOND);
    let mut last = record(&scenario);
    assert!((3..=4).contains(&last.starting), "{last:?}");
    for reset in 1..=2 {
        let mut after = Scenario::after_reset(Ecu::Amt, Ecu::Amt.config(), Some(last));
        after.silent().pass_us(SECOND);
        after.bench.act(|engine, now| engine.other_failed(now, true));
        last = record(&after);
        assert!((3 + reset..=4 + 2 * reset).contains(&last.starting), "{reset}: {last:?}");
        assert!(matches!(last.order, Order::Run(_)), "{reset}: {last:?}");
    }
}

/// Where nothing is received and nothing is due, the silences are retained as they pass: a reset must not forget what went by since
/// the last event.
#[test]
fn silences_are_retained_while_nothing_happens() {
    for ecu in BOTH {
        let mut config = ecu.with(|rules| rules.loss.hold = Duration::from_secs(60));
        if let EcuConfig::Amt(amt) = &mut config.ecu {
            amt.serial_delay = Duration::from_secs(60);
        }
        let mut scenario = Scenario::started_with(ecu, config, percent(50));
        scenario.fly_us(run(50), Origin::Rc, SECOND).silent().pass_us(20 * SECOND);
        let now = record(&scenario);
        assert!(matches!(now.order, Order::Run(_)), "{ecu:?} {now:?}");
        for silent in [now.silent, now.all_silent] {
            assert!((19_600..=20_200).contains(&silent.as_millis()), "{ecu:?} {now:?}");
        }
        let unconfirmed = if ecu == Ecu::Amt { 19_600..=20_200 } else { 0..=0 };
        assert!(unconfirmed.contains(&now.unconfirmed.as_millis()), "{ecu:?} {now:?}");
    }
}

/// An order that is given up with its source silent: the silence since its last command is retained, although the node has received
/// it since it began.
#[test]
fn the_silence_after_an_order_that_was_given_up_is_retained() {
    for (commands, silence) in [(false, 5800..=6400), (true, 0..=500)] {
        let mut scenario = flying(Ecu::Amt);
        scenario.silent();
        if commands {
            scenario.fly_us(run(50), Origin::Rc, 6 * SECOND);
        } else {
            scenario.pass_us(6 * SECOND);
        }
        // Any input makes it read the time.
        scenario.bench.act(|engine, now| engine.other_failed(now, true));
        let now = record(&scenario);
        assert_eq!(now.order, Order::Listen);
        for silent in [now.silent, now.all_silent] {
            assert!(silence.contains(&silent.as_millis()), "{commands}: {now:?}");
        }
    }
}

/// Where no order is in force, a source that is received ends the counts of silence and of resets.
#[test]
fn counts_without_an_order_end_when_a_source_is_received() {
    for ecu in BOTH {
        let silence = Duration::from_secs(5);
        let last = record(&flying(ecu)).without_start().with(|state| {
            state.resets = 2;
            state.silent = silence;
            state.all_silent = silence;
        });
        for received in [false, true] {
            let mut after = Scenario::after_reset(ecu, ecu.config(), Some(last));
            after.silent().pass_us(SECOND);
            if received {
                let _ = after.command(run(50));
            }
            // Any input makes it read the time.
            after.bench.act(|engine, now| engine.other_failed(now, true));
            let now = record(&after);
            assert_eq!(now.resets, if received { 0 } else { 3 }, "{ecu:?}");
            assert_eq!(now.silent > silence, !received, "{ecu:?}: {now:?}");
            assert_eq!(now.all_silent > silence, !received, "{ecu:?}: {now:?}");
        }
    }
}

/// Arming as commanded by each source is also retained over a loss of power: one that commanded "arm" all along has to disarm first after a
/// stop, whether the stop came before the loss or after it.
#[test]
fn a_source_that_was_armed_has_to_disarm_first_after_a_loss_of_power() {
    for ecu in BOTH {
        for stop_before in [true, false] {
            let mut scenario = flying(ecu);
            if stop_before {
                scenario.command(Command::EmergencyStop).unwrap();
            }
            let record = record(&scenario).without_start();
            let mut scenario = Scenario::after_reset(ecu, ecu.config(), Some(record));
            scenario.introduce();
            scenario.reports(Reports::Standby).pass_us(2 * SECOND);
            if !stop_before {
                scenario.command(Command::EmergencyStop).unwrap();
            }
            scenario.command(Command::ReleaseStop).unwrap();
            assert_eq!(scenario.command(Command::Arm), Err(Rejected::DisarmFirst), "{ecu:?} {stop_before}");
            scenario.command(Command::Disarm).unwrap();
            scenario.command(Command::Arm).unwrap();
        }
    }
}

/// Until the node begins, its record is the restored one, whatever is commanded: a reset in between must find the run.
#[test]
fn a_command_before_the_node_begins_leaves_the_record_as_it_was_restored() {
    for ecu in BOTH {
        let restored = record(&flying(ecu));
        assert!(matches!(restored.order, Order::Run(_)) && restored.ran, "{ecu:?}");
        let mut engine = Engine::new(&ecu.config());
        engine.restore(Some(restored));
        engine.command(at_us(0), run(50), Origin::Bench, true).unwrap_err();
        let now = engine.record();
        assert_eq!((now.order, now.origin, now.ran), (restored.order, restored.origin, true), "{ecu:?}");
        let after = Scenario::after_reset(ecu, ecu.config(), Some(now));
        assert!(matches!(after.order(), Order::Doubt(_)), "{ecu:?}: {}", after.order());
    }
}

/// A lower source that is received between two resets does not end their count: the demand is another's.
#[test]
fn resets_are_counted_while_only_a_lower_source_is_received() {
    for ecu in BOTH {
        for (origin, counted) in [(Origin::Bench, true), (Origin::Rc, false)] {
            let mut scenario = flying(ecu);
            for reset in 1..=2 {
                scenario = scenario.reset(ecu.config());
                scenario.reports = Some(Reports::Running);
                scenario.fly_us(run(50), origin, 2 * FRAME_PERIOD_US);
                assert_eq!(record(&scenario).resets, if counted { reset } else { 0 }, "{ecu:?} {origin:?}");
            }
        }
    }
}

/// What the search for an engine knows of it continues over a second reset: that its order was given up, that error sets came, and that
/// its exhaust is expected to fall yet.
#[test]
fn what_a_search_knows_continues_over_a_second_reset() {
    type Change = fn(&mut RetainedState);
    let changes: [(&str, Change); 4] = [
        ("nothing", |_| {}),
        ("given up", |state| state.exhaust_ignored = true),
        ("after faults", |state| state.after_faults = true),
        ("a fall", |state| state.fall_expected = Duration::from_secs(5)),
    ];
    for (name, change) in changes {
        let mut last = record(&flying(Ecu::Amt)).without_start().with(change);
        assert_eq!(last.order, Order::Listen, "{name}");
        for reset in 1..=2 {
            let mut scenario = Scenario::after_reset(Ecu::Amt, Ecu::Amt.config(), Some(last));
            scenario.silent().pass_us(SECOND);
            last = record(&scenario);
            assert_eq!(last.exhaust_ignored, name == "given up", "{name} {reset}");
            assert_eq!(last.after_faults, name == "after faults", "{name} {reset}");
            let fall = last.fall_expected.as_millis();
            let left = 5000 - 1000 * reset;
            let expected = if name == "a fall" { left - 500 * reset..=left } else { 0..=0 };
            assert!(expected.contains(&fall), "{name} {reset}: {fall}");
        }
    }
}
