//! The engines' wiring, as parameters of the node.

use super::world::*;
use crate::dialect::*;
use crate::record::{self, NotUsed};
use crate::service::ParameterStorage;
use crate::service::parameters::{node_parameters, wiring_parameters};
use crate::settings::{EngineSettings, NodeSettings};
use crate::store::NotSaved;
use embassy_time::Instant;
use jetlink::config::EngineConfig;
use jetlink::ecu::amt::codec::EngineModel;
use jetlink::ecu::zk::codec::Rate;
use jetlink::line::Line;
use jetlink::wiring::{Contradiction, Wiring, WiringError};
use std::collections::BTreeSet;
use std::string::{String, ToString};
use std::vec::Vec;

/// Wiring of the engines of the world.
const IMAGE: [Wiring; 2] = [
    Wiring::of(&EngineConfig::amt("left", 0, Line::new(9600), None)),
    Wiring::of(&EngineConfig::zk("right", 1, Line::new(9600), Rate::Hz20)),
];

/// Names and values of the node's parameters.
async fn listed(world: &World<'_>) -> Vec<(String, f32)> {
    let at = world.frames.borrow().len();
    let request = PARAM_REQUEST_LIST_DATA { target_system: SYSTEM, target_component: NODE };
    world.say(TO_GROUND, GROUND, &request);
    world.pass_s(5.0).await;
    let frames = world.frames.borrow();
    let mut listed = Vec::new();
    for (_, port, frame) in frames.iter().skip(at) {
        if let (TO_GROUND, MavMessage::PARAM_VALUE(value)) = (*port, &frame.message()) {
            assert_eq!(usize::from(value.param_index), listed.len());
            listed.push((value.param_id.to_str().unwrap().into(), value.param_value));
        }
    }
    listed
}

#[test]
fn wiring_of_each_engine_is_listed_after_the_other_parameters_of_the_node() {
    run(async |world| {
        world.ready().await;
        let own: Vec<String> = node_parameters().map(|row| row.name.to_string()).collect();
        let without: Vec<_> = listed(world).await.into_iter().map(|(name, _)| name).collect();
        assert_eq!(without, own, "a node whose wiring is no parameter");
        world.service.borrow_mut().set_wiring(&IMAGE, &IMAGE, None);
        let all = listed(world).await;
        let mut expected: Vec<(String, f32)> = Vec::new();
        for (engine, wiring) in IMAGE.iter().enumerate() {
            for row in wiring_parameters(wiring) {
                let name = row.name.replacen('1', &(engine + 1).to_string(), 1);
                expected.push((name, row.default as f32));
            }
        }
        assert_eq!(all[own.len()..], expected);
        assert_eq!((expected[0].0.as_str(), expected[11].0.as_str()), ("E1_PORT", "E2_ZK_RATE"));
        // With six engines, as many as an image may have.
        assert!(own.len() + 6 * wiring_parameters(&IMAGE[0]).len() <= 60);
    });
}

#[test]
fn wiring_is_set_counts_from_the_next_start_on_and_changes_nothing_before() {
    run(async |world| {
        world.ready().await;
        world.service.borrow_mut().set_wiring(&IMAGE, &IMAGE, None);
        let before: Vec<_> = world.service.borrow().engine_settings().map(|(config, _)| *config).collect();
        // Two engines swap ports: in between they contradict each other.
        for (name, value) in [
            ("E1_PORT", 1.0),
            ("E2_PORT", 0.0),
            ("E1_PROTO", 2.0),
            ("E2_PROTO", 1.0),
            ("E1_BAUD", 115_200.0),
            ("E1_STOP", 2.0),
            ("E1_ZK_RATE", 50.0),
            ("E2_AMT_ENGINE", 3.0),
        ] {
            let (echo, text) = world.set(NODE, name, value).await;
            assert_eq!(echo, Some(value), "{name}: {text}");
            assert!(text.contains(&std::format!("{name} takes effect at the node's next start")), "{text}");
        }
        let service = world.service.borrow();
        let wiring: Vec<_> = service.wiring().to_vec();
        let mut engines: [EngineConfig; 2] = [before[0], before[1]];
        wiring.iter().zip(&mut engines).for_each(|(wiring, engine)| wiring.apply(engine));
        assert_eq!((engines[0].port, engines[0].line), (1, Line::with_two_stop_bits(115_200)));
        assert_eq!(engines[0].ecu, EngineConfig::zk("left", 1, engines[0].line, Rate::Hz50).ecu);
        let olympus = EngineConfig::amt("right", 0, Line::new(9600), Some(EngineModel::Olympus));
        assert_eq!((engines[1].port, engines[1].line, engines[1].ecu), (0, olympus.line, olympus.ecu));
        let after: Vec<_> = service.engine_settings().map(|(config, _)| *config).collect();
        assert_eq!(before, after, "what is in force");
    });
}

#[test]
fn wiring_out_of_its_range_is_refused_with_what_there_is() {
    run(async |world| {
        world.ready().await;
        world.service.borrow_mut().set_wiring(&IMAGE, &IMAGE, None);
        for (name, value, old, why) in [
            ("E1_PORT", 16.0, 0.0, "use 0 to 15"),
            ("E1_PROTO", 0.0, 1.0, "use 1 to 2"),
            ("E1_PROTO", 3.0, 1.0, "use 1 to 2"),
            ("E2_BAUD", 9601.0, 9600.0, "use 2400, 4800, 9600, 19200, 38400, 57600 or 115200"),
            ("E2_BAUD", 1200.0, 9600.0, "or 115200"),
            ("E1_STOP", 3.0, 1.0, "use 1 to 2"),
            ("E1_AMT_ENGINE", 8.0, 0.0, "use 0 to 7"),
            ("E2_ZK_RATE", 33.0, 20.0, "use 20, 50 or 100"),
            ("TELEM_BAUD", 100_000.0, 57_600.0, "or 115200"),
        ] {
            let (echo, text) = world.set(NODE, name, value).await;
            assert_eq!(echo, Some(old), "{name}: {text}");
            assert!(text.contains("not set") && text.contains(why), "{name}: {text}");
        }
        assert_eq!(world.service.borrow().wiring(), IMAGE);
        for name in ["E0_PORT", "E3_PORT", "E_PORT", "PORT"] {
            let (echo, text) = world.set(NODE, name, 1.0).await;
            assert!(echo.is_none() && text.contains("no parameter has this name"), "{name}: {text}");
        }
        assert_eq!(world.set(NODE, "TELEM_BAUD", 115_200.0).await.0, Some(115_200.0));
    });
}

#[test]
fn wiring_is_refused_while_an_engine_turns_and_set_when_it_is_at_rest() {
    run(async |world| {
        world.ready().await;
        world.service.borrow_mut().set_wiring(&IMAGE, &IMAGE, None);
        assert_eq!(world.set(NODE, "E1_PORT", 2.0).await.0, Some(2.0));
        world.start(1).await;
        for (name, old) in [("E1_PORT", 2.0), ("E2_PORT", 1.0), ("TELEM_BAUD", 57_600.0)] {
            let (echo, text) = world.set(NODE, name, if old > 9.0 { 9600.0 } else { 5.0 }).await;
            assert_eq!(echo, Some(old), "{name}");
            assert!(text.contains("an engine turns"), "{text}");
        }
    });
}

/// Contents of the record of the node, as a start reads it.
fn read(record: &[u8]) -> (NodeSettings, [Wiring; 2]) {
    let (mut node, mut wiring) = (NodeSettings::DEFAULT, IMAGE);
    record::apply_to_node(&mut node, &mut wiring, record);
    (node, wiring)
}

#[test]
fn a_record_of_the_node_has_the_wiring_that_differs_from_the_image_and_no_other() {
    let mut node = NodeSettings::DEFAULT;
    assert!(node.set("MAV_GCS_2", 77));
    let mut wiring = IMAGE;
    let empty = record::of_node(&node, None, &wiring, &IMAGE);
    assert_eq!(read(&empty), (node, IMAGE));
    for (name, number) in [("E1_PORT", 7), ("E1_BAUD", 115_200), ("E1_ZK_RATE", 100), ("E1_AMT_ENGINE", 7)] {
        assert!(wiring[1].change(name, number), "{name}");
        let stored = record::of_node(&node, None, &wiring, &IMAGE);
        assert_eq!(stored.len(), empty.len() + 6, "one number has all of it");
        assert_eq!(read(&stored), (node, wiring), "{name}");
        // If it is as in the image, another image uses its own.
        let (mut other, mut image) = (NodeSettings::DEFAULT, [Wiring::of(&OTHER); 2]);
        record::apply_to_node(&mut other, &mut image, &stored);
        assert_eq!((other, image), (node, [Wiring::of(&OTHER), wiring[1]]));
        // A damaged record, or one that is not a wiring, changes nothing.
        let mut damaged = stored.clone();
        damaged.iter_mut().rev().take(4).for_each(|byte| *byte = 0xFF);
        assert_eq!(read(&damaged), (node, IMAGE));
        let all = record::of_node(&node, Some(&NodeSettings::DEFAULT), &wiring, &IMAGE);
        assert_eq!(read(&all), (node, wiring), "in RAM, too");
    }
    // With eight engines there is space for all.
    let changed = [wiring[1]; 8];
    let all = record::of_node(&node, None, &changed, &[IMAGE[0]; 8]);
    assert_eq!(all.len(), empty.len() + 8 * 6);
    let hashes: BTreeSet<u16> = (0..8)
        .map(record::hash_of_wiring)
        .chain(node_parameters().map(|row| record::hash(row.name)))
        .collect();
    assert_eq!(hashes.len(), 8 + node_parameters().count());
}

const OTHER: EngineConfig = EngineConfig::zk("other", 5, Line::new(57_600), Rate::Hz50);

#[test]
fn wiring_is_stored_with_the_node_and_is_as_before_if_it_cannot_be() {
    run(async |world| {
        world.ready().await;
        {
            let mut service = world.service.borrow_mut();
            service.set_wiring(&IMAGE, &IMAGE, None);
            service.set_parameter_storage(ParameterStorage::Stored);
        }
        for (result, stays) in [(Ok(()), 4.0), (Err(NotSaved::Failed), 4.0)] {
            let new = if result.is_ok() { 4.0 } else { 5.0 };
            assert_eq!(world.set(NODE, "E2_PORT", new).await, (None, String::new()));
            let (key, stored) = world.service.borrow_mut().next_save().unwrap();
            assert_eq!((key, read(&stored).1[1].port, read(&stored).1[0]), (0, new as u8, IMAGE[0]));
            let at = world.frames.borrow().len();
            world.service.borrow_mut().saved(Instant::now(), result);
            world.pass_s(0.2).await;
            assert_eq!(world.answers(at).0, Some(stays));
        }
    });
}

#[test]
fn wiring_that_contradicts_itself_is_reported_on_every_port_and_engines_start_all_the_same() {
    run(async |world| {
        world.ready().await;
        let mut stored = IMAGE;
        assert!(stored[1].change("E1_PORT", 0));
        let error = WiringError { row: 1, why: Contradiction::SamePort };
        world.service.borrow_mut().set_wiring(&stored, &IMAGE, Some(error));
        let at = world.frames.borrow().len();
        world.pass_s(25.0).await;
        for port in [TO_AUTOPILOT, TO_GROUND] {
            let frames = world.frames.borrow();
            let texts = frames.iter().skip(at).filter_map(|(_, to, frame)| match &frame.message() {
                MavMessage::STATUSTEXT(text) if *to == port && frame.from.component == ENGINE[1] => {
                    Some((text.severity, text.text.to_str().unwrap().to_string()))
                }
                _ => None,
            });
            let reported: Vec<_> =
                texts.filter(|(_, text)| text.starts_with("right: wiring as in the image")).collect();
            assert!(
                (2..=3).contains(&reported.len()) && reported.iter().all(|(severity, _)| *severity == 3),
                "{reported:?}"
            );
        }
        assert!(
            world
                .texts()
                .replace('\n', "")
                .contains("not as stored: two engines on one port: change E2_PORT"),
            "{}",
            world.texts()
        );
        // It can be read and corrected.
        assert_eq!(world.set(NODE, "E2_PORT", 1.0).await.0, Some(1.0));
        world.start(0).await;
        let at = world.frames.borrow().len();
        world.service.borrow_mut().set_wiring(&IMAGE, &IMAGE, None);
        world.pass_s(25.0).await;
        let frames = world.frames.borrow();
        let reported = frames.iter().skip(at).any(|(_, _, frame)| {
            matches!(&frame.message(), MavMessage::STATUSTEXT(text) if text.text.to_str().unwrap().contains("wiring"))
        });
        assert!(!reported, "without a contradiction nothing is reported");
    });
}

#[test]
fn a_stored_setting_that_does_not_fit_the_line_costs_no_other_one() {
    let image = EngineConfig::amt("left", 0, Line::new(9600), None);
    let (mut set, own) = (image, EngineSettings { relight: true, ..EngineSettings::DEFAULT });
    for (name, number) in [("LIM_EGT", 7000), ("RISE", 300), ("LINK_LOST", 2000), ("AMT_GUARD", 15_000)] {
        assert_eq!(set.set(name, number), Ok(()), "{name}");
    }
    let record = record::of_engine(&set, &own, None, None);
    for baud in [9600, 2400] {
        let (mut found, mut found_own) = (image, EngineSettings::DEFAULT);
        found.line = Line::new(baud);
        let not_used = record::apply_to_engine(&mut found, &mut found_own, &record);
        let guard = if baud == 9600 { 15_000 } else { 500 };
        for (name, number) in [("LIM_EGT", 7000), ("RISE", 300), ("LINK_LOST", 2000), ("AMT_GUARD", guard)] {
            assert_eq!(found.number(name), Some(number), "{name} at {baud}");
        }
        assert_eq!(found_own, own);
        assert_eq!(not_used, (baud == 2400).then_some(GUARD));
    }
}

const GUARD: NotUsed = NotUsed { name: "AMT_GUARD", number: 15_000 };

#[test]
fn a_stored_setting_that_does_not_fit_the_line_is_reported_and_stays_stored_until_it_is_set() {
    let reported = |world: &World<'_>, at: usize| {
        let frames = world.frames.borrow();
        let texts = frames.iter().skip(at).filter_map(|(_, port, frame)| match &frame.message() {
            MavMessage::STATUSTEXT(text) => {
                Some((*port, frame.from.component, text.text.to_str().unwrap().to_string()))
            }
            _ => None,
        });
        let texts = texts.filter(|(.., text)| text.starts_with("left: AMT_GUARD as in the image"));
        let ports: Vec<_> = texts.map(|(port, component, _)| (port, component)).collect();
        let count = |port| ports.iter().filter(|it| **it == (port, ENGINE[0])).count();
        assert_eq!(ports.len(), count(TO_AUTOPILOT) + count(TO_GROUND));
        (count(TO_AUTOPILOT), count(TO_GROUND))
    };
    run(async |world| {
        world.ready().await;
        world.service.borrow_mut().set_parameter_storage(ParameterStorage::Stored);
        let at = world.frames.borrow().len();
        world.pass_s(21.0).await;
        assert_eq!(reported(world, at), (0, 0), "the control");
        world.service.borrow_mut().set_not_used(0, Some(GUARD));
        // What is saved, with the result of that.
        let set = async |name: &str, value: f32, result| {
            assert_eq!(world.set(ENGINE[0], name, value).await.0, None);
            let (_, record) = world.service.borrow_mut().next_save().unwrap();
            world.service.borrow_mut().saved(Instant::now(), result);
            let (mut config, mut own) =
                (EngineConfig::amt("left", 0, Line::new(9600), None), EngineSettings::DEFAULT);
            assert_eq!(record::apply_to_engine(&mut config, &mut own, &record), None);
            let at = world.frames.borrow().len();
            world.pass_s(21.0).await;
            let number = |name| config.number(name).unwrap();
            (number("LIM_EGT"), number("AMT_GUARD"), reported(world, at))
        };
        let twice = (2, 2);
        assert_eq!(set("LIM_EGT", 7000.0, Ok(())).await, (7000, 15_000, twice), "another setting");
        assert_eq!(set("AMT_GUARD", 600.0, Err(NotSaved::Full)).await, (7000, 600, twice), "in vain");
        assert_eq!(set("LIM_EGT", 7100.0, Ok(())).await, (7100, 15_000, twice), "it is still stored");
        assert_eq!(set("AMT_GUARD", 600.0, Ok(())).await, (7100, 600, (0, 0)));
        assert_eq!(set("LIM_EGT", 7200.0, Ok(())).await, (7200, 600, (0, 0)));
    });
}
