//! Damaged streams: nothing panics, and exactly the whole frames with a correct checksum are handled, in order and once.
//!
//! The judge is an independent reader, written from the MAVLink documents: it has the whole stream, computes the checksum
//! bit by bit, and has the numbers of each message from another implementation (pymavlink 2.4.50). Its rule: from the first offset on, a
//! frame begins where a start byte is followed by known flags, a known message, as many bytes as the length says, the right checksum and, if
//! flagged, a signature. After it the next one is looked for; where none begins, one byte further. So what is inside of a frame is not a frame.

use super::extras::EXTRAS;
use crate::dialect::*;
use crate::extras::extra;
use crate::frame::{Address, Received, encode};
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
    // And of all others; numbers have 24 bits.
    let mut known = EXTRAS.into_iter().peekable();
    for id in 0..1 << 24 {
        let expected = known.next_if(|(other, _)| *other == id).map(|(_, extra)| extra);
        assert_eq!(extra(id), expected, "message {id}");
    }
    assert_eq!(known.next(), None);
    assert!(MESSAGES.iter().all(|(id, extra, _)| EXTRAS.contains(&(*id, *extra))));
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

/// What begins with these bytes.
enum Begins<'a> {
    /// No frame.
    Nothing,
    /// What would be one, but for its checksum.
    Wrong,
    /// A whole frame: its length, its number and its payload.
    Whole(usize, u32, &'a [u8]),
}

fn begins(bytes: &[u8]) -> Begins<'_> {
    let parts = || {
        let length = usize::from(*bytes.get(1)?);
        let (header, signature, id) = match *bytes.first()? {
            0xFE => (6, 0, u32::from(*bytes.get(5)?)),
            0xFD => {
                let signature = match *bytes.get(2)? {
                    0 => 0,
                    1 => 13,
                    _ => return None,
                };
                (10, signature, u32::from_le_bytes([*bytes.get(7)?, *bytes.get(8)?, *bytes.get(9)?, 0]))
            }
            _ => return None,
        };
        let (_, extra) = EXTRAS.into_iter().find(|(known, _)| *known == id)?;
        let frame = bytes.get(..header + length + 2 + signature)?;
        let right = checksum(&frame[1..header + length], extra).to_le_bytes();
        Some((frame.len(), id, &frame[header..header + length], frame[header + length..][..2] == right))
    };
    match parts() {
        None => Begins::Nothing,
        Some((.., false)) => Begins::Wrong,
        Some((length, id, payload, true)) => Begins::Whole(length, id, payload),
    }
}

/// Number and payload of a message, without the zeros at its end: version 2 leaves them out.
fn trimmed(id: u32, payload: &[u8]) -> (u32, Vec<u8>) {
    let end = payload.iter().rposition(|byte| *byte != 0).map_or(0, |last| last + 1);
    (id, payload[..end].to_vec())
}

/// What a stream consists of.
#[derive(Default)]
struct Read {
    /// Frames that command or set, addressed to our system.
    commands: u32,
    sets: u32,
    /// Frames of messages that are used, in order.
    frames: Vec<(u32, Vec<u8>)>,
    counters: Received,
}

fn read(stream: &[u8]) -> Read {
    let mut read = Read::default();
    let mut rest = stream;
    while !rest.is_empty() {
        let Begins::Whole(length, id, payload) = begins(rest) else {
            read.counters.bad_checksums += u32::from(matches!(begins(rest), Begins::Wrong));
            read.counters.skipped += 1;
            rest = &rest[1..];
            continue;
        };
        rest = &rest[length..];
        let Some((.., target)) = MESSAGES.into_iter().find(|(known, ..)| *known == id) else {
            read.counters.unknown += 1;
            continue;
        };
        read.counters.frames += 1;
        read.frames.push(trimmed(id, payload));
        // Zeros at the end of a payload are left out in version 2.
        if target.is_none_or(|at| payload.get(at).copied().unwrap_or(0) != 3) {
            continue;
        }
        if id == 23 { read.sets += 1 } else { read.commands += 1 }
    }
    read
}

/// A frame of `FILE_TRANSFER_PROTOCOL`, or a signed heartbeat whose signature anything may be, with this in it.
fn around(rng: &mut fastrand::Rng, inner: &[u8]) -> Vec<u8> {
    let (signed, id, extra) = if rng.bool() { (0, 110, 84) } else { (1, 0, 50) };
    let mut frame = std::vec![0xFD, inner.len() as u8, signed, 0, rng.u8(..), 3, 1, id, 0, 0];
    frame.extend_from_slice(inner);
    let sum = checksum(&frame[1..], extra);
    frame.extend_from_slice(&sum.to_le_bytes());
    frame.extend((0..13 * signed).map(|_| *rng.choice(&[0xFD, 0xFE, 0x00]).unwrap()));
    frame
}

/// Stray bytes: the beginning of a frame that never was.
fn stray(rng: &mut fastrand::Rng) -> Vec<u8> {
    let flags = rng.u8(0..2);
    let header = if rng.bool() {
        std::vec![0xFE, rng.u8(..), rng.u8(..), 3, 1, *rng.choice(&[0, 36, 76, 110]).unwrap()]
    } else {
        std::vec![0xFD, rng.u8(..), flags, 0, 0, 3, 1, *rng.choice(&[0, 36, 76, 110]).unwrap(), 0, 0]
    };
    header[..rng.usize(1..=header.len())].to_vec()
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
            match rng.u8(0..40) {
                0..=3 => {}
                // What is inside of it counts once it is damaged.
                4 | 5 => {
                    frame = around(&mut rng, &frame);
                    if rng.bool() {
                        damage(&mut rng, &mut frame);
                    }
                }
                6..=8 => stream.extend(stray(&mut rng)),
                _ => damage(&mut rng, &mut frame),
            }
            if frame != before {
                damaged += 1;
            } else if matches!(read(&frame), Read { commands, sets, .. } if commands + sets > 0) {
                untouched += 1;
            }
            sent += 1;
            stream.extend_from_slice(&frame);
        }
        let before = service.counters();
        let port = rng.usize(0..2);
        let received_before = service.port_counters(port).unwrap().received;
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
        let Read { commands, sets, frames: found, counters: expected } = read(&stream);
        let taken = core::mem::take(&mut service.handled);
        handled += taken.len() as u64;
        // Each frame taken was also found by the other reader, and each one found was taken, in the same order.
        let taken: Vec<_> = taken.into_iter().map(|(id, payload)| trimmed(id, &payload)).collect();
        assert_eq!(taken, found, "{stream:02X?}");
        let received = service.port_counters(port).unwrap().received;
        let counted = Received {
            frames: received.frames.wrapping_sub(received_before.frames),
            unknown: received.unknown.wrapping_sub(received_before.unknown),
            bad_checksums: received.bad_checksums.wrapping_sub(received_before.bad_checksums),
            skipped: received.skipped.wrapping_sub(received_before.skipped),
        };
        assert_eq!(counted, expected, "{stream:02X?}");
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
    // Enough of the whole orders were obeyed, or the test would check nothing.
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
