//! The key and its time stamp over a loss of power: a frame that has acted does not act again. With a mock of a flash.

use super::store::{Mock, load};
use super::world::*;
use crate::cover::Cover;
use crate::dialect::*;
use crate::frame::{Address, encode};
use crate::ids::*;
use crate::port::PortConfig;
use crate::record::read_signing;
use crate::runner::Runner;
use crate::service::{ParameterStorage, Service};
use crate::settings::{Identity, NodeSettings};
use crate::signing::{Key, SigningState, Stamp};
use crate::store::{AtRest, Found, NotSaved, Store};
use embassy_futures::block_on;
use embassy_futures::join::join;
use embassy_futures::select::select;
use embassy_time::{Duration, Instant, Timer};
use fastrand::Rng;
use jetlink::command::Order;
use jetlink::engine::state::EngineState;
use std::string::String;

const MINUTE: Duration = Duration::from_secs(60);

fn key(byte: u8) -> Option<Key> {
    Key::new([byte; 32])
}

fn known() -> NodeSettings {
    NodeSettings { identity: Identity { system: SYSTEM, ..Identity::DEFAULT }, ..NodeSettings::DEFAULT }
}

fn before_all() -> Stamp {
    Stamp::new(SENDERS_STAMP - 1).unwrap()
}

/// The ground station is on a radio, and settings are stored.
fn run_stored(signing: SigningState, scenario: impl AsyncFnOnce(&World<'_>)) {
    run_signed(known(), signing, PortConfig::network(), async |world| {
        world.service.borrow_mut().set_parameter_storage(ParameterStorage::Stored);
        scenario(world).await;
    });
}

/// Saves what waits, as the runner does.
fn save(world: &World<'_>, store: &mut Store<'_, Mock<'_>>) {
    loop {
        let next = world.service.borrow_mut().next_save();
        let Some((key, record)) = next else { return };
        let result = block_on(store.save(key, &record));
        world.service.borrow_mut().saved(Instant::now(), result);
    }
}

/// The state of signing found after a loss of power.
fn stored(mock: Mock<'_>, at_rest: &AtRest) -> (Found, Option<SigningState>) {
    let (_, found, records) = load(mock, at_rest);
    (found, records.iter().find_map(|(key, record)| read_signing(*key, record)))
}

fn start(engine: usize) -> COMMAND_LONG_DATA {
    COMMAND_LONG_DATA {
        param1: 1.0,
        command: CMD_DO_ENGINE_CONTROL,
        target_system: SYSTEM,
        target_component: ENGINE[engine],
        ..Default::default()
    }
}

fn stop(engine: usize) -> COMMAND_LONG_DATA {
    COMMAND_LONG_DATA { param1: 0.0, ..start(engine) }
}

fn set(value: f32) -> PARAM_SET_DATA {
    PARAM_SET_DATA {
        param_value: value,
        target_system: SYSTEM,
        target_component: ENGINE[0],
        param_id: "LOSS_HOLD".into(),
        param_type: PARAM_REAL32,
    }
}

/// Answers to starts and stops of an engine, and texts, since a frame.
fn answers(world: &World<'_>, at: usize) -> (std::vec::Vec<u8>, String) {
    let (mut acks, mut texts) = (std::vec::Vec::new(), String::new());
    for (_, port, frame) in world.frames.borrow().iter().skip(at) {
        match &frame.message() {
            MavMessage::COMMAND_ACK(ack) if *port == TO_GROUND => acks.push(ack.result),
            MavMessage::STATUSTEXT(text) if *port == TO_GROUND => texts += text.text.to_str().unwrap(),
            _ => {}
        }
    }
    (acks, texts)
}

#[test]
fn what_acts_waits_until_its_stamp_is_stored_and_what_stops_or_reads_does_not() {
    run_stored(SigningState::new(key(7), before_all()), async |world| {
        world.ready().await;
        let at_rest = AtRest::new();
        at_rest.set(true);
        let (mut store, ..) = load(Mock::new(&at_rest), &at_rest);
        save(world, &mut store);
        // The periodic one has covered some seconds.
        world.pass_s(11.0).await;
        let at = world.frames.borrow().len();
        world.say(TO_GROUND, GROUND, &start(0));
        world.pass_s(0.05).await;
        assert_eq!((answers(world, at).0.len(), world.telemetry(0).ordered.order), (0, Order::Standby));
        let stamp = world.stamp.get();
        // Other commands are obeyed meanwhile.
        assert_eq!(world.command(ENGINE[1], CMD_REQUEST_MESSAGE, &[225.0]).await.0, ACCEPTED);
        save(world, &mut store);
        world.pass_s(0.1).await;
        assert_eq!(answers(world, at).0, [0, 0]);
        assert!(matches!(world.telemetry(0).ordered.order, Order::Run(_)));
        // The stamp in the store is ahead of it.
        let (found, state) = stored(store.into_flash(), &at_rest);
        let state = state.unwrap();
        assert!(found == Found::Whole && state.key() == key(7).as_ref());
        let ahead = state.stamp().get() - stamp;
        assert!((900_000..=1_010_000).contains(&ahead), "{ahead}");
        // A covered frame does not wait.
        assert!(world.command(ENGINE[1], CMD_USER_1, &[2.0, 21196.0]).await.0.is_some());
        assert!(world.service.borrow_mut().next_save().is_none());
    });
}

#[test]
fn a_start_that_is_not_stored_within_300_ms_or_that_a_stop_follows_is_refused() {
    run_stored(SigningState::new(key(7), before_all()), async |world| {
        world.ready().await;
        let at = world.frames.borrow().len();
        world.say(TO_GROUND, GROUND, &start(0));
        world.pass_s(0.25).await;
        assert_eq!(answers(world, at).0, []);
        world.pass_s(0.15).await;
        let (acks, texts) = answers(world, at);
        assert!(
            acks == [Ack::TemporarilyRejected as u8] && texts.contains("being stored"),
            "{acks:?} {texts}"
        );
        // A later save has no effect on it.
        assert!(world.service.borrow_mut().next_save().is_some());
        world.service.borrow_mut().saved(Instant::now(), Ok(()));
        world.pass_s(12.0).await;
        assert_eq!(world.telemetry(0).ordered.order, Order::Standby);
        let at = world.frames.borrow().len();
        world.say(TO_GROUND, GROUND, &start(0));
        world.say(TO_GROUND, GROUND, &stop(0));
        assert!(world.service.borrow_mut().next_save().is_some());
        world.service.borrow_mut().saved(Instant::now(), Ok(()));
        world.pass_s(3.0).await;
        let (acks, texts) = answers(world, at);
        assert!(
            acks == [0, 1] && texts.contains("stopped since"),
            "the stop, then the start: {acks:?} {texts}"
        );
        assert_eq!(world.telemetry(0).ordered.order, Order::Standby);
        world.start(0).await;
    });
}

#[test]
fn a_stop_takes_back_only_what_waits_for_its_engine_and_a_cancel_only_if_it_is_allowed() {
    run_stored(SigningState::new(key(7), before_all()), async |world| {
        world.ready().await;
        let saved = || {
            assert!(world.service.borrow_mut().next_save().is_some());
            world.service.borrow_mut().saved(Instant::now(), Ok(()));
        };
        world.say(TO_GROUND, GROUND, &start(0));
        world.say(TO_GROUND, GROUND, &start(1));
        world.say(TO_GROUND, GROUND, &stop(1));
        saved();
        world.pass_s(1.0).await;
        assert!(matches!(world.telemetry(0).ordered.order, Order::Run(_)), "its start was not stopped");
        assert_eq!(world.telemetry(1).ordered.order, Order::Standby);
        world.say(TO_GROUND, GROUND, &stop(0));
        world.pass_s(1.0).await;
        world.cold(0).await;
        // A system that may not command may not stop, either.
        let nobody = Address { system: 9, ..GROUND };
        let cancel = COMMAND_CANCEL_DATA {
            command: CMD_DO_ENGINE_CONTROL,
            target_system: SYSTEM,
            target_component: ENGINE[0],
        };
        world.pass_s(20.0).await;
        world.say(TO_GROUND, GROUND, &start(0));
        world.say(TO_GROUND, nobody, &cancel);
        saved();
        world.pass_s(1.0).await;
        assert!(matches!(world.telemetry(0).ordered.order, Order::Run(_)), "a stranger's cancel counts");
    });
}

#[test]
fn a_store_that_fails_refuses_at_rest_and_does_not_keep_an_engine_from_a_relight() {
    run_stored(SigningState::new(key(7), before_all()), async |world| {
        world.ready().await;
        let fails = |world: &World<'_>, why| {
            assert!(world.service.borrow_mut().next_save().is_some());
            world.service.borrow_mut().saved(Instant::now(), Err(why));
        };
        // A save that is due by time.
        fails(world, NotSaved::Failed);
        for why in [NotSaved::Failed, NotSaved::Full] {
            let at = world.frames.borrow().len();
            world.say(TO_GROUND, GROUND, &start(0));
            fails(world, why);
            world.pass_s(0.2).await;
            let (acks, texts) = answers(world, at);
            let text = if why == NotSaved::Full { "the storage is full" } else { "cannot be stored" };
            assert!(acks == [Ack::TemporarilyRejected as u8] && texts.contains(text), "{acks:?} {texts}");
            assert_eq!(world.telemetry(0).ordered.order, Order::Standby);
        }
        // Stored, the same is a start.
        world.say(TO_GROUND, GROUND, &start(0));
        assert!(world.service.borrow_mut().next_save().is_some());
        world.service.borrow_mut().saved(Instant::now(), Ok(()));
        world.until("the engine runs", 120, || world.telemetry(0).state == EngineState::Running).await;
        // While one engine turns, the other one is started in any case, and a text reports it.
        let at = world.frames.borrow().len();
        world.say(TO_GROUND, GROUND, &start(1));
        fails(world, NotSaved::Full);
        world.pass_s(0.2).await;
        let (acks, texts) = answers(world, at);
        assert!(acks == [0] && texts.contains("its time stamp is not stored"), "{acks:?} {texts}");
        world.until("the engine runs", 120, || world.telemetry(1).state == EngineState::Running).await;
    });
}

#[test]
fn stamps_are_stored_where_an_engine_stops_and_each_ten_minutes_at_rest() {
    run_stored(SigningState::new(key(7), before_all()), async |world| {
        world.ready().await;
        let saves = |world: &World<'_>| {
            let mut stamps = std::vec::Vec::new();
            while let Some((key, record)) = { world.service.borrow_mut().next_save() } {
                stamps.push(read_signing(key, &record).unwrap().stamp().get());
                world.service.borrow_mut().saved(Instant::now(), Ok(()));
            }
            stamps
        };
        assert_eq!(saves(world).len(), 1, "at the start");
        world.pass_s(590.0).await;
        assert_eq!(saves(world).len(), 0);
        world.pass_s(30.0).await;
        assert_eq!(saves(world).len(), 1, "after 10 min");
        world.say(TO_GROUND, GROUND, &start(0));
        world
            .until("the engine runs", 120, || {
                saves(world);
                world.telemetry(0).state == EngineState::Running
            })
            .await;
        world.pass_s(1300.0).await;
        assert_eq!(saves(world).len(), 0, "not in flight");
        world.say(TO_GROUND, GROUND, &stop(0));
        let stopped = world.stamp.get();
        world.until("at rest", 600, || world.telemetry(0).state.is_stopped()).await;
        world.pass_s(1.0).await;
        let stamps = saves(world);
        assert!(stamps.iter().any(|&stamp| stamp > stopped), "{stamps:?} {stopped}");
        // Without a key there is nothing to save.
        world.key_is_everywhere.set(false);
        world.service.borrow_mut().set_parameter_storage(ParameterStorage::Lost);
        world.pass_s(700.0).await;
        assert_eq!(saves(world).len(), 0);
    });
}

/// A start is recorded, the power is lost, and the start is sent again.
#[test]
fn a_replay_after_a_loss_of_power_starts_nothing_and_a_new_start_does() {
    let at_rest = AtRest::new();
    at_rest.set(true);
    let mut flash = None;
    let mut recorded = std::vec::Vec::new();
    run_stored(SigningState::new(key(7), before_all()), async |world| {
        world.ready().await;
        let (mut store, ..) = load(Mock::new(&at_rest), &at_rest);
        save(world, &mut store);
        world.pass_s(30.0).await;
        for frame in [world.frame(TO_GROUND, GROUND, &start(0)), world.frame(TO_GROUND, GROUND, &set(2000.0))]
        {
            world.say_bytes(TO_GROUND, &frame);
            recorded.push(frame);
        }
        save(world, &mut store);
        world.pass_s(1.0).await;
        assert!(matches!(world.telemetry(0).ordered.order, Order::Run(_)), "it is a start");
        flash = Some(store.into_flash());
    });
    let (found, state) = stored(flash.unwrap(), &at_rest);
    assert_eq!(found, Found::Whole);
    let state = state.unwrap();
    // With the stamp from before the flight the replay is accepted: nobody else has been received, and it is within 1 minute.
    let old = SigningState::new(key(7), before_all());
    for (state, counts) in [(state, false), (old, true)] {
        run_stored(state, async |world| {
            // The clock of the others has advanced meanwhile.
            world.stamp.set(SENDERS_STAMP + 100 * 100_000);
            world.service.borrow_mut().set_parameter_storage(ParameterStorage::Lost);
            world.plane.alive.set(false);
            world.ground.set(false);
            world.until("standby", 30, || world.telemetry(0).state == EngineState::Standby).await;
            for frame in &recorded {
                world.say_bytes(TO_GROUND, frame);
            }
            world.pass_s(2.0).await;
            assert!(!matches!(world.telemetry(0).ordered.order, Order::Run(_)));
            let value = world.service.borrow().engine_settings().next().unwrap().0.number("LOSS_HOLD");
            let now = world.service.borrow().counters();
            let (set, behind) = if counts { (2000, 0) } else { (1000, 2) };
            assert_eq!((value, now.commands, now.signing.clocks_behind), (Some(set), counts.into(), behind));
            world.plane.alive.set(true);
            world.ground.set(true);
            world.ready().await;
            world.start(0).await;
        });
    }
}

fn setup(secret_key: [u8; 32]) -> SETUP_SIGNING_DATA {
    SETUP_SIGNING_DATA {
        initial_timestamp: SENDERS_STAMP,
        target_system: SYSTEM,
        target_component: NODE,
        secret_key,
    }
}

/// The control: the key is not replaced while the setting waits.
#[test]
fn a_setting_that_waits_is_not_obeyed_once_its_key_is_replaced() {
    for replaced in [false, true] {
        run_signed(known(), SigningState::new(key(7), before_all()), PortConfig::usb(), async |world| {
            world.service.borrow_mut().set_parameter_storage(ParameterStorage::Stored);
            world.key_is_everywhere.set(!replaced);
            world.ready().await;
            let at_rest = AtRest::new();
            at_rest.set(true);
            let (mut store, ..) = load(Mock::new(&at_rest), &at_rest);
            let hold = || world.service.borrow().engine_settings().next().unwrap().0.number("LOSS_HOLD");
            world.say(TO_AUTOPILOT, GROUND, &set(2500.0));
            assert_eq!(hold(), Some(1000), "it waits");
            if replaced {
                let initial_timestamp = SENDERS_STAMP + 100_000_000;
                let setup = SETUP_SIGNING_DATA { initial_timestamp, ..setup([2; 32]) };
                world.say(TO_GROUND, GROUND, &setup);
            }
            let now = world.service.borrow().signing(Instant::now());
            assert_eq!(now.key(), key(if replaced { 2 } else { 7 }).as_ref(), "{}", world.texts());
            save(world, &mut store);
            world.pass_s(0.1).await;
            save(world, &mut store);
            assert_eq!(hold(), Some(if replaced { 1000 } else { 2500 }));
        });
    }
}

/// Keys are set and cleared, and settings are set in between: the power is cut at every write and erase. The state found then covers
/// everything that has acted, and the key is the last one stored, or the one being stored.
#[test]
fn after_a_power_cut_at_any_write_or_erase_no_stamp_goes_back_and_no_key_is_lost() {
    let at_rest = AtRest::new();
    at_rest.set(true);
    let set_up_and_set = |left, seed| {
        let mock = Mock { left, rng: Rng::with_seed(seed), ..Mock::new(&at_rest) };
        let off = mock.off.clone();
        // Keys that may be found, and the stamp of the last setting obeyed with the last of them.
        let (mut keys, mut acted) = (std::vec![None], 0);
        let mut flash = None;
        run_signed(known(), SigningState::NONE, PortConfig::usb(), async |world| {
            world.service.borrow_mut().set_parameter_storage(ParameterStorage::Stored);
            world.key_is_everywhere.set(false);
            world.until("at rest", 30, || world.service.borrow().is_at_rest()).await;
            let (mut store, ..) = load(mock, &at_rest);
            for (round, byte) in [1, 1, 0, 2, 1, 0].into_iter().enumerate() {
                if keys.last() != Some(&key(byte)) {
                    acted = 0;
                }
                keys.push(key(byte));
                world.say_bytes(TO_GROUND, &encode(GROUND, 0, &setup([byte; 32])));
                world.key.set(key(byte));
                save(world, &mut store);
                for i in 0..2 {
                    if off.get() || byte == 0 {
                        break;
                    }
                    keys = std::vec![key(byte)];
                    // The previous save covers 10 s.
                    world.stamp.set(world.stamp.get() + 1_500_000);
                    let value = (1000 + 10 * round + i) as i32;
                    // Not over USB.
                    world.say(TO_AUTOPILOT, GROUND, &set(value as f32));
                    let stamp = world.stamp.get();
                    save(world, &mut store);
                    world.pass_s(0.01).await;
                    save(world, &mut store);
                    let service = world.service.borrow();
                    if service.engine_settings().next().unwrap().0.number("LOSS_HOLD") == Some(value) {
                        acted = stamp;
                    }
                }
                if off.get() {
                    break;
                }
                keys = std::vec![key(byte)];
            }
            flash = Some(store.into_flash());
        });
        (flash.unwrap(), keys, acted)
    };
    let (flash, ..) = set_up_and_set(None, 0);
    let operations = flash.done;
    assert!(flash.erases > 2, "{} erases, {operations} operations", flash.erases);
    let (found, state) = stored(flash, &at_rest);
    assert!(found == Found::Whole && state.unwrap().key().is_none(), "zeros have cleared it");
    let mut covered = 0;
    for (cut, seed) in (1..=operations).zip(0..) {
        let (flash, keys, acted) = set_up_and_set(Some(cut), seed);
        let case = std::format!("cut at {cut} of {operations}, seed {seed}");
        let (found, state) = stored(Mock { left: None, ..flash }, &at_rest);
        assert_ne!(found, Found::Damaged, "{case}");
        let found = state.as_ref().and_then(|state| state.key().copied());
        assert!(keys.contains(&found), "{case}: {state:?}");
        if keys.last() == Some(&found) && acted > 0 {
            covered += 1;
            assert!(state.unwrap().stamp().get() >= acted, "{case}");
        }
    }
    assert!(covered > operations / 4, "{covered} of {operations}");
}

/// With the runner, as in an image.
#[test]
fn the_runner_stores_key_and_stamp_without_a_frame_that_comes() {
    sim::clock::reset();
    let at_rest = AtRest::new();
    let (mut store, ..) = load(Mock::new(&at_rest), &at_rest);
    let now = Instant::now();
    let signing = SigningState::new(key(7), before_all());
    let mut service: Service<'_, 1, 1> = Service::new(now, known(), signing, [], [PortConfig::network()]);
    service.set_parameter_storage(ParameterStorage::Stored);
    let runner = Runner::new(service);
    let node = join(runner.keep_time(|_, _| ()), runner.store_settings(&mut store, &at_rest));
    sim::clock::run(select(node, Timer::after_secs(1)));
    let (found, state) = stored(store.into_flash(), &at_rest);
    let state = state.unwrap();
    assert!(found == Found::Whole && state.key() == key(7).as_ref() && state.stamp() > before_all());
}

#[test]
fn the_newer_stamp_counts_at_a_start_and_a_missing_key_in_ram_clears_no_stored_one() {
    let state = |key, stamp| Some(SigningState::new(key, Stamp::new(stamp).unwrap()));
    let counts = |retained, stored| {
        let state = SigningState::at_start(retained, stored);
        (state.key().copied(), state.stamp().get())
    };
    assert_eq!(counts(None, None), (None, 0));
    assert_eq!(counts(None, state(key(1), 5)), (key(1), 5));
    assert_eq!(counts(state(key(1), 5), None), (key(1), 5));
    assert_eq!(counts(state(key(1), 5), state(key(1), 7)), (key(1), 7));
    assert_eq!(counts(state(key(1), 9), state(key(1), 7)), (key(1), 9));
    // A key that could not be stored counts as long as it is in RAM.
    assert_eq!(counts(state(key(2), 5), state(key(1), 7)), (key(2), 5));
    assert_eq!(counts(state(None, 9), state(key(1), 7)), (key(1), 9));
    assert_eq!(counts(state(key(1), 9), state(None, 7)), (key(1), 9));
}

#[test]
fn one_save_covers_ten_seconds() {
    let mut cover = Cover::new(Instant::from_secs(0));
    let stamp = |seconds: u64| Stamp::new(seconds * 100_000).unwrap();
    assert!(!cover.covers(stamp(1)) && cover.next_save().is_none());
    cover.want(stamp(100));
    assert_eq!(cover.next_save(), Some(stamp(110)));
    assert!(!cover.covers(stamp(100)), "it is not saved yet");
    assert!(cover.saved(Ok(())) && !cover.saved(Ok(())));
    assert!(cover.covers(stamp(110)) && !cover.covers(stamp(111)));
    let due = |cover: &mut Cover, after: Duration| cover.is_due(Instant::from_secs(0) + after, false, true);
    assert!(due(&mut cover, MINUTE) && !due(&mut cover, 10 * MINUTE) && due(&mut cover, 11 * MINUTE));
}

/// A stop that a component does not know takes back nothing that waits for its stamp.
#[test]
fn a_stop_to_a_component_that_has_no_engine_takes_nothing_back() {
    for stops in [None, Some(NODE), Some(ENGINE[0])] {
        run_stored(SigningState::new(key(7), before_all()), async |world| {
            world.ready().await;
            let at = world.frames.borrow().len();
            world.say(TO_GROUND, GROUND, &set(500.0));
            if let Some(target_component) = stops {
                world.say(TO_GROUND, GROUND, &COMMAND_LONG_DATA { target_component, ..stop(0) });
            }
            for _ in 0..10 {
                world.pass_s(0.02).await;
                while world.service.borrow_mut().next_save().is_some() {
                    world.service.borrow_mut().saved(Instant::now(), Ok(()));
                }
            }
            let (echo, texts) = world.answers(at);
            let expected = if stops == Some(ENGINE[0]) { 1000.0 } else { 500.0 };
            assert_eq!(echo, Some(expected), "stop to {stops:?}: {texts}");
        });
    }
}

/// The key is replaced while the stamp of the old one is being saved, which fails: a setting that waits is not what has failed.
#[test]
fn a_failed_save_of_a_replaced_key_is_not_the_result_of_a_setting() {
    for replaced in [false, true] {
        run_signed(known(), SigningState::new(key(7), before_all()), PortConfig::usb(), async |world| {
            world.service.borrow_mut().set_parameter_storage(ParameterStorage::Stored);
            world.ready().await;
            assert_eq!(world.service.borrow_mut().next_save().map(|(key, _)| key), Some(0x80));
            world.say(TO_GROUND, GROUND, &set(500.0));
            if replaced {
                world.key_is_everywhere.set(false);
                world.say(TO_GROUND, GROUND, &setup([9; 32]));
            }
            world.service.borrow_mut().saved(Instant::now(), Err(NotSaved::Failed));
            let hold = world.service.borrow().engine_settings().next().unwrap().0.parameter("LOSS_HOLD");
            assert_eq!(hold, Some(500), "replaced: {replaced}");
        });
    }
}

/// What RAM retains is settled: while a setting waits for the store, which may refuse it, nothing new is retained.
#[test]
fn a_setting_that_waits_for_the_store_is_not_settled() {
    run_signed(known(), SigningState::NONE, PortConfig::usb(), async |world| {
        world.service.borrow_mut().set_parameter_storage(ParameterStorage::Stored);
        world.ready().await;
        assert!(world.service.borrow().is_saved());
        world.say(
            TO_GROUND,
            GROUND,
            &PARAM_SET_DATA { param_id: "MAV_EFI_EVERY".into(), target_component: NODE, ..set(500.0) },
        );
        world.say(TO_GROUND, GROUND, &set(500.0));
        let mut service = world.service.borrow_mut();
        for (record, result) in [(0, Ok(())), (1, Err(NotSaved::Full))] {
            assert!(!service.is_saved());
            assert_eq!(service.next_save().map(|(key, _)| key), Some(record));
            service.saved(Instant::now(), result);
        }
        assert!(service.is_saved());
        assert_eq!(service.engine_settings().next().unwrap().0.parameter("LOSS_HOLD"), Some(1000));
    });
}
