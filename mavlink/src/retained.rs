//! Key, last time stamp and senders in RAM that survives a reset, but not a loss of power ([`Copies`]).

use crate::signing::{Key, STREAMS, SigningState, Stamp};
use jetlink::copies::Copies;

/// Key, stamp, senders; the rest is free.
const WORDS: usize = (KEY + 2 + SENDER * STREAMS) | 1;
const KEY: usize = 8;
/// Of a sender ([`SigningState::senders`]).
const SENDER: usize = 2;
/// Change it with the layout.
const LAYOUT: u32 = 0x4B45_5903;

/// The memory. Any content is valid, so start-up need not initialise it.
#[derive(Debug, Default)]
#[repr(C)]
pub struct KeyMemory {
    words: Copies<WORDS, LAYOUT>,
}

impl KeyMemory {
    /// Empty.
    pub const fn new() -> Self {
        Self { words: Copies::new() }
    }

    /// The state stored last; `None`: nothing was stored since power-up.
    pub fn load(&self) -> Option<SigningState> {
        read(&self.words.load()?)
    }

    /// Stores key and stamp if they differ from the stored ones. Do not call it from two priorities at once.
    pub fn store(&self, state: &SigningState) {
        if self.load().is_some_and(|stored| stored.key() == state.key() && stored.stamp() == state.stamp()) {
            return;
        }
        // It may be the first time after a reset.
        self.words.repair();
        self.words.store(&words(state));
    }
}

fn words(state: &SigningState) -> [u32; WORDS] {
    let key = state.key().map_or([0; 32], Key::bytes);
    let (stamp, (parts, _)) = (state.stamp().get(), key.as_chunks::<4>());
    let mut words = [0; WORDS];
    let content = parts
        .iter()
        .map(|part| u32::from_le_bytes(*part))
        .chain([stamp as u32, (stamp >> 32) as u32])
        .chain(state.senders().flatten());
    words.iter_mut().zip(content).for_each(|(word, part)| *word = part);
    words
}

fn read(words: &[u32]) -> Option<SigningState> {
    let (key, content) = words.split_at_checked(KEY)?;
    let (stamp, senders) = content.split_at_checked(2)?;
    let mut bytes = [0; 4 * KEY];
    bytes.iter_mut().zip(key.iter().flat_map(|word| word.to_le_bytes())).for_each(|(to, byte)| *to = byte);
    let [low, high] = stamp.try_into().ok()?;
    let stamp = Stamp::new(u64::from(low) | u64::from(high) << 32)?;
    let (senders, _) = senders.as_chunks();
    let state = SigningState::new(Key::new(bytes), stamp);
    Some(senders.iter().fold(state, |state, sender| state.with_sender(*sender)))
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
    fn what_was_stored_last_is_loaded_also_a_cleared_key() {
        let memory = KeyMemory::new();
        assert_eq!(content(&memory), None);
        for round in 0..5 {
            for (key, stamp) in [(7, 5), (7, (1 << 47) + round), (8, 3), (0, 4)] {
                memory.store(&state(key, stamp));
                assert_eq!(content(&memory), Some((Key::new([key; 32]), stamp)));
            }
        }
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
}
