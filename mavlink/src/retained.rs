//! Key, last time stamp and senders in RAM that survives a reset, but not a loss of power.
//!
//! A reset may interrupt a write: there are two copies, each with a checksum and a number, written alternately. The random contents after
//! a power-up have no correct checksum.

use crate::signing::{Key, STREAMS, SigningState, Stamp};
use core::sync::atomic::{AtomicU32, Ordering};
use jetlink::checksum::Checksum;

/// Number, key, stamp, senders, checksum.
const WORDS: usize = 1 + KEY + 2 + SENDER * STREAMS + 1;
const KEY: usize = 8;
/// Of a sender ([`SigningState::senders`]).
const SENDER: usize = 2;

/// Prefix of the data under the checksum: it identifies this layout.
const LAYOUT: &[u8] = b"jetlink key 2";

/// The memory. Any content is valid, so start-up need not initialise it. Each copy is written whole, with further words after it, as
/// an STM32H7 loses the last 64 bits written (AN5342).
#[derive(Debug)]
#[repr(C, align(8))]
pub struct KeyMemory {
    copies: [[AtomicU32; WORDS]; 2],
    flush: [AtomicU32; 2],
}

impl Default for KeyMemory {
    fn default() -> Self {
        Self::new()
    }
}

impl KeyMemory {
    /// Empty.
    pub const fn new() -> Self {
        Self {
            copies: [const { [const { AtomicU32::new(0) }; WORDS] }; 2],
            flush: [const { AtomicU32::new(0) }; 2],
        }
    }

    /// The intact copy that was written last: its number, its place and its contents.
    fn newest(&self) -> Option<(u32, usize, SigningState)> {
        let mut newest: Option<(u32, usize, SigningState)> = None;
        for (place, copy) in self.copies.iter().enumerate() {
            let Some((number, state)) = read(copy.each_ref().map(|word| word.load(Ordering::Relaxed))) else {
                continue;
            };
            // Numbers wrap.
            let is_newer = |other: u32| number.wrapping_sub(other).cast_signed() > 0;
            if newest.as_ref().is_none_or(|(other, ..)| is_newer(*other)) {
                newest = Some((number, place, state));
            }
        }
        newest
    }

    /// The state stored last; `None`: nothing was stored since power-up.
    pub fn load(&self) -> Option<SigningState> {
        self.newest().map(|(.., state)| state)
    }

    /// Stores key and stamp if they differ from the stored ones. Do not call it from two priorities at once.
    pub fn store(&self, state: &SigningState) {
        let (number, place) = match self.newest() {
            Some((.., stored)) if stored.key() == state.key() && stored.stamp() == state.stamp() => return,
            Some((number, place, _)) => (number.wrapping_add(1), 1 - place),
            None => (0, 0),
        };
        let Some(copy) = self.copies.get(place) else { return };
        for (to, word) in copy.iter().zip(words(number, state)).chain(self.flush.iter().zip([number; 2])) {
            to.store(word, Ordering::SeqCst);
        }
    }
}

fn words(number: u32, state: &SigningState) -> [u32; WORDS] {
    let key = state.key().map_or([0; 32], Key::bytes);
    let (stamp, (parts, _)) = (state.stamp().get(), key.as_chunks::<4>());
    let mut words = [number; WORDS];
    let content = parts
        .iter()
        .map(|part| u32::from_le_bytes(*part))
        .chain([stamp as u32, (stamp >> 32) as u32])
        .chain(state.senders().flatten())
        .chain(core::iter::repeat(0));
    words.iter_mut().skip(1).zip(content).for_each(|(word, part)| *word = part);
    if let Some((last, content)) = words.split_last_mut() {
        *last = checksum(content);
    }
    words
}

fn read(words: [u32; WORDS]) -> Option<(u32, SigningState)> {
    let (&sum, content) = words.split_last()?;
    if checksum(content) != sum {
        return None;
    }
    let (&number, content) = content.split_first()?;
    let (key, content) = content.split_at_checked(KEY)?;
    let (stamp, senders) = content.split_at_checked(2)?;
    let mut bytes = [0; 4 * KEY];
    bytes.iter_mut().zip(key.iter().flat_map(|word| word.to_le_bytes())).for_each(|(to, byte)| *to = byte);
    let [low, high] = stamp.try_into().ok()?;
    let stamp = Stamp::new(u64::from(low) | u64::from(high) << 32)?;
    let (senders, _) = senders.as_chunks();
    let state = SigningState::new(Key::new(bytes), stamp);
    Some((number, senders.iter().fold(state, |state, sender| state.with_sender(*sender))))
}

fn checksum(words: &[u32]) -> u32 {
    Checksum::new().bytes(LAYOUT).words(words).value()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ids::Address;
    use crate::signing::{Ignored, Signature, Signing};
    use embassy_time::Instant;

    fn state(key: u8, stamp: u64) -> SigningState {
        SigningState::new(Key::new([key; 32]), Stamp::new(stamp).unwrap())
    }

    fn content(memory: &KeyMemory) -> Option<(Option<Key>, u64)> {
        memory.load().map(|state| (state.key().copied(), state.stamp().get()))
    }

    #[test]
    fn what_was_stored_last_is_loaded_and_a_cleared_key_is_none() {
        let memory = KeyMemory::new();
        assert_eq!(content(&memory), None);
        for round in 0..5 {
            for (key, stamp) in [(7, 5), (7, (1 << 47) + round), (8, 3), (0, 4)] {
                memory.store(&state(key, stamp));
                assert_eq!(content(&memory), Some((Key::new([key; 32]), stamp)));
            }
        }
        // Also where the numbers wrap.
        for (place, number) in [(0, u32::MAX - 1), (1, u32::MAX)] {
            for (to, word) in memory.copies[place].iter().zip(words(number, &state(9, 1))) {
                to.store(word, Ordering::Relaxed);
            }
        }
        memory.store(&state(9, 2));
        memory.store(&state(9, 3));
        assert_eq!(content(&memory), Some((Key::new([9; 32]), 3)));
    }

    /// A sender that is 5 days behind is known, one that is 8 days behind is not.
    #[test]
    fn senders_come_back_with_their_stamps() {
        let day = 24 * 3600 * 100_000;
        let stamp = Stamp::new(100 * day).unwrap();
        let mut signing =
            Signing::new(Instant::from_secs(1), SigningState::new(Key::new([7; 32]), Stamp::ZERO));
        let from = |component| Address { system: 3, component };
        let judge = |signing: &mut Signing, component, units, port| {
            let signature = Signature::Right { link: 9, stamp: Stamp::new(units).unwrap() };
            signing.judge(Instant::from_secs(1), port, from(component), signature)
        };
        assert_eq!(judge(&mut signing, 1, 92 * day, 0), Ok(()));
        // The first one that is ahead advances our clock; the second was there before.
        let state = signing.state(Instant::from_secs(1));
        let state = state.with_sender([u32::from_le_bytes([3, 2, 9, 0x80 | 1 << 4]), 0]);
        let mut signing = Signing::new(Instant::from_secs(1), state);
        assert_eq!(judge(&mut signing, 2, 95 * day, 1), Ok(()));
        assert_eq!(judge(&mut signing, 3, stamp.get(), 2), Ok(()));
        let memory = KeyMemory::new();
        memory.store(&signing.state(Instant::from_secs(1)));
        let mut again = Signing::new(Instant::from_secs(1), memory.load().unwrap());
        assert_eq!(judge(&mut again, 1, 92 * day + 1, 0), Err(Ignored::Behind));
        assert_eq!(judge(&mut again, 2, 95 * day, 1), Err(Ignored::Replayed));
        assert_eq!(judge(&mut again, 2, 95 * day + 1, 1), Ok(()));
        assert_eq!(judge(&mut again, 3, stamp.get(), 2), Err(Ignored::Replayed));
        assert_eq!(judge(&mut again, 3, stamp.get() + 1, 2), Ok(()));
    }

    #[test]
    fn reset_in_the_middle_of_a_write_leaves_the_earlier_copy() {
        for cut in 0..=WORDS {
            let memory = KeyMemory::new();
            memory.store(&state(1, 100));
            memory.store(&state(1, 200));
            let (number, place, _) = memory.newest().unwrap();
            let next = words(number + 1, &state(2, 300));
            for (to, word) in memory.copies[1 - place].iter().zip(next).take(cut) {
                to.store(word, Ordering::Relaxed);
            }
            let expected = if cut == WORDS { (Key::new([2; 32]), 300) } else { (Key::new([1; 32]), 200) };
            assert_eq!(content(&memory), Some(expected), "{cut}");
        }
    }

    #[test]
    fn whatever_a_power_up_leaves_is_no_key() {
        fastrand::seed(1);
        for _ in 0..10_000 {
            let memory = KeyMemory::new();
            let fill = fastrand::u32(..);
            for word in memory.copies.iter().flatten() {
                word.store(if fastrand::bool() { fill } else { fastrand::u32(..) }, Ordering::Relaxed);
            }
            assert_eq!(content(&memory), None);
        }
        for fill in [0, u32::MAX, 0xAAAA_AAAA] {
            let memory = KeyMemory::new();
            memory.copies.iter().flatten().for_each(|word| word.store(fill, Ordering::Relaxed));
            assert_eq!(content(&memory), None, "{fill:x}");
        }
    }
}
