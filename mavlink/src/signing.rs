//! Signing of MAVLink 2: only a sender with the key may command, even if others can write on the link.
//!
//! A signed frame ends with the number of its link, a time stamp and the first 48 bits of SHA-256 over key, frame, link and stamp.
//! Every sender (system, component, link) increments its time stamps, so that a recorded frame that is sent again is recognised.
//! A node has no clock of the day: its stamps continue from the last one that was stored, and follow those that it accepts.

use crate::ids::{Address, MAX_FRAME};
use embassy_time::{Duration, Instant};
use heapless::Vec;
use sha2::{Digest, Sha256};

/// Length of the end of a signed frame: link, stamp and signature.
pub const SIGNATURE: usize = 13;
/// Number of senders that are remembered.
pub const STREAMS: usize = if cfg!(feature = "signing") { 16 } else { 1 };
/// Bytes of the hash that are sent.
const HASH: usize = 6;
/// How far the first stamp of a sender may be behind ours: 1 minute.
const BEHIND: u64 = Stamp::units(Duration::from_secs(60));
/// Longest delay of a copy that arrives on another port.
const COPY: u64 = Stamp::units(Duration::from_secs(10));

/// Parts of a byte of a sender that is retained.
#[cfg(feature = "signing")]
const IS_SENDER: u8 = 0x80;
#[cfg(feature = "signing")]
const PORT_AT: u8 = 4;
#[cfg(feature = "signing")]
const PORT: u8 = 7;
#[cfg(feature = "signing")]
const BEHIND_HIGHEST: u8 = 0x0F;

/// A key shared by ground station, autopilot and node. It is neither logged nor printed.
#[derive(Clone, Copy, PartialEq, Eq)]
pub struct Key([u8; 32]);

impl Key {
    /// A key; `None`: all bytes are zero.
    pub fn new(bytes: [u8; 32]) -> Option<Self> {
        (bytes != [0; 32]).then_some(Self(bytes))
    }

    /// Its bytes, to store them.
    #[cfg(feature = "signing")]
    pub(crate) const fn bytes(&self) -> [u8; 32] {
        self.0
    }

    /// Signs a whole frame, from its first byte to its stamp.
    fn sign(&self, parts: &[&[u8]]) -> [u8; HASH] {
        let mut hash = Sha256::new();
        hash.update(self.0);
        parts.iter().for_each(|part| hash.update(part));
        let [a, b, c, d, e, f, ..] = <[u8; 32]>::from(hash.finalize());
        [a, b, c, d, e, f]
    }

    /// Checks the signature of a frame: `frame` up to its checksum, and the bytes after it.
    pub(crate) fn check(&self, frame: &[u8], signature: [u8; SIGNATURE]) -> Signature {
        let [link, s0, s1, s2, s3, s4, s5, received @ ..] = signature;
        let stamp = Stamp(u64::from_le_bytes([s0, s1, s2, s3, s4, s5, 0, 0]));
        let expected = self.sign(&[frame, &[link, s0, s1, s2, s3, s4, s5]]);
        // In constant time: it does not matter where they differ.
        let differ = expected.iter().zip(received).fold(0, |all, (one, other)| all | (one ^ other));
        if differ == 0 { Signature::Right { link, stamp } } else { Signature::Wrong }
    }
}

impl core::fmt::Debug for Key {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str("Key")
    }
}

/// Time stamp: units of 10 µs since 2015-01-01, 48 bits.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Debug, Default)]
pub struct Stamp(u64);

impl Stamp {
    /// The first one.
    pub(crate) const ZERO: Self = Self(0);

    /// The last one.
    pub const MAX: Self = Self((1 << 48) - 1);

    /// A stamp; `None`: more than 48 bits.
    pub const fn new(units: u64) -> Option<Self> {
        if units <= Self::MAX.0 { Some(Self(units)) } else { None }
    }

    /// Units of 10 µs since 2015-01-01.
    pub const fn get(self) -> u64 {
        self.0
    }

    const fn units(time: Duration) -> u64 {
        time.as_micros() / 10
    }

    /// The stamp later by `time`.
    #[cfg(feature = "signing")]
    pub(crate) fn later(self, time: Duration) -> Self {
        self.after(Self::units(time))
    }

    fn after(self, units: u64) -> Self {
        Self(self.0.saturating_add(units)).min(Self::MAX)
    }
}

/// Result of checking a frame's signature.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Signature {
    /// The frame has no signature.
    Missing,
    /// There is no key to verify it with.
    Unverified,
    /// It was made with another key, or for another frame.
    Wrong,
    /// It was made with our key. This does not show whether it is new.
    Right {
        /// Number of the sender's link.
        link: u8,
        /// When it was sent, by the sender's clock.
        stamp: Stamp,
    },
}

/// Why a frame is ignored.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) enum Ignored {
    Unsigned,
    Wrong,
    Replayed,
    Duplicate,
    Behind,
    TooMany,
}

/// Counters of frames ignored because of their signature. All wrap.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct SigningCounters {
    /// Without a signature.
    pub not_signed: u32,
    /// Signed with another key, or changed on the way.
    pub badly_signed: u32,
    /// Signed, but not newer than the last frame of their sender.
    pub replayed: u32,
    /// Copies that arrived on another port.
    pub duplicates: u32,
    /// First frames of a sender whose clock is more than 1 minute behind ours.
    pub clocks_behind: u32,
    /// Frames of a 17th sender.
    pub too_many: u32,
    /// Refused `SETUP_SIGNING` messages.
    pub setups_refused: u32,
}

impl SigningCounters {
    /// Each counter with its name as a named value.
    pub(crate) const fn named(&self) -> [(&'static str, u32); 7] {
        [
            ("unsigned", self.not_signed),
            ("badsigned", self.badly_signed),
            ("replayed", self.replayed),
            ("duplicate", self.duplicates),
            ("clockback", self.clocks_behind),
            ("toomany", self.too_many),
            ("setups", self.setups_refused),
        ]
    }

    pub(crate) const fn count(&mut self, why: Ignored) {
        let counter = match why {
            Ignored::Unsigned => &mut self.not_signed,
            Ignored::Wrong => &mut self.badly_signed,
            Ignored::Replayed => &mut self.replayed,
            Ignored::Duplicate => &mut self.duplicates,
            Ignored::Behind => &mut self.clocks_behind,
            Ignored::TooMany => &mut self.too_many,
        };
        *counter = counter.wrapping_add(1);
    }
}

/// A sender, with its last accepted frame.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
struct Stream {
    from: Address,
    link: u8,
    stamp: Stamp,
    port: usize,
}

/// State of signing that has to survive a restart of the node. The code that builds the service retains it, in RAM that survives a
/// reset or in storage, and keeps it as secret as the key.
///
/// Without the key everything is obeyed unsigned. With an old stamp, later frames can be replayed; if the senders are lost,
/// so can those of the last minute ([`SigningState::new`] begins without).
#[derive(Clone, Debug, Default)]
pub struct SigningState {
    key: Option<Key>,
    /// The last stamp that was used or accepted.
    stamp: Stamp,
    streams: Vec<Stream, STREAMS>,
}

impl SigningState {
    /// No key: nothing is signed or has to be.
    pub const NONE: Self = Self::new(None, Stamp::ZERO);

    /// The state at a start, from RAM that survived a reset and from storage: the newer stamp, and the key in RAM, which is as new. RAM
    /// without a key does not clear a stored one, which may not have been read at the last start.
    #[cfg(feature = "signing")]
    pub fn at_start(retained: Option<Self>, stored: Option<Self>) -> Self {
        match (retained, stored) {
            (Some(retained), Some(stored)) if retained.key.is_none() || retained.key == stored.key => {
                let streams = if retained.key == stored.key { retained.streams } else { Vec::new() };
                Self { key: stored.key, stamp: retained.stamp.max(stored.stamp), streams }
            }
            (Some(state), _) | (None, Some(state)) => state,
            (None, None) => Self::NONE,
        }
    }

    /// Its senders, two words each: system, component, link, a byte, and how far the sender's last stamp is behind. The byte has the
    /// highest bits of that, the port, and a bit that is always set. A sender that is 7 days behind is left out.
    #[cfg(feature = "signing")]
    pub(crate) fn senders(&self) -> impl Iterator<Item = [u32; 2]> {
        self.streams.iter().filter_map(|stream| {
            let behind = self.stamp.0.saturating_sub(stream.stamp.0);
            let highest = u8::try_from(behind >> 32).ok().filter(|highest| *highest <= BEHIND_HIGHEST)?;
            let port = u8::try_from(stream.port).unwrap_or(u8::MAX) & PORT;
            let last = IS_SENDER | port << PORT_AT | highest;
            let Address { system, component } = stream.from;
            Some([u32::from_le_bytes([system, component, stream.link, last]), behind as u32])
        })
    }

    /// The same with another sender, if the words are one and there is space for it.
    #[cfg(feature = "signing")]
    pub(crate) fn with_sender(mut self, [sender, behind]: [u32; 2]) -> Self {
        let [system, component, link, last] = sender.to_le_bytes();
        if last & IS_SENDER != 0 {
            let from = Address { system, component };
            let behind = u64::from(last & BEHIND_HIGHEST) << 32 | u64::from(behind);
            let stamp = Stamp(self.stamp.0.saturating_sub(behind));
            let port = usize::from(last >> PORT_AT & PORT);
            let _ = self.streams.push(Stream { from, link, stamp, port });
        }
        self
    }

    /// A key, and the last time stamp that was used.
    pub const fn new(key: Option<Key>, stamp: Stamp) -> Self {
        Self { key, stamp, streams: Vec::new() }
    }

    /// The key, if there is one.
    pub const fn key(&self) -> Option<&Key> {
        self.key.as_ref()
    }

    /// The last time stamp.
    pub const fn stamp(&self) -> Stamp {
        self.stamp
    }
}

/// Signs what is sent and judges what is received.
#[derive(Debug)]
pub(crate) struct Signing {
    state: SigningState,
    /// A stamp, and the time at which it was valid: the clock continues from there.
    clock: (Stamp, Instant),
    /// The stamp at the start: frames that act need a later one. The retained senders may be 0.1 s old, or lost.
    #[cfg(feature = "signing")]
    floor: Stamp,
}

impl Signing {
    pub fn new(now: Instant, state: SigningState) -> Self {
        let clock = (state.stamp, now);
        Self {
            #[cfg(feature = "signing")]
            floor: state.stamp,
            state,
            clock,
        }
    }

    /// Whether there was a state at the start: one without a key has a stamp as well.
    #[cfg(feature = "signing")]
    pub fn was_retained(&self) -> bool {
        self.floor > Stamp::ZERO
    }

    /// Whether a frame that acts is too new to have been obeyed before the start.
    #[cfg(feature = "signing")]
    pub fn is_new(&self, stamp: Stamp) -> bool {
        stamp > self.floor
    }

    pub const fn key(&self) -> Option<&Key> {
        // Without the feature, an image contains nothing of signing.
        if cfg!(feature = "signing") { self.state.key() } else { None }
    }

    /// What is to be stored.
    pub fn state(&self, now: Instant) -> SigningState {
        SigningState { stamp: self.stamp(now), ..self.state.clone() }
    }

    /// The last stamp that was used or accepted.
    #[cfg(feature = "signing")]
    pub const fn last(&self) -> Stamp {
        self.state.stamp
    }

    /// Bytes that signing adds to a frame.
    pub const fn overhead(&self) -> usize {
        if self.key().is_some() { SIGNATURE } else { 0 }
    }

    /// Its clock: no earlier than any stamp used or accepted.
    pub fn stamp(&self, now: Instant) -> Stamp {
        let (stamp, at) = self.clock;
        stamp.after(Stamp::units(now.saturating_duration_since(at))).max(self.state.stamp)
    }

    /// The seal of the next frame. No two are alike.
    pub fn seal(&mut self, now: Instant, link: u8) -> Option<Seal<'_>> {
        self.key()?;
        let stamp = self.stamp(now).max(self.state.stamp.after(1));
        let key = self.state.key.as_ref()?;
        self.state.stamp = stamp;
        Some(Seal { key, link, stamp })
    }

    /// Judges a frame, and remembers it if it is accepted. Only with a key.
    pub fn judge(
        &mut self,
        now: Instant,
        port: usize,
        from: Address,
        signature: Signature,
    ) -> Result<(), Ignored> {
        let (link, stamp) = match signature {
            Signature::Missing => return Err(Ignored::Unsigned),
            Signature::Unverified | Signature::Wrong => return Err(Ignored::Wrong),
            Signature::Right { link, stamp } => (link, stamp),
        };
        let ours = self.stamp(now);
        let oldest = Stamp(ours.0.saturating_sub(BEHIND));
        let accepted = Stream { from, link, stamp, port };
        let known = self.state.streams.iter_mut().find(|known| known.from == from && known.link == link);
        match known {
            Some(known) if stamp > known.stamp => *known = accepted,
            Some(known) if known.port != port && stamp.after(COPY) >= known.stamp => {
                return Err(Ignored::Duplicate);
            }
            Some(_) => return Err(Ignored::Replayed),
            None if stamp < oldest => return Err(Ignored::Behind),
            None => self.remember(oldest, accepted)?,
        }
        if stamp > ours {
            self.state.stamp = stamp;
            self.clock = (stamp, now);
        }
        Ok(())
    }

    fn remember(&mut self, oldest: Stamp, stream: Stream) -> Result<(), Ignored> {
        let streams = &mut self.state.streams;
        let Err(stream) = streams.push(stream) else { return Ok(()) };
        // A sender older than a new one may be can be forgotten: nothing that it has sent is accepted again.
        let place = streams.iter_mut().find(|known| known.stamp < oldest).ok_or(Ignored::TooMany)?;
        *place = stream;
        Ok(())
    }

    /// Sets the key, or clears it. The stamp never goes back unless another key replaces the present one: so a clock that was
    /// far ahead can be corrected.
    #[cfg(feature = "signing")]
    pub fn set_key(&mut self, now: Instant, key: Option<Key>, stamp: Stamp) {
        let replaced = matches!((self.state.key, key), (Some(old), Some(new)) if old != new);
        let stamp = if replaced { stamp } else { self.stamp(now).max(stamp) };
        if self.state.key != key {
            self.state = SigningState::new(key, stamp);
            self.floor = stamp;
        }
        self.state.stamp = stamp;
        self.clock = (stamp, now);
    }
}

/// Data to sign a frame with.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Seal<'a> {
    pub key: &'a Key,
    pub link: u8,
    pub stamp: Stamp,
}

impl Seal<'_> {
    /// Signs a frame whose flags mark it as signed.
    pub fn sign(self, frame: &mut Vec<u8, MAX_FRAME>) {
        let [s0, s1, s2, s3, s4, s5, ..] = self.stamp.0.to_le_bytes();
        let tail = [self.link, s0, s1, s2, s3, s4, s5];
        let hash = self.key.sign(&[frame, &tail]);
        // The largest frame has space for them.
        let _ = frame.extend_from_slice(&tail);
        let _ = frame.extend_from_slice(&hash);
    }
}

#[cfg(all(test, feature = "signing"))]
mod tests {
    use super::*;

    const FROM: Address = Address { system: 255, component: 190 };
    const SECOND: u64 = 100_000;
    const OURS: u64 = 1_000 * SECOND;

    fn at(seconds: u64) -> Instant {
        Instant::from_secs(100 + seconds)
    }

    fn signing() -> Signing {
        Signing::new(at(0), SigningState::new(Key::new([7; 32]), Stamp(OURS)))
    }

    fn right(link: u8, stamp: u64) -> Signature {
        Signature::Right { link, stamp: Stamp(stamp) }
    }

    #[test]
    fn a_key_is_not_printed_and_zeros_are_not_a_key() {
        assert_eq!(Key::new([0; 32]), None);
        let key = Key::new([0xA5; 32]).unwrap();
        let text = std::format!("{:?}", Signing::new(at(0), SigningState::new(Some(key), Stamp(1))));
        assert!(text.contains("key: Some(Key)") && !text.contains("165"), "{text}");
    }

    #[test]
    fn a_replay_is_rejected_and_a_newer_frame_is_not() {
        let mut signing = signing();
        assert_eq!(signing.judge(at(0), 1, FROM, right(0, OURS)), Ok(()));
        assert_eq!(signing.judge(at(0), 1, FROM, right(0, OURS)), Err(Ignored::Replayed));
        assert_eq!(signing.judge(at(0), 1, FROM, right(0, OURS - 1)), Err(Ignored::Replayed));
        assert_eq!(signing.judge(at(0), 1, FROM, right(0, OURS + 1)), Ok(()));
        assert_eq!(signing.judge(at(0), 1, FROM, Signature::Wrong), Err(Ignored::Wrong));
        assert_eq!(signing.judge(at(0), 1, FROM, Signature::Missing), Err(Ignored::Unsigned));
        // Another link, and another component, count separately.
        assert_eq!(signing.judge(at(0), 1, FROM, right(1, OURS)), Ok(()));
        assert_eq!(signing.judge(at(0), 1, Address { component: 1, ..FROM }, right(0, OURS)), Ok(()));
    }

    #[test]
    fn a_copy_by_another_port_is_a_duplicate_for_ten_seconds() {
        let mut signing = signing();
        assert_eq!(signing.judge(at(0), 1, FROM, right(0, OURS)), Ok(()));
        assert_eq!(signing.judge(at(0), 2, FROM, right(0, OURS)), Err(Ignored::Duplicate));
        assert_eq!(signing.judge(at(0), 1, FROM, right(0, OURS + 10 * SECOND)), Ok(()));
        assert_eq!(signing.judge(at(0), 2, FROM, right(0, OURS)), Err(Ignored::Duplicate));
        assert_eq!(signing.judge(at(0), 2, FROM, right(0, OURS - 1)), Err(Ignored::Replayed));
        // The first one is used, on either port.
        assert_eq!(signing.judge(at(0), 2, FROM, right(0, OURS + 11 * SECOND)), Ok(()));
        assert_eq!(signing.judge(at(0), 1, FROM, right(0, OURS + 11 * SECOND)), Err(Ignored::Duplicate));
    }

    #[test]
    fn a_new_sender_may_be_one_minute_behind_and_not_more() {
        let behind = 60 * SECOND;
        assert_eq!(signing().judge(at(0), 1, FROM, right(0, OURS - behind)), Ok(()));
        assert_eq!(signing().judge(at(0), 1, FROM, right(0, OURS - behind - 1)), Err(Ignored::Behind));
        // Our clock continues.
        assert_eq!(signing().judge(at(10), 1, FROM, right(0, OURS - 50 * SECOND)), Ok(()));
        assert_eq!(signing().judge(at(10), 1, FROM, right(0, OURS - 50 * SECOND - 1)), Err(Ignored::Behind));
        // It follows a sender that is ahead, and never goes back.
        let mut signing = signing();
        assert_eq!(signing.judge(at(0), 1, FROM, right(0, 2 * OURS)), Ok(()));
        assert_eq!(signing.judge(at(0), 1, FROM, right(1, OURS)), Err(Ignored::Behind));
        assert_eq!(signing.judge(at(0), 1, FROM, right(2, 2 * OURS - behind)), Ok(()));
        assert_eq!(signing.state(at(3)).stamp().get(), 2 * OURS + 3 * SECOND);
    }

    #[test]
    fn a_seventeenth_sender_waits_until_one_is_a_minute_old() {
        let mut signing = signing();
        for link in 0..16 {
            assert_eq!(signing.judge(at(0), 1, FROM, right(link, OURS)), Ok(()));
        }
        assert_eq!(signing.judge(at(0), 1, FROM, right(16, OURS + 1)), Err(Ignored::TooMany));
        // Known senders continue, all but the first.
        let later = OURS + 61 * SECOND;
        for link in 1..16 {
            assert_eq!(signing.judge(at(61), 1, FROM, right(link, later)), Ok(()));
        }
        assert_eq!(signing.judge(at(61), 1, FROM, right(16, later)), Ok(()));
        // What the first one had sent is too old for a new sender.
        assert_eq!(signing.judge(at(61), 1, FROM, right(0, OURS)), Err(Ignored::Behind));
    }

    #[test]
    fn stamps_of_what_is_sent_rise_with_the_clock_and_follow_what_is_accepted() {
        let mut signing = signing();
        let mut stamps = std::vec::Vec::new();
        for (ms, count) in [(0, 3), (1, 1), (1000, 2)] {
            let now = at(0) + Duration::from_millis(ms);
            (0..count).for_each(|_| stamps.push(signing.seal(now, 0).unwrap().stamp.get() - OURS));
        }
        assert_eq!(stamps, [1, 2, 3, 100, SECOND, SECOND + 1]);
        assert_eq!(signing.judge(at(1), 1, FROM, right(0, 2 * OURS)), Ok(()));
        assert_eq!(signing.seal(at(1), 0).unwrap().stamp.get(), 2 * OURS + 1);
        // A restart continues from what was retained, and recognises the stamps that it has seen.
        let mut again = Signing::new(at(0), signing.state(at(1)));
        assert_eq!(again.seal(at(0), 0).unwrap().stamp.get(), 2 * OURS + 2);
        assert_eq!(again.judge(at(0), 1, FROM, right(0, 2 * OURS)), Err(Ignored::Replayed));
        // The last stamp does not overflow.
        assert_eq!(signing.judge(at(1), 1, FROM, right(0, Stamp::MAX.get())), Ok(()));
        assert_eq!(signing.seal(at(9), 0).unwrap().stamp, Stamp::MAX);
    }

    #[test]
    fn another_key_begins_with_its_own_stamp_and_the_same_one_does_not_go_back() {
        let (mut signing, key, other) = (signing(), Key::new([7; 32]), Key::new([8; 32]));
        assert_eq!(signing.judge(at(0), 1, FROM, right(0, OURS)), Ok(()));
        signing.set_key(at(1), key, Stamp(5));
        assert_eq!(signing.judge(at(1), 1, FROM, right(0, OURS)), Err(Ignored::Replayed));
        assert_eq!(signing.state(at(1)).stamp().get(), OURS + SECOND);
        signing.set_key(at(1), None, Stamp(0));
        assert!(signing.seal(at(1), 0).is_none() && signing.overhead() == 0);
        signing.set_key(at(1), key, Stamp(5));
        assert!(signing.state(at(1)).stamp().get() > OURS);
        signing.set_key(at(1), other, Stamp(5));
        assert_eq!(signing.seal(at(2), 0).unwrap().stamp.get(), 5 + SECOND);
    }
}
