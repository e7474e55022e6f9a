//! Arming by the vehicle's heartbeats: whose engine `MAV_DISARM_STBY` shuts down, and what counts as armed after an emergency stop.

use super::world::*;
use crate::ids::*;
use crate::settings::{Identity, NodeSettings};
use embassy_time::Duration;
use jetlink::command::{Command, Demand, Origin};
use jetlink::engine::state::EngineState;
use jetlink::units::Throttle;

/// Time of `MAV_DISARM_STBY`, in ms; −1: off.
const OFF: f32 = -1.0;
const AFTER: f32 = 5_000.0;

fn throttle(tenths: u16) -> Command {
    Command::Run(Demand::Throttle(Throttle::from_tenths(tenths).unwrap()))
}

/// A radio pilot flies an engine that MAVLink has started, and the autopilot shows disarmed: the pilot's engine runs on. One that MAVLink
/// flies is shut down.
#[test]
fn disarmed_stops_no_engine_that_another_source_flies() {
    for (after, flies, runs_on) in [(OFF, true, true), (AFTER, true, true), (AFTER, false, false)] {
        run(async |world| {
            world.ready().await;
            assert_eq!(world.set(ENGINE[1], "MAV_DISARM_STBY", after).await.0, Some(after));
            let radio = world.node.owners()[1].source(Origin::Rc).unwrap();
            let fly = async |seconds: u32| {
                for _ in 0..20 * seconds {
                    if flies {
                        let _ = radio.command(throttle(600));
                    }
                    world.pass_s(0.05).await;
                }
            };
            world.start(1).await;
            fly(10).await;
            let by = if flies { Origin::Rc } else { Origin::Mavlink };
            assert_eq!(world.telemetry(1).active_source, by);
            world.plane.armed.set(false);
            fly(10).await;
            assert_eq!(world.ordered(1).is_some(), runs_on, "after {after} ms, flown by {by}");
        });
    }
}

/// An engine that was found running is left alone until the vehicle is armed, also by `MAV_DISARM_STBY`.
#[test]
fn disarmed_stops_no_engine_that_was_found_running() {
    for after in [OFF, AFTER] {
        run_beside_a_running_engine(async |world| {
            world.until("found", 60, || world.ordered(1).is_some()).await;
            assert_eq!(world.set(ENGINE[1], "MAV_DISARM_STBY", after).await.0, Some(after));
            assert_eq!(world.telemetry(1).active_source, Origin::Node);
            world.pass_s(20.0).await;
            assert!(world.ordered(1).is_some(), "after {after} ms");
        });
    }
}

/// An emergency stop and its release, and a vehicle that has been armed all the time: it has to show disarmed first, also if it was not
/// received before.
#[test]
fn after_a_stop_a_vehicle_that_appears_armed_has_to_disarm_first() {
    for (received_before, disarms) in [(true, false), (false, false), (false, true)] {
        let identity = Identity { system: SYSTEM, ..Identity::DEFAULT };
        run_with(NodeSettings { identity, ..NodeSettings::DEFAULT }, async |world| {
            world.plane.armed.set(true);
            world.plane.heartbeats.set(received_before);
            world.until("standby", 30, || world.telemetry(1).state == EngineState::Standby).await;
            world.pass_s(5.0).await;
            assert_eq!(world.command(ENGINE[1], CMD_USER_1, &[1.0, 21196.0]).await.0, ACCEPTED);
            world.pass_s(2.0).await;
            assert_eq!(world.command(ENGINE[1], CMD_USER_1, &[2.0, 21196.0]).await.0, ACCEPTED);
            world.plane.heartbeats.set(true);
            world.plane.every.set(Some(Duration::from_millis(25)));
            world.pass_s(20.0).await;
            if disarms {
                world.plane.armed.set(false);
                world.pass_s(5.0).await;
                world.plane.armed.set(true);
                world.pass_s(5.0).await;
            }
            let (answer, texts) = world.control(1, &[1.0]).await;
            let expected = if disarms { ACCEPTED } else { NOT_NOW };
            assert_eq!(answer, expected, "received before: {received_before}, disarms: {disarms}: {texts}");
        });
    }
}
