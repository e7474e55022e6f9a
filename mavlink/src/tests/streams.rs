//! What is sent without a request: rates, the share of a port, identity, values.

use super::world::*;
use crate::dialect::*;
use crate::frame::{Decoder, encode};
use crate::ids::*;
use crate::port::PortConfig;
use crate::service::{EngineParts, Service};
use crate::settings::{EngineSettings, Identity, NodeSettings};
use crate::signing::{Key, SigningState, Stamp};
use bench::rows::{self, simulated};
use embassy_futures::join::{join, join4};
use embassy_futures::select::select;
use embassy_time::{Duration, Instant, Timer};
use jetlink::command::{Command, Origin};
use jetlink::config::EngineConfig;
use jetlink::ecu::amt::codec::EngineModel;
use jetlink::ecu::zk::codec::Rate;
use jetlink::line::Line;
use jetlink::node::Node;
use jetlink::runner::LineErrors;
use sim::clock;
use std::collections::BTreeMap;
use std::string::{String, ToString};
use std::vec::Vec;

static ERRORS: LineErrors = LineErrors::new();

/// Rate of a component's messages on a port within the last seconds, per second.
fn rate(world: &World<'_>, seconds: u64, port: usize, component: u8, what: fn(&MavMessage) -> bool) -> f64 {
    let from = Instant::now() - Duration::from_secs(seconds);
    let frames = world.frames.borrow();
    let recent = frames.iter().filter(|(at, on, frame)| {
        *at >= from && *on == port && frame.from.component == component && what(&frame.message())
    });
    recent.count() as f64 / seconds as f64
}

const BEAT: fn(&MavMessage) -> bool = |message| matches!(message, MavMessage::HEARTBEAT(_));
const EFI: fn(&MavMessage) -> bool = |message| matches!(message, MavMessage::EFI_STATUS(_));
const VALUES: fn(&MavMessage) -> bool = |message| matches!(message, MavMessage::NAMED_VALUE_FLOAT(_));

#[test]
fn nothing_is_sent_before_the_vehicle_is_known_and_heartbeats_after() {
    run(async |world| {
        world.pass_s(4.0).await;
        assert_eq!(*world.bytes.borrow(), [0; 2], "an autopilot is received that is not learnt yet");
        world.pass_s(20.0).await;
        for port in [TO_AUTOPILOT, TO_GROUND] {
            for component in [NODE, ENGINE[0], ENGINE[1]] {
                let rate = rate(world, 10, port, component, BEAT);
                assert!((0.9..=1.1).contains(&rate), "{component}: {rate}");
            }
        }
        for (_, _, frame) in &*world.frames.borrow() {
            assert_eq!(frame.from.system, SYSTEM);
            if let MavMessage::HEARTBEAT(beat) = &frame.message() {
                // A ground station must not take it for a vehicle, or for an armed one.
                assert_eq!((beat.mavtype, beat.autopilot), (TYPE_GENERIC, AUTOPILOT_INVALID));
                assert_eq!((beat.base_mode, beat.mavlink_version), (MODE_CUSTOM, 3));
            }
        }
    });
}

#[test]
fn without_an_autopilot_the_ground_station_sees_system_1() {
    run(async |world| {
        world.plane.alive.set(false);
        world.pass_s(10.0).await;
        let [to_autopilot, to_ground] = *world.bytes.borrow();
        assert!(to_autopilot == 0 && to_ground > 1000);
        assert!(world.frames.borrow().iter().all(|(.., frame)| frame.from.system == 1));
    });
    let identity = Identity { system: 42, ..Identity::DEFAULT };
    run_with(NodeSettings { identity, ..NodeSettings::DEFAULT }, async |world| {
        world.plane.alive.set(false);
        world.pass_s(10.0).await;
        assert!(world.bytes.borrow().iter().all(|&bytes| bytes > 1000));
        assert!(world.frames.borrow().iter().all(|(.., frame)| frame.from.system == 42));
    });
}

#[test]
fn the_autopilot_gets_one_engine_and_a_quarter_of_its_port_at_most() {
    run(async |world| {
        world.ready().await;
        world.pass_s(10.0).await;
        assert!((3.9..=4.1).contains(&rate(world, 10, TO_AUTOPILOT, ENGINE[0], EFI)));
        assert_eq!(rate(world, 10, TO_AUTOPILOT, ENGINE[1], EFI), 0.0);
        let names = |component: u8| {
            let frames = world.frames.borrow();
            let mut names: Vec<String> = frames
                .iter()
                .filter(|(_, port, frame)| *port == TO_AUTOPILOT && frame.from.component == component)
                .filter_map(|(.., frame)| match &frame.message() {
                    MavMessage::NAMED_VALUE_FLOAT(value) => Some(value.name.to_str().unwrap().into()),
                    _ => None,
                })
                .collect();
            names.sort_unstable();
            names.dedup();
            names
        };
        assert!(!names(ENGINE[0]).contains(&"rpm1".to_string()), "{:?}", names(ENGINE[0]));
        assert!(names(ENGINE[0]).contains(&"margin1".to_string()), "{:?}", names(ENGINE[0]));
        for name in ["rpm2", "egt2", "flow2", "thr2", "pumpv2", "link2"] {
            assert!(names(ENGINE[1]).contains(&name.to_string()), "{name} of {:?}", names(ENGINE[1]));
        }
        // Both engines, as often as the setting allows: the share holds.
        assert_eq!(world.set(NODE, "MAV_EFI_ENGINE", 255.0).await.0, Some(255.0));
        assert_eq!(world.set(NODE, "MAV_EFI_EVERY", 100.0).await.0, Some(100.0));
        world.pass_s(5.0).await;
        let before = world.bytes.borrow()[TO_AUTOPILOT];
        world.pass_s(60.0).await;
        let share = (world.bytes.borrow()[TO_AUTOPILOT] - before) as f64 / 60.0 / 5760.0;
        assert!((0.2..0.255).contains(&share), "{share}");
        let efi = ENGINE.map(|component| rate(world, 60, TO_AUTOPILOT, component, EFI));
        assert!(efi.iter().all(|&rate| rate > 3.0), "neither is left out: {efi:?}");
        assert!(world.service.borrow().port_counters(TO_AUTOPILOT).unwrap().telemetry_dropped > 0);
        // A wide port gets all.
        assert!((9.5..=10.0).contains(&rate(world, 10, TO_GROUND, ENGINE[0], EFI)));
        assert!(rate(world, 10, TO_GROUND, ENGINE[1], VALUES) > 20.0);
    });
}

/// Four engines, with all values that either protocol has, on a port that is emptied each millisecond.
#[test]
fn a_wide_port_carries_everything_of_four_engines_at_10_hz_also_signed() {
    for key in [None, Key::new([7; 32])] {
        clock::reset();
        let engines = [
            EngineConfig::amt("left", 0, Line::new(2400), Some(EngineModel::Olympus)),
            EngineConfig::amt("right", 1, Line::new(2400), Some(EngineModel::Titan)),
            EngineConfig::zk("centre", 2, Line::new(9600), Rate::Hz20),
            EngineConfig::zk("booster", 3, Line::new(115_200), Rate::Hz50),
        ];
        let node: Node<4> = Node::new(&engines, None).unwrap();
        let parts = node.owners().into_iter().zip(engines).map(|(owner, config)| EngineParts {
            source: owner.source(Origin::Mavlink).unwrap(),
            setup: owner.setup(),
            config,
            settings: EngineSettings::DEFAULT,
        });
        let identity = Identity { autopilot_port: 0, ..Identity::DEFAULT };
        let settings = NodeSettings { identity, ..NodeSettings::DEFAULT };
        let signing = SigningState::new(key, Stamp::new(1000).unwrap());
        let mut service: Service<'_, 4, 1> =
            Service::new(Instant::now(), settings, signing, parts, [PortConfig::usb()]);
        let wires = engines.each_ref().map(|engine| rows::wire(engine, simulated(engine).ecu(), 1));
        let [(rx0, tx0, p0), (rx1, tx1, p1), (rx2, tx2, p2), (rx3, tx3, p3)] = wires;
        let [r0, r1, r2, r3] = node.runners();
        let mut counts = BTreeMap::<(u8, Option<String>), u32>::new();
        let run = join4(
            r0.run(rx0, tx0, &ERRORS),
            r1.run(rx1, tx1, &ERRORS),
            r2.run(rx2, tx2, &ERRORS),
            r3.run(rx3, tx3, &ERRORS),
        );
        let plugs = join4(p0.run(), p1.run(), p2.run(), p3.run());
        let scenario = async {
            let (mut decoder, begin) = (Decoder::new(), Instant::now());
            while Instant::now() < begin + Duration::from_secs(30) {
                service.poll(Instant::now());
                let mut bytes = [0; 1024];
                let count = service.transmit(0, &mut bytes);
                let mut bytes = &bytes[..count];
                while let (taken, Some(frame)) = decoder.receive(key.as_ref(), bytes) {
                    bytes = &bytes[taken..];
                    let what = match &frame.message() {
                        MavMessage::EFI_STATUS(_) => None,
                        MavMessage::NAMED_VALUE_FLOAT(value) => Some(value.name.to_str().unwrap().into()),
                        _ => continue,
                    };
                    let counts_now = Instant::now() >= begin + Duration::from_secs(20);
                    *counts.entry((frame.from.component, what)).or_default() += u32::from(counts_now);
                }
                Timer::after(Duration::from_millis(1)).await;
            }
        };
        clock::run(select(join(run, plugs), scenario));
        assert!(counts.len() >= 4 * 3, "{counts:?}");
        let slow: Vec<_> = counts.iter().filter(|(_, count)| **count < 99).collect();
        assert!(slow.is_empty(), "within 10 s, signed {}: {slow:?}", key.is_some());
    }
}

#[test]
fn rates_are_per_port_and_a_message_comes_on_request() {
    run(async |world| {
        world.ready().await;
        let interval = [225.0, 500_000.0];
        assert_eq!(world.command(ENGINE[1], CMD_SET_MESSAGE_INTERVAL, &interval).await.0, Some(0));
        world.pass_s(20.0).await;
        assert!((1.9..=2.1).contains(&rate(world, 10, TO_GROUND, ENGINE[1], EFI)));
        assert!((3.9..=4.1).contains(&rate(world, 10, TO_AUTOPILOT, ENGINE[0], EFI)));
        for (params, answer) in [
            (&[225.0, -1.0][..], 0),
            (&[251.0, -1.0], 0),
            (&[225.0, 10.0], 2),
            (&[225.0, f32::NAN], 2),
            (&[30.0, 100_000.0], 3),
        ] {
            let answered = world.command(ENGINE[1], CMD_SET_MESSAGE_INTERVAL, params).await.0;
            assert_eq!(answered, Some(answer), "{params:?}");
        }
        world.pass_s(3.0).await;
        let quiet = |what| rate(world, 2, TO_GROUND, ENGINE[1], what) == 0.0;
        assert!(quiet(EFI) && quiet(VALUES));
        assert_eq!(world.command(ENGINE[1], CMD_REQUEST_MESSAGE, &[225.0]).await.0, Some(0));
        assert!(!quiet(EFI));
        assert_eq!(world.command(ENGINE[1], CMD_REQUEST_MESSAGE, &[30.0]).await.0, Some(3));
    });
}

/// The longest interval that fits is 16 s. The control: without another request nothing comes meanwhile.
/// A ground station behind the autopilot requests what an ArduPilot would mix up. The control: of the engine that `MAV_EFI_ENGINE` has.
#[test]
fn no_request_sends_the_autopilot_efi_status_of_another_engine() {
    run(async |world| {
        world.ready().await;
        for (engine, expected) in [(0, ACCEPTED), (1, DENIED)] {
            for (command, params) in
                [(CMD_SET_MESSAGE_INTERVAL, [225.0, 200_000.0]), (CMD_REQUEST_MESSAGE, [225.0, 0.0])]
            {
                let to = (SYSTEM, ENGINE[engine]);
                let (answer, texts) = world.command_from(TO_AUTOPILOT, GROUND, to, command, 0, &params).await;
                assert_eq!(answer, expected, "{command}: {texts}");
                assert_eq!(texts.contains("MAV_EFI_ENGINE"), engine == 1, "{texts}");
            }
        }
        world.pass_s(10.0).await;
        let rates = || ENGINE.map(|component| rate(world, 5, TO_AUTOPILOT, component, EFI).round());
        assert_eq!(rates(), [5.0, 0.0]);
        // Nor what was requested before the setting changed.
        assert_eq!(world.set(NODE, "MAV_EFI_ENGINE", 2.0).await.0, Some(2.0));
        world.pass_s(10.0).await;
        assert_eq!(rates(), [0.0, 4.0]);
    });
}

#[test]
fn another_interval_counts_at_once_and_so_do_the_defaults_of_another_peer() {
    for what in ["nothing", "an interval", "the default", "another peer"] {
        run(async |world| {
            world.ready().await;
            let set = async |us: f32| {
                for message in [225.0, 251.0] {
                    let interval = [message, us];
                    let answer = world.command(ENGINE[1], CMD_SET_MESSAGE_INTERVAL, &interval).await;
                    assert_eq!(answer.0, Some(0));
                }
            };
            set(16_000_000.0).await;
            world.pass_s(2.0).await;
            match what {
                "an interval" => set(500_000.0).await,
                "the default" => set(0.0).await,
                "another peer" => {
                    for is_open in [false, true] {
                        world.service.borrow_mut().set_open(Instant::now(), TO_GROUND, is_open);
                    }
                }
                _ => {}
            }
            world.pass_s(1.1).await;
            for message in [EFI, VALUES] {
                let rate = rate(world, 1, TO_GROUND, ENGINE[1], message);
                assert_eq!(rate > 0.0, what != "nothing", "{what}: {rate}");
            }
        });
    }
}

#[test]
fn efi_status_is_what_the_engine_reports_and_never_a_number_that_cannot_be_cast() {
    run(async |world| {
        world.ready().await;
        world.start(1).await;
        world.throttle(1700);
        world.pass_s(20.0).await;
        let frames = world.frames.borrow();
        let of = |component: u8| {
            frames.iter().filter_map(move |(_, _, frame)| match frame.message() {
                MavMessage::EFI_STATUS(efi) if frame.from.component == component => Some(efi),
                _ => None,
            })
        };
        for efi in of(ENGINE[0]).chain(of(ENGINE[1])) {
            for value in [efi.ecu_index, efi.engine_load, efi.throttle_position, efi.throttle_out] {
                assert!((0.0..=100.0).contains(&value), "{efi:?}");
            }
            let all = [
                efi.rpm,
                efi.fuel_flow,
                efi.exhaust_gas_temperature,
                efi.ignition_voltage,
                efi.barometric_pressure,
            ];
            assert!(all.iter().all(|value| value.is_finite()), "{efi:?}");
        }
        let last = of(ENGINE[1]).next_back().unwrap();
        let report = world.telemetry(1).report;
        assert!((last.rpm - report.rpm.unwrap().value.get() as f32).abs() < 500.0, "{last:?}");
        assert!(
            (last.throttle_out - 75.0).abs() < 0.01 && (last.throttle_position - 75.0).abs() <= 1.0,
            "{last:?}"
        );
        assert_eq!(last.exhaust_gas_temperature, last.cylinder_head_temperature);
        assert!(last.exhaust_gas_temperature > 300.0 && last.fuel_flow > 50.0, "{last:?}");
        assert_eq!((last.health, last.ecu_index), (1, 1.0));
    });
}

#[test]
fn the_state_of_an_engine_is_in_its_heartbeat_and_its_texts() {
    run(async |world| {
        world.ready().await;
        world.start(1).await;
        world.pass_s(2.0).await;
        let mut states = Vec::new();
        for (_, port, frame) in &*world.frames.borrow() {
            if let (TO_GROUND, MavMessage::HEARTBEAT(beat)) = (*port, &frame.message())
                && frame.from.component == ENGINE[1]
                && states.last() != Some(&(beat.custom_mode as u8))
            {
                states.push(beat.custom_mode as u8);
            }
        }
        assert!(states.ends_with(&[3, 6, 7]) || states.ends_with(&[3, 5, 6, 7]), "{states:?}");
        let texts = world.texts();
        for text in [
            "right: ECU reports starting",
            "right: ECU reports running",
            "right: run, throttle 0.0 %, from mavlink",
        ] {
            assert!(texts.contains(text), "{text}: {texts}");
        }
    });
}

/// A script repeats what is refused, as often as it likes. The control: it does not.
#[test]
fn an_event_has_its_text_among_refusals() {
    for every in [None, Some(4), Some(1)] {
        run(async |world| {
            world.ready().await;
            let bench = world.node.owners()[1].source(Origin::Bench).unwrap();
            let nonsense = COMMAND_LONG_DATA {
                command: CMD_USER_1,
                param1: 99.0,
                target_system: SYSTEM,
                target_component: ENGINE[1],
                ..Default::default()
            };
            for i in 0..200 {
                if every.is_some_and(|every| i % every == 0) {
                    world.say(TO_GROUND, GROUND, &nonsense);
                }
                if i == 150 {
                    bench.command(Command::EmergencyStop).unwrap();
                }
                world.pass_s(0.1).await;
            }
            let texts = world.texts();
            assert_eq!(texts.contains("refused"), every.is_some());
            assert!(texts.contains("right: emergency stop, from bench"), "every {every:?}");
        });
    }
}

/// Bytes and frames of telemetry on a slow port within 30 s, with or without a refused setting, which only a text answers, every half second.
fn on_a_slow_port(baud: u32, with_texts: bool) -> (f64, usize, usize) {
    let mut found = None;
    let port = PortConfig::uart(baud);
    run_signed(NodeSettings::DEFAULT, SigningState::NONE, port, async |world| {
        world.ready().await;
        // What the start reported has been paid for.
        world.pass_s(30.0).await;
        let (bytes, frames) = (world.bytes.borrow()[TO_GROUND], world.frames.borrow().len());
        for _ in 0..60 {
            match with_texts {
                true => drop(world.set(ENGINE[0], "NO_SUCH", 1.0).await),
                false => world.pass_s(0.2).await,
            }
            world.pass_s(0.3).await;
        }
        let share =
            (world.bytes.borrow()[TO_GROUND] - bytes) as f64 / 30.0 / f64::from(port.bytes_per_second);
        let sent = world.frames.borrow();
        let count = |what: fn(&MavMessage) -> bool| {
            sent.iter()
                .skip(frames)
                .filter(|(_, on, frame)| *on == TO_GROUND && what(&frame.message()))
                .count()
        };
        found = Some((share, count(EFI) + count(VALUES), count(BEAT)));
    });
    found.unwrap()
}

#[test]
fn other_telemetry_gives_way_to_texts_and_heartbeats_are_always_sent() {
    let (share, telemetry, beats) = on_a_slow_port(4800, false);
    assert!((0.2..0.25).contains(&share), "{share}");
    assert!(telemetry > 15 && beats == 90, "{telemetry}, {beats}");
    let (share, telemetry, beats) = on_a_slow_port(4800, true);
    // 63 bytes of heartbeats and two texts of 59 in each second: already more than a quarter.
    assert_eq!((telemetry, beats), (0, 90), "{share}");
    assert!(share < 0.4, "{share}");
}

/// The exception that docs/mavlink.md states: nothing else that is not requested is sent then.
#[test]
fn at_2400_baud_heartbeats_of_three_components_take_the_whole_share() {
    let (share, telemetry, beats) = on_a_slow_port(2400, false);
    assert_eq!((telemetry, beats), (0, 90));
    assert!((0.26..0.27).contains(&share), "{share}");
}

#[test]
fn heartbeats_of_four_engines_have_the_documented_share() {
    let documented = include_str!("../../../docs/mavlink.md");
    let beat = encode(GROUND, 0, &HEARTBEAT_DATA { mavlink_version: 3, ..Default::default() }).len() as u32;
    let signed = beat + crate::signing::SIGNATURE as u32;
    assert_eq!((beat, signed), (21, 34));
    for baud in jetlink::line::Line::BAUD_RATES {
        let percent = |bytes: u32| (5 * bytes * 1000 + baud / 2) / baud;
        let row = std::format!("| {baud} | {} % | {} % |", percent(beat), percent(signed));
        assert!(documented.contains(&row), "{row}");
        // With six engines, the most that an image has, signed.
        assert_eq!(7 * signed * 40 < baud, baud >= 9600, "below a quarter at {baud}");
    }
}

/// Anybody reads parameters as fast as the line carries the requests, whose answers are longer. The control: nobody does.
#[test]
fn heartbeats_and_answers_to_stops_come_while_a_flood_of_reads_is_answered() {
    for floods in [false, true] {
        run(async |world| {
            world.ready().await;
            let at = world.frames.borrow().len();
            let read = |param_index: i16| PARAM_REQUEST_READ_DATA {
                param_index,
                target_system: SYSTEM,
                target_component: ENGINE[0],
                param_id: "".into(),
            };
            for i in 0..2000 {
                // 28 bytes in 5 ms, and a request has 16 or 17.
                let requests = if floods { 1 + i16::from(i % 3 > 0) } else { 0 };
                (0..requests).for_each(|next| world.say(TO_AUTOPILOT, GROUND, &read((i + next) % 30)));
                if i % 200 == 100 {
                    world.say(TO_AUTOPILOT, GROUND, &stop_command(1));
                }
                world.pass_s(0.005).await;
            }
            world.pass_s(1.0).await;
            let frames = world.frames.borrow();
            let sent = frames.iter().skip(at).filter(|(_, port, _)| *port == TO_AUTOPILOT);
            let count =
                |what: fn(&MavMessage) -> bool| sent.clone().filter(|(.., it)| what(&it.message())).count();
            let acks = count(|message| matches!(message, MavMessage::COMMAND_ACK(_)));
            let values = count(|message| matches!(message, MavMessage::PARAM_VALUE(_)));
            assert_eq!((acks, values > 1000), (10, floods), "{values} values");
            assert_eq!(count(BEAT), 3 * 11, "{floods}");
        });
    }
}
