//! Findings 4, 10 and 15: what the node does after a reset. A loss continues over resets, a stop reaches the ECU in every
//! mode, and a record of another engine arms nothing.

use crate::wire::Frame;
use crate::world::*;
use jetlink::config::EngineConfig;
use jetlink::ecu::amt::codec::EngineModel;
use jetlink::report::Counters;
use jetlink::telemetry::Telemetry;
use jetlink::units::Celsius;
use sim::ecu::SECOND;
use sim::turbine::Phase;
use sim::wire::Direction;

// -----------------------------------------------------------------------------------------------
// Finding 4
// -----------------------------------------------------------------------------------------------

/// Resets at this interval for this time.
fn reset_loop(world: &mut World, period_seconds: f64, seconds: f64) {
    let end = world.now() + (seconds * 1e9) as u64;
    while world.now() < end {
        world.reset();
        world.pass_s(period_seconds - START_UP);
    }
}

/// Since then the engine has not been sent run above idle.
#[track_caller]
fn assert_not_above_idle(world: &World, since: u64) {
    let most = world.sent(since).filter_map(Frame::throttle).max();
    assert!(most.unwrap_or(0) == 0, "sent run at {:.1} %", f64::from(most.unwrap_or(0)) / 10.0);
    let idle = world.turbine(|turbine| turbine.parameters().idle_rpm);
    assert!(world.rpm() < 1.05 * idle, "{} rpm", world.rpm());
}

fn dead_source_in_a_reset_loop(engine: impl Fn() -> World, period_seconds: f64) {
    let mut world = engine();
    world.fly(Rc, 90);
    world.silent(Rc);
    reset_loop(&mut world, period_seconds, 25.0);
    let from = world.now();
    reset_loop(&mut world, period_seconds, 30.0);
    assert_not_above_idle(&world, from);
}

#[test]
fn demand_of_a_dead_source_does_not_outlive_a_reset_loop_on_a_zk_3_ecu() {
    for period in [0.7, 0.9, 1.05, 1.4] {
        dead_source_in_a_reset_loop(|| World::one(zk(3, |_, _| {})), period);
    }
}

#[test]
fn demand_of_a_dead_source_does_not_outlive_a_reset_loop_on_a_zk_5_ecu() {
    for period in [0.7, 0.9, 1.05, 1.4] {
        dead_source_in_a_reset_loop(|| World::one(zk(5, |_, _| {})), period);
    }
}

#[test]
fn demand_of_a_dead_source_does_not_outlive_a_reset_loop_on_an_amt_ecu() {
    for period in [0.7, 0.9, 1.05, 1.4] {
        dead_source_in_a_reset_loop(|| World::one(amt(|_, _| {})), period);
    }
}

/// Resets so frequent that the node never receives enough to order anything; a ZK ECU from version 5 keeps its engine
/// running.
#[test]
fn reset_loop_too_quick_to_listen_brings_a_zk_engine_without_a_source_to_standby() {
    let mut world = World::one(zk(5, |_, _| {}));
    world.fly(Rc, 90);
    world.silent(Rc);
    for _ in 0..200 {
        world.reset();
        world.pass_s(0.08);
    }
    assert!(!world.phase().is_live(), "{:?} at {} rpm", world.phase(), world.rpm());
}

#[test]
fn five_resets_1_05_s_apart_leave_an_engine_with_a_fresh_source_at_its_demand() {
    for engine in [zk(3, |_, _| {}), zk(5, |_, _| {}), amt(|_, _| {})] {
        let mut world = World::one(engine);
        world.fly(Rc, 60);
        let from = world.now();
        for _ in 0..5 {
            world.reset();
            world.pass_s(1.05 - START_UP);
        }
        world.pass_s(10.0);
        world.assert_not_shut_down(from);
        assert_eq!(world.throttle_sent(0), Some(600));
    }
}

/// A loop of resets without a source ends at the fail-safe, from which MAVLink takes the engine. That RC takes over from
/// it much later is a take-over like any other.
#[test]
fn take_over_long_after_a_reset_loop_waits() {
    for engine in [zk(5, |_, _| {}), amt(|_, _| {})] {
        let mut world = World::one(engine);
        world.fly(Rc, 90);
        world.silent(Rc);
        reset_loop(&mut world, 1.05, 5.0);
        world.streams(Mavlink, run(60));
        world.pass_s(20.0);
        assert_eq!(world.throttle_sent(0), Some(600));
        let from = world.now();
        world.streams(Rc, run(40));
        world.pass_s(1.5);
        let lowest = world.sent(from).filter_map(Frame::throttle).min();
        assert_eq!(lowest, Some(600), "before the take-over has waited its 2 s");
        world.pass_s(2.0);
        assert_eq!(world.throttle_sent(0), Some(400));
    }
}

#[test]
fn one_reset_of_an_engine_without_a_source_ends_at_idle() {
    for engine in [zk(5, |_, _| {}), amt(|_, _| {})] {
        let mut world = World::one(engine);
        world.fly(Rc, 90);
        world.silent(Rc);
        world.reset();
        world.pass_s(9.0);
        let from = world.now();
        world.pass_s(1.0);
        assert_not_above_idle(&world, from);
    }
}

// -----------------------------------------------------------------------------------------------
// Finding 10, with a record
// -----------------------------------------------------------------------------------------------

/// An engine in one of the modes of ZK-9, and a node that is reset and receives nothing from its ECU.
fn deaf_after_a_reset(by_rpm: bool) -> World {
    let mut world = World::one(zk(5, |_, _| {}));
    world.start(Rc);
    world.streams(Rc, if by_rpm { run_rpm(110_000) } else { run(50) });
    world.pass_s(8.0);
    world.silent(Rc);
    world.plugs[0].cut_one(Direction::ToNode, true);
    world.reset();
    world.pass_s(0.5);
    assert_eq!(world.phase(), Phase::Running);
    world
}

fn emergency_stop_stops(mut world: World) {
    world.command(Rc, EmergencyStop).expect("never refused");
    world.pass_s(1.0);
    assert!(!world.phase().is_live(), "{:?} 1 s after the stop", world.phase());
}

#[test]
fn emergency_stop_reaches_an_ecu_in_rpm_mode_after_a_reset_with_nothing_received() {
    emergency_stop_stops(deaf_after_a_reset(true));
}

#[test]
fn emergency_stop_reaches_an_ecu_in_throttle_mode_after_a_reset_with_nothing_received() {
    emergency_stop_stops(deaf_after_a_reset(false));
}

/// Standby is also sent blind.
#[test]
fn standby_reaches_an_ecu_after_a_reset_with_nothing_received() {
    for by_rpm in [false, true] {
        let mut world = deaf_after_a_reset(by_rpm);
        world.streams(Rc, Standby);
        world.pass_s(5.0);
        assert!(!world.phase().is_live(), "{:?} after 5 s of standby", world.phase());
    }
}

#[test]
fn latched_stop_reaches_an_ecu_in_rpm_mode_after_a_reset() {
    let mut world = World::one(zk(5, |_, _| {}));
    world.start(Rc);
    world.streams(Rc, run_rpm(110_000));
    world.pass_s(8.0);
    // Nothing gets through until the node has been reset.
    world.plugs[0].cut(true);
    world.command(Rc, EmergencyStop).expect("never refused");
    world.pass_s(0.2);
    world.halt();
    world.plugs[0].cut(false);
    world.plugs[0].cut_one(Direction::ToNode, true);
    world.reset();
    world.pass_s(1.0);
    assert!(!world.phase().is_live(), "{:?}", world.phase());
}

// -----------------------------------------------------------------------------------------------
// Finding 15
// -----------------------------------------------------------------------------------------------

/// The node is armed, and comes back from a reset with another engine's settings on the same port.
#[test]
fn record_of_another_protocol_does_not_arm_an_engine() {
    let mut world = World::one(amt(|_, _| {}));
    world.ready(Rc);
    world.halt();
    let (config, ecu) = zk(5, |_, _| {});
    let mut world = world.reconfigured(config, ecu);
    world.boot();
    world.streams(Rc, Standby);
    world.pass_s(5.0);
    world.streams(Rc, run(0));
    world.pass_s(60.0);
    world.assert_ignitions(0);
    world.starts_again(Rc);
}

#[test]
fn record_of_another_amt_engine_does_not_arm_an_engine() {
    let mut world = World::one(amt(|_, _| {}));
    world.ready(Rc);
    world.halt();
    let (mut config, ecu) = amt(|_, _| {});
    config.ecu = EngineConfig::amt("amt", 0, config.line, Some(EngineModel::Titan)).ecu;
    let mut world = world.reconfigured(config, ecu);
    world.boot();
    world.streams(Rc, Standby);
    world.pass_s(5.0);
    world.streams(Rc, run(0));
    world.pass_s(60.0);
    world.assert_ignitions(0);
    world.starts_again(Rc);
}

/// RAM survives a short loss of power; "armed" does not. After a watchdog reset it does.
#[test]
fn memory_that_survived_a_loss_of_power_does_not_arm_an_engine() {
    for engine in [|| zk(5, |_, _| {}), || amt(|_, _| {})] {
        for power_lost in [true, false] {
            let mut world = World::one(engine());
            world.ready(Rc);
            world.halt();
            world.pass_s(0.3);
            if power_lost {
                world.boot_after_power_loss();
            } else {
                world.boot();
            }
            world.streams(Rc, Standby);
            world.pass_s(5.0);
            world.streams(Rc, run(0));
            world.pass_s(60.0);
            world.assert_ignitions(usize::from(!power_lost));
        }
    }
}

/// Then only the ECU's reports are known: the previous demand returns only from its source.
#[test]
fn engine_in_flight_resumes_after_a_loss_of_power_that_memory_survived() {
    for engine in [zk(5, |_, _| {}), amt(|_, _| {})] {
        let mut world = World::one(engine);
        world.fly(Rc, 60);
        world.silent(Rc);
        let from = world.now();
        world.halt();
        world.pass_s(0.3);
        world.boot_after_power_loss();
        world.pass_s(8.0);
        world.assert_not_shut_down(from);
        assert_eq!(world.throttle_sent(0), Some(0), "no source commands it: idle");
        world.streams(Rc, run(60));
        world.pass_s(8.0);
        assert_eq!(world.throttle_sent(0), Some(600));
    }
}

/// A stop that was latched stays latched.
#[test]
fn latched_stop_survives_a_loss_of_power_that_memory_survived() {
    for engine in [zk(5, |_, _| {}), amt(|_, _| {})] {
        let mut world = World::one(engine);
        world.fly(Rc, 60);
        world.command(Rc, EmergencyStop).expect("never refused");
        world.halt();
        world.pass_s(0.05);
        world.boot_after_power_loss();
        world.pass_s(5.0);
        assert!(!world.phase().is_live());
        assert!(world.handle(0).telemetry().stop_latched);
    }
}

/// An engine with a changed limit is the same engine.
#[test]
fn engine_resumes_after_a_reset_with_another_limit() {
    for engine in [zk(5, |_, _| {}), amt(|_, _| {})] {
        let mut world = World::one(engine);
        world.fly(Rc, 60);
        let from = world.now();
        world.configs[0].supervision.limits.over_temperature.at = Some(Celsius::from_tenths(9000));
        world.reset();
        world.pass_s(10.0);
        world.assert_not_shut_down(from);
        assert_eq!(world.throttle_sent(0), Some(600));
    }
}

/// The part of the telemetry that a pilot, a ground station and the LED show, without counters.
fn shown(world: &World) -> Telemetry {
    let mut telemetry = world.handle(0).telemetry();
    telemetry.counters = Counters::default();
    telemetry
}

/// Two nodes whose only difference is that the transmitter of one has hung for 3 s.
#[test]
fn dead_transmitter_shows_in_telemetry() {
    let after = |hung: bool| {
        let mut world = World::one(zk(5, |_, _| {}));
        world.ready(Rc);
        world.plugs[0].stall_tx(hung);
        world.pass_s(3.0);
        shown(&world)
    };
    let healthy = after(false);
    assert!(healthy == after(false), "two like nodes show the same");
    assert!(healthy != after(true), "the node whose transmitter hangs shows the same as a healthy one");
}

/// A transmitter that hung and continues: no earlier frame is sent, however long it hung.
#[test]
fn transmitter_that_hung_sends_nothing_old() {
    for hung in [1.8, 3.8] {
        let mut world = World::one(zk(5, |_, _| {}));
        world.fly(Rc, 90);
        world.plugs[0].stall_tx(true);
        world.pass_s(hung - 1.5);
        world.streams(Rc, Standby);
        world.pass_s(1.5);
        let from = world.now();
        world.plugs[0].stall_tx(false);
        world.pass_s(2.0);
        let old = world.sent(from).filter(|frame| frame.is_run()).count();
        assert!(old <= 1, "{old} frames, and one was on its way when the transmitter hung for {hung} s");
        let old = world.sent(from + SECOND / 20).filter(|frame| frame.is_run()).count();
        assert_eq!(old, 0);
        assert!(!world.phase().is_live());
    }
}
