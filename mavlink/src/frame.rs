//! Frames of MAVLink: bytes to messages (version 1 and 2) and messages to bytes (version 2).
//!
//! A frame is what has the right checksum, also of a message that is not used: it is skipped as a whole, because its payload may look like
//! a frame. Where a checksum is wrong, or cannot be checked because the message is in no dialect, no frame begins: the search continues at
//! the second byte. So a few stray bytes that claim a length lose nothing of what follows them.

use crate::dialect::MavMessage;
use crate::extras::extra;
use crate::fields::Fields;
pub use crate::ids::{Address, MAX_FRAME};
#[cfg(test)]
use crate::sent::generated;
use crate::sent::{Payload, SENT_PAYLOAD};
use crate::signing::{Key, SIGNATURE, Signature};
use heapless::Vec;
#[cfg(test)]
use mavlink_core::{Message, MessageData};

/// Largest frame that is sent here, signed.
pub const MAX_SENT: usize = 10 + SENT_PAYLOAD + 2 + SIGNATURE;

/// Number of checks until the beginnings of incomplete frames are given up: 0.5 s, as the service checks every 50 ms. Otherwise damaged bytes
/// that look like the beginning of a long frame would delay a stop until as many bytes have arrived.
const PATIENCE: u8 = 10;

const START_V1: u8 = 0xFE;
const START_V2: u8 = 0xFD;
const SIGNED: u8 = 0x01;

/// Without a table, which would take half a kilobyte, for some thousand bytes a second.
const CHECKSUM: crc::Crc<u16, crc::NoTable> = crc::Crc::<u16, crc::NoTable>::new(&crc::CRC_16_MCRF4XX);

/// A message with its sender.
#[derive(Clone, PartialEq)]
pub struct Frame {
    /// Its sender.
    pub from: Address,
    /// The number of its message.
    pub id: u32,
    /// Contents of the message.
    pub(crate) fields: Fields,
    /// Result of checking its signature.
    pub signature: Signature,
}

impl core::fmt::Debug for Frame {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        let mut frame = f.debug_struct("Frame");
        // A key is not printed.
        frame.field("from", &self.from).field("id", &self.id).field("signature", &self.signature);
        frame.finish_non_exhaustive()
    }
}

#[cfg(test)]
impl Frame {
    /// The message, as the generated parsers have it.
    pub fn message(&self) -> MavMessage {
        MavMessage::parse(mavlink_core::MavlinkVersion::V2, self.id, self.fields.all()).unwrap()
    }
}

/// Counters of what a port received. All wrap.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Received {
    /// Good frames of known messages.
    pub frames: u32,
    /// Good frames of messages that jetlink does not use.
    pub unknown: u32,
    /// Wrong checksums.
    pub bad_checksums: u32,
    /// Bytes that belonged to no good frame, each once.
    pub skipped: u32,
}

/// Finds frames in a stream of bytes.
#[derive(Debug, Default)]
pub struct Decoder {
    /// The beginning of a frame, or nothing.
    buffer: Vec<u8, MAX_FRAME>,
    /// How many of its first bytes were there when the checks began to count, and the number of checks since. They wait together: many
    /// false beginnings, one behind the other, cost the time of one.
    waiting: usize,
    looks: u8,
    /// How many of its first bytes have waited for too long. No frame that is still incomplete begins in them.
    stale: usize,
    counters: Received,
}

/// What the bytes of the buffer are.
#[expect(clippy::large_enum_variant, reason = "there is one at a time, on the stack")]
enum Found {
    /// The beginning of a frame.
    Incomplete,
    /// No frame begins here.
    Nothing,
    /// A frame of a message that is not used.
    Unknown(usize),
    /// A frame, as long as this.
    Frame(usize, Frame),
}

impl Decoder {
    /// A decoder without bytes.
    pub const fn new() -> Self {
        Self {
            buffer: Vec::new(),
            waiting: 0,
            looks: 0,
            stale: 0,
            counters: Received { frames: 0, unknown: 0, bad_checksums: 0, skipped: 0 },
        }
    }

    /// Forgets the beginning of a frame: the rest will not arrive.
    pub(crate) fn clear(&mut self) {
        self.buffer.clear();
        (self.waiting, self.looks, self.stale) = (0, 0, 0);
    }

    /// Counters of what was received.
    pub const fn counters(&self) -> Received {
        self.counters
    }

    /// Takes bytes until a frame is complete. Returns how many it took, and the frame. It may hold further frames when all
    /// bytes are taken: call it until it returns none. Signatures are verified with the key, if there is one.
    pub fn receive(&mut self, key: Option<&Key>, bytes: &[u8]) -> (usize, Option<Frame>) {
        if let Some(frame) = self.search(key) {
            return (0, Some(frame));
        }
        for (i, &byte) in bytes.iter().enumerate() {
            // It never holds a whole frame here, so there is space.
            if self.buffer.push(byte).is_err() {
                self.clear();
            }
            if let Some(frame) = self.search(key) {
                return (i + 1, Some(frame));
            }
        }
        (bytes.len(), None)
    }

    /// Gives up frames whose rest does not arrive. Call it every 50 ms, and then [`Self::receive`] until it returns none.
    pub fn look_after(&mut self) {
        if self.waiting == 0 {
            (self.waiting, self.looks) = (self.buffer.len(), 0);
        }
        self.looks = self.looks.saturating_add(1);
        if self.looks >= PATIENCE {
            (self.stale, self.waiting) = (self.waiting, 0);
        }
    }

    /// No frame begins with the first byte.
    fn skip(&mut self) {
        let next = self.buffer.iter().skip(1).position(|&byte| is_start(byte));
        let gone = next.map_or(self.buffer.len(), |at| at + 1);
        self.counters.skipped = self.counters.skipped.wrapping_add(gone as u32);
        self.drop_first(gone);
    }

    /// Searches the buffer until it holds the beginning of a frame or nothing.
    ///
    /// The work is bounded by the buffer: each round that does not end the search drops at least one byte, and each byte is at most once the first
    /// one when a checksum is computed, over 265 bytes of the longest frame. So a byte costs one such checksum on average, and one that
    /// completes a false frame at most as many as the buffer has bytes.
    fn search(&mut self, key: Option<&Key>) -> Option<Frame> {
        loop {
            match self.look(key) {
                Found::Incomplete => return None,
                Found::Nothing => self.skip(),
                Found::Unknown(len) => {
                    self.counters.unknown = self.counters.unknown.wrapping_add(1);
                    self.drop_first(len);
                }
                Found::Frame(len, frame) => {
                    self.counters.frames = self.counters.frames.wrapping_add(1);
                    self.drop_first(len);
                    return Some(frame);
                }
            }
        }
    }

    fn drop_first(&mut self, count: usize) {
        self.waiting = self.waiting.saturating_sub(count);
        self.stale = self.stale.saturating_sub(count);
        // The rest fits. A copy in place would add 1.4 kB of `core`.
        self.buffer = Vec::from_slice(self.buffer.get(count..).unwrap_or_default()).unwrap_or_default();
    }

    fn look(&mut self, key: Option<&Key>) -> Found {
        let (&start, rest) = match self.buffer.split_first() {
            Some(parts) => parts,
            None => return Found::Incomplete,
        };
        if !is_start(start) {
            return Found::Nothing;
        }
        let incomplete = if self.stale > 0 { Found::Nothing } else { Found::Incomplete };
        let Some(&len) = rest.first() else { return incomplete };
        let (header, signature) = if start == START_V1 {
            (6, 0)
        } else {
            match rest.get(1) {
                None => return incomplete,
                Some(&flags) if flags & !SIGNED != 0 => return Found::Nothing,
                Some(&flags) => (10, if flags & SIGNED != 0 { SIGNATURE } else { 0 }),
            }
        };
        if self.buffer.len() < header {
            return incomplete;
        }
        let at = |i: usize| self.buffer.get(i).copied().unwrap_or(0);
        let (from, id) = if start == START_V1 {
            (Address { system: at(3), component: at(4) }, u32::from(at(5)))
        } else {
            let id = u32::from_le_bytes([at(7), at(8), at(9), 0]);
            (Address { system: at(5), component: at(6) }, id)
        };
        // The checksum of an unknown message cannot be verified, so its length is not trusted: these may be stray bytes before a stop.
        let Some(extra) = extra(id) else { return Found::Nothing };
        let end = header + usize::from(len);
        let whole = end + 2 + signature;
        if self.buffer.len() < whole {
            return incomplete;
        }
        let checked = self.buffer.get(1..end).unwrap_or_default();
        if checksum(checked, extra).to_le_bytes() != [at(end), at(end + 1)] {
            self.counters.bad_checksums = self.counters.bad_checksums.wrapping_add(1);
            return Found::Nothing;
        }
        if !MavMessage::all_ids().contains(&id) {
            return Found::Unknown(whole);
        }
        let fields = Fields::new(self.buffer.get(header..end).unwrap_or_default());
        let (frame, tail) = self.buffer.split_at_checked(end + 2).unwrap_or_default();
        let tail = tail.get(..signature).and_then(|tail| <[u8; SIGNATURE]>::try_from(tail).ok());
        let signature = match (tail, key) {
            (None, _) => Signature::Missing,
            (Some(_), None) => Signature::Unverified,
            (Some(tail), Some(key)) => key.check(frame, tail),
        };
        Found::Frame(whole, Frame { from, id, fields, signature })
    }
}

const fn is_start(byte: u8) -> bool {
    byte == START_V1 || byte == START_V2
}

fn checksum(bytes: &[u8], extra: u8) -> u16 {
    let mut digest = CHECKSUM.digest();
    digest.update(bytes);
    digest.update(&[extra]);
    digest.finalize()
}

/// Encodes any message as a frame of MAVLink 2, without a signature, as the generated code writes it.
#[cfg(test)]
pub(crate) fn encode<M: MessageData>(from: Address, sequence: u8, message: &M) -> Vec<u8, MAX_FRAME> {
    encode_payload(from, sequence, &generated(message), false)
}

/// The same, as the beginning of a signed frame: its signature has to follow.
#[cfg(test)]
pub(crate) fn encode_to_sign<M: MessageData>(from: Address, sequence: u8, message: &M) -> Vec<u8, MAX_FRAME> {
    encode_payload(from, sequence, &generated(message), true)
}

/// A frame; `to_sign`: its signature has to follow.
pub(crate) fn encode_payload(
    from: Address,
    sequence: u8,
    payload: &Payload,
    to_sign: bool,
) -> Vec<u8, MAX_FRAME> {
    let bytes = payload.bytes();
    let [low, mid, high, _] = payload.id.to_le_bytes();
    let header = [
        START_V2,
        bytes.len() as u8, // 73 at most
        if to_sign { SIGNED } else { 0 },
        0,
        sequence,
        from.system,
        from.component,
        low,
        mid,
        high,
    ];
    let mut frame = Vec::new();
    // The largest frame fits.
    let _ = frame.extend_from_slice(&header);
    let _ = frame.extend_from_slice(bytes);
    let sum = checksum(frame.get(1..).unwrap_or_default(), payload.extra_crc);
    let _ = frame.extend_from_slice(&sum.to_le_bytes());
    frame
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dialect::{COMMAND_LONG_DATA, HEARTBEAT_DATA, SERVO_OUTPUT_RAW_DATA, SETUP_SIGNING_DATA};
    use crate::signing::{Seal, Stamp};

    const FROM: Address = Address { system: 7, component: 25 };

    fn heartbeat() -> HEARTBEAT_DATA {
        HEARTBEAT_DATA {
            custom_mode: 0x0102_0304,
            mavtype: 0,
            autopilot: 8,
            base_mode: 1,
            system_status: 4,
            mavlink_version: 3,
        }
    }

    /// Known answer of pymavlink 2.4.50: `HEARTBEAT` 7/25, sequence 5.
    #[test]
    fn a_heartbeat_is_what_another_implementation_sends() {
        let frame = encode(FROM, 5, &heartbeat());
        assert_eq!(frame[..], KNOWN_HEARTBEAT);
    }

    /// The same message in MAVLink 1.
    #[test]
    fn version_1_is_received() {
        let (taken, frame) = Decoder::new().receive(None, &KNOWN_HEARTBEAT_V1);
        assert_eq!(taken, KNOWN_HEARTBEAT_V1.len());
        assert_eq!(frame, Some(frame_of(Signature::Missing)));
    }

    fn frame_of(signature: Signature) -> Frame {
        let payload = generated(&heartbeat());
        Frame { from: FROM, id: HEARTBEAT_DATA::ID, fields: Fields::new(payload.bytes()), signature }
    }

    /// Known answer of pymavlink 2.4.50: the same heartbeat, signed as link 2. Made with
    ///
    /// ```text
    /// os.environ["MAVLINK20"] = "1"
    /// from pymavlink.dialects.v20 import common as m
    /// mav = m.MAVLink(None, srcSystem=7, srcComponent=25)
    /// mav.seq, mav.signing.sign_outgoing = 5, True
    /// mav.signing.secret_key = bytes(range(1, 33))
    /// mav.signing.link_id, mav.signing.timestamp = 2, 0x0123456789AB
    /// print(m.MAVLink_heartbeat_message(0, 8, 1, 0x01020304, 4, 3).pack(mav).hex())
    /// ```
    const SIGNED_HEARTBEAT: [u8; 34] = [
        0xFD, 0x09, 0x01, 0x00, 0x05, 0x07, 0x19, 0x00, 0x00, 0x00, 0x04, 0x03, 0x02, 0x01, 0x00, 0x08, 0x01,
        0x04, 0x03, 0xA6, 0xA9, 0x02, 0xAB, 0x89, 0x67, 0x45, 0x23, 0x01, 0xF9, 0x19, 0x3A, 0xB6, 0xBC, 0x55,
    ];

    fn key() -> Key {
        Key::new(core::array::from_fn(|i| i as u8 + 1)).unwrap()
    }

    #[test]
    fn a_signed_frame_is_what_another_implementation_sends() {
        let stamp = Stamp::new(0x0123_4567_89AB).unwrap();
        let mut frame = encode_to_sign(FROM, 5, &heartbeat());
        Seal { key: &key(), link: 2, stamp }.sign(&mut frame);
        assert_eq!(frame[..], SIGNED_HEARTBEAT);
        let received = |key: Option<&Key>, bytes: &[u8]| Decoder::new().receive(key, bytes).1;
        let right = Signature::Right { link: 2, stamp };
        assert_eq!(received(Some(&key()), &SIGNED_HEARTBEAT), Some(frame_of(right)));
        assert_eq!(received(None, &SIGNED_HEARTBEAT), Some(frame_of(Signature::Unverified)));
        let other = Key::new([1; 32]).unwrap();
        assert_eq!(received(Some(&other), &SIGNED_HEARTBEAT), Some(frame_of(Signature::Wrong)));
        assert_eq!(received(Some(&key()), &KNOWN_HEARTBEAT), Some(frame_of(Signature::Missing)));
        // Link, stamp and signature, bit by bit; the sequence, which the checksum covers as well.
        for bit in 21 * 8..34 * 8 {
            let mut changed = SIGNED_HEARTBEAT;
            changed[bit / 8] ^= 1 << (bit % 8);
            assert_eq!(received(Some(&key()), &changed), Some(frame_of(Signature::Wrong)), "bit {bit}");
        }
        let mut changed = SIGNED_HEARTBEAT;
        changed[4] ^= 1;
        let sum = checksum(&changed[1..19], HEARTBEAT_DATA::EXTRA_CRC).to_le_bytes();
        changed[19..21].copy_from_slice(&sum);
        assert_eq!(received(Some(&key()), &changed), Some(frame_of(Signature::Wrong)));
    }

    #[test]
    fn a_key_is_not_printed_with_its_frame() {
        let setup = SETUP_SIGNING_DATA { secret_key: [0xA5; 32], ..Default::default() };
        let frame = Decoder::new().receive(None, &encode(FROM, 0, &setup)).1.unwrap();
        assert_eq!(frame.message(), MavMessage::SETUP_SIGNING(setup));
        let text = std::format!("{frame:?}");
        assert!(text.contains("Missing") && !text.contains("165"), "{text}");
    }

    const KNOWN_HEARTBEAT: [u8; 21] = [
        0xFD, 0x09, 0x00, 0x00, 0x05, 0x07, 0x19, 0x00, 0x00, 0x00, 0x04, 0x03, 0x02, 0x01, 0x00, 0x08, 0x01,
        0x04, 0x03, 0x41, 0x51,
    ];
    const KNOWN_HEARTBEAT_V1: [u8; 17] = [
        0xFE, 0x09, 0x05, 0x07, 0x19, 0x00, 0x04, 0x03, 0x02, 0x01, 0x00, 0x08, 0x01, 0x04, 0x03, 0x79, 0x3A,
    ];

    fn all(decoder: &mut Decoder, mut bytes: &[u8]) -> std::vec::Vec<Frame> {
        let mut frames = std::vec::Vec::new();
        loop {
            let (taken, frame) = decoder.receive(None, bytes);
            bytes = &bytes[taken..];
            match frame {
                Some(frame) => frames.push(frame),
                None => return frames,
            }
        }
    }

    #[test]
    fn a_frame_is_found_after_and_inside_of_noise() {
        let good = encode(FROM, 1, &heartbeat());
        let mut damaged = good.clone();
        damaged[12] ^= 0x40;
        // Noise, the beginning of a frame, and a damaged one.
        let stream = [&[0x55, 0xFD, 0xFC][..], &good[..15], &damaged, &good, &good].concat();
        for step in 1..stream.len() {
            let mut decoder = Decoder::new();
            let mut frames = std::vec::Vec::new();
            for piece in stream.chunks(step) {
                frames.extend(all(&mut decoder, piece));
            }
            assert_eq!(frames.len(), 2, "in pieces of {step} bytes: {:?}", decoder.counters());
            assert!(decoder.counters().bad_checksums > 0 && decoder.counters().skipped > 0);
        }
    }

    /// What a decoder found in a stream that came in pieces, and its counters.
    fn found(stream: &[u8], step: usize) -> (std::vec::Vec<Frame>, Received) {
        let mut decoder = Decoder::new();
        let pieces = stream.chunks(step);
        let frames = pieces.flat_map(|piece| all(&mut decoder, piece)).collect();
        (frames, decoder.counters())
    }

    fn stop(engine: u8) -> COMMAND_LONG_DATA {
        COMMAND_LONG_DATA { command: 223, target_system: 1, target_component: engine, ..Default::default() }
    }

    /// A stop in version 1, whose zeros are sent.
    fn stop_v1(engine: u8) -> std::vec::Vec<u8> {
        let mut frame = std::vec![START_V1, 33, 9, 255, 190, 76];
        frame.extend_from_slice(&Fields::new(generated(&stop(engine)).bytes()).all()[..33]);
        let sum = checksum(&frame[1..], COMMAND_LONG_DATA::EXTRA_CRC);
        frame.extend_from_slice(&sum.to_le_bytes());
        frame
    }

    /// A whole frame with these bytes as its payload, of a message that is not used.
    fn around(id: u16, extra: u8, payload: &[u8]) -> std::vec::Vec<u8> {
        let mut frame = std::vec![START_V2, payload.len() as u8, 0, 0, 0, 1, 1, id as u8, (id >> 8) as u8, 0];
        frame.extend_from_slice(payload);
        let sum = checksum(&frame[1..], extra);
        frame.extend_from_slice(&sum.to_le_bytes());
        frame
    }

    /// `FILE_TRANSFER_PROTOCOL`.
    fn file(payload: &[u8]) -> std::vec::Vec<u8> {
        around(110, 84, payload)
    }

    fn outputs(count: u8) -> std::vec::Vec<u8> {
        let outputs = |i: u8| SERVO_OUTPUT_RAW_DATA {
            time_usec: 1_000_000 + 25_000 * u32::from(i),
            servo3_raw: 1500,
            ..Default::default()
        };
        let autopilot = Address { system: 1, component: 1 };
        (0..count).flat_map(|i| encode(autopilot, i, &outputs(i))).collect()
    }

    /// Each whole frame is found, in order and once, whatever a few bytes before it claim to be. The stream after them is as long as the longest
    /// frame.
    #[test]
    fn stray_bytes_lose_no_frame() {
        let stream = outputs(12);
        let ground = Address { system: 255, component: 190 };
        let full = [START_V2, 0xFF, 0, 0, 7, 1, 1, 36, 0, 0];
        let mut strays: std::vec::Vec<std::vec::Vec<u8>> = std::vec![
            std::vec![START_V2, 0xFF, 0x00],
            std::vec![START_V2, 0x80, 0x00],
            std::vec![START_V2, 0xFF, 0x01],
            std::vec![START_V1, 0xFF],
            std::vec![START_V1, 0x80],
            [START_V2, 0xFF, 0x00].repeat(5),
            // A message that is not used, and one that is in no dialect.
            std::vec![START_V2, 0xFF, 0, 0, 7, 1, 1, 110, 0, 0],
            std::vec![START_V2, 0xFF, 1, 0, 0, 1, 1, 99],
            std::vec![START_V2, 0xFF, 0, 0, 7, 1, 1, 0xFF, 0xFF, 0xFF],
        ];
        // The beginnings of frames: as long as this one says, and much longer.
        let whole = encode(ground, 3, &stop(27));
        strays.extend((1..whole.len()).map(|end| whole[..end].to_vec()));
        strays.extend((1..=full.len()).map(|end| full[..end].to_vec()));
        // A header of each length, and garbage of each length.
        strays.extend((0..=255).map(|len| std::vec![START_V2, len, 0]));
        strays.extend((0..=255).map(|len| std::vec![START_V1, len]));
        let mut rng = fastrand::Rng::with_seed(3);
        for length in 1..=300 {
            let mut garbage = std::vec![0; length];
            rng.fill(&mut garbage);
            garbage[0] = *rng.choice(&[START_V1, START_V2]).unwrap();
            strays.push(garbage);
        }
        for stop in [encode(ground, 9, &stop(26)).to_vec(), stop_v1(26)] {
            for stray in &strays {
                let all = [&stream[..], stray, &stop, &stream].concat();
                for step in [1, 7, 64, all.len()] {
                    let (frames, counters) = found(&all, step);
                    let ids: std::vec::Vec<_> = frames.iter().map(|frame| frame.id).collect();
                    assert_eq!(ids, [&[36; 12][..], &[76], &[36; 12]].concat(), "{stray:02X?} {counters:?}");
                    // Each byte counts once.
                    assert_eq!(counters.skipped as usize, stray.len(), "{stray:02X?}");
                    assert_eq!((counters.frames, counters.unknown), (25, 0));
                }
            }
        }
    }

    /// After a damaged frame, and inside of one: its length is right, its checksum is not.
    #[test]
    fn frames_after_and_inside_of_a_wrong_frame_are_found() {
        let two = [encode(FROM, 1, &stop(26)), encode(FROM, 2, &stop(27))].concat();
        for mut wrong in [file(&two), around(36, 222, &two)] {
            for at in [4, 6, wrong.len() - 1] {
                wrong[at] ^= 0x10;
                let (frames, counters) = found(&[&wrong[..], &two].concat(), 1000);
                let stops = frames.iter().map(|frame| frame.fields.u8(31)).collect::<std::vec::Vec<_>>();
                assert_eq!(stops, [26, 27, 26, 27]);
                assert_eq!((counters.skipped, counters.bad_checksums), (12, 1));
                wrong[at] ^= 0x10;
            }
        }
    }

    /// What is the payload of a whole frame is data, also of a message that is not used, and whatever is around it.
    #[test]
    fn a_command_inside_of_a_whole_frame_is_not_received() {
        let inner = encode(FROM, 1, &stop(26));
        assert_eq!(found(&inner, 1).0.len(), 1);
        let outer = [file(&inner), around(385, 147, &inner), around(0, 50, &inner)];
        for (outer, used) in outer.iter().zip([0, 0, 1]) {
            for noise in [&[][..], &[0x55], &[START_V2], &[START_V1, 0xFF], &[START_V2, 0xFF, 0]] {
                let stream = [noise, outer, noise, &outputs(12)[..]].concat();
                for step in [1, 7, stream.len()] {
                    let (frames, counters) = found(&stream, step);
                    assert!(frames.iter().all(|frame| frame.id != COMMAND_LONG_DATA::ID), "{noise:02X?}");
                    assert_eq!((frames.len(), counters.unknown), (12 + used, 1 - used as u32));
                    assert_eq!(counters.skipped as usize, 2 * noise.len());
                }
            }
        }
    }

    /// The rest of a frame does not arrive: whatever has waited for the time-out is decoded, however many frames seem to begin in it.
    #[test]
    fn frames_after_many_false_ones_wait_for_one_time_out() {
        let mut decoder = Decoder::new();
        let stream = [&[START_V1, 0xFF].repeat(20)[..], &encode(FROM, 1, &stop(26))].concat();
        assert_eq!(all(&mut decoder, &stream).len(), 0);
        let mut checks = 0;
        while all(&mut decoder, &[]).is_empty() {
            checks += 1;
            assert!(checks <= PATIENCE);
            decoder.look_after();
        }
        assert_eq!((checks, decoder.counters().skipped), (PATIENCE, 40));
        // The beginning of another one has its own time, and a frame that is complete in time is received.
        let whole = encode(FROM, 1, &stop(26));
        assert_eq!(all(&mut decoder, &whole[..20]).len(), 0);
        (1..PATIENCE).for_each(|_| decoder.look_after());
        assert_eq!(all(&mut decoder, &whole[20..]).len(), 1);
    }

    #[test]
    fn a_signed_frame_is_as_long_as_its_signature() {
        let plain = encode(FROM, 1, &heartbeat());
        let mut signed = plain.clone();
        signed[2] = SIGNED;
        let end = signed.len() - 2;
        let sum = checksum(&signed[1..end], HEARTBEAT_DATA::EXTRA_CRC).to_le_bytes();
        signed.truncate(end);
        signed.extend_from_slice(&sum).unwrap();
        signed.extend_from_slice(&[0xFD; SIGNATURE]).unwrap();
        signed.extend_from_slice(&plain).unwrap();
        assert_eq!(all(&mut Decoder::new(), &signed).len(), 2);
        // An unknown flag means that the frame cannot be understood.
        signed[2] = 0x02;
        assert_eq!(all(&mut Decoder::new(), &signed).len(), 1);
    }
}
