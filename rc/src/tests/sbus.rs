//! SBUS: known frames, every damage, flags, rates.

use super::frames::{stick, us};
use crate::channels::{Channels, Pulse};
use crate::sbus::Sbus;
use embassy_time::Instant;
use sim::receiver::sbus;
use std::vec::Vec;

/// Time between two frames, and of a byte, in µs.
const EVERY: u64 = 14_000;
const BYTE: u64 = 120;

/// Bytes, each with its time.
type Timed = Vec<(u64, u8)>;

/// Frames one after the other, each byte at its time.
fn timed(frames: impl IntoIterator<Item = Vec<u8>>) -> Timed {
    let byte = |(i, frame): (usize, Vec<u8>)| {
        let begin = 1_000_000 + i as u64 * EVERY;
        frame
            .into_iter()
            .enumerate()
            .map(move |(n, byte)| (begin + n as u64 * BYTE, byte))
            .collect::<Vec<_>>()
    };
    frames.into_iter().enumerate().flat_map(byte).collect()
}

/// Valid channels, with their time.
fn play(sbus: &mut Sbus, bytes: &Timed) -> Vec<(u64, Channels)> {
    let mut counts = Vec::new();
    for &(at, byte) in bytes {
        let (taken, channels) = sbus.receive(Instant::from_micros(at), &[byte]);
        assert_eq!(taken, 1);
        counts.extend(channels.map(|channels| (at, channels)));
    }
    counts
}

/// Known answers: frames in the tests of other public decoders (zklapow/sbus; LapochnihIvan/SBUSParser, whose frame has
/// reserved flags set, so only its channels are compared).
#[test]
fn frames_are_what_other_implementations_read() {
    let first = [
        0x0F, 0xE0, 0x03, 0x1F, 0x58, 0xC0, 0x07, 0x16, 0xB0, 0x80, 0x05, 0x2C, 0x60, 0x01, 0x0B, 0xF8, 0xC0,
        0x07, 0x00, 0x00, 0x00, 0x00, 0x00, 0x03, 0x00,
    ];
    let of_first = [992, 992, 352, 992, 352, 352, 352, 352, 352, 352, 992, 992, 0, 0, 0, 0];
    let second = [
        15, 41, 107, 214, 235, 44, 169, 3, 33, 187, 239, 95, 95, 76, 252, 16, 236, 190, 212, 237, 81, 6, 69,
        1, 0,
    ];
    let of_second = [809, 717, 943, 1174, 58, 1602, 1006, 767, 1119, 1929, 67, 1910, 1355, 987, 404, 552];
    for (frame, steps, digital) in [(first, of_first, [2000, 2000]), (second, of_second, [2000, 1000])] {
        let counts = play(&mut Sbus::new(), &timed(std::vec![frame.to_vec(); 4]));
        let (_, channels) = counts.last().unwrap();
        for (i, steps) in (1..).zip(steps) {
            assert_eq!(us(channels, i), Pulse::of_steps(steps).us(), "channel {i}");
        }
        assert_eq!([17, 18].map(|number| us(channels, number)), digital);
    }
}

#[test]
fn every_value_of_every_channel_arrives() {
    for value in 0..2048 {
        let channels = core::array::from_fn(|i| (value + 131 * i as u16) & 0x7FF);
        let counts = play(&mut Sbus::new(), &timed(std::vec![sbus(channels, 0); 4]));
        let (_, got) = counts.last().unwrap();
        for (i, value) in (1..).zip(channels) {
            assert_eq!(us(got, i), Pulse::of_steps(value).us(), "{value} in channel {i}");
        }
    }
}

#[test]
fn third_frame_after_a_pause_counts() {
    let stream = timed(std::vec![sbus(stick(1200), 0); 10]);
    let counts = play(&mut Sbus::new(), &stream);
    // It is unknown whether the line had paused before the first one.
    assert_eq!(counts.len(), 7);
    assert_eq!(counts[0].0, 1_000_000 + 3 * EVERY + 24 * BYTE);
    assert!(counts.iter().all(|(_, channels)| us(channels, 3) == 1200));
}

/// Each byte of a frame dropped, doubled, and with each bit flipped, in a stream at idle: only idle counts, and the frames after
/// it count again.
#[test]
fn no_damage_of_one_frame_moves_a_channel() {
    let good = sbus(stick(1200), 0);
    let mut damaged = Vec::new();
    for i in 0..good.len() {
        let mut dropped = good.clone();
        dropped.remove(i);
        let mut doubled = good.clone();
        doubled.insert(i, good[i]);
        let mut inserted = good.clone();
        inserted.insert(i, 0x0F);
        damaged.extend([dropped, doubled, inserted]);
        damaged.extend((0..8).map(|bit| {
            let mut flipped = good.clone();
            flipped[i] ^= 1 << bit;
            flipped
        }));
        // Cut by a reset.
        damaged.push(good[..i].to_vec());
    }
    for bad in damaged {
        let frames = (0..12).map(|i| if i == 6 { bad.clone() } else { good.clone() });
        let mut input = Sbus::new();
        let counts = play(&mut input, &timed(frames));
        for (_, channels) in &counts {
            for number in 1..=18 {
                let expected = us(&counts[0].1, number);
                assert_eq!(us(channels, number), expected, "channel {number}: {bad:02X?}");
            }
        }
        assert!(counts.len() >= 6, "{} counted: {bad:02X?}", counts.len());
        // The first frame, without a known pause before it, and this one.
        let counters = input.counters();
        let noted = counters.bad_frames + counters.truncated + counters.bytes_skipped;
        assert!(counters.frames == 11 || noted > 25 || bad.is_empty(), "{counters:?}: {bad:02X?}");
        assert!(counts.last().unwrap().0 > 1_000_000 + 11 * EVERY, "the last frame counts");
    }
}

/// The control of the test above: the same value in two consecutive frames is a move.
#[test]
fn two_frames_in_a_row_move_a_channel() {
    let frames = (0..8).map(|i| sbus(stick(if i < 5 { 1200 } else { 1800 }), 0));
    let counts: Vec<_> = play(&mut Sbus::new(), &timed(frames)).iter().map(|(_, c)| us(c, 3)).collect();
    assert_eq!(counts, [1200, 1200, 1200, 1800, 1800]);
}

#[test]
fn start_in_the_middle_of_a_stream_finds_the_frames() {
    // 0x0F and 0 in every channel, so that a frame could begin anywhere.
    let mut bytes = std::vec![0x0F];
    bytes.extend((0..22).map(|i| if i % 3 == 0 { 0x0F } else { 0 }));
    bytes.extend([0, 0]);
    let stream = timed(std::vec![bytes; 8]);
    let whole = play(&mut Sbus::new(), &stream);
    for begin in 0..25 {
        let counts = play(&mut Sbus::new(), &stream[begin..].to_vec());
        assert_eq!(counts.len(), 5, "from byte {begin}");
        assert!(counts.iter().all(|(_, channels)| *channels == whole[0].1), "from byte {begin}");
    }
}

#[test]
fn pieces_of_any_size_and_a_late_task_change_nothing() {
    let stream = timed((0..20).map(|i| sbus(stick(1200 + 10 * i), 0)));
    let whole: Vec<_> = play(&mut Sbus::new(), &stream).into_iter().map(|(_, channels)| channels).collect();
    for size in 1..=25 {
        for late in [0, 100, 700, 3000] {
            let (mut input, mut counts) = (Sbus::new(), Vec::new());
            // Pieces end with the frame; each is read `late` µs after its last byte.
            for frame in stream.chunks(25) {
                for piece in frame.chunks(size) {
                    let now = Instant::from_micros(piece.last().unwrap().0 + late);
                    let bytes: Vec<u8> = piece.iter().map(|(_, byte)| *byte).collect();
                    let mut left = &bytes[..];
                    while !left.is_empty() {
                        let (taken, channels) = input.receive(now, left);
                        counts.extend(channels);
                        left = &left[taken..];
                    }
                }
            }
            assert_eq!(counts, whole, "pieces of {size}, {late} µs late");
        }
    }
    // A task that did not run for 40 ms gets three frames at once.
    let (mut input, mut counts) = (Sbus::new(), 0);
    for (i, frames) in stream.chunks(75).enumerate() {
        let bytes: Vec<u8> = frames.iter().map(|(_, byte)| *byte).collect();
        let mut left = &bytes[..];
        while !left.is_empty() {
            let (taken, channels) = input.receive(Instant::from_micros(2_000_000 + i as u64 * 42_000), left);
            counts += u32::from(channels.is_some());
            left = &left[taken..];
        }
    }
    assert!(counts >= 13, "{counts} of 17");
}

#[test]
fn fail_safe_and_lost_frames_are_silence() {
    let flags = |flags: u8, from: usize| {
        let frames =
            (0..20).map(move |i| sbus(stick(1200), if (from..from + 5).contains(&i) { flags } else { 0 }));
        let mut input = Sbus::new();
        let counts = play(&mut input, &timed(frames));
        let frame = |at: u64| ((at - 1_000_000) / EVERY) as usize;
        (counts.iter().map(|(at, _)| frame(*at)).collect::<Vec<_>>(), *input.counters())
    };
    let all: Vec<usize> = (3..20).collect();
    assert_eq!(flags(0, 8).0, all);
    let (counts, counters) = flags(0x08, 8);
    assert_eq!(counts, [3, 4, 5, 6, 7, 15, 16, 17, 18, 19], "three frames after the fail-safe");
    assert_eq!((counters.fail_safe, counters.frame_lost), (5, 0));
    // Receivers set both.
    assert_eq!(flags(0x0C, 8).0, counts);
    // Five lost frames are more than 50 ms: three consecutive frames are needed again.
    let (counts, counters) = flags(0x04, 8);
    assert_eq!(counts, [3, 4, 5, 6, 7, 15, 16, 17, 18, 19]);
    assert_eq!((counters.fail_safe, counters.frame_lost), (0, 5));
    // One lost frame costs only itself.
    let frames = (0..12).map(|i| sbus(stick(1200), if i == 8 { 0x04 } else { 0 }));
    assert_eq!(play(&mut Sbus::new(), &timed(frames)).len(), 8);
}

#[test]
fn wrong_parity_drops_its_frame() {
    let good = sbus(stick(1200), 0);
    let stream = timed(std::vec![good; 12]);
    for bad in 0..25 {
        let mut input = Sbus::new();
        let mut counts = 0;
        for (i, &(at, byte)) in stream.iter().enumerate() {
            if i == 6 * 25 + bad {
                input.line_error();
            }
            let (_, channels) = input.receive(Instant::from_micros(at), &[byte]);
            counts += u32::from(channels.is_some());
        }
        assert_eq!(counts, 6, "byte {bad}: of 9, without the frame and the two after it");
        assert_eq!(input.counters().line_errors, 1);
    }
}

#[test]
fn flood_of_frames_does_not_count() {
    let frame = sbus(stick(1800), 0);
    let mut input = Sbus::new();
    play(&mut input, &timed(std::vec![frame.clone(); 4]));
    let mut counts = 0;
    for i in 0..1000 {
        // 1000 frames in 100 ms, which have time for 33.
        let (_, channels) = input.receive(Instant::from_micros(1_100_000 + i * 100), &frame);
        counts += u32::from(channels.is_some());
    }
    assert!((30..=40).contains(&counts), "{counts}");
    assert_eq!(input.counters().too_fast, 1000 - counts - 2);
}

#[test]
fn ends_of_sbus_2_are_good_and_all_others_are_not() {
    for end in 0..=u8::MAX {
        let mut frame = sbus(stick(1200), 0);
        frame[24] = end;
        let counts = play(&mut Sbus::new(), &timed(std::vec![frame; 6])).len();
        let good = matches!(end, 0 | 0x04 | 0x14 | 0x24 | 0x34);
        assert_eq!(counts, if good { 3 } else { 0 }, "{end:#04X}");
    }
    for flags in 0..=u8::MAX {
        let counts = play(&mut Sbus::new(), &timed(std::vec![sbus(stick(1200), flags); 6])).len();
        assert_eq!(counts, if flags < 4 { 3 } else { 0 }, "flags {flags:#04X}");
    }
}

/// A task reads the first bytes of a frame in time, and the rest late, after the pause that follows.
#[test]
fn rest_of_a_frame_that_is_read_late_does_not_count_as_a_pause() {
    for first in 1..25 {
        for late in [0, 300, 400, 500, 1000, 5000] {
            let mut input = Sbus::new();
            let mut counts = 0;
            for i in 0..60_u64 {
                let frame = sbus(stick(1200 + i as u16 * 5), 0);
                let begin = 1_000_000 + i * EVERY;
                let late = if i % 3 == 2 { late } else { 0 };
                let end = |bytes: usize| begin + bytes as u64 * BYTE;
                for (at, bytes) in [(end(first), &frame[..first]), (end(25) + late, &frame[first..])] {
                    let (taken, channels) = input.receive(Instant::from_micros(at), bytes);
                    assert_eq!(taken, bytes.len());
                    counts += u32::from(channels.is_some());
                }
            }
            assert_eq!((counts, input.counters().truncated), (57, 0), "{first} bytes, {late} µs late");
        }
    }
}

/// A frame is cut off, and as many bytes of the next one are read at once as it lacks: their last byte is not an end byte.
#[test]
fn rest_that_a_frame_lacks_does_not_end_it_unless_it_ends_like_one() {
    for first in 1..25 {
        let mut input = Sbus::new();
        let frames = (0..8).map(|_| sbus(stick(1900), 0));
        assert_eq!(play(&mut input, &timed(frames)).len(), 5, "three to count, and the first is none");
        let frame = sbus(stick(1900), 0);
        let begin = 1_000_000 + 8 * EVERY;
        input.receive(Instant::from_micros(begin + first as u64 * BYTE), &frame[..first]);
        // The next frame, whose last byte read is not an end byte.
        let next = &frame[..25 - first];
        let (_, channels) = input.receive(Instant::from_micros(begin + EVERY), next);
        let ends = matches!(next.last(), Some(0 | 0x04 | 0x14 | 0x24 | 0x34));
        assert!(channels.is_none() || ends, "{first}");
        assert_eq!(input.counters().truncated, u32::from(channels.is_none()), "{first}");
    }
}

/// Random bytes at the full rate of the line for 100 s: valid frames are counted, so that a change shows.
#[test]
fn noise_is_silence() {
    let mut random = fastrand::Rng::with_seed(15);
    let (mut input, mut counts) = (Sbus::new(), 0);
    for i in 0..833_333_u64 {
        // A pause now and then, as noise has.
        let at = i * BYTE + i / 40 * 700;
        let (_, channels) = input.receive(Instant::from_micros(at), &[random.u8(..)]);
        counts += u32::from(channels.is_some());
    }
    assert_eq!(counts, 0, "{:?}", input.counters());
    assert!(input.counters().bytes_skipped > 100_000);
}
