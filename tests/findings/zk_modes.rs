//! Findings 10 and 11: which of the three modes of ZK-9 an ECU may be commanded in. Run by ID 6 needs a version that two
//! reports agree on; an emergency stop needs nothing.

use crate::wire::{Frame, Sent};
use crate::world::*;
use jetlink::command::Command;
use jetlink::ecu::{EcuConfig, Service, zk as zk_ecu};
use sim::ecu::{MILLIS, SECOND};
use sim::turbine::Phase;
use sim::wire::Direction;
use sim::zk::{Action, Sw, ZkCommand, crc8};

/// Status ID 6 of an engine with 160 000 rpm at most: this protocol version, 20 Hz.
fn identity(version: u8) -> [u8; 7] {
    let [a, b, c, d, e, f] = [0xF6, 0, 0, 160, 24, version << 2];
    [a, b, c, d, e, f, crc8(&[a, b, c, d, e, f])]
}

/// An engine whose switch is to be sent in ID 6 where the ECU supports that.
fn split(version: u8) -> World {
    World::one(zk(version, |config, _| {
        if let EcuConfig::Zk(zk) = &mut config.ecu {
            zk.split_switch = true;
        }
    }))
}

fn by_id_6(world: &World, switch: Sw) -> usize {
    let is = |frame: &&Frame| matches!(frame.sent, Sent::Zk(ZkCommand::Switch { sw, .. }) if sw == switch);
    world.sent(0).filter(is).count()
}

/// Frames a second of ID 1 with run, over the last 5 s.
fn rate_of_run(world: &World) -> f64 {
    let from = world.now() - 5 * SECOND;
    world.sent(from).filter(|frame| frame.throttle().is_some()).count() as f64 / 5.0
}

/// One frame that reports version 4, among noise before the ECU's own.
#[test]
fn one_false_report_of_version_4_does_not_make_run_go_by_id_6() {
    // Before the first ID 6 of its own, and after it.
    for after in [0.0, 0.75] {
        let mut world = split(3);
        world.pass_s(after);
        world.plugs[0].inject_to_node(&identity(4));
        world.fly(Rc, 60);
        assert_eq!(by_id_6(&world, Sw::Run), 0, "version 3 has no ID 6");
        let rate = rate_of_run(&world);
        assert!(rate > 19.0, "ID 1 goes out {rate} times a second of 20");
        // It ends when it is sent standby, by ID 1.
        world.streams(Rc, Standby);
        world.pass_s(1.0);
        assert!(!world.phase().is_live());
    }
}

/// With a wire that is broken at first, the switch follows so late that the host may assume another mode; and one frame
/// reports version 4.
#[test]
fn switch_that_follows_late_does_not_make_run_of_a_version_3_ecu_go_by_id_6() {
    let mut world = World::one(zk(3, |_, _| {}));
    world.plugs[0].cut_one(Direction::ToEcu, true);
    world.streams(Rc, Standby);
    world.plugs[0].inject_to_node(&identity(4));
    // The ECU itself is silent while it receives nothing.
    for _ in 0..20 {
        world.plugs[0].inject_to_node(&stop_report());
        world.pass_s(0.2);
    }
    world.plugs[0].cut_one(Direction::ToEcu, false);
    world.fly(Rc, 60);
    assert_eq!(by_id_6(&world, Sw::Run), 0, "version 3 has no ID 6");
    assert!(rate_of_run(&world) > 19.0);
}

/// Status ID 1: stop, no error, 26 °C, the switch at stop.
fn stop_report() -> [u8; 7] {
    let [a, b, c, d, e, f] = [0xF1, 0, 0, 0, 0, 76];
    [a, b, c, d, e, f, crc8(&[a, b, c, d, e, f])]
}

#[test]
fn run_goes_by_id_6_where_version_4_is_known() {
    for version in [4, 5, 6] {
        let mut world = split(version);
        world.fly(Rc, 60);
        assert!(by_id_6(&world, Sw::Run) > 100);
        world.streams(Rc, Standby);
        world.pass_s(1.0);
        assert!(!world.phase().is_live());
    }
}

#[test]
fn run_goes_by_id_1_at_every_send_slot_where_the_version_is_3() {
    let mut world = split(3);
    world.fly(Rc, 60);
    assert_eq!(by_id_6(&world, Sw::Run), 0);
    assert!(rate_of_run(&world) > 19.0);
}

/// Another ECU took the place of one that supported ID 6: what was known about the old one is no longer
/// valid.
#[test]
fn run_does_not_go_by_id_6_to_an_older_ecu_that_took_the_place_of_one_of_version_4() {
    let mut world = split(4);
    world.fly(Rc, 60);
    world.streams(Rc, Standby);
    world.until("cool", 300.0, |world| world.phase() == Phase::Standby);
    world.plugs[0].replace_ecu(zk(3, |_, _| {}).1);
    let from = world.now();
    world.fly(Rc, 60);
    let late = |frame: &&Frame| frame.is_id_6() && frame.is_run();
    assert_eq!(world.sent(from).filter(late).count(), 0, "version 3 has no ID 6");
    assert!(rate_of_run(&world) > 19.0);
}

/// An ECU of version 5 that never reports its version itself, and for which this number of version reports
/// was received.
fn version_received(times: usize) -> World {
    let mut world = World::one(zk(5, |_, ecu| ecu.ids = vec![1, 2, 3, 8]));
    world.start(Rc);
    for _ in 0..times {
        world.plugs[0].inject_to_node(&identity(5));
        world.pass_s(0.1);
    }
    world
}

/// ID 6 or ID 7 on the wire within 3 s of a demand for a speed.
fn speed_goes_out(mut world: World) -> bool {
    let from = world.now();
    world.streams(Rc, run_rpm(110_000));
    world.pass_s(3.0);
    world.sent(from).any(|frame| matches!(frame.sent, Sent::Zk(ZkCommand::Switch { .. } | ZkCommand::Rpm(_))))
}

#[test]
fn one_report_of_a_version_allows_no_speed() {
    assert!(!speed_goes_out(version_received(1)), "one frame allowed ID 6 and 7");
}

#[test]
fn two_reports_of_a_version_allow_a_speed() {
    assert!(speed_goes_out(version_received(2)));
}

/// The pump is opened for a long time from version 5 on.
fn pump_command_goes_out(times: usize) -> bool {
    let mut world = World::one(zk(5, |_, ecu| ecu.ids = vec![1, 2, 3, 8]));
    world.ready(Rc);
    for _ in 0..times {
        world.plugs[0].inject_to_node(&identity(5));
        world.pass_s(0.1);
    }
    let from = world.now();
    let _ = world.command(Rc, service(zk_ecu::codec::Action::OpenPump));
    world.pass_s(3.0);
    world.sent(from).any(|frame| frame.is_action(Action::OpenPump))
}

fn service(action: zk_ecu::codec::Action) -> Command {
    Command::Service(Service::Zk(zk_ecu::config::Service::Action(action)))
}

#[test]
fn one_report_of_a_version_allows_no_service_of_that_version() {
    assert!(!pump_command_goes_out(1), "one frame allowed the pump to be opened");
}

#[test]
fn two_reports_of_a_version_allow_a_service_of_that_version() {
    assert!(pump_command_goes_out(2));
}

/// After a reset that nothing survived, with nothing received, a stop goes out in every mode.
#[test]
fn emergency_stop_reaches_an_ecu_in_rpm_mode_where_nothing_is_known() {
    for version in [4, 5] {
        let mut world = World::one(zk(version, |_, _| {}));
        world.start(Rc);
        world.streams(Rc, run_rpm(110_000));
        world.pass_s(8.0);
        world.silent(Rc);
        world.plugs[0].cut_one(Direction::ToNode, true);
        world.halt();
        world.forget();
        world.reset();
        world.pass_s(0.3);
        assert_eq!(world.phase(), Phase::Running);
        world.command(Rc, EmergencyStop).expect("never refused");
        let stop = world.now();
        world.pass_s(1.0);
        assert!(!world.phase().is_live(), "{:?} 1 s after the stop", world.phase());
        // At every send slot.
        world.pass_s(9.0);
        let stops = world.sent(stop + 100 * MILLIS).filter(|frame| frame.is_stop()).count();
        assert!(stops >= 190, "{stops} stops in 10 s at 20 Hz");
    }
}
