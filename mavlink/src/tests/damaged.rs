//! A node whose stored settings are damaged: it is unknown who may command; so are the key and every setting. Only a stop counts, and
//! the actions of a person at the board.

#[cfg(feature = "signing")]
use super::store::{Mock, Word, load, unreadable};
use super::world::*;
use crate::dialect::*;
use crate::frame::Address;
#[cfg(feature = "signing")]
use crate::frame::encode;
use crate::ids::*;
use crate::port::PortConfig;
use crate::retained_settings::{AttachedDefaults, Defaults};
#[cfg(feature = "signing")]
use crate::runner::Runner;
#[cfg(feature = "signing")]
use crate::service::{ParameterStorage, Request, Service};
use crate::settings::{Identity, NodeSettings};
use crate::signing::SigningState;
#[cfg(feature = "signing")]
use crate::signing::{Key, Stamp};
#[cfg(feature = "signing")]
use crate::store::{AtRest, Found, NotSaved};
#[cfg(feature = "signing")]
use embassy_futures::block_on;
#[cfg(feature = "signing")]
use embassy_futures::join::join;
#[cfg(feature = "signing")]
use embassy_futures::select::select;
#[cfg(feature = "signing")]
use embassy_time::{Duration, Instant, Timer};
use jetlink::command::Order;
use jetlink::engine::state::EngineState;
use jetlink::event::LossStage;
#[cfg(feature = "signing")]
use std::cell::Cell;
use std::vec::Vec;

const CONFIRM: &[f32] = &[30.0, 21196.0];
const EMERGENCY_STOP: &[f32] = &[1.0, 21196.0];
const RELEASE: &[f32] = &[2.0, 21196.0];
/// A system that may not command.
const STRANGER: Address = Address { system: 77, component: 1 };

/// The vehicle's id is set in the image.
fn known() -> NodeSettings {
    NodeSettings { identity: Identity { system: SYSTEM, ..Identity::DEFAULT }, ..NodeSettings::DEFAULT }
}

/// The ground station is on a radio: nobody is at the board.
fn run_on_a_radio(settings: NodeSettings, scenario: impl AsyncFnOnce(&World<'_>)) {
    run_signed(settings, SigningState::NONE, PortConfig::network(), scenario);
}

fn stop_of(engine: usize, system: u8) -> COMMAND_LONG_DATA {
    COMMAND_LONG_DATA {
        command: CMD_DO_ENGINE_CONTROL,
        target_system: system,
        target_component: ENGINE[engine],
        ..Default::default()
    }
}

#[test]
fn nothing_is_obeyed_by_radio_but_a_stop_and_a_stop_of_anybody_is() {
    run_on_a_radio(known(), async |world| {
        world.ready().await;
        world.start(1).await;
        world.service.borrow_mut().set_damaged(true);
        // Also from systems that may command by default.
        for (component, params) in
            [(ENGINE[0], RELEASE), (ENGINE[0], &[10.0][..]), (ENGINE[1], &[20.0, 5.0]), (NODE, CONFIRM)]
        {
            let (answer, text) = world.command(component, CMD_USER_1, params).await;
            assert!(answer == NOT_NOW || answer == DENIED, "{params:?}: {answer:?} {text}");
            assert!(text.contains("damaged"), "{params:?}: {text}");
        }
        let (answer, text) = world.control(0, &[1.0]).await;
        assert!(answer == NOT_NOW && text.contains("damaged"), "{answer:?} {text}");
        let (answer, text) = world.command(NODE, CMD_PREFLIGHT_REBOOT_SHUTDOWN, &[1.0]).await;
        assert!(answer == NOT_NOW && text.contains("damaged"), "{answer:?} {text}");
        for (component, name, value) in [(NODE, "MAV_GCS_2", 9.0), (ENGINE[1], "LOSS_HOLD", 5.0)] {
            let (echo, text) = world.set(component, name, value).await;
            assert!(echo.is_some_and(|echo| echo != value) && text.contains("damaged"), "{echo:?} {text}");
        }
        // Reading is harmless.
        assert_eq!(world.command(ENGINE[0], CMD_REQUEST_MESSAGE, &[225.0]).await.0, ACCEPTED);
        assert_eq!(world.telemetry(1).state, EngineState::Running, "none of it has touched the engine");
        // A stop is obeyed, whoever sends it: it is unknown who may.
        let stop = world.frame(TO_GROUND, STRANGER, &stop_of(1, SYSTEM));
        let to = (SYSTEM, ENGINE[1]);
        let answer = world.answer_to(TO_GROUND, &stop, STRANGER, to, CMD_DO_ENGINE_CONTROL).await;
        assert_eq!(answer.0, ACCEPTED, "{}", answer.1);
        world.until("stopped", 10, || world.telemetry(1).ordered.order == Order::Standby).await;
        let from = Address { system: 78, ..STRANGER };
        let answer = world.command_from(TO_GROUND, from, (SYSTEM, NODE), CMD_USER_1, 0, EMERGENCY_STOP).await;
        assert_eq!(answer.0, ACCEPTED, "{}", answer.1);
        world.until("latched", 10, || (0..2).all(|engine| world.telemetry(engine).stop_latched)).await;
        // With intact settings a stranger stops nothing.
        world.service.borrow_mut().set_damaged(false);
        assert_eq!(world.command(ENGINE[0], CMD_USER_1, RELEASE).await.0, ACCEPTED);
        let answer = world.command_from(TO_GROUND, from, (SYSTEM, NODE), CMD_USER_1, 0, EMERGENCY_STOP).await;
        assert_eq!(answer.0, DENIED, "{}", answer.1);
    });
}

#[cfg(feature = "signing")]
#[test]
fn a_person_at_the_board_sets_and_confirms() {
    run(async |world| {
        world.ready().await;
        world.service.borrow_mut().set_damaged(true);
        assert_eq!(world.set(NODE, "MAV_GCS_2", 9.0).await.0, Some(9.0));
        assert_eq!(world.set(ENGINE[1], "LOSS_HOLD", 500.0).await.0, Some(500.0));
        let (answer, text) = world.control(0, &[1.0]).await;
        assert!(answer == NOT_NOW && text.contains("damaged"), "a start takes the confirmation: {text}");
        // Not on the autopilot's port.
        let away = world.command_from(TO_AUTOPILOT, GROUND, (SYSTEM, NODE), CMD_USER_1, 0, CONFIRM).await;
        assert!(away.0 == NOT_NOW && !world.service.borrow_mut().take_rewrite(), "{away:?}");
        assert_eq!(world.command(NODE, CMD_USER_1, CONFIRM).await.0, ACCEPTED);
        assert!(world.service.borrow_mut().take_rewrite());
        // They are damaged until everything is stored, and a text reports each result.
        for result in [Err(NotSaved::Failed), Ok(())] {
            let (answer, text) = world.command(NODE, CMD_USER_1, CONFIRM).await;
            assert!(answer == NOT_NOW && text.contains("being stored"), "once at a time: {answer:?} {text}");
            assert!(world.service.borrow().is_damaged() && !world.service.borrow().is_saved());
            assert!(world.control(0, &[1.0]).await.1.contains("damaged"));
            world.pass_s(6.0).await;
            world.service.borrow_mut().rewritten(Instant::now(), result);
            world.pass_s(0.2).await;
            assert!(world.service.borrow().is_saved());
            if result.is_err() {
                assert!(world.texts().contains("settings not confirmed: it cannot be stored"));
                assert!(!world.texts().contains("confirmed and stored"));
                assert_eq!(world.command(NODE, CMD_USER_1, CONFIRM).await.0, ACCEPTED);
                assert!(world.service.borrow_mut().take_rewrite());
            }
        }
        assert!(
            world.texts().contains("settings confirmed and stored") && !world.service.borrow().is_damaged()
        );
        world.start(0).await;
    });
}

/// Its memory does not answer: a person confirms each time.
#[cfg(feature = "signing")]
#[test]
fn without_a_memory_a_person_confirms_until_the_power_is_lost() {
    run(async |world| {
        world.ready().await;
        world.service.borrow_mut().set_parameter_storage(ParameterStorage::Lost);
        world.service.borrow_mut().set_damaged(true);
        let away = world.command_from(TO_AUTOPILOT, GROUND, (SYSTEM, NODE), CMD_USER_1, 0, CONFIRM).await;
        assert!(away.0 == NOT_NOW && world.service.borrow().is_damaged(), "{away:?}");
        assert!(world.control(0, &[1.0]).await.1.contains("damaged"));
        let (answer, text) = world.command(NODE, CMD_USER_1, CONFIRM).await;
        assert!(answer == ACCEPTED && text.contains("confirmed until the power is lost"), "{text}");
        assert!(!world.service.borrow_mut().take_rewrite() && world.service.borrow().is_saved());
        world.pass_s(6.0).await;
        world.start(0).await;
    });
}

/// The id of the vehicle was learnt, and is lost with the settings: the node knows no system that a message may address.
#[test]
fn a_stop_counts_though_the_id_of_the_vehicle_is_lost() {
    run_on_a_radio(known(), async |world| {
        world.ready().await;
        world.start(1).await;
        world.lose_settings();
        world.pass_s(3.0).await;
        assert_eq!(world.service.borrow().system_id(), None, "it is not learnt while an engine runs");
        // Not all components, and none of ours.
        for component in [0, 1, 99] {
            let stop = COMMAND_LONG_DATA { target_component: component, ..stop_of(1, SYSTEM) };
            world.say(TO_AUTOPILOT, GROUND, &stop);
        }
        world.say(TO_AUTOPILOT, GROUND, &COMMAND_LONG_DATA { param1: 1.0, ..stop_of(0, SYSTEM) });
        world.pass_s(2.0).await;
        assert!(matches!(world.telemetry(1).ordered.order, Order::Run(_)));
        assert_eq!(world.telemetry(0).ordered.order, Order::Standby, "and no start");
        let cancel = COMMAND_CANCEL_DATA {
            command: CMD_DO_ENGINE_CONTROL,
            target_system: SYSTEM,
            target_component: ENGINE[1],
        };
        world.say(TO_AUTOPILOT, GROUND, &cancel);
        world.until("stopped", 2, || world.telemetry(1).ordered.order == Order::Standby).await;
    });
}

/// The throttle output of an engine is also a setting: the demand of a running engine goes through the stages of loss, and nothing
/// shuts it down.
#[test]
fn a_running_engine_runs_on_at_the_fail_safe_throttle() {
    run_on_a_radio(known(), async |world| {
        world.ready().await;
        world.start(1).await;
        world.throttle(1500);
        world.until("half throttle", 20, || world.ordered(1) == Some(500)).await;
        world.service.borrow_mut().set_damaged(true);
        world.pass_s(1.5).await;
        assert_eq!(world.ordered(1), Some(500), "held");
        world.until("idle", 10, || world.ordered(1) == Some(0)).await;
        world.throttle(1900);
        for _ in 0..120 {
            world.pass_s(1.0).await;
            let telemetry = world.telemetry(1);
            assert_eq!((world.ordered(1), telemetry.state), (Some(0), EngineState::Running));
            assert_eq!(telemetry.loss, LossStage::FailSafe);
        }
        // Confirmed, it follows again.
        world.service.borrow_mut().set_damaged(false);
        world.until("full throttle", 20, || world.ordered(1) == Some(1000)).await;
    });
}

#[cfg(feature = "signing")]
#[test]
fn damage_is_reported_on_every_port_until_it_is_confirmed() {
    run(async |world| {
        world.ready().await;
        let reported = |world: &World<'_>, at: usize| {
            let frames = world.frames.borrow();
            let texts = frames.iter().skip(at).filter_map(|(_, port, frame)| match &frame.message() {
                MavMessage::STATUSTEXT(text) if text.text.to_str().is_ok_and(|it| it.contains("DAMAGED")) => {
                    assert_eq!((text.severity, frame.from.component), (Severity::Critical as u8, NODE));
                    Some(*port)
                }
                _ => None,
            });
            texts.collect::<Vec<_>>()
        };
        // The highest byte of custom_mode, and whether it is critical.
        let shown = |world: &World<'_>| {
            let frames = world.frames.borrow();
            let last = frames.iter().rev().find_map(|(_, _, frame)| match &frame.message() {
                MavMessage::HEARTBEAT(beat) if frame.from.component == NODE => Some(beat.clone()),
                _ => None,
            });
            let last = last.unwrap();
            (last.custom_mode >> 24, last.system_status == SystemStatus::Critical as u8)
        };
        assert_eq!((reported(world, 0).len(), shown(world)), (0, (0, false)));
        world.service.borrow_mut().set_damaged(true);
        let at = world.frames.borrow().len();
        world.pass_s(25.0).await;
        let ports = reported(world, at);
        for port in [TO_AUTOPILOT, TO_GROUND] {
            assert_eq!(ports.iter().filter(|&&other| other == port).count(), 3, "{ports:?}");
        }
        assert_eq!(shown(world), (1, true));
        assert_eq!(world.command(NODE, CMD_USER_1, CONFIRM).await.0, ACCEPTED);
        assert!(world.service.borrow_mut().take_rewrite());
        world.service.borrow_mut().rewritten(Instant::now(), Ok(()));
        let at = world.frames.borrow().len();
        world.pass_s(25.0).await;
        assert_eq!((reported(world, at).len(), shown(world)), (0, (0, false)));
    });
}

/// After a reset in flight RAM has the settings, but not whether frames have to be signed.
#[cfg(feature = "signing")]
#[test]
fn retained_settings_do_not_count_while_it_is_unknown_whether_there_was_a_key() {
    let key = SigningState::new(Key::new([7; 32]), Stamp::new(1000).unwrap());
    for (signing, obeys) in [(SigningState::NONE, false), (no_key(), true), (key, true)] {
        let mut service: Service<'_, 1, 1> =
            Service::new(Instant::now(), known(), signing, [], [PortConfig::network()]);
        service.set_retained();
        assert_eq!((service.is_damaged(), service.has_to_be_confirmed()), (!obeys, true));
    }
}

/// After a reset in flight RAM has the settings: everything continues, and a person confirms them later, over USB.
#[test]
fn settings_that_ram_has_retained_count_as_before() {
    run_signed(NodeSettings::DEFAULT, no_key(), PortConfig::usb(), async |world| {
        world.ready().await;
        let engines: Vec<_> = world.service.borrow().engine_settings().map(|(config, _)| *config).collect();
        assert_eq!(world.set(ENGINE[1], "LOSS_HOLD", 500.0).await.0, Some(500.0));
        // For the second engine this, and its output, which is 4 in this world.
        let attached = AttachedDefaults::NONE;
        let node = &NodeSettings::DEFAULT;
        let defaults = Defaults { node, engines: &engines, own: &[], wiring: &[], attached, room: 64 };
        let keys: Vec<_> = {
            let service = world.service.borrow();
            service.changes(&defaults).map(|(key, record)| (key, record.len() / 6)).collect()
        };
        assert_eq!(keys, [(0, 1), (1, 0), (2, 2)], "the id that was learnt is of the node");
        world.start(1).await;
        world.service.borrow_mut().set_retained();
        assert!(!world.service.borrow().is_damaged() && world.service.borrow().has_to_be_confirmed());
        world.throttle(1500);
        world.until("half throttle", 20, || world.ordered(1) == Some(500)).await;
        world.throttle(IDLE_US);
        let away = world.command_from(TO_AUTOPILOT, GROUND, (SYSTEM, NODE), CMD_USER_1, 0, CONFIRM).await;
        assert!(away.0 != ACCEPTED && !world.service.borrow_mut().take_rewrite(), "{away:?}");
        let stranger = Address { system: 78, ..STRANGER };
        let answer =
            world.command_from(TO_GROUND, stranger, (SYSTEM, NODE), CMD_USER_1, 0, EMERGENCY_STOP).await;
        assert_eq!(answer.0, DENIED, "who may command is known: {}", answer.1);
        world.pass_s(10.0).await;
        world.start(0).await;
        assert!(world.texts().contains("stored settings DAMAGED: confirm"), "{}", world.texts());
        for engine in 0..2 {
            assert_eq!(world.control(engine, &[0.0]).await.0, ACCEPTED);
        }
        world.cold(0).await;
        world.cold(1).await;
        #[cfg(feature = "signing")]
        {
            assert_eq!(world.command(NODE, CMD_USER_1, CONFIRM).await.0, ACCEPTED);
            assert!(
                world.service.borrow_mut().take_rewrite() && world.service.borrow().has_to_be_confirmed()
            );
            world.service.borrow_mut().rewritten(Instant::now(), Ok(()));
        }
        #[cfg(not(feature = "signing"))]
        world.service.borrow_mut().set_damaged(false);
        assert!(!world.service.borrow().has_to_be_confirmed());
    });
}

/// The person who confirms restarts the board next. With the runner and a slow memory, as in an image.
#[cfg(feature = "signing")]
#[test]
fn a_restart_after_a_confirmation_waits_until_all_is_stored() {
    sim::clock::reset();
    let at_rest = AtRest::new();
    at_rest.set(true);
    let (mut store, ..) = load(Mock::new(&at_rest), &at_rest);
    for key in 0..3 {
        block_on(store.save(key, &[key; 40])).unwrap();
    }
    let mut mock = store.into_flash();
    mock.words[1] = Word::Torn;
    mock.erase_time = Some(Duration::from_secs(2));
    let (mut store, found, _) = load(mock, &at_rest);
    assert_eq!(found, Found::Damaged);
    let now = Instant::now();
    let mut service: Service<'_, 1, 1> =
        Service::new(now, known(), SigningState::NONE, [], [PortConfig::usb()]);
    service.set_parameter_storage(ParameterStorage::Stored);
    service.set_damaged(true);
    let to_node = |command, params: &[f32]| COMMAND_LONG_DATA {
        command,
        param1: params[0],
        param2: params.get(1).copied().unwrap_or_default(),
        target_system: SYSTEM,
        target_component: NODE,
        ..Default::default()
    };
    service.receive(now, 0, &encode(GROUND, 0, &to_node(CMD_USER_1, CONFIRM)));
    service.receive(now, 0, &encode(GROUND, 1, &to_node(CMD_PREFLIGHT_REBOOT_SHUTDOWN, &[1.0])));
    let runner = Runner::new(service);
    let restarted = Cell::new(None);
    let node = async {
        let request = runner.keep_time(|_, service| assert!(restarted.get().is_none(), "{service:?}")).await;
        restarted.set(Some((request, Instant::now())));
    };
    sim::clock::run(select(node, runner.store_settings(&mut store, &at_rest)));
    let (request, at) = restarted.get().expect("it restarts");
    assert!(request == Request::Reboot && at >= now + Duration::from_secs(4), "two erases: {at}");
    let mock = Mock { erase_time: None, ..store.into_flash() };
    let (_, found, records) = load(mock, &at_rest);
    assert_eq!((found, records.keys().copied().collect::<Vec<_>>()), (Found::Whole, std::vec![0, 0x80]));
}

/// A node with a port for an autopilot and USB, for 8 s on a damaged memory: what its next start finds.
#[cfg(feature = "signing")]
fn next_start(mock: Mock<'_>, key: Option<Key>, says: impl FnOnce(&mut Service<'_, 1, 2>, Instant)) -> Found {
    sim::clock::reset();
    let at_rest = mock.at_rest;
    let (mut store, found, _) = load(mock, at_rest);
    assert_eq!(found, Found::Damaged);
    let now = Instant::now();
    let signing = SigningState::new(key, Stamp::new(1000).unwrap());
    let ports = [PortConfig::uart(57_600), PortConfig::usb()];
    let mut service = Service::new(now, NodeSettings::DEFAULT, signing, [], ports);
    service.set_parameter_storage(ParameterStorage::Stored);
    service.set_damaged(true);
    says(&mut service, now);
    let runner = Runner::new(service);
    let node = join(runner.keep_time(|_, _| ()), runner.store_settings(&mut store, at_rest));
    sim::clock::run(select(node, Timer::after_secs(8)));
    let mock = store.into_flash();
    assert!(mock.done > 0, "something was stored");
    load(mock, at_rest).1
}

#[cfg(feature = "signing")]
#[test]
fn nothing_that_the_node_stores_by_itself_confirms_the_settings() {
    let at_rest = AtRest::new();
    let unreadable = unreadable(&at_rest);
    let (mut store, ..) = load(Mock::new(&at_rest), &at_rest);
    for key in 0..3 {
        block_on(store.save(key, &[key; 40])).unwrap();
    }
    let mut partly = store.into_flash();
    partly.words[1] = Word::Torn;
    // The next record meets a word that is not empty, and the memory does not accept it.
    let mut full = partly.clone();
    let used = full.words.iter().rposition(|&word| word != Word::Holds([0xFF; 32])).unwrap();
    full.words[used + 2] = Word::Torn;
    for mock in [unreadable, partly, full].map(|mock| Mock { done: 0, ..mock }) {
        let learns = |service: &mut Service<'_, 1, 2>, now| {
            let beat = HEARTBEAT_DATA { mavtype: 1, autopilot: 3, mavlink_version: 3, ..Default::default() };
            for second in 0..7 {
                service.receive(now + Duration::from_secs(second), 0, &encode(AUTOPILOT, 0, &beat));
            }
            assert!(!service.is_saved(), "the id is learnt");
        };
        assert_eq!(next_start(mock.clone(), None, learns), Found::Damaged, "an id");
        assert_eq!(next_start(mock.clone(), Key::new([7; 32]), |_, _| ()), Found::Damaged, "a time stamp");
        let confirms = |service: &mut Service<'_, 1, 2>, now| {
            let confirm = COMMAND_LONG_DATA {
                command: CMD_USER_1,
                param1: CONFIRM[0],
                param2: CONFIRM[1],
                target_system: SYSTEM,
                target_component: NODE,
                ..Default::default()
            };
            service.receive(now, 1, &encode(GROUND, 0, &confirm));
        };
        assert_eq!(next_start(mock, None, confirms), Found::Whole, "a person");
    }
}

/// An image without USB does not know the record of the key; this one knows no attached devices.
#[cfg(feature = "signing")]
#[test]
fn a_memory_with_a_record_of_another_image_is_not_rewritten() {
    for other in [None, Some(0x85)] {
        sim::clock::reset();
        let at_rest = AtRest::new();
        at_rest.set(true);
        let (mut store, ..) = load(Mock::new(&at_rest), &at_rest);
        for key in [Some(0), other].into_iter().flatten() {
            block_on(store.save(key, &[1; 40])).unwrap();
        }
        let mut mock = store.into_flash();
        let used = mock.words.iter().rposition(|&word| word != Word::Holds([0xFF; 32])).unwrap();
        // The next record meets a word that is not empty.
        mock.words[used + 2] = Word::Torn;
        let (mut store, ..) = load(mock, &at_rest);
        let now = Instant::now();
        let mut service: Service<'_, 1, 1> =
            Service::new(now, NodeSettings::DEFAULT, SigningState::NONE, [], [PortConfig::uart(57_600)]);
        service.set_parameter_storage(ParameterStorage::Stored);
        let beat = HEARTBEAT_DATA { mavtype: 1, autopilot: 3, mavlink_version: 3, ..Default::default() };
        for second in 0..7 {
            service.receive(now + Duration::from_secs(second), 0, &encode(AUTOPILOT, 0, &beat));
        }
        assert!(!service.is_saved(), "the id is learnt");
        let runner = Runner::new(service);
        sim::clock::run(select(runner.store_settings(&mut store, &at_rest), Timer::after_secs(8)));
        let (_, found, records) = load(store.into_flash(), &at_rest);
        assert_eq!((found, records.contains_key(&0x85)), (Found::Whole, other.is_some()));
        assert_eq!(records[&0] != [1; 40], other.is_none(), "stored where nothing is lost by it");
    }
}
