//! Damaged streams: nothing panics, and only whole frames with a correct checksum are obeyed.
//!
//! The judge is an independent reader, written from the MAVLink documents: it examines every offset, computes the checksum
//! bit by bit, and has the numbers of each message from another implementation (pymavlink 2.4.50).

use crate::dialect::*;
use crate::frame::{Address, encode};
use crate::port::PortConfig;
use crate::service::{EngineParts, Service};
use crate::settings::{EngineSettings, Identity, NodeSettings};
use crate::signing::SigningState;
use embassy_time::{Duration, Instant};
use jetlink::command::Origin;
use jetlink::config::EngineConfig;
use jetlink::ecu::zk::codec::Rate;
use jetlink::line::Line;
use jetlink::node::Node;
use mavlink_core::Message;
use std::vec::Vec;

/// Number of a message, its `CRC_EXTRA`, and the offset of its target system if it commands or sets.
const MESSAGES: [(u32, u8, Option<usize>); 17] = [
    (0, 50, None),
    (20, 214, None),
    (21, 159, None),
    (22, 220, None),
    (23, 168, Some(4)),
    (36, 222, None),
    (65, 118, None),
    (70, 124, None),
    (75, 158, Some(30)),
    (76, 152, Some(30)),
    (77, 143, None),
    (80, 14, Some(2)),
    (225, 208, None),
    (251, 170, None),
    (253, 83, None),
    (256, 71, None),
    (376, 199, None),
];

#[test]
fn the_dialect_has_the_checksums_of_another_implementation() {
    assert_eq!(MavMessage::all_ids().len(), MESSAGES.len());
    for (id, extra, _) in MESSAGES {
        assert_eq!(MavMessage::extra_crc(id), extra, "message {id}");
    }
}

/// The checksum of MAVLink, from its document: X.25, bit by bit.
fn checksum(bytes: &[u8], extra: u8) -> u16 {
    let mut crc = 0xFFFF_u16;
    for byte in bytes.iter().chain([&extra]) {
        crc ^= u16::from(*byte);
        for _ in 0..8 {
            crc = if crc & 1 != 0 { crc >> 1 ^ 0x8408 } else { crc >> 1 };
        }
    }
    crc
}

/// A whole frame at the beginning of these bytes: its number and its payload.
fn whole(bytes: &[u8]) -> Option<(u32, &[u8])> {
    let length = usize::from(*bytes.get(1)?);
    let (header, id) = match *bytes.first()? {
        0xFE => (6, u32::from(*bytes.get(5)?)),
        0xFD if bytes.get(2)? & 0xFE == 0 => {
            (10, u32::from_le_bytes([*bytes.get(7)?, *bytes.get(8)?, *bytes.get(9)?, 0]))
        }
        _ => return None,
    };
    let (_, extra, _) = MESSAGES.into_iter().find(|(known, ..)| *known == id)?;
    let sum = bytes.get(header + length..header + length + 2)?;
    let right = checksum(bytes.get(1..header + length)?, extra).to_le_bytes();
    (sum == right).then(|| (id, &bytes[header..header + length]))
}

/// Number and payload of a message, without the zeros at its end: version 2 leaves them out.
fn trimmed(id: u32, payload: &[u8]) -> (u32, Vec<u8>) {
    let end = payload.iter().rposition(|byte| *byte != 0).map_or(0, |last| last + 1);
    (id, payload[..end].to_vec())
}

/// Whole frames that command or set, addressed to our system, at any offset; and all whole frames.
fn orders(stream: &[u8]) -> (u32, u32, Vec<(u32, Vec<u8>)>) {
    let (mut commands, mut sets) = (0, 0);
    let mut all = Vec::new();
    for offset in 0..stream.len() {
        let Some((id, payload)) = whole(&stream[offset..]) else { continue };
        all.push(trimmed(id, payload));
        let target = MESSAGES.into_iter().find(|(known, ..)| *known == id).and_then(|(.., target)| target);
        // Zeros at the end of a payload are left out in version 2.
        if target.is_none_or(|at| payload.get(at).copied().unwrap_or(0) != 3) {
            continue;
        }
        if id == 23 { sets += 1 } else { commands += 1 }
    }
    (commands, sets, all)
}

fn original(rng: &mut fastrand::Rng) -> Vec<u8> {
    let from =
        Address { system: *rng.choice(&[255, 3, 7]).unwrap(), component: *rng.choice(&[1, 190]).unwrap() };
    let target_component = rng.u8(24..29);
    let frame = match rng.u8(0..6) {
        0 | 1 => {
            let command = *rng.choice(&[223, 31_010, 185, 246, 511, 512, 400]).unwrap();
            let param1 = f32::from(rng.u8(0..4));
            let param2 = *rng.choice(&[0.0, 21196.0, 36.0]).unwrap();
            encode(
                from,
                rng.u8(..),
                &COMMAND_LONG_DATA {
                    command,
                    param1,
                    param2,
                    target_system: 3,
                    target_component,
                    ..Default::default()
                },
            )
        }
        2 => encode(
            from,
            rng.u8(..),
            &COMMAND_INT_DATA { command: 223, target_system: 3, target_component, ..Default::default() },
        ),
        3 => {
            let param_id = (*rng.choice(&["LOSS_THR", "MAV_GCS_1", "LIM_RPM"]).unwrap()).into();
            let param_value = f32::from(rng.u8(..));
            encode(
                from,
                rng.u8(..),
                &PARAM_SET_DATA { param_id, param_value, target_system: 3, target_component, param_type: 9 },
            )
        }
        4 => encode(from, rng.u8(..), &HEARTBEAT_DATA { mavtype: 1, autopilot: 3, ..Default::default() }),
        _ => encode(
            from,
            rng.u8(..),
            &SERVO_OUTPUT_RAW_DATA { time_usec: rng.u32(..), servo3_raw: 1900, ..Default::default() },
        ),
    };
    frame.to_vec()
}

/// Damages a frame: single bits, whole bytes, bursts longer than the checksum, and missing or duplicated pieces.
fn damage(rng: &mut fastrand::Rng, frame: &mut Vec<u8>) {
    let at = rng.usize(0..frame.len());
    match rng.u8(0..7) {
        0 => frame[at] ^= 1 << rng.u8(0..8),
        1 => frame[at] = rng.u8(..),
        2 => frame.iter_mut().skip(at).take(rng.usize(3..9)).for_each(|byte| *byte = rng.u8(..)),
        3 => frame.iter_mut().skip(10).for_each(|byte| *byte = rng.u8(..)),
        4 => frame.truncate(at),
        5 => frame.insert(at, rng.u8(..)),
        _ => {
            frame.remove(at);
        }
    }
}

fn damaged_streams(frames: u64, seed: u64) {
    sim::clock::reset();
    let engines = [
        EngineConfig::amt("left", 0, Line::new(9600), None),
        EngineConfig::zk("right", 1, Line::new(9600), Rate::Hz20),
    ];
    let node: Node<2> = Node::new(&engines, None).unwrap();
    let identity = Identity { system: 3, ..Identity::DEFAULT };
    let parts = node.owners().into_iter().zip(engines);
    let parts = parts.map(|(owner, config)| EngineParts {
        source: owner.source(Origin::Mavlink).unwrap(),
        setup: owner.setup(),
        config,
        settings: EngineSettings::DEFAULT,
    });
    let mut now = Instant::from_secs(1);
    let ports = [PortConfig::uart(57_600), PortConfig::usb()];
    let settings = NodeSettings { identity, ..NodeSettings::DEFAULT };
    let mut service: Service<'_, 2, 2> = Service::new(now, settings, SigningState::NONE, parts, ports);
    let mut rng = fastrand::Rng::with_seed(seed);
    let (mut sent, mut damaged, mut whole_orders, mut obeyed) = (0_u64, 0_u64, 0_u64, 0_u64);
    let (mut by_chance, mut handled) = (0, 0_u64);
    while sent < frames {
        // A stream, and its undamaged orders.
        let mut stream = Vec::new();
        let mut untouched = 0;
        for _ in 0..200 {
            let mut frame = original(&mut rng);
            let before = frame.clone();
            if rng.u8(0..10) > 0 {
                damage(&mut rng, &mut frame);
            }
            if frame != before {
                damaged += 1;
            } else if matches!(orders(&frame), (commands, sets, _) if commands + sets > 0) {
                untouched += 1;
            }
            sent += 1;
            stream.extend_from_slice(&frame);
        }
        let before = service.counters();
        let port = rng.usize(0..2);
        let mut rest = &stream[..];
        while !rest.is_empty() {
            let (piece, after) = rest.split_at(rng.usize(1..=rest.len().min(300)));
            rest = after;
            service.receive(now, port, piece);
            now += Duration::from_millis(20);
            service.poll(now);
            let mut bytes = [0; 256];
            for port in 0..2 {
                while service.transmit(port, &mut bytes) > 0 {}
            }
        }
        // A frame begun at its end is completed here: zeros may be the rest of its checksum.
        service.receive(now, port, &[0; 300]);
        stream.extend_from_slice(&[0; 300]);
        let (commands, sets, mut all) = orders(&stream);
        for (id, payload) in core::mem::take(&mut service.handled) {
            let message = trimmed(id, &payload);
            let place = all.iter().position(|found| *found == message);
            // Each frame taken was also found by the other reader, once.
            let Some(place) = place else { panic!("message {id} is none: {payload:02X?} in {stream:02X?}") };
            all.swap_remove(place);
            handled += 1;
        }
        let done = service.counters();
        let (commanded, set) = (
            done.commands.wrapping_sub(before.commands),
            done.parameters_set.wrapping_sub(before.parameters_set),
        );
        assert!(
            commanded <= commands && set <= sets,
            "{commanded} of {commands}, {set} of {sets}: {stream:02X?}"
        );
        whole_orders += u64::from(commands + sets);
        by_chance += u64::from(commands + sets).saturating_sub(untouched);
        obeyed += u64::from(commanded + set);
    }
    std::println!(
        "{sent} frames, {damaged} of them damaged; {whole_orders} whole orders, of which {by_chance} although damaged; \
         {obeyed} carried out or answered; {handled} messages are what the other reader has found"
    );
    // Enough of the whole frames were received, or the test would check nothing.
    assert!(obeyed * 4 > whole_orders && obeyed > 0);
}

#[test]
fn damaged_streams_move_nothing_by_themselves() {
    damaged_streams(40_000, 1);
}

/// The long run: `cargo test --profile campaign -p jetlink-mavlink --lib ten_million -- --ignored --nocapture`.
#[test]
#[ignore = "takes minutes"]
fn ten_million_frames_of_damaged_streams_move_nothing_by_themselves() {
    damaged_streams(10_000_000, 2);
}
