//! Commands: who is obeyed, when an engine starts and stops, and what is answered.

use super::world::*;
use crate::dialect::*;
use crate::frame::Address;
use crate::ids::*;
use jetlink::command::{Command, Demand, Order, Origin};
use jetlink::engine::state::EngineState;
use jetlink::units::Throttle;

const UNSUPPORTED: Option<u8> = Some(3);
const USER: u16 = CMD_USER_1;

#[test]
fn each_condition_of_a_start_is_named() {
    run(async |world| {
        world.until("standby", 30, || world.telemetry(0).state == EngineState::Standby).await;
        world.until("learnt", 30, || world.service.borrow().system_id() == Some(SYSTEM)).await;
        world.pass_s(4.0).await;
        let (answer, text) = world.control(0, &[1.0]).await;
        assert_eq!(answer, NOT_NOW);
        assert!(text.contains("left: refused: arm the vehicle"), "{text}");
        world.plane.armed.set(true);
        world.throttle(1500);
        world.pass_s(8.0).await;
        let (answer, text) = world.control(0, &[1.0]).await;
        assert_eq!(answer, NOT_NOW);
        assert!(text.contains("bring the throttle to idle first"), "{text}");
        world.pass_s(1.0).await;
        let (answer, text) = world.control(0, &[1.0]).await;
        assert_eq!(answer, NOT_NOW);
        assert!(text.contains("this repeats a refused start"), "{text}");
        world.throttle(0);
        world.pass_s(6.0).await;
        let (answer, text) = world.control(0, &[1.0]).await;
        assert_eq!(answer, NOT_NOW);
        assert!(text.contains("no throttle received"), "{text}");
        world.throttle(IDLE_US);
        world.pass_s(6.0).await;
        // The refusals are forgotten: none of it starts anything later.
        assert_eq!(world.telemetry(0).ordered.order, Order::Standby);
        assert_eq!(world.control(0, &[1.0]).await.0, ACCEPTED);
        world.until("starting", 5, || matches!(world.telemetry(0).ordered.order, Order::Run(_))).await;
        world.pass_s(6.0).await;
        let (answer, text) = world.control(0, &[1.0]).await;
        assert_eq!(answer, NOT_NOW);
        assert!(text.contains("stop it first"), "{text}");
        assert!(matches!(world.telemetry(0).ordered.order, Order::Run(_)), "that cost nothing");
    });
}

#[test]
fn malformed_commands_are_denied() {
    run(async |world| {
        world.ready().await;
        for params in [
            &[1.0, 0.0, 5.0][..],
            &[1.0, 0.0, f32::NAN],
            &[2.0],
            &[-1.0],
            &[0.5],
            &[f32::NAN],
            &[f32::INFINITY],
            &[1.0, 7.0],
            &[1.0, 0.0, 0.0, 2.0],
            &[1.0, f32::NAN],
            &[1.0, 0.0, 0.0, f32::NAN],
        ] {
            assert_eq!(world.control(1, params).await.0, DENIED, "{params:?}");
            world.pass_s(1.0).await;
        }
        assert_eq!(world.telemetry(1).ordered.order, Order::Standby);
        for (component, command) in [
            (NODE, CMD_DO_ENGINE_CONTROL),
            (ENGINE[0], CMD_PREFLIGHT_REBOOT_SHUTDOWN),
            (ENGINE[0], 400),
            (NODE, 20),
            (NODE, 65_535),
        ] {
            assert_eq!(
                world.command(component, command, &[1.0]).await.0,
                UNSUPPORTED,
                "{component} {command}"
            );
        }
    });
}

/// What is unused may be anything. The control: `malformed_commands_are_denied` has starts with such values.
#[test]
fn a_stop_acts_whatever_its_other_fields_are() {
    for params in [
        &[0.0, f32::NAN][..],
        &[-0.0, 7.0],
        &[0.0, 0.0, f32::NAN],
        &[0.0, 0.0, 5.0],
        &[0.0, 0.0, 0.0, f32::NAN],
        &[0.0, 0.0, 0.0, 2.0],
        &[0.0, f32::NAN, f32::NAN, f32::NAN, f32::NAN, f32::NAN, f32::NAN],
    ] {
        run(async |world| {
            world.ready().await;
            assert_eq!(world.control(1, &[1.0]).await.0, ACCEPTED);
            assert!(matches!(world.telemetry(1).ordered.order, Order::Run(_)));
            assert_eq!(world.control(1, params).await.0, ACCEPTED, "{params:?}");
            assert_eq!(world.telemetry(1).ordered.order, Order::Standby, "{params:?}");
        });
    }
}

#[test]
fn only_what_is_addressed_to_us_is_obeyed() {
    run(async |world| {
        world.ready().await;
        world.start(1).await;
        let stop = [1.0, 21196.0];
        for target in
            [(SYSTEM, 0), (0, ENGINE[1]), (0, 0), (SYSTEM, 24), (SYSTEM, 28), (SYSTEM, 1), (7, ENGINE[1])]
        {
            for command in [USER, CMD_DO_FLIGHTTERMINATION, CMD_DO_ENGINE_CONTROL] {
                let params = if command == CMD_DO_ENGINE_CONTROL { [0.0, 0.0] } else { stop };
                let (answer, _) = world.command_from(TO_GROUND, GROUND, target, command, 0, &params).await;
                assert_eq!(answer, None, "{target:?} {command}");
            }
        }
        // Systems that may not command.
        for system in [7, 254, 0] {
            let from = Address { system, component: 190 };
            let target = (SYSTEM, ENGINE[1]);
            let (answer, text) = world.command_from(TO_GROUND, from, target, USER, 0, &stop).await;
            assert_eq!(answer, DENIED, "{system}: {text}");
        }
        assert!(world.texts().contains("system 7 may not command here"), "{}", world.texts());
        assert_eq!(world.telemetry(1).state, EngineState::Running);
        // The autopilot's own system may, and so may one that is set.
        let (answer, _) = world
            .command_from(TO_AUTOPILOT, AUTOPILOT, (SYSTEM, ENGINE[1]), CMD_DO_ENGINE_CONTROL, 0, &[0.0])
            .await;
        assert_eq!(answer, ACCEPTED);
        assert_eq!(world.telemetry(1).ordered.order, Order::Standby);
    });
}

#[test]
fn a_stop_acts_against_the_stream_and_only_a_command_starts_again() {
    run(async |world| {
        world.ready().await;
        for stop in [0, 1, 2] {
            world.start(1).await;
            world.throttle(1700);
            world.until("it follows", 10, || world.ordered(1) == Some(750)).await;
            match stop {
                0 => assert_eq!(world.control(1, &[0.0]).await.0, ACCEPTED),
                1 => assert_eq!(world.command(ENGINE[1], USER, &[3.0]).await.0, ACCEPTED),
                _ => {
                    let message = COMMAND_CANCEL_DATA {
                        command: CMD_DO_ENGINE_CONTROL,
                        target_system: SYSTEM,
                        target_component: ENGINE[1],
                    };
                    let at = world.frames.borrow().len();
                    world.say(TO_GROUND, GROUND, &message);
                    world.pass_s(0.2).await;
                    let frames = world.frames.borrow();
                    let ack = frames.iter().skip(at).find_map(|(_, _, frame)| match &frame.message() {
                        MavMessage::COMMAND_ACK(ack) => Some((ack.command, ack.result)),
                        _ => None,
                    });
                    assert_eq!(ack, Some((CMD_DO_ENGINE_CONTROL, Ack::Cancelled as u8)));
                }
            }
            assert_eq!(world.telemetry(1).ordered.order, Order::Standby);
            world.pass_s(20.0).await;
            assert_eq!(world.telemetry(1).ordered.order, Order::Standby, "the stream starts nothing");
            world.throttle(IDLE_US);
            world.cold(1).await;
        }
    });
}

#[test]
fn disarming_ends_a_start_and_the_bit_allows_one() {
    run(async |world| {
        world.ready().await;
        assert_eq!(world.control(1, &[1.0]).await.0, ACCEPTED);
        world.pass_s(1.0).await;
        world.plane.armed.set(false);
        world.until("the start ends", 5, || world.telemetry(1).ordered.order == Order::Standby).await;
        world.cold(1).await;
        assert_eq!(world.control(1, &[1.0]).await.0, NOT_NOW);
        world.pass_s(6.0).await;
        // Disarmed all the time: the bit allows it, and nothing ends it.
        assert_eq!(world.control(1, &[1.0, 0.0, 0.0, 1.0]).await.0, ACCEPTED);
        world.until("it runs", 120, || world.telemetry(1).state == EngineState::Running).await;
        world.pass_s(1.0).await;
        assert!(!world.telemetry(1).armed, "the bit arms for one start");
        world.throttle(1900);
        world.pass_s(5.0).await;
        assert_eq!(world.ordered(1), Some(0), "disarmed: idle");
        // A change from armed to disarmed also ends a start that the bit allowed.
        world.throttle(IDLE_US);
        assert_eq!(world.control(1, &[0.0]).await.0, ACCEPTED);
        world.cold(1).await;
        assert_eq!(world.control(1, &[1.0, 0.0, 0.0, 1.0]).await.0, ACCEPTED);
        world.plane.armed.set(true);
        world.pass_s(2.5).await;
        assert!(matches!(world.telemetry(1).ordered.order, Order::Run(_)));
        world.plane.armed.set(false);
        world.until("the start ends", 5, || world.telemetry(1).ordered.order == Order::Standby).await;
    });
}

#[test]
fn an_emergency_stop_is_latched_and_arming_counts_only_after_disarmed() {
    run(async |world| {
        world.ready().await;
        world.start(1).await;
        assert_eq!(world.command(ENGINE[1], USER, &[1.0]).await.0, DENIED, "without the number");
        assert_eq!(world.telemetry(1).state, EngineState::Running);
        assert_eq!(world.command(ENGINE[1], USER, &[1.0, 21196.0]).await.0, ACCEPTED);
        assert!(world.telemetry(1).stop_latched && !world.telemetry(0).stop_latched);
        let (answer, text) = world.control(1, &[1.0]).await;
        assert_eq!(answer, NOT_NOW, "{text}");
        world.until("at rest", 300, || world.state(1) <= 3).await;
        world.pass_s(60.0).await;
        assert!(!world.telemetry(1).armed);
        assert_eq!(world.command(ENGINE[1], USER, &[2.0, 0.0]).await.0, DENIED);
        assert_eq!(world.command(ENGINE[1], USER, &[2.0, 21196.0]).await.0, ACCEPTED);
        assert!(!world.telemetry(1).stop_latched);
        world.until("standby", 60, || world.telemetry(1).state == EngineState::Standby).await;
        world.pass_s(10.0).await;
        let (answer, text) = world.control(1, &[1.0]).await;
        assert_eq!(answer, NOT_NOW);
        assert!(text.contains("disarm the vehicle, then arm it again"), "{text}");
        world.plane.armed.set(false);
        world.pass_s(5.0).await;
        world.plane.armed.set(true);
        world.pass_s(5.0).await;
        world.start(1).await;
        // Addressed to the node's component, it stops all engines; so does DO_FLIGHTTERMINATION.
        assert_eq!(world.command(NODE, CMD_DO_FLIGHTTERMINATION, &[0.0]).await.0, DENIED);
        assert_eq!(world.command(NODE, CMD_DO_FLIGHTTERMINATION, &[1.0]).await.0, ACCEPTED);
        assert!((0..2).all(|engine| world.telemetry(engine).stop_latched));
    });
}

/// Armed throughout the stop, its release and a restart of the node before or after it: that is not a change from disarmed to armed. The
/// control: after the vehicle has disarmed the engine starts again, also if it disarmed while the node restarted.
#[test]
fn a_restart_does_not_replace_disarming_after_an_emergency_stop() {
    for (latched, disarms) in
        [(true, None), (false, None), (true, Some(true)), (false, Some(true)), (false, Some(false))]
    {
        run(async |world| {
            world.ready().await;
            world.start(1).await;
            assert_eq!(world.command(ENGINE[1], USER, &[1.0, 21196.0]).await.0, ACCEPTED);
            world.until("at rest", 300, || world.state(1) <= 3).await;
            world.pass_s(60.0).await;
            if latched {
                world.restart_service();
                world.pass_s(5.0).await;
            }
            assert_eq!(world.command(ENGINE[1], USER, &[2.0, 21196.0]).await.0, ACCEPTED);
            world.until("standby", 60, || world.telemetry(1).state == EngineState::Standby).await;
            if disarms == Some(false) {
                // While nobody listens.
                world.plane.armed.set(false);
            }
            if !latched {
                world.restart_service();
                world.pass_s(5.0).await;
            }
            match disarms {
                None => {
                    let (answer, text) = world.control(1, &[1.0]).await;
                    assert_eq!(answer, NOT_NOW, "{latched} {text}");
                    assert!(text.contains("isarm"), "{text}");
                    assert!(!world.telemetry(1).armed, "{latched}");
                }
                Some(seen) => {
                    if seen {
                        world.plane.armed.set(false);
                        world.pass_s(5.0).await;
                    }
                    world.plane.armed.set(true);
                    world.pass_s(5.0).await;
                    world.start(1).await;
                }
            }
        });
    }
}

/// Radio control releases a stop and arms, with a disarmed autopilot and with none.
#[test]
fn what_another_source_arms_after_a_stop_stays_armed() {
    for alive in [true, false] {
        run(async |world| {
            world.plane.alive.set(alive);
            world.until("standby", 30, || world.telemetry(0).state == EngineState::Standby).await;
            let radio = world.node.owners()[0].source(Origin::Rc).expect("nobody else is radio control");
            radio.command(Command::EmergencyStop).expect("never refused");
            world.pass_s(3.0).await;
            assert!(world.telemetry(0).stop_latched);
            radio.command(Command::ReleaseStop).expect("the engine is at rest");
            radio.command(Command::Arm).expect("nothing is latched");
            world.pass_s(3.0).await;
            assert!(world.telemetry(0).armed, "the autopilot is alive: {alive}");
        });
    }
}

#[test]
fn without_a_demand_source_the_commanding_station_keeps_the_order_alive() {
    run(async |world| {
        world.ready().await;
        assert_eq!(world.set(ENGINE[1], "MAV_THR_SRC", 0.0).await.0, Some(0.0));
        world.ground.set(false);
        world.pass_s(10.0).await;
        let (answer, text) = world.control(1, &[1.0]).await;
        assert_eq!(answer, NOT_NOW);
        assert!(text.contains("no heartbeat from the commanding system"), "{text}");
        world.ground.set(true);
        world.pass_s(6.0).await;
        world.start(1).await;
        // The throttle of the autopilot is not its source.
        world.throttle(1900);
        world.pass_s(30.0).await;
        assert_eq!((world.telemetry(1).loss as u8, world.ordered(1)), (0, Some(0)));
        world.ground.set(false);
        world.pass_s(4.0).await;
        assert_eq!(world.telemetry(1).loss as u8, 0);
        world.until("lost", 5, || world.telemetry(1).loss as u8 > 0).await;
    });
}

#[test]
fn after_a_restart_an_order_without_a_demand_source_needs_a_station_that_may_command() {
    run(async |world| {
        world.ready().await;
        assert_eq!(world.set(ENGINE[1], "MAV_THR_SRC", 0.0).await.0, Some(0.0));
        // The autopilot is one of them, which this test has to exclude.
        assert_eq!(world.set(NODE, "MAV_OWN_CMD", 0.0).await.0, Some(0.0));
        world.start(1).await;
        world.restart_service();
        world.pass_s(30.0).await;
        assert_eq!((world.telemetry(1).loss as u8, world.ordered(1)), (0, Some(0)), "the station is there");
        world.ground.set(false);
        world.until("lost", 10, || world.telemetry(1).loss as u8 > 0).await;
        world.restart_service();
        world.pass_s(20.0).await;
        assert!(world.telemetry(1).loss as u8 > 0, "nobody is there");
    });
}

#[test]
fn a_start_waits_for_another_engine() {
    run(async |world| {
        world.ready().await;
        assert_eq!(world.control(0, &[1.0]).await.0, ACCEPTED);
        assert_eq!(world.control(1, &[1.0]).await.0, ACCEPTED);
        assert_eq!(world.ordered(1), None);
        assert!(world.telemetry(1).start_waits_until.is_some());
        let (echo, text) = world.set(ENGINE[1], "MAV_THR_OUT", 9.0).await;
        assert_eq!(echo, Some(4.0), "what a waiting start was judged by stays: {text}");
        world
            .until("both run", 200, || (0..2).all(|i| world.telemetry(i).state == EngineState::Running))
            .await;
        // A stop cancels a waiting start.
        for engine in 0..2 {
            assert_eq!(world.control(engine, &[0.0]).await.0, ACCEPTED);
        }
        world.cold(0).await;
        world.cold(1).await;
        assert_eq!(world.control(0, &[1.0]).await.0, ACCEPTED);
        assert_eq!(world.control(1, &[1.0]).await.0, ACCEPTED);
        assert_eq!(world.control(1, &[0.0]).await.0, ACCEPTED);
        world.pass_s(200.0).await;
        assert_eq!(world.telemetry(0).state, EngineState::Running);
        assert_eq!(world.telemetry(1).ordered.order, Order::Standby);
    });
}

/// A start that waits "repeats every interlock, arming and idle, when it goes": a stream that rose meanwhile cancels it, and starts
/// nothing when it is at idle again.
#[test]
fn a_start_that_waits_is_refused_when_the_stream_rises() {
    run(async |world| {
        world.ready().await;
        assert_eq!(world.control(0, &[1.0]).await.0, ACCEPTED);
        assert_eq!(world.control(1, &[1.0]).await.0, ACCEPTED);
        assert!(world.telemetry(1).start_waits_until.is_some());
        world.throttle(1740);
        world.pass_s(2.0).await;
        assert_eq!(world.telemetry(1).start_waits_until, None);
        let texts = world.texts();
        assert!(texts.contains("idle"), "{texts}");
        world.throttle(1100);
        world.until("the other runs", 200, || world.telemetry(0).state == EngineState::Running).await;
        world.pass_s(20.0).await;
        assert_eq!(world.telemetry(1).ordered.order, Order::Standby);
    });
}

#[test]
fn the_node_restarts_only_with_all_engines_at_rest() {
    run(async |world| {
        world.ready().await;
        world.start(1).await;
        assert_eq!(world.command(NODE, CMD_PREFLIGHT_REBOOT_SHUTDOWN, &[1.0]).await.0, NOT_NOW);
        assert_eq!(world.request(), None);
        assert_eq!(world.control(1, &[0.0]).await.0, ACCEPTED);
        world.cold(1).await;
        assert_eq!(world.command(NODE, CMD_PREFLIGHT_REBOOT_SHUTDOWN, &[2.0]).await.0, DENIED);
        assert_eq!(world.command(NODE, CMD_PREFLIGHT_REBOOT_SHUTDOWN, &[1.0]).await.0, ACCEPTED);
        assert_eq!(world.request(), Some(crate::service::Request::Reboot));
    });
}

#[cfg(feature = "signing")]
#[test]
fn damaged_settings_grant_no_start_until_a_person_confirms_them() {
    const CONFIRM_SETTINGS: &[f32] = &[30.0, 21196.0];
    run(async |world| {
        world.ready().await;
        // Nothing to confirm.
        let (answer, text) = world.command(NODE, USER, CONFIRM_SETTINGS).await;
        assert_eq!((answer, world.service.borrow_mut().take_rewrite()), (NOT_NOW, false), "{text}");
        assert!(text.contains("the settings are not damaged"), "{text}");
        // Running engines continue, and the settings are confirmed only with all engines at rest.
        world.start(1).await;
        world.service.borrow_mut().set_damaged(true);
        let (answer, text) = world.command(NODE, USER, CONFIRM_SETTINGS).await;
        assert_eq!((answer, world.service.borrow_mut().take_rewrite()), (NOT_NOW, false), "{text}");
        assert!(matches!(world.telemetry(1).ordered.order, Order::Run(_)));
        // A stop does not need intact settings. A start does.
        assert_eq!(world.control(1, &[0.0]).await.0, ACCEPTED);
        world.cold(1).await;
        let (answer, text) = world.control(0, &[1.0]).await;
        assert_eq!(answer, NOT_NOW);
        assert!(text.contains("the stored settings are damaged"), "{text}");
        world.pass_s(6.0).await;
        assert_eq!(world.telemetry(0).ordered.order, Order::Standby, "nor later");
        // Only at the board; the ground station's port is USB.
        let away = world.command_from(TO_AUTOPILOT, GROUND, (SYSTEM, NODE), USER, 0, CONFIRM_SETTINGS);
        let (answer, text) = away.await;
        assert_eq!((answer, world.service.borrow_mut().take_rewrite()), (NOT_NOW, false), "{text}");
        assert!(text.contains("over USB"), "{text}");
        let (answer, text) = world.command(NODE, USER, CONFIRM_SETTINGS).await;
        assert_eq!((answer, world.service.borrow_mut().take_rewrite()), (ACCEPTED, true), "{text}");
        world.service.borrow_mut().rewritten(embassy_time::Instant::now(), Ok(()));
        world.pass_s(0.2).await;
        world.start(0).await;
    });
}

#[test]
fn a_stop_after_the_rest_of_a_damaged_frame_acts_within_a_second() {
    run(async |world| {
        world.ready().await;
        world.start(1).await;
        // The first bytes of a frame of 280 bytes: everything after them may belong to it.
        world.say_bytes(TO_GROUND, &[0xFD, 255, 0, 0, 0, 255, 190, 0, 0, 0]);
        world.pass_s(0.1).await;
        world.say(TO_GROUND, GROUND, &stop_command(1));
        world.pass_s(0.3).await;
        assert_eq!(world.ordered(1), Some(0), "it waits for the rest of the frame");
        world.pass_s(0.5).await;
        assert_eq!(world.ordered(1), None, "the stop acts");
    });
}

/// Stray bytes that look like the beginning of a long frame, right before the only stop, while the autopilot's stream runs on the same port.
#[test]
fn a_stop_after_stray_bytes_acts_while_the_stream_runs() {
    run(async |world| {
        world.ready().await;
        for stray in [&[0xFD, 0xFF, 0x00][..], &[0xFD, 0x80, 0x00], &[0xFE, 0xFF]] {
            world.start(1).await;
            world.say_bytes(TO_AUTOPILOT, stray);
            world.say(TO_AUTOPILOT, GROUND, &stop_command(1));
            world.pass_s(0.6).await;
            assert_eq!(world.ordered(1), None, "the stop acts after {stray:02X?}");
            world.cold(1).await;
        }
    });
}

/// The answers to a start since frame `at`.
fn answers(world: &World<'_>, at: usize) -> std::vec::Vec<u8> {
    let frames = world.frames.borrow();
    let acks = frames.iter().skip(at).filter_map(|(_, _, frame)| match &frame.message() {
        MavMessage::COMMAND_ACK(ack) if ack.command == CMD_DO_ENGINE_CONTROL => Some(ack.result),
        _ => None,
    });
    acks.collect()
}

#[test]
fn a_start_is_in_progress_until_the_engine_runs_only_where_that_is_set() {
    run(async |world| {
        world.ready().await;
        assert_eq!(world.set(NODE, "MAV_IN_PROGRESS", 1.0).await.0, Some(1.0));
        let at = world.frames.borrow().len();
        assert_eq!(world.control(1, &[1.0]).await.0, Some(Ack::InProgress as u8));
        world.until("the engine runs", 120, || world.telemetry(1).state == EngineState::Running).await;
        world.pass_s(3.0).await;
        let all = answers(world, at);
        let (last, before) = all.split_last().unwrap();
        assert_eq!(*last, Ack::Accepted as u8, "{all:?}");
        assert!(before.len() > 5 && before.iter().all(|ack| *ack == Ack::InProgress as u8), "{all:?}");
        // A stop is answered as always; the earlier start already was.
        assert_eq!(world.control(1, &[0.0]).await.0, Some(Ack::Accepted as u8));
        // A stop cancels a start in progress.
        world.cold(1).await;
        let at = world.frames.borrow().len();
        assert_eq!(world.control(1, &[1.0]).await.0, Some(Ack::InProgress as u8));
        world.pass_s(2.0).await;
        assert_eq!(world.command(ENGINE[1], CMD_USER_1, &[3.0]).await.0, Some(0));
        world.pass_s(2.0).await;
        assert_eq!(answers(world, at).last(), Some(&(Ack::Cancelled as u8)));
    });
}

/// Where signing is left out, as on boards.
#[cfg(not(feature = "signing"))]
#[test]
fn without_signing_a_key_is_answered_with_a_text() {
    run(async |world| {
        world.ready().await;
        let setup = |component| SETUP_SIGNING_DATA {
            target_system: SYSTEM,
            target_component: component,
            ..Default::default()
        };
        world.say(TO_GROUND, GROUND, &setup(ENGINE[0]));
        world.pass_s(1.0).await;
        assert!(!world.texts().contains("no signing here"), "{}", world.texts());
        world.say(TO_GROUND, GROUND, &setup(NODE));
        world.pass_s(1.0).await;
        assert!(world.texts().contains("no signing here"), "{}", world.texts());
    });
}

/// On the bench by USB, without an autopilot, the node is system 1. An autopilot that is then switched on is not learnt while the engine is
/// ordered to run: whoever commands it keeps the id, and can stop it.
#[test]
fn a_stop_counts_while_an_autopilot_is_received_that_is_not_learnt() {
    const SELF: u8 = 1;
    let kinds: [(u16, &[f32]); 4] = [
        (CMD_DO_ENGINE_CONTROL, &[0.0]),
        (USER, &[3.0]),
        (USER, &[1.0, 21196.0]),
        (CMD_DO_FLIGHTTERMINATION, &[1.0]),
    ];
    for (command, params) in kinds {
        run(async |world| {
            world.plane.alive.set(false);
            world.until("standby", 30, || world.telemetry(1).state == EngineState::Standby).await;
            world.pass_s(10.0).await;
            let set = PARAM_SET_DATA {
                param_value: 0.0,
                target_system: SELF,
                target_component: ENGINE[1],
                param_id: "MAV_THR_SRC".into(),
                param_type: PARAM_REAL32,
            };
            world.say(TO_GROUND, GROUND, &set);
            world.pass_s(1.0).await;
            let to_one = async |command, params: &[f32]| {
                world.command_from(TO_GROUND, GROUND, (SELF, ENGINE[1]), command, 0, params).await
            };
            assert_eq!(to_one(CMD_DO_ENGINE_CONTROL, &[1.0, 0.0, 0.0, 1.0]).await.0, ACCEPTED);
            world.until("runs", 120, || world.telemetry(1).state == EngineState::Running).await;
            world.plane.alive.set(true);
            world.pass_s(10.0).await;
            let at = world.frames.borrow().len();
            world.pass_s(5.0).await;
            let frames = world.frames.borrow()[at..].iter().filter(|(_, port, _)| *port == TO_GROUND).count();
            assert!(frames > 20, "{frames} frames in 5 s");
            // Addressed to another system it does not stop: the node has an id here.
            let other = command_to((SYSTEM, ENGINE[1]), command, params);
            world.say(TO_GROUND, GROUND, &other);
            world.pass_s(0.2).await;
            assert!(matches!(world.telemetry(1).ordered.order, Order::Run(_)));
            assert_eq!(to_one(command, params).await.0, ACCEPTED, "{command} {params:?}");
            assert!(!matches!(world.telemetry(1).ordered.order, Order::Run(_)));
            // At rest the autopilot is learnt.
            world.until("learnt", 60, || world.service.borrow().system_id() == Some(SYSTEM)).await;
        });
    }
}

fn command_to((system, component): (u8, u8), command: u16, params: &[f32]) -> COMMAND_LONG_DATA {
    let param = |i: usize| params.get(i).copied().unwrap_or(0.0);
    COMMAND_LONG_DATA {
        param1: param(0),
        param2: param(1),
        param4: param(3),
        command,
        target_system: system,
        target_component: component,
        ..Default::default()
    }
}

/// On the autopilot's port the node has no id until it has learnt one: there only a stop counts, whatever system it names.
#[test]
fn where_the_node_has_no_id_a_stop_to_its_component_counts_and_nothing_else_does() {
    for stop in [true, false] {
        run(async |world| {
            world.plane.alive.set(false);
            world.until("standby", 30, || world.telemetry(1).state == EngineState::Standby).await;
            world.pass_s(4.0).await;
            let radio = world.node.owners()[1].source(Origin::Rc).unwrap();
            radio.command(Command::Arm).unwrap();
            radio.command(Command::Standby).unwrap();
            radio.command(Command::Run(Demand::Throttle(Throttle::IDLE))).unwrap();
            assert!(matches!(world.telemetry(1).ordered.order, Order::Run(_)));
            let message = match stop {
                true => command_to((9, ENGINE[1]), CMD_DO_ENGINE_CONTROL, &[0.0]),
                false => command_to((9, ENGINE[1]), CMD_PREFLIGHT_REBOOT_SHUTDOWN, &[1.0]),
            };
            world.say(TO_AUTOPILOT, GROUND, &message);
            let to_none = command_to((9, 0), CMD_DO_ENGINE_CONTROL, &[0.0]);
            world.say(TO_AUTOPILOT, GROUND, &to_none);
            assert_eq!(world.telemetry(1).ordered.order == Order::Standby, stop);
        });
    }
}

#[test]
fn after_an_accepted_restart_nothing_starts_and_an_engine_that_turns_keeps_the_node() {
    run(async |world| {
        world.ready().await;
        assert_eq!(world.command(NODE, CMD_PREFLIGHT_REBOOT_SHUTDOWN, &[1.0]).await.0, ACCEPTED);
        let (answer, texts) = world.control(1, &[1.0]).await;
        assert_eq!(answer, NOT_NOW);
        assert!(texts.contains("restart"), "{texts}");
        assert!(world.request().is_some());
        // Radio control meanwhile starts one.
        let radio = world.node.owners()[1].source(Origin::Rc).unwrap();
        radio.command(Command::Standby).unwrap();
        radio.command(Command::Run(Demand::Throttle(Throttle::IDLE))).unwrap();
        assert_eq!(world.request(), None);
        world.pass_s(0.2).await;
        assert!(world.texts().contains("no restart"), "{}", world.texts());
    });
}

/// Radio control arms and starts an engine while the vehicle is disarmed. A start by MAVLink is refused, and does not disarm or
/// stop it.
#[test]
fn a_refused_start_does_not_disarm_what_another_source_has_armed() {
    run(async |world| {
        world.until("standby", 30, || world.telemetry(1).state == EngineState::Standby).await;
        world.until("learnt", 30, || world.service.borrow().system_id() == Some(SYSTEM)).await;
        world.pass_s(4.0).await;
        let radio = world.node.owners()[1].source(Origin::Rc).unwrap();
        radio.command(Command::Arm).unwrap();
        radio.command(Command::Standby).unwrap();
        radio.command(Command::Run(Demand::Throttle(Throttle::IDLE))).unwrap();
        world.pass_s(0.5).await;
        let (answer, texts) = world.control(1, &[1.0, 0.0, 0.0, 1.0]).await;
        assert_eq!(answer, NOT_NOW, "{texts}");
        assert!(world.telemetry(1).armed, "it was armed by radio control");
        assert!(matches!(world.telemetry(1).ordered.order, Order::Run(_)), "its start continues");
        // The control: an engine that MAVLink itself armed for a refused start is not armed afterwards.
        world.left.cut(true);
        world.pass_s(0.5).await;
        let (answer, _) = world.control(0, &[1.0, 0.0, 0.0, 1.0]).await;
        assert_eq!(answer, NOT_NOW, "its ECU is not received");
        assert!(!world.telemetry(0).armed);
    });
}
