//! Finding 7: an AMT ECU with a fault sends error sets only, which do not report the engine's state. The exhaust shows
//! it: a burning engine continues, any other is not sent run.

use crate::world::*;
use sim::amt::{AmtTemper, Status, error};
use sim::ecu::{MILLIS, SECOND};
use sim::turbine::Phase;

/// An AMT engine at this throttle whose ECU sends error sets only.
fn flying_with_a_fault(percent: u8, temper: AmtTemper) -> World {
    let mut world = World::one(amt(|_, ecu| ecu.temper = temper));
    world.fly(Rc, percent);
    world.amt(|ecu| ecu.set_errors(error::SUPPLY_LOW));
    world.pass_s(5.0);
    assert_eq!(world.phase(), Phase::Running);
    world
}

#[test]
fn burning_engine_with_error_sets_continues_at_its_demand() {
    let mut world = flying_with_a_fault(75, AmtTemper::DEFAULT);
    let from = world.now();
    world.pass_s(120.0);
    world.assert_not_shut_down(from);
    assert_eq!(world.throttle_sent(0), Some(750));
}

/// Its source has long been silent, which must not cause standby while the engine runs. The exhaust shows that it does, and
/// then the ECU again: the one report in between is not a reason.
#[test]
fn burning_engine_without_a_source_continues_when_its_fault_clears() {
    let mut world = World::one(amt(|_, _| {}));
    world.fly(Rc, 50);
    world.silent(Rc);
    world.pass_s(20.0);
    let from = world.now();
    world.amt(|ecu| ecu.set_errors(error::SUPPLY_LOW));
    world.pass_s(20.0);
    world.amt(|ecu| ecu.set_errors(0));
    world.pass_s(20.0);
    world.assert_not_shut_down(from);
    assert_eq!(world.phase(), Phase::Running);
}

#[test]
fn burning_engine_with_error_sets_resumes_after_a_reset() {
    let mut world = flying_with_a_fault(75, AmtTemper::DEFAULT);
    let from = world.now();
    world.reset();
    world.pass_s(60.0);
    world.assert_not_shut_down(from);
    assert_eq!(world.throttle_sent(0), Some(750));
}

/// The engine was stopped and has cooled while the node was in reset.
fn cold_after_a_reset(pilot: bool) {
    let mut world = flying_with_a_fault(75, AmtTemper::DEFAULT);
    world.halt();
    // Without replies the ECU shuts the engine down.
    world.pass_s(300.0);
    world.amt(|ecu| ecu.set_errors(error::SUPPLY_LOW));
    assert!(world.egt() < 100.0 && !world.phase().is_live(), "{}", world.egt());
    if !pilot {
        world.silent(Rc);
    }
    let from = world.now();
    world.boot();
    world.pass_s(600.0);
    world.assert_not_sent_run(from);
    world.amt(|ecu| ecu.set_errors(0));
    world.pass_s(60.0);
    world.assert_not_sent_run(from);
    world.assert_ignitions(1);
    world.starts_again(Rc);
}

#[test]
fn cold_engine_with_error_sets_is_not_sent_run_after_a_reset_without_a_source() {
    cold_after_a_reset(false);
}

#[test]
fn cold_engine_with_error_sets_is_not_sent_run_after_a_reset_with_a_source() {
    cold_after_a_reset(true);
}

/// The exhaust of an engine at 90 % falls by more than 15 °C a second for 3 s when its flame is out, and is below 300 °C
/// within 25 s.
#[test]
fn run_ends_when_the_flame_goes_out_with_error_sets() {
    for pilot in [true, false] {
        let mut world = flying_with_a_fault(90, AmtTemper::DEFAULT);
        if !pilot {
            world.silent(Rc);
        }
        world.turbine(|turbine| turbine.flame_out());
        world.pass_s(30.0);
        let from = world.now();
        world.pass_s(600.0);
        world.assert_not_sent_run(from);
        assert!(world.sent(from).all(|frame| frame.is_stop()));
        world.assert_ignitions(1);
        world.amt(|ecu| ecu.set_errors(0));
        world.starts_again(Rc);
    }
}

/// An ECU that clears its fault after a minute and then obeys whatever it is sent.
#[test]
fn old_run_is_not_sent_after_fault_clears() {
    let temper = AmtTemper {
        trips_clear_after: Some(60 * SECOND),
        starts_hot: true,
        clearance: 0,
        ..AmtTemper::DEFAULT
    };
    let mut world = flying_with_a_fault(90, temper);
    world.turbine(|turbine| turbine.flame_out());
    world.pass_s(50.0);
    world.amt(|ecu| ecu.set_errors(0));
    world.pass_s(300.0);
    world.assert_ignitions(1);
    world.starts_again(Rc);
}

/// An ECU that clears its fault 0.6 s after a flame-out, before the exhaust has shown it: run is in force, and it starts on run alone
/// from 5 % down, however hot. What reports rest (10 %), or start clearance (5 %), gets no reply until it is standby. The control: the fault
/// clears on an engine that runs, and the reply to each set is run.
#[test]
fn run_in_force_is_not_sent_when_a_fault_clears_early() {
    for (percent, status, standby_within) in
        [(10, Status::NoClearance, 0.5), (5, Status::StartClearance, 3.0)]
    {
        let temper = AmtTemper {
            trips_clear_after: Some(600 * MILLIS),
            starts_hot: true,
            clearance: 4 * SECOND,
            ..AmtTemper::DEFAULT
        };
        let mut world = flying_with_a_fault(percent, temper);
        let clear = world.now();
        world.amt(|ecu| ecu.set_errors(0));
        world.pass_s(5.0);
        world.assert_not_shut_down(clear);
        let runs = world.sent(clear).filter(|frame| frame.is_run()).count();
        assert!(runs >= 39, "{runs} replies to 40 sets");

        world.turbine(|turbine| turbine.flame_out());
        let out = world.now();
        world.until("a trip", 10.0, |world| world.turbine(|turbine| turbine.trip().is_some()));
        world.until("no trip", 1.0, |world| world.turbine(|turbine| turbine.trip().is_none()));
        let clear = world.now();
        world.amt(|ecu| assert_eq!(ecu.status(), status));
        assert!(world.sent(out).all(|frame| frame.is_run()));
        // The reply to a set that began before.
        world.pass_s(0.05);
        let from = world.now();
        world.pass_s(20.0);
        world.assert_not_sent_run(from);
        let standby = world.sent(from).next().map(|frame| seconds(frame.at - clear));
        assert!(standby.is_some_and(|after| after < standby_within), "{percent} %: {standby:?}");
        world.assert_ignitions(1);
        world.starts_again(Rc);
    }
}

/// The ECU's own error sets after a flame-out, without any other fault.
#[test]
fn run_ends_when_the_flame_goes_out_and_the_ecu_reports_nothing_else() {
    let mut world = World::one(amt(|_, _| {}));
    world.fly(Rc, 90);
    world.turbine(|turbine| turbine.flame_out());
    world.pass_s(30.0);
    let from = world.now();
    world.pass_s(60.0);
    world.assert_not_sent_run(from);
    world.assert_ignitions(1);
    world.starts_again(Rc);
}
