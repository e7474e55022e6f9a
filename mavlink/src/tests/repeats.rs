//! Repeated starts: which command is a repeat of one before it, and what is answered. A heartbeat that comes twice.

use super::world::*;
use crate::dialect::*;
use crate::frame::Address;
use crate::ids::*;
use crate::settings::NodeSettings;
use jetlink::command::{Command, Order, Origin};
use jetlink::engine::state::EngineState;

/// A `COMMAND_INT` has the coordinate frame in place of the confirmation: whatever it is, the start is not a repeat.
#[test]
fn a_start_as_command_int_is_not_a_repeat() {
    run(async |world| {
        world.ready().await;
        assert_eq!(world.control(0, &[1.0]).await.0, ACCEPTED);
        assert_eq!(world.control(0, &[0.0]).await.0, ACCEPTED);
        world.until("standby", 300, || world.telemetry(0).state == EngineState::Standby).await;
        world.pass_s(6.0).await;
        let start = COMMAND_INT_DATA {
            param1: 1.0,
            command: CMD_DO_ENGINE_CONTROL,
            target_system: SYSTEM,
            target_component: ENGINE[0],
            frame: 3,
            ..Default::default()
        };
        let frame = world.frame(TO_GROUND, GROUND, &start);
        let to = (SYSTEM, ENGINE[0]);
        let (answer, text) = world.answer_to(TO_GROUND, &frame, GROUND, to, CMD_DO_ENGINE_CONTROL).await;
        assert_eq!(answer, ACCEPTED, "{text}");
    });
}

#[test]
fn a_repeated_start_gets_the_last_answer_and_does_nothing() {
    run(async |world| {
        world.ready().await;
        let target = (SYSTEM, ENGINE[1]);
        let again = async |from: Address, confirmation: u8| {
            world.command_from(TO_GROUND, from, target, CMD_DO_ENGINE_CONTROL, confirmation, &[1.0]).await
        };
        assert_eq!(again(GROUND, 0).await.0, ACCEPTED);
        world.pass_s(1.0).await;
        assert_eq!(again(GROUND, 0).await.0, ACCEPTED, "within 5 s");
        world.pass_s(10.0).await;
        assert_eq!(again(GROUND, 1).await.0, ACCEPTED, "a repeat by its number");
        let (answer, text) = again(Address { system: 255, component: 191 }, 0).await;
        assert_eq!(answer, NOT_NOW, "somebody else: {text}");
        // After a stop the repeat is refused.
        assert_eq!(world.control(1, &[0.0]).await.0, ACCEPTED);
        let (answer, text) = again(GROUND, 2).await;
        assert_eq!(answer, NOT_NOW);
        assert!(text.contains("this start is a repeat"), "{text}");
        assert_eq!(world.telemetry(1).ordered.order, Order::Standby);
        world.cold(1).await;
        assert_eq!(again(GROUND, 0).await.0, ACCEPTED, "a new one");
    });
}

/// However late: the sender counts one start on. The control: a new one of it is decided anew.
#[test]
fn a_late_repeat_of_a_refused_start_gets_its_answer_and_starts_nothing() {
    run(async |world| {
        world.ready().await;
        let target = (SYSTEM, ENGINE[1]);
        let start = async |confirmation: u8| {
            let command = CMD_DO_ENGINE_CONTROL;
            world.command_from(TO_GROUND, GROUND, target, command, confirmation, &[1.0]).await
        };
        world.throttle(1500);
        world.pass_s(1.0).await;
        let (answer, text) = start(0).await;
        assert!(answer == NOT_NOW && text.contains("throttle to idle first"), "{answer:?} {text}");
        world.throttle(IDLE_US);
        world.pass_s(30.0).await;
        let (answer, text) = start(1).await;
        assert!(answer == NOT_NOW && text.contains("repeats a refused start"), "{answer:?} {text}");
        // On another way, later than the next one.
        assert_eq!(start(3).await.0, NOT_NOW);
        world.pass_s(3.0).await;
        assert_eq!(start(2).await.0, NOT_NOW);
        assert_eq!(world.telemetry(1).ordered.order, Order::Standby);
        assert_eq!(start(0).await.0, ACCEPTED);
    });
}

/// By radio control, with standby or an emergency stop. The control: a new start.
#[test]
fn a_repeat_starts_nothing_after_a_stop_of_another_source() {
    for stop in [Command::ShutDown, Command::EmergencyStop] {
        run(async |world| {
            world.ready().await;
            let radio = world.node.owners()[1].source(Origin::Rc).unwrap();
            let start = async |component: u8, confirmation: u8| {
                let (from, to) = (Address { system: 255, component }, (SYSTEM, ENGINE[1]));
                let command = CMD_DO_ENGINE_CONTROL;
                world.command_from(TO_GROUND, from, to, command, confirmation, &[1.0]).await
            };
            assert_eq!(start(190, 0).await.0, ACCEPTED);
            world.pass_s(3.0).await;
            assert!(radio.command(stop).is_ok());
            // At once, and late. The one of the second sender was sent before the stop, and its first copy was lost.
            for (sender, after) in [(191, 0.0), (190, 0.0), (190, 10.0)] {
                world.pass_s(after).await;
                let (answer, text) = start(sender, 1).await;
                assert_eq!(answer, NOT_NOW, "{stop:?} {sender} {text}");
                assert!(text.contains("this start is a repeat"), "{stop:?} {sender} {text}");
                assert_eq!(world.ordered(1), None);
            }
            if stop == Command::ShutDown {
                world.cold(1).await;
                assert_eq!(start(190, 0).await.0, ACCEPTED);
            }
        });
    }
}

/// A sender whose first copies are always lost, or that begins to count at 1, is not locked out.
#[test]
fn a_confirmation_that_does_not_rise_is_of_a_new_start() {
    run(async |world| {
        world.ready().await;
        let start = async |confirmation: u8| {
            let (to, command) = ((SYSTEM, ENGINE[1]), CMD_DO_ENGINE_CONTROL);
            world.command_from(TO_GROUND, GROUND, to, command, confirmation, &[1.0]).await
        };
        world.throttle(1500);
        world.pass_s(1.0).await;
        assert_eq!(start(1).await.0, NOT_NOW);
        world.throttle(IDLE_US);
        world.pass_s(6.0).await;
        assert_eq!(start(1).await.0, ACCEPTED);
        world.pass_s(6.0).await;
        assert_eq!(start(2).await.0, ACCEPTED, "a repeat");
        assert_eq!(world.control(1, &[0.0]).await.0, ACCEPTED);
        world.cold(1).await;
        let (answer, text) = start(3).await;
        assert!(answer == NOT_NOW && text.contains("this start is a repeat"), "{answer:?} {text}");
        world.pass_s(6.0).await;
        assert_eq!(start(1).await.0, ACCEPTED, "a new one");
    });
}

/// A sender repeats a start whose first copy was lost. Somebody has stopped the engine in between.
#[test]
fn a_repeat_whose_first_copy_was_lost_starts_nothing_after_a_stop() {
    run(async |world| {
        world.ready().await;
        let repeat = async |component: u8| {
            let (from, to) = (Address { system: 255, component }, (SYSTEM, ENGINE[1]));
            world.command_from(TO_GROUND, from, to, CMD_DO_ENGINE_CONTROL, 1, &[1.0]).await
        };
        assert_eq!(world.control(1, &[0.0]).await.0, ACCEPTED);
        world.pass_s(4.0).await;
        let (answer, text) = repeat(191).await;
        assert!(answer == NOT_NOW && text.contains("this start is a repeat"), "{answer:?} {text}");
        assert_eq!(world.telemetry(1).ordered.order, Order::Standby);
        // No sender repeats for that long: it is a new one, of which the first copy was lost.
        world.pass_s(1.0).await;
        assert_eq!(repeat(192).await.0, ACCEPTED);
    });
}

#[test]
fn a_start_with_a_confirmation_gets_no_old_answer_where_its_run_has_ended() {
    run(async |world| {
        world.ready().await;
        world.start(1).await;
        let again = async || {
            let to = (SYSTEM, ENGINE[1]);
            world.command_from(TO_GROUND, GROUND, to, CMD_DO_ENGINE_CONTROL, 1, &[1.0]).await
        };
        // A repeat while it runs gets the same answer.
        assert_eq!(again().await.0, ACCEPTED);
        // Radio control ends it.
        let radio = world.node.owners()[1].source(Origin::Rc).unwrap();
        radio.command(Command::ShutDown).unwrap();
        drop(radio);
        world.pass_s(2.0).await;
        world.cold(1).await;
        world.pass_s(60.0).await;
        let (answer, texts) = again().await;
        let runs = matches!(world.telemetry(1).ordered.order, Order::Run(_));
        assert!(answer == ACCEPTED && runs, "after more than 5 s it is judged again: {answer:?} {texts}");
    });
}

#[test]
fn a_repeat_of_a_start_that_has_ended_is_refused() {
    run(async |world| {
        world.ready().await;
        assert_eq!(world.control(1, &[1.0]).await.0, ACCEPTED);
        world.pass_s(1.0).await;
        world.plane.armed.set(false);
        world.until("the start ends", 3, || world.telemetry(1).ordered.order == Order::Standby).await;
        for confirmation in [0, 1] {
            let to = (SYSTEM, ENGINE[1]);
            let (answer, texts) =
                world.command_from(TO_GROUND, GROUND, to, CMD_DO_ENGINE_CONTROL, confirmation, &[1.0]).await;
            assert_eq!(answer, NOT_NOW);
            assert!(texts.contains("has ended"), "{texts}");
        }
    });
}

#[test]
fn a_start_while_disarmed_is_not_the_same_start_as_one_without_the_bit() {
    run(async |world| {
        world.until("standby", 30, || world.telemetry(0).state == EngineState::Standby).await;
        world.until("learnt", 30, || world.service.borrow().system_id() == Some(SYSTEM)).await;
        world.pass_s(4.0).await;
        assert_eq!(world.control(0, &[1.0]).await.0, NOT_NOW);
        world.pass_s(1.0).await;
        let (answer, texts) = world.control(0, &[1.0, 0.0, 0.0, 1.0]).await;
        assert_eq!(answer, ACCEPTED, "{texts}");
    });
}

/// The control: another heartbeat like it, a second later.
#[test]
fn a_heartbeat_that_its_link_delivers_twice_does_not_arm() {
    for (after, expected) in [(0.0, NOT_NOW), (0.15, NOT_NOW), (1.0, ACCEPTED)] {
        run(async |world| {
            world.ready().await;
            world.plane.armed.set(false);
            world.pass_s(5.0).await;
            world.plane.heartbeats.set(false);
            world.pass_s(1.0).await;
            let beat = HEARTBEAT_DATA {
                custom_mode: 0,
                mavtype: 1,
                autopilot: 3,
                base_mode: 1 | MODE_ARMED,
                system_status: 4,
                mavlink_version: 3,
            };
            world.say(TO_AUTOPILOT, AUTOPILOT, &beat);
            world.pass_s(after).await;
            world.say(TO_AUTOPILOT, AUTOPILOT, &beat);
            world.pass_s(0.2).await;
            let (answer, texts) = world.control(1, &[1.0]).await;
            assert_eq!(answer, expected, "after {after} s: {texts}");
        });
    }
}

/// A start, another one that replaces it in what is remembered, a stop, and a copy of the first start: it starts nothing, as without the
/// other one. A new start does, 5 s after what was forgotten.
#[test]
fn a_copy_of_a_start_that_is_no_longer_remembered_starts_nothing_after_a_stop() {
    // The same sender's, with param4; or those of other senders.
    for (with_bit, others) in [(false, 0), (true, 0), (false, 3), (false, 4)] {
        run(async |world| {
            world.ready().await;
            assert_eq!(world.control(1, &[1.0]).await.0, ACCEPTED);
            if with_bit {
                assert_eq!(world.control(1, &[1.0, 0.0, 0.0, 1.0]).await.0, NOT_NOW);
            }
            for other in 0..others {
                let from = Address { system: 255, component: 191 + other };
                let to = (SYSTEM, ENGINE[1]);
                let _ = world.command_from(TO_GROUND, from, to, CMD_DO_ENGINE_CONTROL, 0, &[1.0]).await;
            }
            assert_eq!(world.control(1, &[0.0]).await.0, ACCEPTED);
            world.until("standby", 4, || world.telemetry(1).state == EngineState::Standby).await;
            let (answer, text) = world.control(1, &[1.0]).await;
            assert_eq!(answer, NOT_NOW, "{with_bit}, {others} others: {text}");
            assert_eq!(world.telemetry(1).ordered.order, Order::Standby);
            world.pass_s(6.0).await;
            let (answer, text) = world.control(1, &[1.0]).await;
            assert_eq!(answer, ACCEPTED, "{with_bit}, {others} others: {text}");
        });
    }
}

/// With `MAV_IN_PROGRESS` whoever waits for the end of a start gets "cancelled" after a stop, also if somebody else's start is refused then.
#[test]
fn the_final_answer_after_a_stop_is_cancelled_whoever_else_tries_to_start() {
    const CANCELLED: u8 = 6;
    for other in [false, true] {
        run_with(NodeSettings { progress: true, ..NodeSettings::DEFAULT }, async |world| {
            world.ready().await;
            assert_eq!(world.control(1, &[1.0]).await.0, Some(5));
            world.pass_s(1.0).await;
            let at = world.frames.borrow().len();
            world.say(TO_GROUND, GROUND, &stop_command(1));
            if other {
                let start = COMMAND_LONG_DATA { param1: 1.0, ..stop_command(1) };
                world.pass_s(0.001).await;
                world.say(TO_GROUND, Address { system: 255, component: 191 }, &start);
            }
            world.pass_s(0.5).await;
            let is_cancelled = world.frames.borrow().iter().skip(at).any(|(_, port, frame)| {
                let MavMessage::COMMAND_ACK(ack) = frame.message() else { return false };
                (*port, ack.target_component, ack.result) == (1, GROUND.component, CANCELLED)
            });
            assert!(is_cancelled, "another start: {other}");
        });
    }
}
