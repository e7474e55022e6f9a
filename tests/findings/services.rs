//! Finding 8: fuel needs a cold engine at rest. Nothing that moves fuel or heats goes to a hot one, and a pump that was
//! opened is closed by whatever ends its reason.

use crate::world::*;
use jetlink::command::{Accepted, Command, Rejected};
use jetlink::ecu::zk::codec::Action;
use jetlink::ecu::{Service, zk};
use sim::ecu::MILLIS;
use sim::turbine::EgtSensor;
use sim::zk::{Action as SentAction, ZkTemper};

/// Services that move fuel or heat, as commanded and as sent to the ECU.
const HOT: [(Action, SentAction); 6] = [
    (Action::Drain, SentAction::DrainOil),
    (Action::TestGlowPlug, SentAction::TestGlowPlug),
    (Action::TestMainValve, SentAction::TestMainValve),
    (Action::TestIgnitionValve, SentAction::TestIgnitionValve),
    (Action::TestPump, SentAction::TestPump),
    (Action::OpenPump, SentAction::OpenPump),
];

fn service(action: Action) -> Command {
    Command::Service(Service::Zk(zk::config::Service::Action(action)))
}

/// An ECU that obeys services while it cools, and whose valves let fuel through.
fn obedient() -> World {
    World::one(zk(5, |_, ecu| {
        ecu.temper = ZkTemper { services_while_cooling: true, valves_pass_fuel: true, ..ZkTemper::DEFAULT };
    }))
}

fn flow(world: &World) -> f64 {
    world.turbine(|turbine| turbine.fuel_flow())
}

#[track_caller]
fn assert_no_fuel_into_a_hot_engine(world: &World) {
    let hot = world.turbine(|turbine| turbine.history().hot_fuel_time());
    assert_eq!(hot, 0, "{:.2} s of fuel into a hot engine", seconds(hot));
}

/// Nothing but a refusal, and nothing on the wire.
#[track_caller]
fn assert_refused(world: &mut World, (action, sent_action): (Action, SentAction)) {
    let from = world.now();
    let answer: Result<Accepted, Rejected> = world.command(Rc, service(action));
    world.pass_s(3.0);
    let sent = world.sent(from).filter(|frame| frame.is_action(sent_action)).count();
    assert_eq!(sent, 0, "{action:?} is on the wire");
    assert!(answer.is_err(), "{action:?}: {answer:?}");
}

/// Accepted, and obeyed by the ECU.
#[track_caller]
fn assert_obeyed(world: &mut World, (action, sent_action): (Action, SentAction)) {
    let from = world.now();
    let answer = world.command(Rc, service(action));
    assert!(answer.is_ok(), "{action:?}: {answer:?}");
    world.pass_s(1.0);
    assert!(world.sent(from).any(|frame| frame.is_action(sent_action)), "{action:?} never went out");
}

#[test]
fn nothing_that_moves_fuel_or_heats_goes_to_an_engine_that_cools() {
    let mut wrong = Vec::new();
    for (action, sent_action) in HOT {
        let mut world = obedient();
        world.fly(Rc, 90);
        world.streams(Rc, Standby);
        world.pass_s(3.0);
        assert!(world.egt() > 500.0);
        let from = world.now();
        let answer = world.command(Rc, service(action));
        world.pass_s(10.0);
        let hot = world.turbine(|turbine| turbine.history().hot_fuel_time());
        if answer.is_ok() || hot > 0 || world.sent(from).any(|frame| frame.is_action(sent_action)) {
            wrong.push(format!("{action:?}: {:.1} s of fuel", seconds(hot)));
        }
    }
    assert!(wrong.is_empty(), "into an engine at more than 500 °C: {wrong:?}");
}

/// The ECU reports standby although the exhaust is hot.
#[test]
fn nothing_that_moves_fuel_or_heats_goes_to_a_hot_engine_in_standby() {
    for hot in HOT {
        let mut world = obedient();
        world.fly(Rc, 90);
        world.streams(Rc, Standby);
        world.zk(|ecu| ecu.set_state(Some(1)));
        world.pass_s(3.0);
        assert!(world.egt() > 500.0);
        assert_refused(&mut world, hot);
        assert_no_fuel_into_a_hot_engine(&world);
    }
}

/// An ECU that does not receive standby stays at stop, with a cold exhaust, and reports this.
#[test]
fn nothing_that_moves_fuel_or_heats_goes_to_an_ecu_that_reports_stop() {
    for hot in HOT {
        let mut world = obedient();
        world.ready(Rc);
        world.zk(|ecu| ecu.set_state(Some(0)));
        world.pass_s(3.0);
        assert_refused(&mut world, hot);
    }
}

#[test]
fn nothing_that_moves_fuel_or_heats_is_done_with_an_exhaust_that_is_not_known() {
    for sensor in [EgtSensor::Open, EgtSensor::Short] {
        for hot in HOT {
            let mut world = obedient();
            world.ready(Rc);
            world.turbine(|turbine| turbine.set_egt_sensor(sensor));
            world.pass_s(3.0);
            assert_refused(&mut world, hot);
        }
    }
}

#[test]
fn nothing_that_moves_fuel_or_heats_is_done_with_an_engine_that_is_not_armed() {
    for hot in HOT {
        let mut world = obedient();
        world.streams(Rc, Standby);
        world.pass_s(3.0);
        assert_refused(&mut world, hot);
    }
}

#[test]
fn everything_is_done_with_a_cold_engine_in_standby() {
    for hot in HOT {
        let mut world = obedient();
        world.ready(Rc);
        assert_obeyed(&mut world, hot);
        assert_no_fuel_into_a_hot_engine(&world);
    }
}

// -----------------------------------------------------------------------------------------------
// The pump
// -----------------------------------------------------------------------------------------------

/// A cold engine whose pump was opened a moment ago, by a source that has commanded nothing else since.
fn pump_open() -> World {
    let mut world = obedient();
    world.ready(Rc);
    world.silent(Rc);
    let answer = world.command(Rc, service(Action::OpenPump));
    assert!(answer.is_ok(), "{answer:?}");
    world.until("fuel", 1.0, |world| flow(world) > 0.0);
    world
}

#[track_caller]
fn assert_closed(world: &mut World, within_seconds: f64) {
    world.pass_s(within_seconds);
    let flow = flow(world);
    assert!(flow == 0.0, "{flow} ml/min after {within_seconds} s");
}

#[test]
fn pump_is_closed_when_its_source_closes_it() {
    let mut world = pump_open();
    world.command(Rc, service(Action::ClosePump)).expect("always possible");
    assert_closed(&mut world, 0.5);
    assert!(world.turbine(|turbine| turbine.fuel_total()) > 0.0);
}

#[test]
fn pump_is_closed_by_an_emergency_stop() {
    let mut world = pump_open();
    let stop = world.now();
    world.command(Rc, EmergencyStop).expect("never refused");
    assert_closed(&mut world, 1.0);
    world.pass_s(10.0);
    let first = |what: &dyn Fn(&crate::wire::Frame) -> bool| {
        world.sent(stop).find(|frame| what(frame)).map(|frame| frame.at).expect("it goes out")
    };
    let closes = |frame: &crate::wire::Frame| frame.is_action(SentAction::ClosePump);
    assert!(first(&|frame| frame.is_stop()) < first(&closes), "the stop goes first");
    let at: Vec<_> = world.sent(stop).filter(|frame| closes(frame)).map(|frame| frame.at).collect();
    assert!((1..=10).contains(&at.len()), "{} times", at.len());
    // At every second send slot at most.
    assert!(at.windows(2).all(|pair| pair[1] - pair[0] >= 95 * MILLIS), "{at:?}");
}

#[test]
fn pump_is_closed_by_standby() {
    let mut world = pump_open();
    world.streams(Rc, Standby);
    assert_closed(&mut world, 2.0);
}

#[test]
fn pump_is_closed_by_disarm() {
    let mut world = pump_open();
    world.command(Rc, Disarm).expect("always accepted");
    assert_closed(&mut world, 2.0);
}

#[test]
fn pump_is_closed_when_its_source_is_silent() {
    let mut world = pump_open();
    assert_closed(&mut world, 15.0);
}

#[test]
fn pump_is_closed_after_a_reset() {
    let mut world = pump_open();
    world.reset();
    assert_closed(&mut world, 5.0);
}

#[test]
fn pump_is_closed_after_a_reset_with_an_emergency_stop() {
    let mut world = pump_open();
    world.command(Rc, EmergencyStop).expect("never refused");
    world.reset();
    assert_closed(&mut world, 5.0);
}

/// It is open "for a long time", and not forever.
#[test]
fn pump_is_closed_after_its_time() {
    let mut world = pump_open();
    world.streams(Rc, Standby);
    assert_closed(&mut world, 600.0);
}
