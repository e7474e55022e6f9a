//! Findings 2, 3, 5 and 12: a start is a permission of one source that is used once, and a command given only once or long
//! ago neither starts an engine nor shuts one down.

use crate::world::*;
use sim::amt::error;
use sim::ecu::MILLIS;
use sim::turbine::Phase;

/// Both kinds of ECU.
fn both() -> [World; 2] {
    [World::one(zk(5, |_, _| {})), World::one(amt(|_, _| {}))]
}

/// An engine that ran and is hot, in standby.
fn shut_down(world: &mut World) {
    world.fly(Rc, 60);
    world.streams(Rc, Standby);
    world.pass_s(5.0);
    assert!(world.egt() > 300.0 && !world.phase().is_live());
}

// -----------------------------------------------------------------------------------------------
// Finding 2
// -----------------------------------------------------------------------------------------------

#[test]
fn run_refused_while_cooling_does_not_start_the_engine_when_it_has_cooled() {
    for mut world in both() {
        shut_down(&mut world);
        let from = world.now();
        world.streams(Rc, run(0));
        world.pass_s(400.0);
        world.assert_ignitions(1);
        assert!(world.egt() < 100.0, "it has cooled");
        world.assert_not_sent_run(from);
        world.starts_again(Rc);
    }
}

/// An ECU that does not cool its engine: the shaft is stopped, and the exhaust is hot.
#[test]
fn run_refused_as_too_hot_does_not_start_the_engine_when_it_has_cooled() {
    let mut world = World::one(amt(|_, ecu| ecu.turbine.cooling_rpm = 0.0));
    shut_down(&mut world);
    world.until("a shaft at rest", 60.0, |world| world.rpm() < 1.0);
    world.pass_s(2.0);
    assert!(world.egt() > 150.0, "{}", world.egt());
    world.streams(Rc, run(0));
    world.pass_s(700.0);
    world.assert_ignitions(1);
    assert!(world.egt() < 100.0, "it has cooled");
    world.starts_again(Rc);
}

#[test]
fn run_refused_as_not_armed_does_not_start_the_engine_when_another_source_arms() {
    for mut world in both() {
        world.ready(Rc);
        world.command(Rc, Disarm).expect("always accepted");
        let from = world.now();
        world.streams(Rc, run(0));
        world.pass_s(3.0);
        world.assert_ignitions(0);
        world.command(Mavlink, Arm).expect("always accepted");
        world.pass_s(60.0);
        world.assert_ignitions(0);
        world.assert_not_sent_run(from);
        world.starts_again(Rc);
    }
}

#[test]
fn run_refused_for_a_fault_does_not_start_the_zk_engine_when_the_fault_clears() {
    let mut world = World::one(zk(5, |_, _| {}));
    world.ready(Rc);
    // Voltage low.
    world.zk(|ecu| ecu.set_error(Some(2)));
    world.pass_s(2.0);
    let from = world.now();
    world.streams(Rc, run(0));
    world.pass_s(20.0);
    world.zk(|ecu| ecu.set_error(None));
    world.pass_s(60.0);
    world.assert_ignitions(0);
    world.assert_not_sent_run(from);
    world.starts_again(Rc);
}

#[test]
fn run_refused_for_a_fault_does_not_start_the_amt_engine_when_the_fault_clears() {
    let mut world = World::one(amt(|_, _| {}));
    world.ready(Rc);
    world.amt(|ecu| ecu.set_errors(error::SUPPLY_LOW));
    world.pass_s(2.0);
    let from = world.now();
    world.streams(Rc, run(0));
    world.pass_s(20.0);
    world.amt(|ecu| ecu.set_errors(0));
    world.pass_s(60.0);
    world.assert_ignitions(0);
    world.assert_not_sent_run(from);
    world.starts_again(Rc);
}

#[test]
fn run_refused_above_idle_does_not_start_the_engine_when_the_stick_comes_down() {
    for mut world in both() {
        world.ready(Rc);
        world.streams(Rc, run(30));
        world.pass_s(3.0);
        world.streams(Rc, run(0));
        world.pass_s(60.0);
        world.assert_ignitions(0);
        world.starts_again(Rc);
    }
}

/// Two engines, of which one starts at a time.
fn group() -> World<2> {
    let mut right = zk(5, |_, _| {});
    right.0.port = 1;
    World::new([amt(|_, _| {}), right])
}

fn ignitions_of(world: &World<2>, engine: usize) -> usize {
    world.turbine_of(engine, |turbine| turbine.history().ignitions.len())
}

#[test]
fn start_that_waits_for_another_engine_begins_when_that_one_runs() {
    let mut world = group();
    world.ready(Rc);
    world.streams(Rc, run(0));
    world.until("the first one runs", 60.0, |world| {
        world.turbine_of(0, |turbine| turbine.phase() == Phase::Running)
    });
    assert_eq!(ignitions_of(&world, 1), 0, "one at a time");
    world.until("the second one runs", 60.0, |world| {
        world.turbine_of(1, |turbine| turbine.phase() == Phase::Running)
    });
}

#[test]
fn start_that_waits_for_another_engine_is_over_when_its_source_is_lost() {
    let mut world = group();
    world.ready(Rc);
    world.streams(Rc, run(0));
    world.pass_s(5.0);
    // RC keeps commanding the first one.
    world.streams_to(0, Rc, run(0));
    world.silence(1, Rc);
    world.pass_s(5.0);
    world.streams_to(1, Rc, run(0));
    world.pass_s(100.0);
    assert_eq!(world.turbine_of(0, |turbine| turbine.phase()), Phase::Running);
    assert_eq!(ignitions_of(&world, 1), 0);
    // Its own standby, then run.
    world.streams_to(1, Rc, Standby);
    world.pass_s(3.0);
    world.streams_to(1, Rc, run(0));
    world.pass_s(60.0);
    assert_eq!(ignitions_of(&world, 1), 1);
}

// -----------------------------------------------------------------------------------------------
// Finding 3
// -----------------------------------------------------------------------------------------------

#[test]
fn standby_of_one_source_and_run_of_another_do_not_start() {
    for mut world in both() {
        world.start(Rc);
        world.streams(Mavlink, run(0));
        world.pass_s(10.0);
        world.streams(Rc, Standby);
        world.until("cool", 300.0, |world| world.phase() == Phase::Standby && world.egt() < 80.0);
        world.pass_s(5.0);
        let from = world.now();
        world.silent(Rc);
        world.pass_s(120.0);
        world.assert_ignitions(1);
        world.assert_not_sent_run(from);
        // Its own standby, then its own run.
        world.starts_again(Mavlink);
    }
}

#[test]
fn standby_of_a_lost_source_does_not_serve_the_run_of_a_lower_one() {
    for mut world in both() {
        world.ready(Rc);
        world.silent(Rc);
        world.pass_s(3.0);
        world.streams(Mavlink, run(0));
        world.pass_s(60.0);
        world.assert_ignitions(0);
        world.starts_again(Mavlink);
    }
}

// -----------------------------------------------------------------------------------------------
// Finding 5
// -----------------------------------------------------------------------------------------------

/// After its last command a source counts as lost after 0.5 s; the demand is held for 1 s; then the fail-safe stage, which
/// runs out 10 s later.
const STAGES: f64 = 0.5 + 1.0 + 10.0;

/// An AMT ECU that requires the stick up for a start, and so never starts here.
fn never_starts() -> World {
    World::one(amt(|_, ecu| ecu.start_throttle = 100))
}

#[test]
fn start_of_an_engine_at_rest_ends_when_the_stages_of_loss_of_its_source_have_run_out() {
    for fresh in [0.3, 30.0] {
        let mut world = never_starts();
        world.ready(Rc);
        world.streams(Rc, run(0));
        world.pass_s(fresh);
        // As long as its source is fresh, the start continues.
        assert!(world.sent(world.now() - 300 * MILLIS).any(|frame| frame.is_run()));
        world.silent(Rc);
        world.pass_s(STAGES + 1.0);
        let over = world.now();
        world.pass_s(120.0);
        world.assert_not_sent_run(over);
        assert!(world.sent(over).all(|frame| frame.is_stop()));
    }
}

#[test]
fn disarm_ends_a_start_of_an_engine_at_rest() {
    let mut world = never_starts();
    world.ready(Rc);
    let from = world.now();
    world.streams(Rc, run(0));
    world.pass_s(3.0);
    assert!(world.sent(from).any(|frame| frame.is_run()));
    disarmed(&mut world);
}

#[test]
fn disarm_ends_a_start_of_an_engine_on_its_way_up() {
    for mut world in both() {
        world.ready(Rc);
        world.streams(Rc, run(0));
        world.until("the fuel ramp", 30.0, |world| world.phase() == Phase::FuelRamp);
        disarmed(&mut world);
        world.assert_ignitions(1);
        world.starts_again(Rc);
    }
}

/// Disarmed while the pilot keeps commanding run: standby from then on.
fn disarmed(world: &mut World) {
    world.command(Rc, Disarm).expect("always accepted");
    // A frame in transmission.
    world.pass_s(0.3);
    let from = world.now();
    world.pass_s(60.0);
    world.assert_not_sent_run(from);
    assert!(!world.phase().is_live());
}

#[test]
fn disarm_leaves_a_running_engine_alone() {
    for mut world in both() {
        world.fly(Rc, 60);
        let from = world.now();
        world.command(Rc, Disarm).expect("always accepted");
        world.pass_s(60.0);
        world.assert_not_shut_down(from);
        assert_eq!(world.throttle_sent(0), Some(600));
    }
}

// -----------------------------------------------------------------------------------------------
// Finding 12
// -----------------------------------------------------------------------------------------------

#[test]
fn rc_away_for_a_moment_while_mavlink_streams_standby_leaves_the_engine_running() {
    for away in [0.6, 1.7, 2.0] {
        for mut world in both() {
            world.fly(Rc, 60);
            world.streams(Mavlink, Standby);
            world.pass_s(5.0);
            let from = world.now();
            world.silent(Rc);
            world.pass_s(away);
            world.streams(Rc, run(60));
            world.pass_s(30.0);
            world.assert_not_shut_down(from);
            assert_eq!(world.throttle_sent(0), Some(600));
        }
    }
}

#[test]
fn mavlink_that_streams_standby_shuts_the_engine_down_when_rc_is_gone() {
    for mut world in both() {
        world.fly(Rc, 60);
        world.streams(Mavlink, Standby);
        world.pass_s(5.0);
        world.silent(Rc);
        // Lost after 0.5 s, held for 1 s, and 5 s at the fail-safe.
        world.pass_s(0.5 + 1.0 + 5.0 + 1.0);
        assert!(world.throttle_sent(0).is_none());
        assert!(!world.phase().is_live());
    }
}

#[test]
fn one_command_of_a_source_that_counts_as_lost_does_not_shut_the_engine_down() {
    for mut world in both() {
        world.fly(Rc, 60);
        world.streams(Mavlink, run(60));
        world.pass_s(1.0);
        world.silent(Rc);
        world.pass_s(10.0);
        let from = world.now();
        let _ = world.command(Rc, Standby);
        world.pass_s(30.0);
        world.assert_not_shut_down(from);
        assert_eq!(world.throttle_sent(0), Some(600));
    }
}

#[test]
fn one_command_among_others_does_not_shut_the_engine_down() {
    for mut world in both() {
        world.fly(Rc, 60);
        let from = world.now();
        let _ = world.command(Rc, Standby);
        world.pass_s(30.0);
        world.assert_not_shut_down(from);
        assert_eq!(world.throttle_sent(0), Some(600));
    }
}

#[test]
fn two_commands_of_the_source_in_control_shut_the_engine_down() {
    for mut world in both() {
        world.fly(Rc, 60);
        world.silent(Rc);
        let _ = world.command(Rc, Standby);
        world.pass_s(0.1);
        let _ = world.command(Rc, Standby);
        world.pass_s(1.0);
        assert!(world.throttle_sent(0).is_none());
        assert!(!world.phase().is_live());
    }
}

#[test]
fn gap_of_0_6_s_in_a_stream_does_not_lower_the_demand() {
    for mut world in both() {
        world.fly(Rc, 100);
        let from = world.now();
        world.silent(Rc);
        world.pass_s(0.6);
        world.streams(Rc, run(100));
        world.pass_s(20.0);
        let lowest = world.sent(from).filter_map(|frame| frame.throttle()).min();
        assert_eq!(lowest, Some(1000), "held for 1 s after the 0.5 s in which the source counts as fresh");
    }
}

#[test]
fn gap_of_10_s_in_a_stream_lowers_the_demand_to_idle() {
    for mut world in both() {
        world.fly(Rc, 100);
        let from = world.now();
        world.silent(Rc);
        world.pass_s(10.0);
        world.assert_not_shut_down(from);
        assert_eq!(world.throttle_sent(0), Some(0));
    }
}
