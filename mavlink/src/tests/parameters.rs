//! Parameters: listed, read, set and refused.

use super::world::*;
use crate::dialect::*;
use crate::port::PortConfig;
use crate::record::apply_to_engine;
use crate::retained_settings::{AttachedDefaults, Defaults};
use crate::service::ParameterStorage;
use crate::service::parameters::{engine_parameters, node_parameters};
use crate::settings::EngineSettings;
use crate::settings::NodeSettings;
use crate::signing::SigningState;
use crate::store::NotSaved;
use embassy_time::Instant;
use jetlink::command::Order;
use jetlink::config::EngineConfig;
use jetlink::ecu::zk::codec::Rate;
use jetlink::engine::state::EngineState;
use jetlink::line::Line;
use std::collections::BTreeMap;
use std::string::{String, ToString};
use std::vec::Vec;

fn list(world: &World<'_>, component: u8) {
    let request = PARAM_REQUEST_LIST_DATA { target_system: SYSTEM, target_component: component };
    world.say(TO_AUTOPILOT, AUTOPILOT, &request);
}

/// Parameters on the autopilot's port since frame `at`: component, index, count, name and value.
fn listed(world: &World<'_>, at: usize) -> Vec<(u8, u16, u16, String, f32)> {
    let frames = world.frames.borrow();
    let values = frames.iter().skip(at).filter_map(|(_, port, frame)| match &frame.message() {
        MavMessage::PARAM_VALUE(value) if *port == TO_AUTOPILOT => Some((
            frame.from.component,
            value.param_index,
            value.param_count,
            value.param_id.to_str().unwrap().into(),
            value.param_value,
        )),
        _ => None,
    });
    values.collect()
}

#[test]
fn a_list_has_every_setting_once_at_twenty_a_second() {
    run(async |world| {
        world.ready().await;
        let at = world.frames.borrow().len();
        list(world, 0);
        world.pass_s(1.0).await;
        let first_second = listed(world, at).len();
        assert!((18..=21).contains(&first_second), "{first_second}");
        world.pass_s(15.0).await;
        let listed = listed(world, at);
        let mut expected = Vec::new();
        let settings = *world.service.borrow().settings();
        let node: Vec<_> = node_parameters().collect();
        for (i, row) in node.iter().enumerate() {
            let value = settings.number(row.name).unwrap() as f32;
            expected.push((NODE, i as u16, node.len() as u16, row.name.to_string(), value));
        }
        let service = world.service.borrow();
        for (component, (config, settings)) in ENGINE.into_iter().zip(service.engine_settings()) {
            let rows: Vec<_> = engine_parameters(config).collect();
            for (i, row) in rows.iter().enumerate() {
                let value =
                    config.number(row.name).or_else(|| settings.own::<false>(row.name)).unwrap() as f32;
                expected.push((component, i as u16, rows.len() as u16, row.name.to_string(), value));
            }
        }
        assert_eq!(listed, expected);
        // No name twice in one component.
        let mut names: BTreeMap<(u8, &str), u32> = BTreeMap::new();
        listed.iter().for_each(|(component, .., name, _)| *names.entry((*component, name)).or_default() += 1);
        assert!(names.values().all(|&count| count == 1));
    });
}

/// As QGroundControl requests them: each component, half a second after the one before, or all at once. None cuts off another one.
#[test]
fn lists_of_several_components_are_all_sent_one_after_the_other() {
    for every_s in [0.5, 0.0] {
        run(async |world| {
            world.ready().await;
            let at = world.frames.borrow().len();
            for component in [ENGINE[0], NODE, ENGINE[1]] {
                list(world, component);
                world.pass_s(every_s).await;
            }
            world.pass_s(10.0).await;
            let frames = listed(world, at);
            let mut indices: BTreeMap<u8, (u16, Vec<u16>)> = BTreeMap::new();
            for (component, index, count, ..) in &frames {
                indices.entry(*component).or_insert((*count, Vec::new())).1.push(*index);
            }
            assert_eq!(indices.len(), 3, "{indices:?}");
            for (component, (count, indices)) in &indices {
                assert_eq!(*indices, (0..*count).collect::<Vec<_>>(), "of {component}");
            }
            let mut order: Vec<_> = frames.iter().map(|(component, ..)| *component).collect();
            order.dedup();
            assert_eq!(order.len(), 3, "one after the other: {order:?}");
        });
    }
}

/// At the same rate, however often it is requested; and a request of a list that waits changes nothing.
#[test]
fn a_list_that_is_requested_again_starts_anew_at_the_same_rate() {
    run(async |world| {
        world.ready().await;
        let at = world.frames.borrow().len();
        list(world, ENGINE[0]);
        world.pass_s(1.0).await;
        let before = listed(world, at).len();
        assert!((18..=21).contains(&before), "{before}");
        list(world, ENGINE[1]);
        list(world, ENGINE[0]);
        list(world, ENGINE[1]);
        world.pass_s(10.0).await;
        let frames = listed(world, at);
        let of = |component| frames.iter().filter(move |(from, ..)| *from == component);
        let count = usize::from(of(ENGINE[0]).next().unwrap().2);
        let indices: Vec<_> = of(ENGINE[0]).map(|(_, index, ..)| usize::from(*index)).collect();
        assert_eq!(indices, (0..before).chain(0..count).collect::<Vec<_>>());
        assert_eq!(of(ENGINE[1]).count(), usize::from(of(ENGINE[1]).next().unwrap().2));
        // Of all components, from the present one on; nobody gets more by requesting more often.
        let at = world.frames.borrow().len();
        for _ in 0..100 {
            list(world, 0);
            list(world, ENGINE[1]);
            world.pass_s(0.01).await;
        }
        let sent = listed(world, at).len();
        assert!((18..=21).contains(&sent), "{sent} in a second");
        world.pass_s(15.0).await;
        let frames = listed(world, at);
        for component in [NODE, ENGINE[0], ENGINE[1]] {
            let indices: Vec<_> =
                frames.iter().filter(|it| it.0 == component).map(|it| (it.1, it.2)).collect();
            let count = usize::from(indices.last().unwrap().1);
            let last = &indices[indices.len() - count..];
            assert!(
                last.iter().map(|(index, _)| usize::from(*index)).eq(0..count),
                "{component}: {indices:?}"
            );
        }
    });
}

#[test]
fn an_engine_has_forty_parameters_at_most_and_what_is_left_out_exists() {
    let amt = EngineConfig::amt("amt", 0, Line::new(9600), None);
    let zk = EngineConfig::zk("zk", 1, Line::new(9600), Rate::Hz20);
    assert!(node_parameters().count() <= 60);
    for config in [amt, zk] {
        let parameters: Vec<_> = engine_parameters(&config).map(|row| row.name).collect();
        assert!(parameters.len() <= 40, "{}", parameters.len());
        let all = config.settings().count() + EngineSettings::SETTINGS.len();
        let left_out: Vec<_> = config.settings().filter(|row| !row.parameter).collect();
        assert_eq!((all, left_out.len()), (parameters.len() + 22, 22));
        assert!(left_out.iter().all(|row| config.number(row.name).is_some()));
    }
}

#[test]
fn a_component_lists_only_its_own_parameters_and_an_unknown_one_lists_none() {
    run(async |world| {
        world.ready().await;
        for (component, some) in [(NODE, true), (ENGINE[1], true), (24, false), (28, false), (1, false)] {
            let at = world.frames.borrow().len();
            list(world, component);
            world.pass_s(10.0).await;
            let listed = listed(world, at);
            assert_eq!(!listed.is_empty(), some, "{component}");
            assert!(listed.iter().all(|(from, ..)| *from == component));
        }
    });
}

#[test]
fn a_setting_is_set_and_counts() {
    run(async |world| {
        world.ready().await;
        assert_eq!(world.set(ENGINE[1], "LOSS_THR", 200.0).await.0, Some(200.0));
        assert_eq!(world.set(ENGINE[1], "MAV_THR_MAX", 2000.0).await.0, Some(2000.0));
        // A loss now ends at 20 %, and full throttle has another pulse.
        world.start(1).await;
        world.throttle(2000);
        world.until("full throttle", 15, || world.ordered(1) == Some(1000)).await;
        world.plane.alive.set(false);
        world.pass_s(20.0).await;
        assert_eq!(world.ordered(1), Some(200));
        // Read by name and by index.
        for (name, index) in [("LOSS_THR", -1), ("", 0)] {
            let at = world.frames.borrow().len();
            let read = PARAM_REQUEST_READ_DATA {
                param_index: index,
                target_system: SYSTEM,
                target_component: ENGINE[1],
                param_id: name.into(),
            };
            world.say(TO_AUTOPILOT, AUTOPILOT, &read);
            world.pass_s(0.1).await;
            let listed = listed(world, at);
            assert_eq!(listed.len(), 1, "{listed:?}");
            assert!(index == 0 || listed[0].4 == 200.0, "{listed:?}");
        }
    });
}

#[test]
fn a_refused_setting_echoes_the_old_value() {
    run(async |world| {
        world.ready().await;
        for (name, value, old, why) in [
            ("LOSS_THR", 1001.0, 0.0, "use 0 to 1000"),
            ("LOSS_THR", 0.5, 0.0, "whole number"),
            ("LOSS_THR", f32::NAN, 0.0, "whole number"),
            ("LOSS_HOLD", -1.0, 1000.0, "use 0 to 60000"),
            ("MAV_THR_MIN", 1900.0, 1100.0, "MAV_THR_MIN has to be below"),
        ] {
            let (echo, text) = world.set(ENGINE[0], name, value).await;
            assert_eq!(echo, Some(old), "{name} {value}: {text}");
            assert!(text.contains("not set") && text.contains(why), "{text}");
        }
        let (echo, text) = world.set(ENGINE[0], "NO_SUCH", 1.0).await;
        assert!(echo.is_none() && text.contains("no parameter has this name"), "{text}");
        // Component 0 sets nothing.
        assert_eq!(world.set(0, "LOSS_THR", 5.0).await, (None, String::new()));
        // A system that may not.
        let set = PARAM_SET_DATA {
            param_value: 5.0,
            target_system: SYSTEM,
            target_component: ENGINE[0],
            param_id: "LOSS_THR".into(),
            param_type: 9,
        };
        world.say(TO_GROUND, crate::frame::Address { system: 7, component: 1 }, &set);
        world.pass_s(0.2).await;
        let service = world.service.borrow();
        let (config, _) = service.engine_settings().next().unwrap();
        assert_eq!(config.number("LOSS_THR"), Some(0));
        assert_eq!(service.counters().parameters_set, 0);
    });
}

/// A setting of the link waits until the engine is at rest; one that the line is too slow for is refused.
#[test]
fn settings_of_a_link_wait_until_the_engine_is_at_rest() {
    run(async |world| {
        world.ready().await;
        let (echo, text) = world.set(ENGINE[1], "LINK_LOST", 3000.0).await;
        assert_eq!((echo, text.as_str()), (Some(3000.0), ""), "at rest: at once");
        world.start(1).await;
        let (echo, text) = world.set(ENGINE[1], "LINK_LOST", 2000.0).await;
        assert_eq!(echo, Some(2000.0));
        assert!(text.contains("LINK_LOST takes effect when the engine is at rest"), "{text}");
        let (echo, text) = world.set(ENGINE[0], "AMT_GUARD", 30_000.0).await;
        assert_eq!(echo, Some(500.0));
        assert!(text.contains("the baud rate leaves no time for this value"), "{text}");
    });
}

#[test]
fn what_moves_an_engine_is_refused_while_one_turns() {
    run(async |world| {
        world.ready().await;
        assert_eq!(world.set(NODE, "MAV_GCS_2", 254.0).await.0, Some(254.0));
        let (echo, text) = world.set(NODE, "MAV_COMP_BASE", 30.0).await;
        assert_eq!(echo, Some(30.0));
        assert!(text.contains("takes effect at the node's next start"), "{text}");
        world.start(1).await;
        for (component, name, value, old) in [
            (ENGINE[1], "MAV_THR_OUT", 1.0, 4.0),
            (ENGINE[1], "MAV_THR_SRC", 0.0, 1.0),
            (ENGINE[1], "MAV_THR_REV", 1.0, 0.0),
            (NODE, "MAV_GCS_1", 1.0, 255.0),
            (NODE, "MAV_SYSID", 9.0, 0.0),
        ] {
            let (echo, text) = world.set(component, name, value).await;
            assert_eq!(echo, Some(old), "{name}");
            assert!(text.contains("an engine turns"), "{text}");
        }
        // The other engine is at rest, and supervision may change at any time.
        assert_eq!(world.set(ENGINE[0], "MAV_THR_OUT", 1.0).await.0, Some(1.0));
        assert_eq!(world.set(ENGINE[1], "LOSS_HOLD", 2000.0).await.0, Some(2000.0));
        assert_eq!(world.telemetry(1).state, EngineState::Running);
    });
}

/// A board that stores nothing has RAM for a limited number of changes. One more is refused; another value of an earlier one is not.
/// The old value returns if the new one is not stored: an engine that has begun to start would get the throttle of another output.
#[test]
fn no_engine_starts_while_a_setting_of_it_is_being_stored() {
    run(async |world| {
        world.ready().await;
        world.service.borrow_mut().set_parameter_storage(ParameterStorage::Stored);
        let set_output = |pulse: u16| {
            let mut outputs = world.plane.outputs.get();
            outputs[2] = pulse;
            world.plane.outputs.set(outputs);
        };
        set_output(0);
        let at = world.frames.borrow().len();
        assert_eq!(world.set(ENGINE[0], "MAV_THR_OUT", 5.0).await.0, None, "not answered yet");
        let (answer, texts) = world.control(0, &[1.0]).await;
        assert!(answer == Some(1) && texts.contains("being stored"), "{answer:?} {texts}");
        // The other engine's settings are not in question.
        assert_eq!(world.control(1, &[1.0]).await.0, Some(0));
        assert!(world.service.borrow_mut().next_save().is_some());
        world.service.borrow_mut().saved(Instant::now(), Err(NotSaved::Full));
        world.pass_s(0.1).await;
        assert_eq!(world.answers(at).0, Some(3.0));
        // Output 5 was at idle, which says nothing about output 3.
        let (answer, texts) = world.control(0, &[1.0]).await;
        assert!(answer == Some(1) && texts.contains("no throttle received"), "{answer:?} {texts}");
        set_output(IDLE_US);
        assert_eq!(world.telemetry(0).ordered.order, Order::Standby);
        world.until("the other one runs", 120, || world.telemetry(1).state == EngineState::Running).await;
        world.pass_s(11.0).await;
        world.start(0).await;
    });
}

#[test]
fn a_change_that_ram_cannot_retain_is_refused_where_nothing_is_stored() {
    const NONE: Defaults<'static> = Defaults {
        node: &NodeSettings::DEFAULT,
        engines: &[],
        own: &[],
        wiring: &[],
        attached: AttachedDefaults::NONE,
        room: 0,
    };
    run(async |world| {
        world.ready().await;
        // For one change of the node beside the id that was learnt.
        let set_storage = |storage| world.leave_room(storage, NONE, 6);
        set_storage(ParameterStorage::Lost);
        assert_eq!(world.set(NODE, "MAV_GCS_2", 9.0).await.0, Some(9.0));
        let (echo, text) = world.set(NODE, "MAV_EFI_EVERY", 500.0).await;
        assert!(echo == Some(250.0) && text.contains("RAM retains no more changes"), "{text}");
        assert_eq!(world.set(NODE, "MAV_GCS_2", 10.0).await.0, Some(10.0));
        // Where it is stored it is accepted, and a text says what a reset would lose.
        set_storage(ParameterStorage::ByBuilder);
        assert_eq!(world.set(NODE, "MAV_EFI_EVERY", 500.0).await.0, Some(500.0));
        let (echo, text) = world.set(NODE, "MAV_EFI_ENGINE", 2.0).await;
        assert!(echo == Some(2.0) && text.contains("RAM has no space to retain it"), "{text}");
    });
}

/// Neither the vehicle's components nor a ground station may set a value that shuts them out: nobody could undo it. A person at the board
/// may, over USB.
#[test]
fn who_may_command_cannot_be_set_so_that_its_sender_may_not() {
    for usb in [false, cfg!(feature = "signing")] {
        let ground = if usb { PortConfig::usb() } else { PortConfig::network() };
        run_signed(NodeSettings::DEFAULT, SigningState::NONE, ground, async |world| {
            world.ready().await;
            assert_eq!(world.set(NODE, "MAV_OWN_CMD", 0.0).await.0, Some(0.0), "the ground station may");
            let (echo, text) = world.set(NODE, "MAV_GCS_1", 254.0).await;
            assert_eq!(echo, Some(if usb { 254.0 } else { 255.0 }), "{text}");
            assert_eq!(text.contains("set it over USB"), !usb, "{text}");
            // Over USB it is set back. The control: with another one set, the first may be removed.
            assert_eq!(world.set(NODE, "MAV_GCS_1", 255.0).await.0, Some(255.0));
            assert_eq!(world.set(NODE, "MAV_GCS_2", 255.0).await.0, Some(255.0));
            assert_eq!(world.set(NODE, "MAV_GCS_1", 0.0).await.0, Some(0.0));
        });
    }
}

/// A second change may come before the record with the first one is made, or while that one is being written.
#[test]
fn ram_echo_and_store_agree_whichever_save_of_two_changes_fails() {
    const FAILS: Result<(), NotSaved> = Err(NotSaved::Full);
    for (results, late, expected) in [
        ([FAILS, FAILS], false, [0, 1000]),
        ([FAILS, Ok(())], false, [0, 1000]),
        ([Ok(()), FAILS], false, [400, 2000]),
        ([Ok(()), Ok(())], false, [400, 2000]),
        ([FAILS, FAILS], true, [0, 1000]),
        ([FAILS, Ok(())], true, [0, 1000]),
        ([Ok(()), FAILS], true, [300, 1000]),
        ([Ok(()), Ok(())], true, [400, 2000]),
    ] {
        run(async |world| {
            world.ready().await;
            world.service.borrow_mut().set_parameter_storage(ParameterStorage::Stored);
            let at = world.frames.borrow().len();
            let mut results = results.into_iter();
            let mut stored = [0, 1000];
            let begin = || world.service.borrow_mut().next_save();
            assert_eq!(world.set(ENGINE[0], "LOSS_THR", 300.0).await.0, None);
            let mut next = if late { begin() } else { None };
            assert_eq!(world.set(ENGINE[0], "LOSS_THR", 400.0).await.0, None);
            assert_eq!(world.set(ENGINE[0], "LOSS_HOLD", 2000.0).await.0, None, "of the same record");
            if !late {
                next = begin();
            }
            while let Some((_, record)) = next {
                let result = results.next().unwrap_or(Ok(()));
                if result.is_ok() {
                    let mut config = EngineConfig::amt("left", 0, Line::new(9600), None);
                    apply_to_engine(&mut config, &mut EngineSettings::DEFAULT.clone(), &record);
                    stored = ["LOSS_THR", "LOSS_HOLD"].map(|name| config.number(name).unwrap());
                }
                world.service.borrow_mut().saved(Instant::now(), result);
                world.pass_s(0.2).await;
                next = begin();
            }
            let service = world.service.borrow();
            let (config, _) = service.engine_settings().next().unwrap();
            let ram = ["LOSS_THR", "LOSS_HOLD"].map(|name| config.number(name).unwrap());
            let frames = world.frames.borrow();
            let echo = |name: &str| {
                let echoes = frames.iter().skip(at).filter_map(|(_, port, frame)| match &frame.message() {
                    MavMessage::PARAM_VALUE(value)
                        if *port == TO_GROUND && value.param_id.to_str() == Ok(name) =>
                    {
                        Some(value.param_value as i32)
                    }
                    _ => None,
                });
                let echoes: Vec<_> = echoes.collect();
                (echoes.len(), *echoes.last().unwrap())
            };
            let (echoed_thr, echoed_hold) = (echo("LOSS_THR"), echo("LOSS_HOLD"));
            assert_eq!((echoed_thr.0, echoed_hold.0), (2, 1), "each change is answered");
            let echoed = [echoed_thr.1, echoed_hold.1];
            assert_eq!((ram, echoed, stored), (expected, expected, expected), "late: {late}");
        });
    }
}
