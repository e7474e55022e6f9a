//! Findings 9 and 13: a demand beyond the maximum is clamped and counts as received, and demands that used to jump now
//! move at a rate.

use crate::wire::Sent;
use crate::world::*;
use jetlink::limit::{Action, Limit};
use jetlink::units::Celsius;
use sim::amt::error;
use sim::ecu::{MILLIS, Nanos};
use sim::turbine::{EgtSensor, Phase};
use sim::zk::ZkCommand;

/// Rate at which a demand rises where something other than the pilot's stick moves it, as a fraction per second.
const RATE: f64 = 0.5;
/// One step of the demand, and the rounding of a frame.
const GRAIN: f64 = 0.03;
const MAX_RPM: u32 = 160_000;

/// The demands sent with run since then, as fractions.
fn demands<const N: usize>(world: &World<N>, engine: usize, since: Nanos) -> Vec<(Nanos, f64)> {
    let mut factor = 0;
    let mut demands = Vec::new();
    for frame in world.sent_to(engine, 0) {
        let demand = match frame.sent {
            Sent::Zk(ZkCommand::Switch { factor: now, .. }) => {
                factor = u32::from(now);
                None
            }
            // Target rpm = code x RPM_X x 10
            Sent::Zk(ZkCommand::Rpm(code)) if factor > 0 => {
                Some(f64::from(u32::from(code) * factor * 10) / f64::from(MAX_RPM))
            }
            _ => frame.throttle().map(|tenths| f64::from(tenths) / 1000.0),
        };
        demands.extend(demand.filter(|_| frame.at >= since).map(|demand| (frame.at, demand)));
    }
    demands
}

/// From any frame to any later one, the demand rises no faster than the rate.
#[track_caller]
fn assert_rises_at_the_rate(demands: &[(Nanos, f64)]) {
    for (n, &(from, low)) in demands.iter().enumerate() {
        for &(at, high) in demands[n..].iter().take(60) {
            let most = low + RATE * seconds(at - from) + GRAIN;
            assert!(
                high <= most,
                "from {:.1} % to {:.1} % within {:.2} s",
                low * 100.0,
                high * 100.0,
                seconds(at - from)
            );
        }
    }
}

/// It rises nevertheless, and no later than it has to.
#[track_caller]
fn assert_reaches(demands: &[(Nanos, f64)], demand: f64) {
    let last = demands.last().map_or(0.0, |&(_, demand)| demand);
    assert!((last - demand).abs() < 0.01, "{:.1} % in the end", last * 100.0);
}

fn both() -> [World; 2] {
    [World::one(zk(5, |_, _| {})), World::one(amt(|_, _| {}))]
}

// -----------------------------------------------------------------------------------------------
// Finding 9
// -----------------------------------------------------------------------------------------------

/// A source that keeps commanding a speed just above the maximum of 160 000 rpm.
#[test]
fn demand_just_above_the_maximum_is_clamped_to_it() {
    for too_much in [160_100, 200_000] {
        let mut world = World::one(zk(5, |_, _| {}));
        world.start(Rc);
        world.streams(Rc, run_rpm(150_000));
        world.pass_s(10.0);
        world.streams(Rc, run_rpm(too_much));
        world.pass_s(10.0);
        let from = world.now();
        world.pass_s(10.0);
        for (_, demand) in demands(&world, 0, from) {
            assert!((demand - 1.0).abs() < 0.001, "{:.1} % of the maximum", demand * 100.0);
        }
        assert!((world.rpm() - f64::from(MAX_RPM)).abs() < 500.0, "{} rpm", world.rpm());
    }
}

#[test]
fn demand_at_the_maximum_is_obeyed() {
    let mut world = World::one(zk(5, |_, _| {}));
    world.start(Rc);
    world.streams(Rc, run_rpm(MAX_RPM));
    world.pass_s(15.0);
    assert!((world.rpm() - f64::from(MAX_RPM)).abs() < 500.0, "{} rpm", world.rpm());
}

// -----------------------------------------------------------------------------------------------
// Finding 13
// -----------------------------------------------------------------------------------------------

/// The pilot's stick goes up while the engine is still starting.
#[test]
fn throttle_rises_at_a_rate_after_a_start_with_the_stick_up() {
    for mut world in both() {
        world.ready(Rc);
        let from = world.now();
        world.streams(Rc, run(0));
        world.until("it starts", 20.0, |world| world.phase().is_starting());
        world.streams(Rc, run(100));
        world.until("it runs", 100.0, |world| world.phase() == Phase::Running);
        world.pass_s(10.0);
        let demands = demands(&world, 0, from);
        assert_rises_at_the_rate(&demands);
        assert_reaches(&demands, 1.0);
    }
}

#[test]
fn speed_rises_at_a_rate_after_a_start_with_the_stick_up() {
    let mut world = World::one(zk(5, |_, _| {}));
    world.ready(Rc);
    let from = world.now();
    world.streams(Rc, run_rpm(0));
    world.until("it starts", 20.0, |world| world.phase().is_starting());
    world.streams(Rc, run_rpm(MAX_RPM));
    world.until("it runs", 100.0, |world| world.phase() == Phase::Running);
    world.pass_s(10.0);
    let demands: Vec<_> =
        demands(&world, 0, from).into_iter().skip_while(|&(_, demand)| demand < 0.3).collect();
    assert_rises_at_the_rate(&demands);
    assert_reaches(&demands, 1.0);
}

/// A higher source that commands more takes over.
#[test]
fn demand_rises_at_a_rate_when_another_source_takes_over() {
    for mut world in both() {
        world.fly(Mavlink, 20);
        let from = world.now();
        world.streams(Rc, run(100));
        world.pass_s(15.0);
        let demands = demands(&world, 0, from);
        assert_rises_at_the_rate(&demands);
        assert_reaches(&demands, 1.0);
    }
}

/// The source was lost until the demand was at idle, and is back.
#[test]
fn demand_rises_at_a_rate_after_a_gap() {
    for mut world in both() {
        world.fly(Rc, 100);
        world.silent(Rc);
        world.pass_s(6.0);
        assert_eq!(world.throttle_sent(0), Some(0));
        let from = world.now();
        world.streams(Rc, run(100));
        world.pass_s(15.0);
        let demands = demands(&world, 0, from);
        assert_rises_at_the_rate(&demands);
        assert_reaches(&demands, 1.0);
    }
}

/// An AMT engine with error sets only: while its exhaust temperature is unknown, its demand is not raised.
#[test]
fn demand_held_while_the_exhaust_is_not_known_rises_at_a_rate() {
    let mut world = World::one(amt(|_, _| {}));
    world.fly(Rc, 20);
    world.amt(|ecu| ecu.set_errors(error::SUPPLY_LOW));
    world.turbine(|turbine| turbine.set_egt_sensor(EgtSensor::Open));
    world.pass_s(5.0);
    let from = world.now();
    world.streams(Rc, run(60));
    world.pass_s(5.0);
    assert_eq!(world.throttle_sent(0), Some(200));
    world.turbine(|turbine| turbine.set_egt_sensor(EgtSensor::Good));
    world.pass_s(15.0);
    let demands = demands(&world, 0, from);
    assert_rises_at_the_rate(&demands);
    assert_reaches(&demands, 0.6);
}

/// A limit that held the demand at the fail-safe: after standby and a new start, nothing jumps either.
#[test]
fn demand_rises_at_a_rate_after_a_start_that_follows_a_limit() {
    let mut world = World::one(zk(5, |config, _| {
        config.supervision.limits.over_temperature =
            Limit { at: Some(Celsius::from_tenths(6500)), action: Action::FailSafe };
    }));
    world.start(Rc);
    world.streams(Rc, run(100));
    world.pass_s(20.0);
    assert_eq!(world.throttle_sent(0), Some(0), "the limit holds");
    world.ready(Rc);
    let from = world.now();
    world.streams(Rc, run(0));
    world.until("it starts", 20.0, |world| world.phase().is_starting());
    world.streams(Rc, run(60));
    world.until("it runs", 100.0, |world| world.phase() == Phase::Running);
    world.pass_s(10.0);
    let demands = demands(&world, 0, from);
    assert_rises_at_the_rate(&demands);
    assert_reaches(&demands, 0.6);
}

/// Two engines at 100 %, of which one fails: the other is reduced to half.
fn reduced_to_half() -> World<2> {
    let mut right = zk(5, |config, _| config.supervision.when_other_fails = Some(500));
    right.0.port = 1;
    let mut world = World::new([amt(|_, _| {}), right]);
    world.ready(Rc);
    world.streams(Rc, run(0));
    world.until("both run", 200.0, |world| {
        (0..2).all(|engine| world.turbine_of(engine, |turbine| turbine.phase() == Phase::Running))
    });
    world.streams(Rc, run(100));
    world.pass_s(10.0);
    world.turbine_of(0, |turbine| turbine.flame_out());
    world.pass_s(20.0);
    assert_eq!(world.throttle_sent(1), Some(500));
    world
}

#[test]
fn demand_rises_at_a_rate_when_the_failure_of_another_engine_clears() {
    let mut world = reduced_to_half();
    let from = world.now() - 1000 * MILLIS;
    // Its pilot shuts it down: it no longer counts as failed.
    world.streams_to(0, Rc, Standby);
    world.pass_s(15.0);
    let demands = demands(&world, 1, from);
    assert_rises_at_the_rate(&demands);
    assert_reaches(&demands, 1.0);
}

/// In normal flight the demand follows the stick as fast as it is moved.
#[test]
fn demand_follows_the_stick_at_once_in_normal_flight() {
    for mut world in both() {
        world.fly(Rc, 20);
        let from = world.now();
        world.streams(Rc, run(100));
        world.pass_s(0.5);
        let demands = demands(&world, 0, from);
        assert_reaches(&demands, 1.0);
        let jump = demands.iter().find(|(_, demand)| *demand > 0.9).expect("it goes up").0;
        assert!(jump - from < 300 * MILLIS, "{:.2} s later", seconds(jump - from));
    }
}
