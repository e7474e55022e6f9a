//! Properties of both codecs: chunking, resynchronisation, counters that add up, and round trips over
//! everything that can be sent.

use jetlink::ecu::amt::codec as amt;
use jetlink::ecu::zk::codec as zk;
use jetlink::units::Throttle;
use proptest::collection::vec;
use proptest::prelude::*;

use crate::support::frames::{amt as amt_frames, printed_crc8, zk as zk_frames};

const ZK_LEN: usize = 7;

// ---------------------------------------------------------------------------------------------
// What the documents require of a decoder, as simply as can be
// ---------------------------------------------------------------------------------------------

/// ZK by the document: at each byte, seven bytes with a head and a right CRC are a frame, anything else is
/// skipped by one byte. Returns the frames, and the number of bytes left at the end.
fn zk_reference(stream: &[u8]) -> (Vec<Vec<u8>>, usize) {
    let mut frames = Vec::new();
    let mut at = 0;
    while let Some(window) = stream.get(at..at + ZK_LEN) {
        if (0xF0..=0xFE).contains(&window[0]) && printed_crc8(&window[..6]) == window[6] {
            frames.push(window.to_vec());
            at += ZK_LEN;
        } else {
            at += 1;
        }
    }
    (frames, stream.len() - at)
}

/// AMT by the document: cut at each 0xFF; a piece contains one frame at its beginning, or none.
fn amt_reference(stream: &[u8]) -> Vec<Vec<u8>> {
    let mut frames = Vec::new();
    let leaders: Vec<usize> = (0..stream.len()).filter(|&i| stream[i] == 0xFF).collect();
    for (i, &start) in leaders.iter().enumerate() {
        let end = leaders.get(i + 1).copied().unwrap_or(stream.len());
        let piece = &stream[start..end];
        let len = match (piece.get(1), piece.get(6), piece.get(7)) {
            (Some(0x05), Some(b'.'), _) => 17,
            (Some(0x05), _, Some(b'.')) => 18,
            (Some(0x05), ..) => continue,
            _ => 6,
        };
        if let Some(frame) = piece.get(..len) {
            frames.push(frame.to_vec());
        }
    }
    frames
}

fn zk_decode(decoder: &mut zk::Decoder, mut bytes: &[u8], into: &mut Vec<Vec<u8>>) {
    while !bytes.is_empty() {
        let (taken, frame) = decoder.feed(bytes);
        assert!((1..=bytes.len()).contains(&taken));
        assert!(frame.is_some() || taken == bytes.len(), "stops early without a frame");
        into.extend(frame.map(|frame| frame.raw().to_vec()));
        bytes = &bytes[taken..];
    }
}

fn amt_decode(decoder: &mut amt::Decoder, mut bytes: &[u8], into: &mut Vec<Vec<u8>>) {
    while !bytes.is_empty() {
        let (taken, frame) = decoder.feed(bytes);
        assert!((1..=bytes.len()).contains(&taken));
        assert!(frame.is_some() || taken == bytes.len(), "stops early without a frame");
        into.extend(frame.map(|frame| {
            let _ = frame.message();
            frame.raw().to_vec()
        }));
        bytes = &bytes[taken..];
    }
}

fn zk_frames_of(stream: &[u8]) -> Vec<Vec<u8>> {
    let mut frames = Vec::new();
    zk_decode(&mut zk::Decoder::new(), stream, &mut frames);
    frames
}

fn amt_frames_of(stream: &[u8]) -> Vec<Vec<u8>> {
    let mut frames = Vec::new();
    amt_decode(&mut amt::Decoder::new(), stream, &mut frames);
    frames
}

// ---------------------------------------------------------------------------------------------
// Streams
// ---------------------------------------------------------------------------------------------

/// Any ZK status frame. Bytes like heads are as likely as all others together.
fn zk_frame() -> impl Strategy<Value = Vec<u8>> {
    (0..15u8, vec(prop_oneof![any::<u8>(), 0xF0..=0xFFu8], 5)).prop_map(|(id, body)| {
        let mut frame = vec![0xF0 | id];
        frame.extend(body);
        frame.push(printed_crc8(&frame));
        frame
    })
}

fn text() -> impl Strategy<Value = String> {
    (0..=99u8, 0..=99u8, 0..=999_999u32)
        .prop_map(|(major, minor, date)| format!("{major}.{minor:02} {date:06} "))
}

/// Any AMT frame.
fn amt_frame() -> impl Strategy<Value = Vec<u8>> {
    prop_oneof![
        4 => vec(0..=0xFEu8, 5).prop_filter("set-up sets are longer", |data| data[0] != 0x05).prop_map(|data| {
            [vec![0xFF], data].concat()
        }),
        1 => (vec(0..=0xFEu8, 3), text()).prop_map(|(pulses, text)| {
            [vec![0xFF, 0x05], pulses, text.into_bytes()].concat()
        }),
    ]
}

/// Bytes of a broken line; for AMT without the leader, for ZK with many heads.
fn noise(max: usize) -> impl Strategy<Value = Vec<u8>> {
    vec(prop_oneof![any::<u8>(), 0xF0..=0xFFu8], 0..max)
}

/// Frames with noise before, between and after.
fn stream_of(frame: impl Strategy<Value = Vec<u8>>) -> impl Strategy<Value = Vec<u8>> {
    (noise(20), vec((frame, prop_oneof![Just(Vec::new()), noise(20)]), 0..12)).prop_map(|(front, rest)| {
        let rest =
            rest.into_iter().map(|(frame, noise)| [frame, noise].concat()).collect::<Vec<_>>().concat();
        [front, rest].concat()
    })
}

/// Where to cut a stream.
fn chunks(stream: &[u8], cuts: &[prop::sample::Index]) -> Vec<Vec<u8>> {
    let mut at: Vec<usize> = cuts.iter().map(|cut| cut.index(stream.len() + 1)).collect();
    at.extend([0, stream.len()]);
    at.sort_unstable();
    at.windows(2).map(|cut| stream[cut[0]..cut[1]].to_vec()).collect()
}

proptest! {
    /// ZK-16: for any bytes in any chunks, the frames are those that the document's rule finds.
    #[test]
    fn zk_16_chunks_of_a_stream_change_nothing(
        stream in stream_of(zk_frame()),
        cuts in vec(any::<prop::sample::Index>(), 0..20),
    ) {
        let (expected, left) = zk_reference(&stream);
        let mut decoder = zk::Decoder::new();
        let mut found = Vec::new();
        for chunk in chunks(&stream, &cuts) {
            zk_decode(&mut decoder, &chunk, &mut found);
        }
        prop_assert_eq!(&found, &expected);
        // Pending bytes begin with a head, so there may be fewer of them than the rule has left.
        prop_assert!(decoder.pending() <= left);
        // Every byte is in a frame, skipped or pending.
        let counters = decoder.counters();
        let in_frames = found.len() * ZK_LEN;
        prop_assert_eq!(in_frames + counters.bytes_skipped as usize + decoder.pending(), stream.len());
        prop_assert_eq!(counters.frames as usize, found.len());
        let unknown = found.iter().filter(|frame| !(1..=9).contains(&(frame[0] & 0x0F))).count();
        prop_assert_eq!(counters.unknown_frames as usize, unknown);
    }

    /// Frames back to back are all found, and nothing is skipped.
    #[test]
    fn zk_frames_back_to_back_are_all_found(frames in vec(zk_frame(), 1..30)) {
        let mut decoder = zk::Decoder::new();
        let mut found = Vec::new();
        zk_decode(&mut decoder, &frames.concat(), &mut found);
        prop_assert_eq!(found, frames);
        prop_assert_eq!((decoder.counters().bytes_skipped, decoder.counters().crc_failures), (0, 0));
    }

    /// ZK-16: a corrupted frame, with or without false heads, never costs the good frame after it, unless seven
    /// bytes across both form a frame by chance (an 8-bit CRC passes one in 256).
    #[test]
    fn zk_16_a_corrupted_frame_does_not_lose_the_next(
        mut bad in zk_frame(),
        byte in 0..7usize,
        flip in 1..=255u8,
        good in zk_frame(),
    ) {
        bad[byte] ^= flip;
        let stream = [bad, good.clone()].concat();
        let by_chance = (0..ZK_LEN).any(|at| {
            let window = &stream[at..at + ZK_LEN];
            (0xF0..=0xFE).contains(&window[0]) && printed_crc8(&window[..6]) == window[6]
        });
        prop_assume!(!by_chance);
        prop_assert_eq!(zk_frames_of(&stream), vec![good]);
    }

    /// ZK-16: after any noise at most one frame is lost: a lock by chance is seven bytes long, so one that began
    /// in the noise ends within the first good frame, and the second is found.
    #[test]
    fn zk_16_noise_loses_a_bounded_number_of_bytes(noise in noise(60), good in zk_frame()) {
        // Except for the one frame in some hundreds that contains another by chance where it meets its copy.
        prop_assume!((1..ZK_LEN).all(|at| {
            let twice = [good.clone(), good.clone()].concat();
            let window = &twice[at..at + ZK_LEN];
            !((0xF0..=0xFE).contains(&window[0]) && printed_crc8(&window[..6]) == window[6])
        }));
        let mut decoder = zk::Decoder::new();
        let mut found = Vec::new();
        zk_decode(&mut decoder, &noise, &mut found);
        found.clear();
        zk_decode(&mut decoder, &[good.clone(), good.clone()].concat(), &mut found);
        // At worst a lock by chance, begun in the noise, ends in the first copy.
        prop_assert_eq!(found.last(), Some(&good), "within 14 bytes");
    }

    /// AMT-1: for any bytes in any chunks, the frames are those between two leaders.
    #[test]
    fn amt_1_chunks_of_a_stream_change_nothing(
        stream in stream_of(amt_frame()),
        cuts in vec(any::<prop::sample::Index>(), 0..20),
    ) {
        let expected = amt_reference(&stream);
        let mut decoder = amt::Decoder::new();
        let mut found = Vec::new();
        for chunk in chunks(&stream, &cuts) {
            amt_decode(&mut decoder, &chunk, &mut found);
        }
        prop_assert_eq!(&found, &expected);
        // Every byte is in a frame, skipped or pending.
        let counters = decoder.counters();
        let in_frames: usize = found.iter().map(Vec::len).sum();
        prop_assert_eq!(in_frames + counters.bytes_skipped as usize + decoder.pending(), stream.len());
        prop_assert_eq!(counters.frames as usize, found.len());
    }

    /// AMT-1: after any noise the very next frame is found: its 0xFF always starts one.
    #[test]
    fn amt_1_noise_never_loses_the_next_frame(noise in noise(60), good in amt_frame()) {
        let found = amt_frames_of(&[noise, good.clone()].concat());
        prop_assert_eq!(found.last(), Some(&good));
    }

    /// AMT-1: bytes lost inside a frame cost that frame and no other.
    #[test]
    fn amt_1_lost_bytes_lose_one_frame(
        before in amt_frame(), spoilt in amt_frame(), after in amt_frame(), lost in any::<prop::sample::Index>(),
    ) {
        // One byte is lost after the leader; the shorter frame of six bytes ends in the next leader.
        prop_assume!(spoilt.len() == 6);
        let mut short = spoilt.clone();
        short.remove(1 + lost.index(5));
        // If Data1 was lost, Data2 takes its place, and 0x05 there opens a set-up set: cut off as well.
        let found = amt_frames_of(&[before.clone(), short, after.clone()].concat());
        prop_assert_eq!(found, vec![before, after]);
    }

    /// AMT-2: each message carries the bytes of its frame.
    #[test]
    fn amt_2_messages_carry_their_bytes(frame in amt_frame()) {
        let (_, decoded) = amt::Decoder::new().feed(&frame);
        let message = decoded.expect("a frame").message();
        let data = &frame[1..6];
        let fields = match message {
            amt::Message::Normal { switch, state, rpm, egt, throttle, vout } => {
                let switch = match switch {
                    amt::SwitchPosition::EmergencyStop => 1,
                    amt::SwitchPosition::AutoStop => 2,
                    amt::SwitchPosition::Run => 4,
                };
                vec![state.code() << 3 | switch, rpm, egt.0, throttle.0, vout]
            }
            amt::Message::Error { errors, egt, throttle, vout } => {
                vec![0, errors.0, egt.0, throttle.0, vout]
            }
            amt::Message::Alternate { engine_id, idle, max, battery, external } => {
                vec![engine_id, idle, max, battery, external]
            }
            amt::Message::Setup(setup) => {
                let text = std::str::from_utf8(&frame[5..]).expect("text");
                prop_assert_eq!(format!("{} {} ", setup.version(), setup.date()), text);
                let min = i32::from(frame[2]) * 256 + i32::from(frame[3]) - 62_464;
                prop_assert_eq!(setup.pw_min_us(), min);
                prop_assert_eq!(setup.pw_max_us(), min + i32::from(frame[4]) * 16);
                return Ok(());
            }
            amt::Message::Unknown => data.to_vec(),
        };
        prop_assert_eq!(&fields[..], data);
    }
}

// ---------------------------------------------------------------------------------------------
// Everything there is
// ---------------------------------------------------------------------------------------------

/// The document's meaning of a payload: `None` if a host may not send it.
fn zk_payload_is_defined(byte1: u8, byte2: u8) -> bool {
    let low = byte1 & 0x0F;
    let ten_bits = u16::from(low & 3) << 8 | u16::from(byte2);
    match byte1 >> 4 {
        0 | 3 => low == 0 && byte2 == 0,
        1 => ten_bits <= 1000,
        2 => low == 0 && (1..=13).contains(&byte2),
        4 => low == 0,
        5 => low == 0 && (10..=70).contains(&byte2),
        6 => low == 0 && byte2 >> 5 == 0 && byte2 >> 2 <= 6,
        7 => true,
        8 => low >> 2 == 0,
        _ => false,
    }
}

/// ZK-2, ZK-3, ZK-4: over all 65 536 payloads, decode and encode are each other's inverse, and undefined
/// payloads are refused.
#[test]
fn zk_2_every_payload_survives_the_round_trip() {
    let mut defined = 0;
    for payload in 0..=u16::MAX {
        let [byte1, byte2] = payload.to_be_bytes();
        let bytes = zk_frames::control(byte1, byte2);
        match zk::Control::decode(bytes) {
            Ok(control) => {
                assert!(
                    zk_payload_is_defined(byte1, byte2),
                    "{bytes:02x?} is not defined, gives {control:?}"
                );
                assert_eq!(control.encode(), bytes, "{control:?}");
                defined += 1;
            }
            Err(error) => {
                assert!(!zk_payload_is_defined(byte1, byte2), "{bytes:02x?} is defined, gives {error}");
                let reserved_id = byte1 >> 4 > 8;
                assert_eq!(matches!(error, zk::ControlError::Id(_)), reserved_id, "{bytes:02x?}: {error}");
                assert!(
                    !matches!(error, zk::ControlError::Head(_) | zk::ControlError::Crc { .. }),
                    "{error}"
                );
            }
        }
    }
    // IDs 0 and 3; 4 × 1001 throttles; 13 actions; 256 voltages; 61 curves; 7 × 4 modes; 4096 rpm; 1024 hPa
    assert_eq!(defined, 2 + 4 * 1001 + 13 + 256 + 61 + 28 + 4096 + 1024);
}

/// ZK-1: no payload passes with any other CRC.
#[test]
fn zk_1_a_wrong_crc_never_passes() {
    for payload in (0..=u16::MAX).step_by(31) {
        let [byte1, byte2] = payload.to_be_bytes();
        let right = printed_crc8(&[byte1, byte2]);
        for crc in (0..=255).filter(|crc| *crc != right) {
            assert_eq!(
                zk::Control::decode([0xFF, byte1, byte2, crc]),
                Err(zk::ControlError::Crc { expected: right, found: crc })
            );
        }
    }
}

/// AMT-10: all 4 × 201 control messages; no byte after the first is ever 0xFF, and the copies agree.
#[test]
fn amt_10_every_control_survives_the_round_trip() {
    for ops in amt::Ops::ALL {
        for half_percents in 0..=200u8 {
            let throttle = Throttle::from_tenths(u16::from(half_percents) * 5).unwrap();
            let control = amt::Control { ops, throttle };
            let bytes = control.encode();
            assert_eq!(bytes, amt_frames::control(ops.code(), half_percents));
            assert_eq!(bytes[0], 0xFF);
            assert!(bytes[1..].iter().all(|byte| *byte != 0xFF));
            assert_eq!(amt::Control::decode(bytes), Ok(control));
        }
    }
}

/// AMT-10: of all pairs of an OPS and a THR byte exactly 4 × 201 are messages.
#[test]
fn amt_10_no_other_bytes_are_a_message() {
    let mut good = 0;
    for ops in 0..=255 {
        for thr in 0..=255 {
            if let Ok(control) = amt::Control::decode([0xFF, ops, thr, ops, thr]) {
                assert_eq!(control.encode(), [0xFF, ops, thr, ops, thr]);
                good += 1;
            }
            let differs = amt::Control::decode([0xFF, ops, thr, ops, thr ^ 1]);
            assert_eq!(differs, Err(amt::ControlError::CopiesDiffer));
        }
    }
    assert_eq!(good, 4 * 201);
}

/// Numbers that look random and are the same at every run (xorshift).
fn random_bytes(count: usize, mut seed: u64) -> impl Iterator<Item = u8> {
    core::iter::repeat_with(move || {
        seed ^= seed << 13;
        seed ^= seed >> 7;
        seed ^= seed << 17;
        (seed >> 24) as u8
    })
    .take(count)
}

/// A million random bytes: no panic, frames as the document's rule finds them, counters that add up.
#[test]
fn zk_16_the_decoder_survives_a_million_random_bytes() {
    let stream: Vec<u8> = random_bytes(1_000_000, 0x5EED).collect();
    let mut decoder = zk::Decoder::new();
    let mut found = Vec::new();
    zk_decode(&mut decoder, &stream, &mut found);
    assert_eq!(found, zk_reference(&stream).0);
    assert!(found.len() > 100, "one window in 4400 is a frame by chance: {}", found.len());
    let skipped = decoder.counters().bytes_skipped as usize;
    assert_eq!(found.len() * ZK_LEN + skipped + decoder.pending(), stream.len());
}

/// AMT-1: the same for AMT. There is no checksum, so most of them form frames.
#[test]
fn amt_1_the_decoder_survives_a_million_random_bytes() {
    let stream: Vec<u8> = random_bytes(1_000_000, 0xA37).collect();
    let mut decoder = amt::Decoder::new();
    let mut found = Vec::new();
    amt_decode(&mut decoder, &stream, &mut found);
    assert_eq!(found, amt_reference(&stream));
    let counters = decoder.counters();
    let in_frames: usize = found.iter().map(Vec::len).sum();
    assert_eq!(in_frames + counters.bytes_skipped as usize + decoder.pending(), stream.len());
    // Every leader begins a frame that was found, cut off, without an end, or is the last one.
    let leaders = stream.iter().filter(|byte| **byte == 0xFF).count();
    let accounted = counters.frames + counters.truncated + counters.malformed;
    assert!((leaders - 1..=leaders).contains(&(accounted as usize)), "{leaders} leaders, {counters:?}");
}

/// After the head of a set-up set, a decoder waits for its full stop and no longer.
#[test]
fn amt_9_setup_is_recognised_at_its_full_stop() {
    for (text, pending_after_third, frame_at) in [("9.35 140617 ", 8, 17), ("10.35 200131 ", 8, 18)] {
        let bytes = amt_frames::setup(text);
        let mut decoder = amt::Decoder::new();
        for (i, byte) in bytes.iter().enumerate() {
            let (_, frame) = decoder.feed(&[*byte]);
            assert_eq!(frame.is_some(), i + 1 == frame_at, "{text} byte {i}");
            if i == 7 {
                assert_eq!(decoder.pending(), pending_after_third);
            }
        }
    }
}

/// ZK-16: a CRC failure drops one byte, never the seven of the window.
#[test]
fn zk_16_the_search_continues_in_the_same_window() {
    //          a head without its frame, then a whole frame whose first bytes were in the false window
    let good = [0xF1, 0x00, 0x00, 0x00, 0x00, 0x4C, 0xA0];
    for false_heads in 1..=30 {
        let stream = [vec![0xF6; false_heads], good.to_vec()].concat();
        assert_eq!(zk_frames_of(&stream), [good.to_vec()], "{false_heads} false heads");
    }
    // A frame full of heads, spoilt in its CRC, costs itself alone.
    let mut full = zk_frames::status(14, 0, [0xF1; 3]);
    full[6] ^= 1;
    assert_eq!(zk_frames_of(&[&full[..], &good].concat()), [good.to_vec()]);
}
