//! Ids and the rate of the telemetry port over a reset, and where an id cannot be stored.

use super::world::*;
use crate::dialect::*;
use crate::frame::Address;
use crate::service::ParameterStorage;
use crate::settings::{Identity, NodeSettings};
use crate::store::NotSaved;
use embassy_time::Instant;
use jetlink::engine::state::EngineState;
use jetlink::units::BaudRate;
use std::collections::BTreeSet;

const OLD: Identity = Identity { system: 0, learnt: SYSTEM, ..Identity::DEFAULT };
const NEW: Identity = Identity {
    system: 9,
    learnt: SYSTEM,
    base: 40,
    autopilot_port: 2,
    telemetry_baud: BaudRate::up_to(115_200),
};

#[test]
fn an_identity_is_one_number_and_back() {
    let last = Identity {
        system: 255,
        learnt: 254,
        base: 90,
        autopilot_port: 8,
        telemetry_baud: BaudRate::up_to(115_200),
    };
    for identity in [OLD, NEW, Identity::DEFAULT, last] {
        assert_eq!(Identity::unpacked(identity.packed()), Some(identity));
    }
    // What a power-up leaves in RAM gives no other one.
    let odd = (0..100_000_u32).map(|i| i.wrapping_mul(0x9E37_79B9).rotate_left(i % 32));
    for number in odd.chain([0, u32::MAX, NEW.packed() | 1 << 31]) {
        assert!(Identity::unpacked(number).is_none_or(|identity| identity.packed() == number), "{number:#x}");
    }
    assert_eq!([0, u32::MAX, NEW.packed() | 1 << 31].map(Identity::unpacked), [None; 3]);
}

#[test]
fn in_flight_the_identity_of_before_the_reset_is_in_force_and_otherwise_the_stored_one() {
    let retained = Some(OLD.packed());
    for (retained, in_flight, expected) in [
        (retained, true, OLD),
        (retained, false, NEW),
        (None, true, NEW),
        (None, false, NEW),
        // Damaged RAM.
        (Some(0), true, NEW),
    ] {
        assert_eq!(Identity::at_start(NEW, retained, in_flight), expected, "{retained:?}, {in_flight}");
    }
}

/// Systems and components of the heartbeats on a port since frame `at`.
fn senders(world: &World<'_>, at: usize, port: usize) -> BTreeSet<(u8, u8)> {
    let frames = world.frames.borrow();
    let beats = frames
        .iter()
        .skip(at)
        .filter(|(_, on, frame)| *on == port && matches!(frame.message(), MavMessage::HEARTBEAT(_)));
    beats.map(|(.., frame)| (frame.from.system, frame.from.component)).collect()
}

const SET: [(&str, f32); 3] = [("MAV_SYSID", 9.0), ("MAV_COMP_BASE", 40.0), ("MAV_AP_PORT", 2.0)];

/// A reset, with what RAM retains over it.
fn reset(world: &World<'_>, in_flight: bool) -> Identity {
    let retained = world.service.borrow().identity().packed();
    world.restart_service();
    let mut service = world.service.borrow_mut();
    let identity = Identity::at_start(service.settings().identity, Some(retained), in_flight);
    service.set_identity(Instant::now(), identity);
    identity
}

#[test]
fn ids_that_were_set_change_nothing_over_resets_in_flight() {
    run(async |world| {
        world.ready().await;
        for (name, value) in SET {
            assert_eq!(world.set(NODE, name, value).await.0, Some(value));
        }
        world.start(1).await;
        world.throttle(1500);
        world.until("it follows", 15, || world.ordered(1) == Some(500)).await;
        for _ in 0..2 {
            let at = world.frames.borrow().len();
            assert_eq!(reset(world, true), OLD, "the id was learnt");
            world.pass_s(15.0).await;
            for port in [TO_AUTOPILOT, TO_GROUND] {
                assert_eq!(
                    senders(world, at, port),
                    [NODE, ENGINE[0], ENGINE[1]].map(|it| (SYSTEM, it)).into()
                );
            }
            let texts = world.answers(at).1;
            assert!(texts.contains("ids and TELEM_BAUD stay as before the reset until"), "{texts}");
            assert_eq!(world.ordered(1), Some(500), "the stream is obeyed");
        }
        // What was set is shown, and a stop is obeyed.
        assert_eq!(world.service.borrow().settings().identity.system, 9);
        assert_eq!(world.control(1, &[0.0]).await.0, Some(0));
        world.until("it has stopped", 300, || world.telemetry(1).state == EngineState::Standby).await;
        assert_eq!(reset(world, false), Identity { telemetry_baud: OLD.telemetry_baud, ..NEW });
        let at = world.frames.borrow().len();
        world.pass_s(15.0).await;
        assert_eq!(senders(world, at, TO_GROUND), [40, 41, 42].map(|component| (9, component)).into());
        let texts = world.answers(at).1;
        assert!(!texts.contains("TELEM_BAUD stay"), "{texts}");
    });
}

/// A replaced autopilot is learnt for the next start: over a reset in flight the id in force stays that of the one before.
#[test]
fn a_learnt_id_that_replaces_another_one_does_not_take_effect_in_flight() {
    run(async |world| {
        world.ready().await;
        world.plane.system.set(77);
        world.until("it is learnt", 30, || world.service.borrow().settings().identity.learnt == 77).await;
        assert_eq!(world.service.borrow().identity().learnt, SYSTEM);
        assert_eq!((reset(world, true).learnt, world.service.borrow().system_id()), (SYSTEM, Some(SYSTEM)));
        assert_eq!((reset(world, false).learnt, world.service.borrow().system_id()), (77, Some(77)));
    });
    // A set id is the one in force, whatever was learnt.
    let set = Identity { system: 9, learnt: 8, ..Identity::DEFAULT };
    run_with(NodeSettings { identity: set, ..NodeSettings::DEFAULT }, async |world| {
        world.pass_s(1.0).await;
        assert_eq!(world.service.borrow().identity(), set);
    });
}

/// Ours is received again just as an engine is started, and the store is full, which only helps itself at rest. The control: a store that does not
/// accept it at rest either gets a single request.
#[test]
fn an_id_that_a_full_store_refused_in_flight_is_stored_at_rest() {
    for result in [Ok(()), Err(NotSaved::Failed)] {
        run(async |world| {
            let learnt = || world.service.borrow().settings().identity.learnt;
            let asks = |result| {
                let asks = world.service.borrow_mut().next_save().is_some();
                asks.then(|| world.service.borrow_mut().saved(Instant::now(), result)).is_some()
            };
            world.ready().await;
            world.service.borrow_mut().set_parameter_storage(ParameterStorage::Stored);
            world.plane.alive.set(false);
            for _ in 0..14 {
                world.pass_s(1.0).await;
                let from = Address { system: SYSTEM + 1, component: 1 };
                world.say(
                    TO_AUTOPILOT,
                    from,
                    &HEARTBEAT_DATA { mavtype: 1, autopilot: 3, ..Default::default() },
                );
            }
            assert!(asks(Ok(())) && learnt() == SYSTEM + 1);
            world.plane.alive.set(true);
            world.pass_s(2.5).await;
            world.start(1).await;
            assert!(asks(Err(NotSaved::Full)) && learnt() == SYSTEM + 1);
            world.pass_s(10.0).await;
            assert!(!asks(Ok(())), "in flight");
            assert_eq!(world.control(1, &[0.0]).await.0, Some(0));
            world.cold(1).await;
            assert!(asks(result));
            assert_eq!(learnt(), if result.is_ok() { SYSTEM } else { SYSTEM + 1 });
            world.pass_s(10.0).await;
            assert!(!asks(Ok(())));
        });
    }
}
