//! CRSF: a known frame, every damage, the link.

use super::frames::{stick, us};
use crate::channels::{Channels, Pulse};
use crate::crsf::Crsf;
use embassy_time::{Duration, Instant};
use sim::receiver::{crsf, crsf_frame, crsf_link};
use std::vec::Vec;

/// Frames every 20 ms, each at once.
fn play(input: &mut Crsf, frames: impl IntoIterator<Item = Vec<u8>>) -> Vec<(usize, Channels)> {
    let mut counts = Vec::new();
    for (i, frame) in frames.into_iter().enumerate() {
        let now = Instant::from_millis(1000 + 20 * i as u64);
        counts.extend(all(input, now, &frame).into_iter().map(|channels| (i, channels)));
    }
    counts
}

fn all(input: &mut Crsf, now: Instant, mut bytes: &[u8]) -> Vec<Channels> {
    let mut counts = Vec::new();
    while !bytes.is_empty() {
        let (taken, channels) = input.receive(now, bytes);
        assert!(taken > 0);
        counts.extend(channels);
        bytes = &bytes[taken..];
    }
    counts
}

/// Known answer: the example of kielerrr/CRSFv2-elrs, a public repository.
#[test]
fn frame_is_what_another_implementation_sends() {
    let frame = [
        0xEE, 0x18, 0x16, 0xE1, 0xE3, 0xDE, 0x09, 0xC7, 0xD7, 0x8A, 0x56, 0x80, 0x0F, 0x7C, 0xE0, 0x03, 0x1F,
        0xF8, 0xC0, 0x07, 0x3E, 0xF0, 0x81, 0x0F, 0x7C, 0x36,
    ];
    let steps = [993, 988, 1063, 995, 173, 173, 992, 992, 992, 992, 992, 992, 992, 992, 992, 992];
    let counts = play(&mut Crsf::new(), std::vec![frame.to_vec(); 3]);
    let [(2, channels)] = counts[..] else { panic!("{counts:?}") };
    for (i, steps) in (1..).zip(steps) {
        assert_eq!(us(&channels, i), Pulse::of_steps(steps).us(), "channel {i}");
    }
    assert_eq!(channels.get(17), None);
}

#[test]
fn every_value_of_every_channel_arrives() {
    for value in 0..2048 {
        let channels = core::array::from_fn(|i| (value + 131 * i as u16) & 0x7FF);
        let counts = play(&mut Crsf::new(), std::vec![crsf(channels); 3]);
        for (i, value) in (1..).zip(channels) {
            assert_eq!(us(&counts[0].1, i), Pulse::of_steps(value).us(), "{value} in channel {i}");
        }
    }
}

#[test]
fn no_damage_of_one_frame_moves_a_channel() {
    let good = crsf(stick(1200));
    let mut damaged = Vec::new();
    for i in 0..good.len() {
        let mut dropped = good.clone();
        dropped.remove(i);
        let mut doubled = good.clone();
        doubled.insert(i, good[i]);
        let mut inserted = good.clone();
        inserted.insert(i, 0xC8);
        damaged.extend([dropped, doubled, inserted, good[..i].to_vec()]);
        // Every value of every byte.
        damaged.extend((1..=u8::MAX).map(|mask| {
            let mut flipped = good.clone();
            flipped[i] ^= mask;
            flipped
        }));
    }
    for bad in damaged {
        let frames = (0..14).map(|i| if i == 6 { bad.clone() } else { good.clone() });
        let counts = play(&mut Crsf::new(), frames);
        assert!(counts.iter().all(|(_, channels)| *channels == counts[0].1), "{bad:02X?}");
        assert!(counts.len() >= 7, "{} counted: {bad:02X?}", counts.len());
        assert_eq!(counts.last().unwrap().0, 13, "the last frame counts");
    }
}

/// The control of the test above: the same value in two consecutive frames is a move.
#[test]
fn two_frames_in_a_row_move_a_channel() {
    let frames = (0..8).map(|i| crsf(stick(if i < 5 { 1200 } else { 1800 })));
    let counts: Vec<_> = play(&mut Crsf::new(), frames).iter().map(|(_, c)| us(c, 3)).collect();
    assert_eq!(counts, [1200, 1200, 1200, 1200, 1800, 1800]);
}

#[test]
fn frames_are_found_in_any_pieces_between_others() {
    let mut stream = Vec::new();
    for i in 0..30 {
        stream.extend(crsf(stick(1200 + 10 * i)));
        match i % 3 {
            0 => stream.extend(crsf_link(100)),
            1 => stream.extend(crsf_frame(0x08, &[0; 8])),
            _ => stream.extend([0x55, 0xC8, 0x00, 0xC8, 0xFF]),
        }
    }
    let mut counted = Vec::new();
    for size in 1..=stream.len() {
        let mut input = Crsf::new();
        let mut counts = 0;
        for (i, piece) in stream.chunks(size).enumerate() {
            // At the full rate of the line.
            let now = Instant::from_micros(1_000_000 + ((i * size + piece.len()) * 24) as u64);
            counts += all(&mut input, now, piece).len();
        }
        let counters = input.counters();
        assert_eq!((counters.frames, counters.statistics, counters.others), (30, 10, 10), "pieces of {size}");
        counted.push(counts);
    }
    // Bytes that belong to no frame end a row: two thirds of the frames are in rows of three.
    assert!(counted.iter().all(|count| *count <= 10) && counted[0] > 5, "{counted:?}");
}

/// A frame with a correct checksum whose payload is too short or too long: a decoder that trusts its type would index beyond it.
#[test]
fn frames_of_another_length_are_counted_and_not_read() {
    for kind in [0x16, 0x14] {
        for len in 0..=60 {
            let mut input = Crsf::new();
            let counts = play(&mut input, std::vec![crsf_frame(kind, &std::vec![0x55; len]); 4]);
            let right = len == if kind == 0x16 { 22 } else { 10 };
            assert_eq!(input.counters().others, if right { 0 } else { 4 }, "type {kind:#04X}, {len} bytes");
            assert_eq!(counts.len(), if right && kind == 0x16 { 2 } else { 0 });
        }
    }
}

#[test]
fn channels_without_a_link_are_silence() {
    let mut input = Crsf::new();
    let mut frames = Vec::new();
    for i in 0..30 {
        frames.push([crsf_link(if (10..20).contains(&i) { 0 } else { 90 }), crsf(stick(1200))].concat());
    }
    let counts: Vec<usize> = play(&mut input, frames).iter().map(|(i, _)| *i).collect();
    let expected: Vec<usize> = (2..10).chain(22..30).collect();
    assert_eq!(counts, expected);
    assert_eq!(input.counters().no_link, 10);
    let link = input.link().unwrap();
    assert_eq!((link.uplink_quality, link.uplink_rssi, link.uplink_snr), (90, [60, 70], 9));
    assert_eq!((link.downlink_quality, link.downlink_snr, link.at), (98, -10, Instant::from_millis(1580)));
}

#[test]
fn after_silence_the_third_frame_counts() {
    let mut input = Crsf::new();
    let count = |input: &mut Crsf, from: u64| {
        let now = |i| Instant::from_millis(from) + Duration::from_millis(20) * i;
        (0..5).map(|i| all(input, now(i), &crsf(stick(1200))).len()).collect::<Vec<_>>()
    };
    assert_eq!(count(&mut input, 1000), [0, 0, 1, 1, 1]);
    assert_eq!(count(&mut input, 2000), [0, 0, 1, 1, 1], "the receiver was off");
}

#[test]
fn unfinished_frame_does_not_come_late() {
    let mut input = Crsf::new();
    let frame = crsf(stick(1800));
    for i in 0..3 {
        all(&mut input, Instant::from_millis(1000 + 20 * i), &frame);
    }
    all(&mut input, Instant::from_millis(1060), &frame[..20]);
    let late = all(&mut input, Instant::from_millis(1090), &frame[20..]);
    assert!(late.is_empty());
    assert_eq!(input.counters().truncated, 1);
}

#[test]
fn noise_is_silence() {
    let mut random = fastrand::Rng::with_seed(15);
    let mut input = Crsf::new();
    let mut counts = 0;
    for i in 0..2_000_000_u64 {
        let (_, channels) = input.receive(Instant::from_micros(i * 24), &[random.u8(..)]);
        counts += u32::from(channels.is_some());
    }
    assert_eq!(counts, 0, "{:?}", input.counters());
    assert!(input.counters().bad_checksums > 1000);
}
