//! A node with a key: unsigned frames have no effect, and only USB sets the key.

use super::world::*;
use crate::dialect::*;
use crate::frame::{Address, encode};
use crate::ids::*;
use crate::port::PortConfig;
use crate::settings::{Identity, NodeSettings};
use crate::signing::{Key, SigningCounters, SigningState, Stamp};
use jetlink::engine::state::EngineState;
use std::string::String;

// Known answers of pymavlink 2.4.50: a start of engine 1 of system 3, from 255/190, link 0. Made with
//
//     os.environ["MAVLINK20"] = "1"
//     from pymavlink.dialects.v20 import common as m
//     def show(message, key):
//         mav = m.MAVLink(None, srcSystem=255, srcComponent=190)
//         mav.seq, mav.signing.sign_outgoing = 5, key is not None
//         mav.signing.secret_key, mav.signing.link_id = key, 0
//         mav.signing.timestamp = 90_000_000_000_000
//         print(message.pack(mav).hex())
//     start = m.MAVLink_command_long_message(3, 26, 223, 0, 1, 0, 0, 0, 0, 0, 0)
//     show(start, bytes(range(1, 33)))
//     show(start, bytes(32 * [0x55]))
//     show(m.MAVLink_setup_signing_message(3, 25, list(range(1, 33)), 90_000_000_000_000), None)
const START: &str = "fd20010005ffbe4c00000000803f000000000000000000000000000000000000000000000000df00031aeaca\
    0000a007c2da5174d5ab2f1648";
const START_WITH_ANOTHER_KEY: &str = "fd20010005ffbe4c00000000803f0000000000000000000000000000000000000000000\
    00000df00031aeaca0000a007c2da5195edc1ec8573";
const SETUP: &str = "fd2a000005ffbe00010000a007c2da51000003190102030405060708090a0b0c0d0e0f10111213141516171819\
    1a1b1c1d1e1f207893";

fn bytes(hex: &str) -> std::vec::Vec<u8> {
    hex.as_bytes()
        .chunks(2)
        .map(|two| u8::from_str_radix(str::from_utf8(two).unwrap(), 16).unwrap())
        .collect()
}

fn key() -> Option<Key> {
    Key::new(core::array::from_fn(|i| i as u8 + 1))
}

/// The ground station is on a radio: not USB.
fn run_with_key(scenario: impl AsyncFnOnce(&World<'_>)) {
    let stored = SigningState::new(key(), Stamp::new(SENDERS_STAMP - 1000).unwrap());
    run_signed(NodeSettings::DEFAULT, stored, PortConfig::network(), scenario);
}

fn counted(world: &World<'_>) -> SigningCounters {
    world.service.borrow().counters().signing
}

const NOTHING: SigningCounters = SigningCounters {
    not_signed: 0,
    badly_signed: 0,
    replayed: 0,
    duplicates: 0,
    clocks_behind: 0,
    too_many: 0,
    setups_refused: 0,
};

fn start() -> COMMAND_LONG_DATA {
    COMMAND_LONG_DATA {
        param1: 1.0,
        command: CMD_DO_ENGINE_CONTROL,
        target_system: SYSTEM,
        target_component: ENGINE[0],
        ..Default::default()
    }
}

async fn started_by(world: &World<'_>, port: usize, frame: &[u8]) -> Option<u8> {
    world.answer_to(port, frame, GROUND, (SYSTEM, ENGINE[0]), CMD_DO_ENGINE_CONTROL).await.0
}

#[test]
fn a_start_has_to_be_signed_and_new() {
    run_with_key(async |world| {
        world.ready().await;
        assert_eq!(counted(world), NOTHING);
        let unsigned = encode(GROUND, 0, &start());
        assert_eq!(started_by(world, TO_GROUND, &unsigned).await, None);
        assert_eq!(counted(world), SigningCounters { not_signed: 1, ..NOTHING });
        assert_eq!(started_by(world, TO_GROUND, &bytes(START_WITH_ANOTHER_KEY)).await, None);
        // The number of the link is also signed.
        let mut other_link = bytes(START);
        let place = other_link.len() - 13;
        other_link[place] = 1;
        assert_eq!(started_by(world, TO_GROUND, &other_link).await, None);
        assert_eq!(counted(world), SigningCounters { not_signed: 1, badly_signed: 2, ..NOTHING });
        assert_eq!(world.telemetry(0).state, EngineState::Standby);
        // Frames signed by pymavlink are obeyed, but only once.
        assert_eq!(started_by(world, TO_GROUND, &bytes(START)).await, Some(0));
        world.until("the engine runs", 120, || world.telemetry(0).state == EngineState::Running).await;
        assert_eq!(world.command(ENGINE[0], CMD_DO_ENGINE_CONTROL, &[0.0]).await.0, Some(0));
        world.cold(0).await;
        assert_eq!(started_by(world, TO_GROUND, &bytes(START)).await, None);
        world.restart_service();
        world.until("the vehicle is learnt", 20, || world.service.borrow().system_id().is_some()).await;
        assert_eq!(started_by(world, TO_GROUND, &bytes(START)).await, None);
        assert_eq!(world.telemetry(0).state, EngineState::Standby);
        let replayed = counted(world).replayed;
        assert_eq!(replayed, 1, "of the restarted service");
        world.ready().await;
        world.start(0).await;
    });
}

#[test]
fn a_copy_by_another_port_is_a_duplicate_and_no_attack() {
    run_with_key(async |world| {
        world.ready().await;
        let frame = world.frame(TO_GROUND, GROUND, &start());
        assert_eq!(started_by(world, TO_GROUND, &frame).await, Some(0));
        assert_eq!(started_by(world, TO_AUTOPILOT, &frame).await, None);
        assert_eq!(counted(world), SigningCounters { duplicates: 1, ..NOTHING });
        assert_eq!(started_by(world, TO_GROUND, &frame).await, None);
        assert_eq!(counted(world), SigningCounters { duplicates: 1, replayed: 1, ..NOTHING });
    });
}

#[test]
fn all_that_moves_an_engine_or_a_setting_has_to_be_signed() {
    run_with_key(async |world| {
        world.ready().await;
        world.start(0).await;
        world.throttle(1500);
        world.pass_s(15.0).await;
        let throttle = world.ordered(0).unwrap();
        assert!(throttle > 400, "{throttle}");
        let before = world.service.borrow().counters();
        let number = f32::from;
        let mut sent = 0;
        let mut unsigned = |port, frame: &[u8]| {
            world.say_bytes(port, frame);
            sent += 1;
        };
        for port in [TO_GROUND, TO_AUTOPILOT] {
            for from in [GROUND, AUTOPILOT] {
                let stop = COMMAND_LONG_DATA { param1: 0.0, ..start() };
                unsigned(port, &encode(from, 0, &stop));
                let emergency = COMMAND_LONG_DATA { param2: 21196.0, command: CMD_USER_1, ..start() };
                unsigned(port, &encode(from, 0, &emergency));
                let stop = COMMAND_INT_DATA {
                    command: CMD_DO_ENGINE_CONTROL,
                    target_system: SYSTEM,
                    target_component: ENGINE[0],
                    ..Default::default()
                };
                unsigned(port, &encode(from, 0, &stop));
                let cancel = COMMAND_CANCEL_DATA {
                    command: CMD_DO_ENGINE_CONTROL,
                    target_system: SYSTEM,
                    target_component: ENGINE[0],
                };
                unsigned(port, &encode(from, 0, &cancel));
                let set = PARAM_SET_DATA {
                    param_value: number(500_u16),
                    target_system: SYSTEM,
                    target_component: ENGINE[0],
                    param_id: "LOSS_THR".into(),
                    param_type: PARAM_REAL32,
                };
                unsigned(port, &encode(from, 0, &set));
                unsigned(port, &encode(from, 0, &outputs(u32::MAX / 2, [IDLE_US; 16])));
                let disarmed =
                    HEARTBEAT_DATA { mavtype: 1, autopilot: 3, base_mode: 1, ..Default::default() };
                (0..3).for_each(|_| unsigned(port, &encode(from, 0, &disarmed)));
            }
        }
        world.pass_s(0.3).await;
        let after = world.service.borrow().counters();
        assert_eq!(after.signing, SigningCounters { not_signed: sent, ..NOTHING });
        assert_eq!((after.commands, after.parameters_set), (before.commands, before.parameters_set));
        assert_eq!(after.demands_late, before.demands_late);
        world.pass_s(5.0).await;
        assert_eq!(world.ordered(0), Some(throttle));
        // Signed, the same is obeyed.
        assert_eq!(world.set(ENGINE[0], "LOSS_THR", 30.0).await.0, Some(30.0));
        let (answer, texts) = world.command(ENGINE[0], CMD_USER_1, &[1.0, 21196.0]).await;
        assert_eq!(answer, Some(0), "{texts}");
        world.until("stopped", 10, || world.ordered(0).is_none()).await;
    });
}

#[test]
fn an_autopilot_without_the_key_is_not_an_autopilot() {
    let identity = Identity { system: SYSTEM, ..Identity::DEFAULT };
    let settings = NodeSettings { identity, ..NodeSettings::DEFAULT };
    let stored = || SigningState::new(key(), Stamp::new(SENDERS_STAMP).unwrap());
    run_signed(settings, stored(), PortConfig::network(), async |world| {
        world.ready().await;
        // It loses its key in flight: its source is lost, and the engine goes to the fail-safe throttle.
        world.start(0).await;
        world.throttle(1500);
        world.pass_s(15.0).await;
        assert!(world.ordered(0).unwrap() > 400);
        let (with_key, demands) = (world.key.take(), world.service.borrow().counters().demands);
        // The node's frames are still signed.
        world.key_is_everywhere.set(false);
        world.pass_s(10.0).await;
        assert_eq!(world.ordered(0), Some(0));
        let now = world.service.borrow().counters();
        assert!(now.demands == demands && now.signing.not_signed > 200, "{now:?}");
        world.key.set(with_key);
        world.pass_s(15.0).await;
        assert!(world.ordered(0).unwrap() > 400);
    });
}

#[test]
fn a_ground_station_without_the_key_keeps_no_order_alive() {
    let stored = SigningState::new(key(), Stamp::new(SENDERS_STAMP).unwrap());
    run_signed(NodeSettings::DEFAULT, stored, PortConfig::network(), async |world| {
        world.ready().await;
        assert_eq!(world.set(ENGINE[0], "MAV_THR_SRC", 0.0).await.0, Some(0.0));
        world.start(0).await;
        world.ground.set(false);
        let beat = HEARTBEAT_DATA { mavtype: TYPE_GCS, autopilot: AUTOPILOT_INVALID, ..Default::default() };
        let lost = |world: &World<'_>| world.texts().matches("source").count();
        let before = lost(world);
        for _ in 0..20 {
            world.say_bytes(TO_GROUND, &encode(GROUND, 0, &beat));
            world.pass_s(1.0).await;
        }
        assert_eq!(counted(world).not_signed, 20);
        assert!(lost(world) > before, "{}", world.texts());
    });
}

#[test]
fn a_clock_behind_and_a_seventeenth_sender_are_counted() {
    run_with_key(async |world| {
        world.ready().await;
        let from = |component| Address { system: 255, component };
        let beat = HEARTBEAT_DATA { mavtype: TYPE_GCS, autopilot: AUTOPILOT_INVALID, ..Default::default() };
        // The autopilot and the ground station are two.
        for component in 1..=14 {
            world.say(TO_GROUND, from(component), &beat);
        }
        assert_eq!(counted(world), NOTHING);
        world.say(TO_GROUND, from(15), &beat);
        assert_eq!(counted(world), SigningCounters { too_many: 1, ..NOTHING });
        // Known senders continue.
        world.start(0).await;
    });
    let ahead = SigningState::new(key(), Stamp::new(SENDERS_STAMP + 7_000_000).unwrap());
    run_signed(NodeSettings::DEFAULT, ahead, PortConfig::network(), async |world| {
        world.pass_s(30.0).await;
        assert!(counted(world).clocks_behind > 50, "{:?}", counted(world));
        assert_eq!(world.service.borrow().system_id(), None, "nobody is accepted");
    });
}

fn setup(secret_key: [u8; 32], target_component: u8) -> SETUP_SIGNING_DATA {
    SETUP_SIGNING_DATA {
        initial_timestamp: SENDERS_STAMP,
        target_system: SYSTEM,
        target_component,
        secret_key,
    }
}

/// Whether the node has a key afterwards, and the accompanying texts.
async fn set_up(world: &World<'_>, port: usize, frame: &[u8]) -> (bool, String) {
    let before = world.texts().len();
    world.say_bytes(port, frame);
    world.pass_s(0.2).await;
    let has = world.service.borrow().signing(embassy_time::Instant::now()).key().is_some();
    (has, world.texts().split_off(before))
}

#[test]
fn the_key_is_set_and_cleared_by_usb_with_all_engines_at_rest() {
    run(async |world| {
        world.ready().await;
        world.start(0).await;
        world.key_is_everywhere.set(false);
        let (has, texts) = set_up(world, TO_GROUND, &bytes(SETUP)).await;
        assert!(!has && texts.contains("stop it first"), "{texts}");
        assert_eq!(world.control(0, &[0.0]).await.0, Some(0));
        world.cold(0).await;
        // Not to the engine, not to everybody, not from a stranger.
        for (from, component) in [(GROUND, ENGINE[0]), (GROUND, 0), (Address { system: 9, ..GROUND }, NODE)] {
            let frame = encode(from, 0, &setup([1; 32], component));
            assert!(!set_up(world, TO_GROUND, &frame).await.0, "{component}");
        }
        assert_eq!(counted(world), SigningCounters { setups_refused: 2, ..NOTHING });
        let (has, texts) = set_up(world, TO_GROUND, &bytes(SETUP)).await;
        assert!(has && texts.contains("signing key set"), "{texts}");
        // Its unsigned throttle is forgotten at once.
        let (answer, texts) = world.control(1, &[1.0, 0.0, 0.0, 1.0]).await;
        assert!(answer == Some(1) && texts.contains("no throttle"), "{answer:?} {texts}");
        // The autopilot has no key yet; what comes over USB needs none, and what is sent is signed from here on.
        world.pass_s(5.0).await;
        assert!(counted(world).not_signed > 50);
        let (answer, texts) = world.control(0, &[1.0]).await;
        assert!(answer == Some(1) && texts.contains("no throttle"), "{answer:?} {texts}");
        world.key.set(key());
        world.pass_s(6.0).await;
        world.key_is_everywhere.set(true);
        world.ready().await;
        world.start(0).await;
        assert_eq!(world.control(0, &[0.0]).await.0, Some(0));
        world.cold(0).await;
        // Zeros clear it.
        world.key_is_everywhere.set(false);
        let frame = world.frame(TO_GROUND, GROUND, &setup([0; 32], NODE));
        let (has, texts) = set_up(world, TO_GROUND, &frame).await;
        assert!(!has && texts.contains("signing key cleared"), "{texts}");
        world.key.set(None);
        world.pass_s(1.0).await;
        world.key_is_everywhere.set(true);
        world.ready().await;
        world.start(0).await;
    });
}

#[test]
fn by_another_port_no_key_is_set_or_cleared() {
    run(async |world| {
        world.ready().await;
        let (has, _) = set_up(world, TO_AUTOPILOT, &bytes(SETUP)).await;
        assert!(!has);
        assert_eq!(counted(world), SigningCounters { setups_refused: 1, ..NOTHING });
        let sent_text = world.frames.borrow().iter().any(|(_, port, frame)| {
            *port == TO_AUTOPILOT
                && matches!(&frame.message(), MavMessage::STATUSTEXT(text)
                    if text.text.to_str().is_ok_and(|text| text.contains("over USB")))
        });
        assert!(sent_text, "the text says why");
    });
    run_with_key(async |world| {
        world.ready().await;
        // Neither signed nor unsigned.
        let clear = setup([0; 32], NODE);
        let signed = world.frame(TO_GROUND, GROUND, &clear);
        for frame in [&encode(GROUND, 0, &clear)[..], &signed] {
            let (has, texts) = set_up(world, TO_GROUND, frame).await;
            assert!(has && texts.contains("over USB"), "{texts}");
        }
        assert_eq!(counted(world), SigningCounters { setups_refused: 2, ..NOTHING });
        world.start(0).await;
    });
}

#[test]
fn what_was_ignored_is_shown_by_the_node() {
    run_with_key(async |world| {
        world.ready().await;
        let values = |at: usize| {
            let frames = world.frames.borrow();
            let mut seen = std::collections::BTreeMap::new();
            for (_, port, frame) in
                frames.iter().skip(at).filter(|(_, _, frame)| frame.from.component == NODE)
            {
                if let (TO_GROUND, MavMessage::NAMED_VALUE_FLOAT(value)) = (*port, &frame.message()) {
                    seen.insert(String::from(value.name.to_str().unwrap()), value.value);
                }
            }
            seen
        };
        assert!(values(0).is_empty(), "nothing was ignored: {:?}", values(0));
        for _ in 0..3 {
            world.say_bytes(TO_GROUND, &encode(GROUND, 0, &start()));
        }
        world.say_bytes(TO_GROUND, &bytes(START_WITH_ANOTHER_KEY));
        let at = world.frames.borrow().len();
        world.pass_s(4.0).await;
        let expected = [("unsigned", 3.0), ("badsigned", 1.0)];
        assert_eq!(values(at), expected.map(|(name, count)| (String::from(name), count)).into());
    });
}

/// A link that was cut shows nothing about its engine.
#[test]
fn no_key_is_set_while_an_engine_is_not_seen_at_rest() {
    run(async |world| {
        world.ready().await;
        world.left.cut(true);
        world.pass_s(3.0).await;
        world.key_is_everywhere.set(false);
        let (has, texts) = set_up(world, TO_GROUND, &bytes(SETUP)).await;
        assert!(!has && texts.contains("all engines must be repor"), "{texts}");
        world.left.cut(false);
        world.pass_s(5.0).await;
        assert!(set_up(world, TO_GROUND, &bytes(SETUP)).await.0);
    });
}

/// An autopilot without real time signs with a clock that is behind. It was received first, so it is known, and stays known over a reset
/// of the node in flight.
#[test]
fn an_autopilot_with_a_clock_behind_is_followed_after_a_reset_of_the_node() {
    const BEHIND: u64 = 120 * 100_000;
    let stored = SigningState::new(key(), Stamp::new(SENDERS_STAMP - BEHIND - 1000).unwrap());
    run_signed(NodeSettings::DEFAULT, stored, PortConfig::network(), async |world| {
        world.autopilot_behind.set(BEHIND);
        world.ready().await;
        world.start(0).await;
        world.throttle(1500);
        world.until("it follows", 20, || world.ordered(0) == Some(500)).await;
        assert_eq!(counted(world).clocks_behind, 0);
        world.restart_service();
        world.throttle(1300);
        world.until("it follows again", 10, || world.ordered(0) == Some(250)).await;
        assert_eq!(counted(world).clocks_behind, 0);
        // Its earlier frames are still replays.
        let beat = HEARTBEAT_DATA { mavtype: 1, autopilot: 3, ..Default::default() };
        let old = world.frame(TO_AUTOPILOT, AUTOPILOT, &beat);
        world.pass_s(2.0).await;
        world.restart_service();
        world.say_bytes(TO_AUTOPILOT, &old);
        assert_eq!(counted(world).replayed, 1);
    });
}
