//! What a loss of power that the RAM survives may neither restart nor forget. A warm reset is the control.

use super::*;
use jetlink::channel::Channel;

/// A panic or a hang before the runner begins is a warm reset, which must not bring back what the loss of power has taken.
#[test]
fn what_a_loss_of_power_takes_stays_taken_over_a_reset_before_the_first_change() {
    let config = Ecu::Zk.config();
    for (reset, kept) in [(Reset::Warm, true), (Reset::PowerLost, false)] {
        for order in [Order::Run(percent(80)), Order::Standby] {
            let record = RetainedState::new(order, Origin::Rc).with(|state| state.armed = true);
            let memory: &'static RetainedMemory = Box::leak(Box::new(RetainedMemory::new()));
            memory.store(&record, config.fingerprint());
            drop(Channel::new(&config, Some((memory, reset))));
            let record = memory.load(config.fingerprint(), Reset::Warm).unwrap();
            assert_eq!(record.armed, kept, "{reset:?} {order}");
            assert_eq!(record.order == order, kept || order == Order::Standby, "{reset:?} {order}");
        }
    }
}

/// The pilot lowers the demand, and the exhaust falls as it has to: for as long as without the reset that is no flame-out.
#[test]
fn amt_8_a_fall_that_was_commanded_before_a_loss_of_power_costs_no_engine() {
    for reset in [Reset::Warm, Reset::PowerLost] {
        for (demand, half_percents, flies) in [(run(0), 0, true), (run(50), 100, false)] {
            let receive_at = |scenario: &mut Scenario, egt_celsius| {
                scenario.values = Values { fault: 1, half_percents, egt_celsius, rpm: None };
                let frame = scenario.ecu.frame(Reports::Running, scenario.values);
                receive(scenario, &frame);
            };
            let mut scenario = with_faults(2 * SECOND, 1, run(50), |_| 700);
            for i in 0..10 {
                let _ = scenario.command(demand);
                scenario.pass_us(FRAME_PERIOD_US);
                receive_at(&mut scenario, 700 - i);
            }
            let mut scenario = after(&scenario, reset);
            // Steady for 0.3 s, 25 °C/s for 3.6 s, and steady again.
            for millis in (0..8000).step_by(50) {
                let _ = scenario.command(demand);
                let egt = 690 - (millis - 300).clamp(0, 3600) / 40;
                receive_at(&mut scenario, egt);
            }
            assert_eq!(scenario.order() != Order::Standby, flies, "{reset:?} {demand:?}");
        }
    }
}

/// 7 s without a reply, with a reset in between: by then the ECU has stopped its engine. So it has in a loop of resets.
#[test]
fn amt_12_the_serial_delay_continues_over_a_loss_of_power() {
    for reset in [Reset::Warm, Reset::PowerLost] {
        for (before, answered) in [(3_500_000, false), (0, true)] {
            let mut scenario = flying(Ecu::Amt);
            scenario.silent().fly_us(run(50), Origin::Rc, before);
            let mut scenario = after(&scenario, reset);
            scenario.fly_us(run(50), Origin::Rc, 3_500_000);
            (0..5).for_each(|_| receive_faults(&mut scenario, 600));
            assert_eq!(runs(&mut scenario) > 0, answered, "{reset:?} {before} us before");
        }
    }
    let mut scenario = after(&flying(Ecu::Amt), Reset::PowerLost);
    for _ in 0..4 {
        scenario.silent().fly_us(run(50), Origin::Rc, 2 * SECOND);
        scenario = scenario.reset(Ecu::Amt.config());
    }
    (0..5).for_each(|_| receive_faults(&mut scenario, 600));
    assert_eq!(runs(&mut scenario), 0);
}

/// Of an engine that was found in a state that a start has, too, nobody knows that it flew, whatever resets come: its demand does not rise. The
/// control: two reports of running.
#[test]
fn amt_an_engine_found_in_a_state_of_a_start_does_not_rise_over_a_reset() {
    for reset in [None, Some(Reset::Warm), Some(Reset::PowerLost)] {
        let mut scenario = Scenario::nothing_received(Ecu::Amt, Ecu::Amt.config());
        for _ in 0..10 {
            let _ = scenario.command(run(80));
            receive(&mut scenario, &report(Ecu::Amt, 0b00100, TURNING));
        }
        if let Some(reset) = reset {
            scenario = after(&scenario, reset);
        }
        scenario.silent();
        assert_eq!(highest(&mut scenario, 0b00100, 0).unwrap_or(0), 0, "{reset:?}");
        assert_eq!(highest(&mut scenario, 0b01100, 0), Some(900), "{reset:?}");
    }
}

/// An order that was given up, then sets with a state that a start has, too: the loss of power must not make an engine of them that flew.
#[test]
fn amt_an_order_that_was_given_up_stays_so_over_a_loss_of_power_after_other_states() {
    for state in COMMON_STATES.into_iter().skip(1) {
        let given_up = || {
            let mut scenario = flying(Ecu::Amt);
            scenario.silent().fly_us(run(50), Origin::Rc, 10 * SECOND);
            assert_eq!(scenario.order(), Order::Listen);
            for _ in 0..5 {
                let _ = scenario.command(run(90));
                let mut frame = report(Ecu::Amt, state, TURNING);
                frame[4] = 20;
                receive(&mut scenario, &frame);
            }
            after(&scenario, Reset::PowerLost)
        };
        assert!(highest(&mut given_up(), state, 20) <= Some(100), "{state:#b}");
        let mut scenario = given_up();
        (0..10).for_each(|_| receive_faults(&mut scenario, 600));
        assert_eq!(runs(&mut scenario), 0, "{state:#b}");
        // The control: it runs.
        assert_eq!(highest(&mut given_up(), 0b01100, 20), Some(900), "{state:#b}");
    }
}

/// An engine that flew is not in doubt after a loss of power, although its ECU reports a state that a start has, too: its demand rises. The
/// control: without a record nobody knows that it flew.
#[test]
fn amt_an_engine_that_flew_before_a_loss_of_power_is_found_running() {
    for state in COMMON_STATES.into_iter().skip(1) {
        let mut scenario = after(&flying(Ecu::Amt), Reset::PowerLost);
        assert_eq!(highest(&mut scenario, state, 100), Some(900), "{state:#b}");
        assert!(scenario.telemetry().in_doubt.is_none(), "{state:#b}");
        let mut scenario = Scenario::after_reset(Ecu::Amt, Ecu::Amt.config(), None);
        assert!(highest(&mut scenario, state, 100) <= Some(500), "{state:#b}");
        assert!(scenario.telemetry().in_doubt.is_some(), "{state:#b}");
    }
}

/// The stages of loss have lowered the demand of an engine by the time it is found: its exhaust falls as it has to. The control: a source
/// commands the throttle that it has, and a fall is a flame-out.
#[test]
fn amt_8_an_engine_that_is_found_by_its_exhaust_after_a_long_loss_may_cool() {
    for commands in [false, true] {
        let fly = |scenario: &mut Scenario, micros: u64| {
            if commands {
                scenario.fly_us(run(90), Origin::Rc, micros);
            } else {
                scenario.pass_us(micros);
            }
        };
        let mut flight = Scenario::started(Ecu::Amt, percent(90));
        flight.reports = Some(Reports::Running);
        flight.fly_us(run(90), Origin::Rc, SECOND);
        fly(&mut flight, 900_000);
        let mut scenario = after(&flight, Reset::PowerLost);
        // Less than the serial delay time of the ECU.
        fly(&mut scenario, 3 * SECOND);
        scenario.values = Values { half_percents: 180, egt_celsius: 700, fault: 1, rpm: None };
        scenario.reports(Reports::Running);
        assert_eq!(scenario.order(), Order::Doubt(percent(if commands { 90 } else { 0 })));
        // 25 °C/s for 4 s, and steady again.
        for i in 0..100 {
            scenario.values.egt_celsius = 700 - i.min(80) * 5 / 4;
            fly(&mut scenario, FRAME_PERIOD_US);
        }
        assert_eq!(scenario.order() == Order::Standby, commands, "{}", scenario.order());
    }
}

/// What shows that an engine may not run stays known over a loss of power.
#[test]
fn doubts_about_error_sets_survive_a_loss_of_power() {
    let memory = RetainedMemory::new();
    let run = RetainedState::new(Order::Run(percent(80)), Origin::Rc);
    let listen = RetainedState::new(Order::Listen, Origin::Node).with(|state| state.ran = true);
    for (exhaust_ignored, after_faults) in [(false, false), (true, false), (false, true), (true, true)] {
        let with = |state: RetainedState| {
            state.with(|state| (state.exhaust_ignored, state.after_faults) = (exhaust_ignored, after_faults))
        };
        memory.store(&with(run), 1);
        assert_eq!(memory.load(1, Reset::Warm), Some(with(run)));
        assert_eq!(memory.load(1, Reset::PowerLost), Some(with(listen)));
    }
}

/// 906000741: a lower source's standby waits for as long as without the reset. The silence that is retained began with the last command,
/// the stages of loss with the end of the timeout.
#[test]
fn a_lower_standby_is_not_obeyed_sooner_after_a_loss_of_power() {
    let config = Ecu::Zk.with(|s| s.loss.lower_standby_after = Duration::from_secs(25));
    let mut scenario = Scenario::started_with(Ecu::Zk, config, percent(50));
    scenario.fly_us(run(50), Origin::Mavlink, 8 * SECOND);
    let last = scenario.now_us() - COMMAND_PERIOD_US;
    // The wire from the ECU is cut.
    scenario.silent().fly_us(Command::Standby, Origin::Bench, 20 * SECOND);
    let silence = scenario.now_us() - last;
    let record = scenario.bench.machine.record().without_start();
    let mut scenario = Scenario::after_reset(Ecu::Zk, config, Some(record));
    scenario.silent();
    let begun = scenario.now_us();
    while scenario.order() != Order::Standby {
        let _ = scenario.command_from(Command::Standby, Origin::Bench);
        scenario.pass_us(COMMAND_PERIOD_US);
    }
    let mavlink_timeout = SECOND;
    let due = mavlink_timeout + HOLD_US + 25 * SECOND - silence;
    let obeyed = scenario.now_us() - begun;
    assert!((due..=due + SECOND).contains(&obeyed), "{obeyed} us, due {due}");
}
