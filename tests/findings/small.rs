//! Finding 14, the smaller ones.

use crate::wire::Frame;
use crate::world::*;
use jetlink::command::{Accepted, Interlock, Rejected};
use jetlink::engine::config::Governor;
use jetlink::engine::state::EngineState;
use jetlink::units::Rpm;
use sim::ecu::{MILLIS, Nanos, SECOND};
use sim::turbine::{EgtSensor, Phase};
use sim::zk::crc8;

fn both() -> [World; 2] {
    [World::one(zk(5, |_, _| {})), World::one(amt(|_, _| {}))]
}

// -----------------------------------------------------------------------------------------------
// Finding 14: arming after an emergency stop
// -----------------------------------------------------------------------------------------------

/// An emergency stop of an armed engine at rest, released again.
fn stopped_and_released() -> [World; 2] {
    both().map(|mut world| {
        world.ready(Rc);
        world.command(Rc, EmergencyStop).expect("never refused");
        world.pass_s(1.0);
        world.command(Rc, ReleaseStop).expect("at rest, and its source at standby");
        world.pass_s(3.0);
        world
    })
}

fn ignitions_after_run(world: &mut World) -> usize {
    world.streams(Rc, run(0));
    world.pass_s(20.0);
    world.ignitions()
}

#[test]
fn engine_is_not_armed_after_an_emergency_stop_and_its_release() {
    for mut world in stopped_and_released() {
        assert_eq!(ignitions_after_run(&mut world), 0);
    }
}

/// A source that has always commanded armed.
#[test]
fn source_that_commanded_arm_during_an_emergency_stop_does_not_arm_the_engine() {
    for mut world in both() {
        world.ready(Rc);
        world.command(Rc, EmergencyStop).expect("never refused");
        for _ in 0..10 {
            let _ = world.command(Rc, Arm);
            world.pass_s(0.1);
        }
        world.command(Rc, ReleaseStop).expect("at rest, and its source at standby");
        for _ in 0..30 {
            let _ = world.command(Rc, Arm);
            world.pass_s(0.1);
        }
        assert_eq!(ignitions_after_run(&mut world), 0);
    }
}

#[test]
fn engine_is_armed_by_a_change_to_armed_after_the_release() {
    for mut world in stopped_and_released() {
        world.command(Rc, Disarm).expect("never refused");
        world.pass_s(0.5);
        world.command(Rc, Arm).expect("never refused");
        world.pass_s(3.0);
        assert_eq!(ignitions_after_run(&mut world), 1);
    }
}

// -----------------------------------------------------------------------------------------------
// Finding 14: the governor
// -----------------------------------------------------------------------------------------------

/// An AMT engine at this speed, held by the node's own governor.
fn governed(rpm: u32) -> World {
    governed_by(Governor::DEFAULT, rpm)
}

fn governed_by(governor: Governor, rpm: u32) -> World {
    let mut world = World::one(amt(|config, _| config.supervision.governor = Some(governor)));
    world.start(Rc);
    world.streams(Rc, run_rpm(rpm));
    world.pass_s(40.0);
    assert!((world.rpm() - f64::from(rpm)).abs() < 1500.0, "{} rpm", world.rpm());
    world
}

fn most_throttle(world: &World, since: Nanos) -> f64 {
    world.sent(since).filter_map(Frame::throttle).max().map_or(0.0, |tenths| f64::from(tenths) / 10.0)
}

#[test]
fn speed_that_no_engine_has_does_not_take_the_governor_to_full_throttle() {
    let most = |max_rpm| {
        let max_rpm = Rpm::new(max_rpm);
        let mut world = governed_by(Governor { max_rpm, ..Governor::DEFAULT }, 70_000);
        let from = world.now();
        world.streams(Rc, run_rpm(u32::MAX));
        world.pass_s(20.0);
        most_throttle(&world, from)
    };
    let most_below = most(100_000);
    assert!(most_below < 95.0, "{most_below} %");
    // This engine has 108 500 rpm at full throttle: it cannot reach a higher maximum.
    assert!(most(110_000) > 98.0, "the control");
}

#[test]
fn governor_does_not_open_the_throttle_against_a_shaft_that_falls_after_a_flame_out() {
    let mut world = governed(80_000);
    let from = world.now();
    let before = most_throttle(&world, from - SECOND);
    world.turbine(|turbine| turbine.flame_out());
    world.pass_s(10.0);
    let most = most_throttle(&world, from);
    assert!(most <= before + 5.0, "from {before} % to {most} %");
}

#[test]
fn governor_holds_a_speed() {
    let mut world = governed(70_000);
    world.streams(Rc, run_rpm(85_000));
    world.pass_s(40.0);
    assert!((world.rpm() - 85_000.0).abs() < 1500.0, "{} rpm", world.rpm());
}

// -----------------------------------------------------------------------------------------------
// Finding 14: the exhaust at -50 °C
// -----------------------------------------------------------------------------------------------

fn ignitions_with(mut world: World, sensor: EgtSensor) -> usize {
    world.ready(Rc);
    world.turbine(|turbine| turbine.set_egt_sensor(sensor));
    world.pass_s(3.0);
    ignitions_after_run(&mut world)
}

#[test]
fn exhaust_at_minus_50_degrees_is_not_known_to_be_cool() {
    for world in both() {
        assert_eq!(ignitions_with(world, EgtSensor::Short), 0);
    }
}

#[test]
fn exhaust_with_an_open_sensor_is_not_known_to_be_cool() {
    for world in both() {
        assert_eq!(ignitions_with(world, EgtSensor::Open), 0);
    }
}

#[test]
fn exhaust_at_15_degrees_is_cool() {
    for world in both() {
        assert_eq!(ignitions_with(world, EgtSensor::Good), 1);
    }
}

// -----------------------------------------------------------------------------------------------
// Finding 14: another ECU on the line
// -----------------------------------------------------------------------------------------------

/// Every supply voltage that is reported in the 3 s after the link to this ECU came up, in mV. Its supply has 11 100 mV.
fn voltages_of(world: &mut World) -> Vec<u32> {
    let mut voltages = Vec::new();
    for _ in 0..300 {
        world.pass_s(0.01);
        let supply = world.handle(0).telemetry().report.supply;
        let new = supply.filter(|supply| supply.at.as_micros() * 1000 + SECOND / 100 > world.now());
        voltages.extend(new.and_then(|supply| supply.value.voltage).map(|voltage| voltage.get()));
    }
    voltages
}

/// Version 3 gives its voltages in 0.1 V, version 5 in 0.2 V (ZK-6).
fn scale_after_a_swap(from: u8, to: u8) {
    // ID 2 is due soon after the boot; ID 6, with the version, comes last.
    let other = zk(to, |_, ecu| ecu.ids = vec![1, 2, 3, 4, 5, 2, 1, 2, 3, 4, 5, 2, 6]).1;
    let mut world = World::one(zk(from, |_, _| {}));
    world.streams(Rc, Standby);
    world.pass_s(3.0);
    world.power(false);
    world.pass_s(5.0);
    world.plugs[0].replace_ecu(other);
    let voltages = voltages_of(&mut world);
    assert!(!voltages.is_empty());
    for voltage in voltages {
        assert!(voltage.abs_diff(11_100) <= 200, "{voltage} mV of a supply with 11100 mV");
    }
}

#[test]
fn version_of_the_zk_ecu_before_does_not_scale_the_voltages_of_the_next() {
    scale_after_a_swap(5, 3);
    scale_after_a_swap(3, 5);
}

#[test]
fn voltages_of_the_same_zk_version_are_right_after_a_swap() {
    scale_after_a_swap(5, 5);
    scale_after_a_swap(3, 3);
}

// -----------------------------------------------------------------------------------------------
// Finding 14: debouncing
// -----------------------------------------------------------------------------------------------

/// Two sets that report running release the demand: the reply to the third one moves at the latest.
#[test]
fn two_reports_of_a_running_amt_engine_release_the_demand() {
    let mut world = World::one(amt(|_, _| {}));
    world.ready(Rc);
    world.streams(Rc, run(0));
    world.until("it starts", 20.0, |world| world.phase().is_starting());
    world.streams(Rc, run(100));
    world.until("it runs", 100.0, |world| world.phase() == Phase::Running);
    let running = world.now();
    world.pass_s(5.0);
    let moved = world.sent(running).find(|frame| frame.throttle() > Some(0)).expect("it moves").at;
    // Three sets of 125 ms, and 25 ms for the last one to be sent.
    let late = moved - running;
    assert!(late < 3 * 125 * MILLIS + 30 * MILLIS, "{:.3} s", seconds(late));
}

/// Status ID 1 of an engine at rest: this state and error, 26 °C, the switch at standby.
fn report(state: u8, error: u8) -> [u8; 7] {
    let [a, b, c, d, e, f] = [0xF1, 0, 0, state | (error & 7) << 5, 1 << 5 | error >> 3, 76];
    [a, b, c, d, e, f, crc8(&[a, b, c, d, e, f])]
}

/// Number of reports after one of the ECU's own, before its next one.
fn inject(world: &mut World, report: [u8; 7], count: usize) {
    world.until("status ID 1", 5.0, |world| {
        let phase = world.handle(0).telemetry().report.phase;
        phase.is_some_and(|phase| phase.at.as_micros() * 1000 + SECOND / 50 > world.now())
    });
    for _ in 0..count {
        world.plugs[0].inject_to_node(&report);
    }
    world.pass_s(0.02 + 0.008 * count as f64);
}

/// Result of a start after this number of reports of a low voltage. One in 256 frames that noise forms passes its CRC.
fn start_after_fault_reports(count: usize) -> Result<Accepted, Rejected> {
    let mut world = World::one(zk(5, |_, _| {}));
    world.ready(Rc);
    inject(&mut world, report(1, 2), count);
    world.command(Rc, run(0))
}

#[test]
fn one_odd_report_of_a_fault_does_not_refuse_the_start_of_a_zk_engine() {
    assert_eq!(start_after_fault_reports(1), Ok(Accepted::InForce));
}

#[test]
fn two_reports_of_a_fault_refuse_the_start_of_a_zk_engine() {
    assert_eq!(start_after_fault_reports(2), Err(Rejected::Start(Interlock::Fault)));
    assert_eq!(start_after_fault_reports(0), Ok(Accepted::InForce));
}

/// The state of an engine at 60 % after this number of reports of standby.
fn state_after_reports_of_standby(count: usize) -> EngineState {
    let mut world = World::one(zk(5, |_, _| {}));
    world.fly(Rc, 60);
    inject(&mut world, report(1, 0), count);
    world.handle(0).telemetry().state
}

#[test]
fn one_odd_report_does_not_change_the_state_of_a_zk_engine() {
    assert_eq!(state_after_reports_of_standby(1), EngineState::Running);
}

#[test]
fn two_reports_change_the_state_of_a_zk_engine() {
    assert_ne!(state_after_reports_of_standby(2), EngineState::Running);
    assert_eq!(state_after_reports_of_standby(0), EngineState::Running);
}
