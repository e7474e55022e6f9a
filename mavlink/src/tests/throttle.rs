//! Throttle from the autopilot: what it moves, what it never starts, and the effect of its silence.

use super::world::*;
use crate::dialect::{HEARTBEAT_DATA, RC_CHANNELS_OVERRIDE_DATA};
use crate::frame::Address;
use crate::ids::{CMD_USER_1, MODE_ARMED};
use embassy_time::{Duration, Instant};
use jetlink::command::{Command, Demand, Order, Origin};
use jetlink::config::{EngineConfig, LinkSettings};
use jetlink::engine::state::EngineState;
use jetlink::event::LossStage;
use jetlink::line::Line;
use jetlink::units::Throttle;
use std::vec::Vec;

#[test]
fn arming_and_the_stream_start_nothing() {
    run(async |world| {
        world.ready().await;
        for pulse in [1000, 1100, 1500, 1900, 1100] {
            world.throttle(pulse);
            world.pass_s(10.0).await;
        }
        world.plane.armed.set(false);
        world.pass_s(5.0).await;
        world.plane.armed.set(true);
        world.pass_s(10.0).await;
        assert!((0..2).all(|engine| world.telemetry(engine).state == EngineState::Standby));
        assert!((0..2).all(|engine| world.ordered(engine).is_none()));
    });
}

#[test]
fn a_start_runs_at_idle_and_then_follows_the_throttle() {
    run(async |world| {
        world.ready().await;
        for engine in 0..2 {
            assert_eq!(world.control(engine, &[1.0]).await.0, Some(0), "engine {engine}");
            world.throttle(1500);
            while world.telemetry(engine).state != EngineState::Running {
                assert!(matches!(world.ordered(engine), None | Some(0)), "idle during the start");
                world.pass_s(0.1).await;
            }
            world.rises_to(engine, 500).await;
            world.throttle(IDLE_US);
            world.until("idle", 10, || world.ordered(engine) == Some(0)).await;
            world.pass_s(12.0).await;
        }
        // Pulse widths that are not accepted count as silence: the last demand is held, then the fail-safe throttle follows.
        world.throttle(1700);
        world.until("both", 10, || (0..2).all(|engine| world.ordered(engine) == Some(750))).await;
        world.throttle(0);
        world.pass_s(1.5).await;
        assert_eq!(world.telemetry(0).loss, LossStage::Hold);
        world.until("fail-safe throttle", 10, || (0..2).all(|engine| world.ordered(engine) == Some(0))).await;
        assert_eq!(world.telemetry(0).loss, LossStage::FailSafe);
        assert_eq!(world.telemetry(0).state, EngineState::Running);
        assert!(world.service.borrow().counters().demands_odd > 0);
    });
}

/// The throttle of output 3 is at idle. After a change of the source, it says nothing about the new one.
#[test]
fn a_start_is_judged_by_the_source_that_is_set_and_not_by_the_one_before() {
    run(async |world| {
        world.ready().await;
        let mut outputs = world.plane.outputs.get();
        outputs[4] = 0;
        world.plane.outputs.set(outputs);
        for (name, silent, driven) in [("MAV_THR_OUT", 5.0, 6.0), ("MAV_THR_SRC", 2.0, 1.0)] {
            assert_eq!(world.set(ENGINE[0], name, silent).await.0, Some(silent));
            let (answer, texts) = world.control(0, &[1.0]).await;
            assert!(answer == Some(1) && texts.contains("no throttle received"), "{name} {answer:?} {texts}");
            world.pass_s(6.0).await;
            assert_eq!(world.set(ENGINE[0], name, driven).await.0, Some(driven));
        }
        world.start(0).await;
    });
}

#[test]
fn disarmed_holds_at_idle_and_does_not_stop() {
    run(async |world| {
        world.ready().await;
        world.start(1).await;
        world.throttle(1500);
        world.until("half throttle", 10, || world.ordered(1) == Some(500)).await;
        world.plane.armed.set(false);
        world.until("idle", 10, || world.ordered(1) == Some(0)).await;
        world.pass_s(60.0).await;
        assert_eq!((world.telemetry(1).state, world.ordered(1)), (EngineState::Running, Some(0)));
        world.plane.armed.set(true);
        world.rises_to(1, 500).await;
    });
}

/// A demand that rises from idle after arming does not catch up after a gap of the stream that is no loss.
#[test]
fn a_demand_that_rises_after_arming_does_not_rise_in_a_gap_of_the_stream() {
    run(async |world| {
        world.ready().await;
        world.start(1).await;
        world.plane.armed.set(false);
        world.pass_s(3.0).await;
        world.throttle(1900);
        world.pass_s(1.0).await;
        assert_eq!(world.ordered(1), Some(0));
        world.plane.armed.set(true);
        world.until("it rises", 10, || world.ordered(1) >= Some(200)).await;
        world.throttle(0);
        world.pass_s(0.8).await;
        assert_eq!(world.telemetry(1).loss, LossStage::None);
        let before = world.ordered(1).unwrap();
        world.throttle(1900);
        world.until("it rises again", 2, || world.ordered(1) > Some(before)).await;
        // A frame may bring the rise of 0.1 s.
        assert!(world.ordered(1) <= Some(before + 50), "{before} to {:?}", world.ordered(1));
        world.rises_to(1, 1000).await;
    });
}

#[test]
fn standby_after_a_time_disarmed_is_a_setting() {
    run(async |world| {
        world.ready().await;
        let (echo, texts) = world.set(ENGINE[1], "MAV_DISARM_STBY", 20_000.0).await;
        assert_eq!(echo, Some(20_000.0), "{texts}");
        world.start(1).await;
        world.plane.armed.set(false);
        world.pass_s(19.0).await;
        assert_eq!(world.telemetry(1).state, EngineState::Running);
        world.until("standby", 5, || world.ordered(1).is_none()).await;
        // Armed again, it does not run again.
        world.plane.armed.set(true);
        world.pass_s(30.0).await;
        assert_eq!(world.ordered(1), None);
    });
}

/// A start that the bit allows takes longer than the time. The control: the engine still gets its standby, and so does the next start.
#[test]
fn a_start_while_disarmed_has_its_whole_time_once_the_engine_runs() {
    run(async |world| {
        world.ready().await;
        assert_eq!(world.set(ENGINE[1], "MAV_DISARM_STBY", 5_000.0).await.0, Some(5_000.0));
        world.plane.armed.set(false);
        world.pass_s(10.0).await;
        for start in ["first", "next"] {
            let (answer, texts) = world.control(1, &[1.0, 0.0, 0.0, 1.0]).await;
            assert_eq!(answer, ACCEPTED, "{start}: {texts}");
            world.until("it runs", 120, || world.telemetry(1).state == EngineState::Running).await;
            world.pass_s(4.0).await;
            assert_eq!(world.ordered(1), Some(0), "{start}");
            world.until("standby", 3, || world.ordered(1).is_none()).await;
            world.cold(1).await;
        }
    });
}

/// An autopilot that restarts in flight shows disarmed, and then hangs: silence does not extend the time disarmed. The control: it continues to show it.
#[test]
fn silence_does_not_count_as_time_disarmed() {
    for silent_after in [Some(4.0), Some(18.0), None] {
        run(async |world| {
            world.ready().await;
            assert_eq!(world.set(ENGINE[1], "MAV_DISARM_STBY", 20_000.0).await.0, Some(20_000.0));
            world.start(1).await;
            world.plane.armed.set(false);
            world.pass_s(silent_after.unwrap_or(0.0)).await;
            world.plane.alive.set(silent_after.is_none());
            world.pass_s(60.0).await;
            assert_eq!(world.ordered(1), silent_after.map(|_| 0), "silent after {silent_after:?} s");
            if silent_after.is_some() {
                // The time begins anew.
                world.plane.alive.set(true);
                world.pass_s(19.0).await;
                assert_eq!(world.ordered(1), Some(0));
                world.until("standby", 5, || world.ordered(1).is_none()).await;
            }
        });
    }
}

#[test]
fn a_dead_autopilot_leads_to_the_stages_of_loss_and_its_return_causes_no_jump() {
    run(async |world| {
        world.ready().await;
        world.start(1).await;
        world.throttle(1900);
        world.until("full throttle", 15, || world.ordered(1) == Some(1000)).await;
        world.plane.alive.set(false);
        world.pass_s(1.5).await;
        assert_eq!((world.telemetry(1).loss, world.ordered(1)), (LossStage::Hold, Some(1000)));
        world.until("fail-safe throttle", 10, || world.ordered(1) == Some(0)).await;
        world.pass_s(30.0).await;
        // It restarts: disarmed, its clock at 0, its throttle at full.
        world.plane.armed.set(false);
        world.plane.booted.set(Instant::now());
        world.plane.alive.set(true);
        let mut last = 0;
        for _ in 0..200 {
            world.pass_s(0.1).await;
            let ordered = world.ordered(1).unwrap();
            assert!(ordered <= last + 60, "from {last} to {ordered}");
            last = ordered;
        }
        assert_eq!(last, 0, "disarmed");
        world.plane.armed.set(true);
        world.rises_to(1, 1000).await;
        // It had forgotten the rate, which was requested again.
        let requests = world.plane.requests.borrow();
        assert!(requests.len() >= 2 && requests.iter().all(|(_, us)| *us == 25_000.0), "{requests:?}");
        let gaps: Vec<Duration> = requests.windows(2).map(|two| two[1].0 - two[0].0).collect();
        assert!(gaps.iter().all(|gap| *gap >= Duration::from_secs(5)), "{gaps:?}");
    });
}

/// The autopilot fails 4 s after its start, and returns with a clock that is past its old one, but 5 s late.
async fn restarts_early(world: &World<'_>) {
    world.plane.booted.set(Instant::now());
    world.pass_s(4.0).await;
    world.plane.alive.set(false);
    world.pass_s(5.0).await;
    world.plane.booted.set(world.plane.booted.get() + Duration::from_secs(5));
    world.plane.alive.set(true);
}

#[test]
fn an_autopilot_that_restarts_in_its_first_seconds_is_followed_again() {
    run(async |world| {
        world.ready().await;
        world.plane.armed.set(false);
        world.pass_s(3.0).await;
        restarts_early(world).await;
        world.pass_s(6.0).await;
        world.plane.armed.set(true);
        world.pass_s(3.0).await;
        world.start(1).await;
        world.throttle(1500);
        world.until("half throttle", 10, || world.ordered(1) == Some(500)).await;
    });
}

/// From an armed vehicle the same stream is one held back by a radio.
#[test]
fn a_stream_of_an_armed_vehicle_that_comes_late_from_a_gap_on_is_lost() {
    run(async |world| {
        world.ready().await;
        world.start(1).await;
        world.throttle(1500);
        restarts_early(world).await;
        world.pass_s(30.0).await;
        assert_eq!((world.telemetry(1).loss, world.ordered(1)), (LossStage::FailSafe, Some(0)));
    });
}

#[test]
fn other_vehicles_and_other_ports_move_nothing() {
    run(async |world| {
        world.ready().await;
        world.start(1).await;
        world.pass_s(3.0).await;
        let time = |us: u32| (Instant::now() - world.plane.booted.get()).as_micros() as u32 + us;
        for i in 0..100 {
            let full = outputs(time(i), [1900; 16]);
            for (port, system, component) in [
                (TO_AUTOPILOT, 7, 1),
                (TO_AUTOPILOT, SYSTEM, 2),
                (TO_AUTOPILOT, 255, 190),
                (TO_GROUND, SYSTEM, 1),
            ] {
                world.say(port, Address { system, component }, &full);
            }
            world.pass_s(0.02).await;
            assert_eq!(world.ordered(1), Some(0));
        }
        // The same frame of our own autopilot counts.
        world.throttle(1900);
        world.pass_s(0.2).await;
        assert!(world.ordered(1) > Some(0));
    });
}

/// A disarmed vehicle falls silent. Neither another vehicle arms it, nor another component, nor a heartbeat like its own on another port.
#[test]
fn other_vehicles_and_other_ports_arm_nothing() {
    run(async |world| {
        world.ready().await;
        world.plane.armed.set(false);
        world.until("disarmed", 5, || !world.telemetry(0).armed).await;
        world.plane.heartbeats.set(false);
        let armed = HEARTBEAT_DATA {
            custom_mode: 0,
            mavtype: 1,
            autopilot: 3,
            base_mode: MODE_ARMED,
            system_status: 4,
            mavlink_version: 3,
        };
        let arms = async |(port, system, component): (usize, u8, u8)| {
            for _ in 0..4 {
                world.say(port, Address { system, component }, &armed);
                world.pass_s(0.5).await;
            }
            world.telemetry(0).armed
        };
        for sender in [(TO_AUTOPILOT, 7, 1), (TO_AUTOPILOT, SYSTEM, 2), (TO_GROUND, SYSTEM, 1)] {
            assert!(!arms(sender).await, "{sender:?}");
        }
        assert!(arms((TO_AUTOPILOT, SYSTEM, 1)).await, "our own does");
    });
}

#[test]
fn rc_override_is_a_throttle_only_where_it_is_chosen() {
    run(async |world| {
        world.ready().await;
        let channels = |target_component: u8, pulse: u16| RC_CHANNELS_OVERRIDE_DATA {
            chan4_raw: pulse,
            target_system: SYSTEM,
            target_component,
            ..Default::default()
        };
        let send = async |from: Address, component: u8, pulse: u16| {
            for _ in 0..30 {
                world.say(TO_GROUND, from, &channels(component, pulse));
                world.pass_s(0.1).await;
            }
        };
        world.start(1).await;
        send(GROUND, ENGINE[1], 1900).await;
        assert_eq!(world.ordered(1), Some(0), "off by default");
        world.control(1, &[0.0]).await;
        world.cold(1).await;
        assert_eq!(world.set(ENGINE[1], "MAV_THR_SRC", 2.0).await.0, Some(2.0));
        send(GROUND, ENGINE[1], IDLE_US).await;
        assert_eq!(world.control(1, &[1.0]).await.0, Some(0));
        for _ in 0..20 {
            send(GROUND, ENGINE[1], IDLE_US).await;
        }
        assert_eq!(world.telemetry(1).state, EngineState::Running);
        send(GROUND, ENGINE[1], 1900).await;
        assert_eq!(world.ordered(1), Some(1000));
        // Frames from others, and frames addressed elsewhere, are silence.
        for (from, component) in [(Address { system: 7, component: 190 }, ENGINE[1]), (GROUND, 0)] {
            send(from, component, 1900).await;
            assert!(world.telemetry(1).loss != LossStage::None, "{from:?} to {component}");
            send(GROUND, ENGINE[1], 1900).await;
            assert_eq!(world.telemetry(1).loss, LossStage::None);
        }
        // While the settings are damaged, it is unknown whose throttle this is.
        world.service.borrow_mut().set_damaged(true);
        send(GROUND, ENGINE[1], 1900).await;
        assert!(world.telemetry(1).loss != LossStage::None);
    });
}

#[test]
fn a_relight_with_the_throttle_up_is_a_setting() {
    run(async |world| {
        world.ready().await;
        world.throttle(1500);
        world.pass_s(1.0).await;
        let (answer, text) = world.control(1, &[1.0]).await;
        assert_eq!(answer, Some(1));
        assert!(text.contains("throttle to idle first"), "{text}");
        assert_eq!(world.set(ENGINE[1], "MAV_RELIGHT", 1.0).await.0, Some(1.0));
        world.pass_s(6.0).await;
        assert_eq!(world.control(1, &[1.0]).await.0, Some(0));
        while world.telemetry(1).state != EngineState::Running {
            assert!(matches!(world.ordered(1), None | Some(0)), "idle during the start");
            world.pass_s(0.1).await;
        }
        world.rises_to(1, 500).await;
    });
}

/// Both engines have flamed out. The control: without the setting, `a_start_that_waits_is_refused_when_the_stream_rises`.
#[test]
fn a_relight_that_waits_for_another_engine_begins_at_idle_with_the_throttle_up() {
    run(async |world| {
        world.ready().await;
        for component in ENGINE {
            assert_eq!(world.set(component, "MAV_RELIGHT", 1.0).await.0, Some(1.0));
        }
        world.throttle(1500);
        world.pass_s(6.0).await;
        assert_eq!(world.control(0, &[1.0]).await.0, Some(0));
        assert_eq!(world.control(1, &[1.0]).await.0, Some(0));
        assert!(world.telemetry(1).start_waits_until.is_some());
        let end = Instant::now() + Duration::from_secs(200);
        while world.telemetry(1).state != EngineState::Running {
            assert!(matches!(world.ordered(1), None | Some(0)), "idle during the start");
            assert!(Instant::now() < end, "never started: {}", world.texts());
            world.pass_s(0.1).await;
        }
        world.rises_to(1, 500).await;
        assert_eq!(world.ordered(0), Some(500));
    });
}

#[test]
fn an_id_that_changes_in_flight_is_a_lost_source() {
    run(async |world| {
        world.ready().await;
        world.start(1).await;
        world.plane.system.set(9);
        world.throttle(1900);
        world.pass_s(20.0).await;
        assert_eq!((world.telemetry(1).loss, world.ordered(1)), (LossStage::FailSafe, Some(0)));
        assert_eq!(world.service.borrow().system_id(), Some(SYSTEM));
    });
}

/// ArduPlane's slow streams, as measured: 10 a second with gaps of 0.29 s do no harm; 1.25 a second with gaps of 2.1 s do.
#[test]
fn slow_streams_go_through_the_stages_of_loss_as_gaps_do() {
    run(async |world| {
        world.ready().await;
        world.start(1).await;
        world.throttle(1500);
        world.until("half throttle", 10, || world.ordered(1) == Some(500)).await;
        world.plane.every.set(Some(Duration::from_millis(290)));
        for _ in 0..200 {
            world.pass_s(0.1).await;
            assert_eq!((world.telemetry(1).loss, world.ordered(1)), (LossStage::None, Some(500)));
        }
        world.plane.every.set(Some(Duration::from_millis(2100)));
        let (mut lost, mut lowest) = (false, 1000);
        for _ in 0..400 {
            world.pass_s(0.1).await;
            lost |= world.telemetry(1).loss != LossStage::None;
            lowest = lowest.min(world.ordered(1).unwrap());
        }
        assert!(lost && world.telemetry(1).state == EngineState::Running);
        assert!(lowest < 500, "lowest {lowest}");
    });
}

#[test]
fn a_vehicle_that_was_learnt_is_known_at_once_after_a_reset_in_flight() {
    run(async |world| {
        world.ready().await;
        world.start(1).await;
        world.throttle(1500);
        world.until("half throttle", 10, || world.ordered(1) == Some(500)).await;
        world.restart_service();
        world.throttle(1300);
        world.until("the stream is followed", 3, || world.ordered(1) == Some(250)).await;
        world.restart_service();
        let (answer, texts) = world.command(ENGINE[1], CMD_USER_1, &[1.0, 21196.0]).await;
        assert_eq!(answer, Some(0), "an emergency stop: {texts}");
        assert!(world.telemetry(1).stop_latched);
        // Another vehicle is accepted from the node's next start, and not while ours is there.
        world.pass_s(40.0).await;
        let (answer, _) = world.command(ENGINE[1], CMD_USER_1, &[2.0, 21196.0]).await;
        assert_eq!(answer, Some(0));
        world.cold(1).await;
        assert_eq!(world.service.borrow().settings().identity.learnt, SYSTEM);
        world.plane.system.set(SYSTEM + 1);
        world.pass_s(30.0).await;
        assert_eq!(world.service.borrow().system_id(), Some(SYSTEM));
        assert_eq!(world.service.borrow().settings().identity.learnt, SYSTEM + 1);
        assert!(world.texts().contains("autopilot is system 4 from the next start"));
        world.restart_service();
        assert_eq!(world.service.borrow().system_id(), Some(SYSTEM + 1));
    });
}

/// PX4 as its source has it: a stream for each instance of its outputs, where a requested rate affects only the first, and 0 for an
/// output that is off.
#[test]
fn px4_sends_the_outputs_of_each_instance_and_the_engine_follows_its_own() {
    run(async |world| {
        let second = |pulse: u16| {
            let mut servo = [0; 16];
            servo[1] = pulse;
            world.plane.px4.set(Some(Some(servo)));
        };
        second(IDLE_US);
        world.ready().await;
        assert_eq!(world.set(ENGINE[1], "MAV_THR_OUT", 18.0).await.0, Some(18.0));
        // All outputs of the first instance are at full.
        world.throttle(1900);
        world.plane.outputs.set([1900; 16]);
        world.start(1).await;
        world.pass_s(5.0).await;
        assert_eq!(world.ordered(1), Some(0), "the first instance moves it");
        second(1500);
        world.until("it follows", 2, || world.ordered(1) == Some(500)).await;
        world.pass_s(5.0).await;
        assert_eq!(world.telemetry(1).loss, LossStage::None, "ten frames a second are enough");
        // PX4 sends 0 for an output that is off, and its frames continue.
        second(0);
        world.until("silence", 5, || world.telemetry(1).loss == LossStage::Hold).await;
        second(1500);
        world.until("it is there again", 20, || world.telemetry(1).loss == LossStage::None).await;
        world.rises_to(1, 500).await;
        // The second instance is gone, the first continues.
        world.plane.px4.set(Some(None));
        world.until("silence", 5, || world.telemetry(1).loss == LossStage::Hold).await;
        world.until("fail-safe throttle", 10, || world.ordered(1) == Some(0)).await;
        assert_eq!(world.telemetry(1).state, EngineState::Running);
        let requests = world.plane.requests.borrow();
        let close = requests.windows(2).filter(|pair| pair[1].0 - pair[0].0 < Duration::from_millis(4900));
        assert!(!requests.is_empty() && close.count() <= 1, "{requests:?}");
    });
}

/// "Two are received: a text, none is learnt." It goes out under the id of each of them, because the node has none. The control: with a single one
/// the node is silent until it has learnt it, which is not an error.
#[test]
fn of_two_autopilots_none_is_learnt_and_a_text_says_so() {
    for two in [true, false] {
        run(async |world| {
            let other = Address { system: SYSTEM + 1, component: 1 };
            for _ in 0..20 {
                world.pass_s(1.0).await;
                let beat = HEARTBEAT_DATA { mavtype: 1, autopilot: 3, ..Default::default() };
                if two {
                    world.say(TO_AUTOPILOT, other, &beat);
                }
            }
            assert_eq!(world.service.borrow().system_id(), (!two).then_some(SYSTEM));
            let (one, other) = (SYSTEM, SYSTEM + 1);
            let says = |one, other| {
                world
                    .texts()
                    .contains(&std::format!("two autopilots, systems {one} and {other}: set MAV_SYSID"))
            };
            assert_eq!(says(one, other) || says(other, one), two, "{}", world.texts());
            let from = |system: u8| {
                let frames = world.frames.borrow();
                frames
                    .iter()
                    .filter(|(_, port, frame)| *port == TO_AUTOPILOT && frame.from.system == system)
                    .count()
            };
            if two {
                assert!(
                    from(SYSTEM) > 0 && from(SYSTEM) == from(SYSTEM + 1),
                    "{} {}",
                    from(SYSTEM),
                    from(SYSTEM + 1)
                );
            }
        });
    }
}

#[test]
fn a_vehicle_that_is_received_beside_ours_is_not_learnt() {
    run(async |world| {
        world.ready().await;
        let other = Address { system: SYSTEM + 1, component: 1 };
        for _ in 0..30 {
            world.pass_s(1.0).await;
            let beat = HEARTBEAT_DATA { mavtype: 1, autopilot: 3, ..Default::default() };
            world.say(TO_AUTOPILOT, other, &beat);
        }
        assert_eq!(world.service.borrow().settings().identity.learnt, SYSTEM);
    });
}

/// Our autopilot restarts on the ground, and another vehicle is received meanwhile. The controls: ours never returns, and so was replaced; the
/// other one is still received beside ours, which is an error, and the vehicle that the node obeys stays.
#[test]
fn another_vehicle_is_no_longer_learnt_once_ours_is_received_again() {
    for (returns, stays) in [(true, false), (true, true), (false, true)] {
        run(async |world| {
            let learnt = || world.service.borrow().settings().identity.learnt;
            let other = async |seconds: u32, is_there: bool| {
                for _ in 0..seconds {
                    world.pass_s(1.0).await;
                    if is_there {
                        let from = Address { system: SYSTEM + 1, component: 1 };
                        let beat = HEARTBEAT_DATA { mavtype: 1, autopilot: 3, ..Default::default() };
                        world.say(TO_AUTOPILOT, from, &beat);
                    }
                }
            };
            world.ready().await;
            world.plane.alive.set(false);
            other(14, true).await;
            assert_eq!(learnt(), SYSTEM + 1);
            world.plane.alive.set(returns);
            other(4, stays).await;
            assert_eq!(learnt(), SYSTEM + 1, "not before 5 s");
            other(10, stays).await;
            let next = if returns { SYSTEM } else { SYSTEM + 1 };
            assert_eq!(learnt(), next, "returns: {returns}, stays: {stays}");
            let texts = world.texts();
            assert_eq!(texts.matches("two autopilots").count(), usize::from(returns && stays), "{texts}");
            world.restart_service();
            assert_eq!(world.service.borrow().system_id(), Some(next));
        });
    }
}

#[test]
fn disarmed_without_a_stream_the_engine_idles_and_does_not_go_to_its_fail_safe_throttle() {
    run(async |world| {
        world.ready().await;
        assert_eq!(world.set(ENGINE[1], "LOSS_THR", 400.0).await.0, Some(400.0));
        world.start(1).await;
        world.throttle(1700);
        world.until("75 %", 15, || world.ordered(1) == Some(750)).await;
        // Outputs without a pulse, while heartbeats come. The control: armed, that is a loss.
        world.throttle(0);
        world.until("fail-safe", 30, || world.ordered(1) == Some(400)).await;
        world.plane.armed.set(false);
        world.until("disarmed is idle", 30, || world.ordered(1) == Some(0)).await;
        world.pass_s(60.0).await;
        assert_eq!(world.ordered(1), Some(0));
        assert_eq!(world.telemetry(1).state, EngineState::Running);
        // Armed again, the stream moves it as before.
        world.plane.armed.set(true);
        world.throttle(1500);
        world.until("50 %", 30, || world.ordered(1) == Some(500)).await;
    });
}

#[test]
fn disarmed_holds_at_idle_over_a_restart_of_the_node() {
    run(async |world| {
        world.ready().await;
        world.start(1).await;
        world.plane.armed.set(false);
        world.pass_s(5.0).await;
        world.throttle(1700);
        world.pass_s(5.0).await;
        assert_eq!(world.ordered(1), Some(0));
        world.restart_service();
        for _ in 0..100 {
            world.pass_s(0.05).await;
            assert_eq!(world.ordered(1), Some(0));
        }
    });
}

/// In flight, with or without heartbeats: it is unknown yet whether the vehicle is armed, so the demand does not rise. It does not fall to
/// idle, either. Without heartbeats this lasts 3 s.
#[test]
fn an_engine_in_flight_keeps_its_throttle_over_a_restart_of_the_node() {
    for heartbeats in [true, false] {
        run(async |world| {
            world.ready().await;
            world.start(1).await;
            world.throttle(1500);
            world.until("50 %", 15, || world.ordered(1) == Some(500)).await;
            world.plane.heartbeats.set(heartbeats);
            world.restart_service();
            world.throttle(1700);
            for _ in 0..20 {
                world.pass_s(0.05).await;
                assert_eq!(world.ordered(1), Some(500), "held until it is known");
            }
            world.until("75 %", 5, || world.ordered(1) == Some(750)).await;
            assert_eq!(world.telemetry(1).loss, LossStage::None);
        });
    }
}

#[test]
fn a_vehicle_that_disarms_while_the_node_restarts_disarms_its_engines() {
    run(async |world| {
        world.ready().await;
        assert!((0..2).all(|engine| world.telemetry(engine).armed));
        world.plane.armed.set(false);
        world.restart_service();
        world.pass_s(10.0).await;
        assert!((0..2).all(|engine| !world.telemetry(engine).armed));
        // The control: an engine armed by another source stays armed.
        let radio = world.node.owners()[1].source(Origin::Rc).unwrap();
        radio.command(Command::Arm).unwrap();
        world.restart_service();
        world.pass_s(10.0).await;
        assert!(world.telemetry(1).armed);
    });
}

#[test]
fn a_vehicle_that_disarms_while_the_node_restarts_ends_a_start() {
    for disarms in [true, false] {
        run(async |world| {
            world.ready().await;
            assert_eq!(world.control(1, &[1.0]).await.0, Some(0));
            world.pass_s(0.5).await;
            world.plane.armed.set(!disarms);
            world.restart_service();
            world.pass_s(10.0).await;
            assert_eq!(world.ordered(1).is_none(), disarms);
        });
    }
}

/// It is unknown who ran it: its switch is at run, and the stream takes it over once the vehicle is armed.
#[test]
fn an_engine_that_is_found_running_without_memory_follows_the_stream_once_armed() {
    run_beside_a_running_engine(async |world| {
        world.until("found", 60, || world.ordered(1).is_some()).await;
        assert_eq!(world.telemetry(1).active_source, Origin::Node);
        world.pass_s(10.0).await;
        world.throttle(1500);
        world.pass_s(20.0).await;
        assert_ne!(world.ordered(1), Some(500), "not before the vehicle is armed");
        assert_eq!(world.telemetry(1).active_source, Origin::Node, "it is left alone");
        world.plane.armed.set(true);
        world.until("it follows the stream", 60, || world.ordered(1) == Some(500)).await;
        assert_eq!(world.telemetry(1).active_source, Origin::Mavlink);
    });
}

/// After a gap its order is given up, and it is found again without a source. Its previous source is known: radio control.
#[test]
fn an_engine_that_another_source_has_flown_is_not_taken_over_after_a_gap() {
    for by_radio in [true, false] {
        run(async |world| {
            assert_eq!(world.node.owners()[0].setup().configure_link(&quick()), Ok(()));
            world.ready().await;
            let radio = world.node.owners()[0].source(Origin::Rc).unwrap();
            let fly = async |seconds: u32| {
                for _ in 0..10 * seconds {
                    if by_radio {
                        let _ = radio.command(Command::Run(Demand::Throttle(Throttle::IDLE)));
                    }
                    world.pass_s(0.1).await;
                }
            };
            if by_radio {
                for _ in 0..30 {
                    radio.command(Command::Standby).unwrap();
                    world.pass_s(0.1).await;
                }
                let mut seconds = 0;
                while world.telemetry(0).state != EngineState::Running {
                    fly(1).await;
                    seconds += 1;
                    assert!(seconds < 120);
                }
                fly(5).await;
            } else {
                world.start(0).await;
            }
            // Its lines are interrupted for longer than the time that the node assumes for its ECU, and radio control is silent.
            world.left.cut(true);
            world.until("given up", 10, || world.telemetry(0).ordered.order == Order::Listen).await;
            world.left.cut(false);
            world.throttle(1500);
            world.until("found", 10, || world.ordered(0).is_some()).await;
            world.pass_s(30.0).await;
            assert_eq!(world.ordered(0) == Some(500), !by_radio, "{:?}", world.telemetry(0).ordered);
        });
    }
}

/// The node assumes that the ECU stops its turbine after 0.5 s without a reply.
fn quick() -> LinkSettings {
    let mut config = EngineConfig::amt("left", 0, Line::new(9600), None);
    assert!(config.change("AMT_SER_DELAY", 1000));
    LinkSettings::from(&config)
}
