//! Words in RAM that survives a reset: two copies with a checksum, each change written to the first one and then to the second.
//! A reset during a write leaves one of them intact, and damage to one of them brings back nothing older.

use crate::checksum::Checksum;
use core::sync::atomic::{AtomicU32, Ordering};

/// `N` words. Place them where start-up does not clear them: any content is valid, and the checksum rejects what a power-up leaves.
/// Change `LAYOUT` with the meaning of the words, so that those of an older firmware are discarded.
///
/// `N` is odd, so that the copies share no 64 bits, the unit of an STM32H7's ECC.
#[derive(Debug)]
#[repr(C, align(8))]
pub struct Copies<const N: usize, const LAYOUT: u32> {
    copies: [Words<N>; 2],
}

#[derive(Debug)]
#[repr(C)]
struct Words<const N: usize> {
    words: [AtomicU32; N],
    checksum: AtomicU32,
}

impl<const N: usize, const LAYOUT: u32> Default for Copies<N, LAYOUT> {
    fn default() -> Self {
        Self::new()
    }
}

impl<const N: usize, const LAYOUT: u32> Copies<N, LAYOUT> {
    /// Empty.
    pub const fn new() -> Self {
        const { assert!(N % 2 == 1, "the copies would share a unit of ECC") };
        Self { copies: [const { Words::new() }; 2] }
    }

    /// The words that were stored last; `None` if both copies are damaged, or were never written.
    pub fn load(&self) -> Option<[u32; N]> {
        self.intact().map(|(_, words)| words)
    }

    /// Stores words. After a reset, call [`Copies::repair`] before the first time. Do not call it from two priorities at once.
    pub fn store(&self, words: &[u32; N]) {
        let checksum = checksum(LAYOUT, words);
        for copy in &self.copies {
            copy.write(words, checksum);
        }
        self.flush();
    }

    /// Makes the copies equal. A reset may have interrupted the write of one of them, and the next one may interrupt that of the
    /// other.
    pub fn repair(&self) {
        if let Some((place, words)) = self.intact()
            && let Some(other) = self.copies.get(1 - place)
        {
            other.write(&words, checksum(LAYOUT, &words));
            self.flush();
        }
    }

    /// Clears both copies: nothing is loaded.
    pub fn clear(&self) {
        for copy in &self.copies {
            copy.write(&[0; N], !checksum(LAYOUT, &[0; N]));
        }
        self.flush();
    }

    /// The first intact copy. It is written first, so the second one is never newer.
    fn intact(&self) -> Option<(usize, [u32; N])> {
        self.copies.iter().enumerate().find_map(|(place, copy)| {
            let words = copy.words.each_ref().map(|word| word.load(Ordering::Acquire));
            (copy.checksum.load(Ordering::Acquire) == checksum(LAYOUT, &words)).then_some((place, words))
        })
    }

    /// An STM32H7 buffers the last 64 bits that were written until others are (AN5342), and a reset loses them. So words of
    /// both copies are written again.
    fn flush(&self) {
        for word in self.copies.iter().filter_map(|copy| copy.words.first()) {
            word.store(word.load(Ordering::Acquire), Ordering::Release);
        }
    }
}

impl<const N: usize> Words<N> {
    const fn new() -> Self {
        Self { words: [const { AtomicU32::new(0) }; N], checksum: AtomicU32::new(0) }
    }

    fn write(&self, words: &[u32; N], checksum: u32) {
        let places = self.words.iter().chain([&self.checksum]);
        for (place, word) in places.zip(words.iter().chain([&checksum])) {
            // Release keeps the order of the writes, for a reset between two of them.
            place.store(*word, Ordering::Release);
        }
    }
}

fn checksum(layout: u32, words: &[u32]) -> u32 {
    Checksum::new().words(&[layout]).words(words).value()
}

#[cfg(test)]
mod tests {
    use super::*;

    const N: usize = 7;
    type Retained = Copies<N, 0x1234_5678>;

    fn number(n: u32) -> [u32; N] {
        core::array::from_fn(|place| n.wrapping_mul(0x9E37_79B9) >> place)
    }

    fn places(memory: &Retained) -> impl Iterator<Item = &AtomicU32> {
        memory.copies.iter().flat_map(|copy| copy.words.iter().chain([&copy.checksum]))
    }

    const PLACES: usize = 2 * (N + 1);

    fn with(words: &[u32; N]) -> Retained {
        let memory = Retained::new();
        memory.store(words);
        memory
    }

    /// A store that a reset ends after so many words.
    fn store_cut(memory: &Retained, words: &[u32; N], count: usize) {
        let whole = with(words);
        for (to, from) in places(memory).zip(places(&whole)).take(count) {
            to.store(from.load(Ordering::Relaxed), Ordering::Relaxed);
        }
    }

    fn flip(memory: &Retained, bit: usize) {
        if let Some(word) = places(memory).nth(bit / 32) {
            word.fetch_xor(1 << (bit % 32), Ordering::Relaxed);
        }
    }

    #[test]
    fn what_was_stored_last_is_loaded_until_it_is_cleared() {
        let memory = Retained::new();
        assert_eq!(memory.load(), None, "empty");
        for n in 0..100 {
            memory.store(&number(n));
            assert_eq!(memory.load(), Some(number(n)));
            memory.repair();
            assert_eq!(memory.load(), Some(number(n)));
        }
        memory.clear();
        assert_eq!(memory.load(), None, "cleared");
        memory.repair();
        assert_eq!(memory.load(), None, "cleared and repaired");
    }

    #[test]
    fn no_content_of_one_value_is_taken_for_words() {
        for fill in [0, u32::MAX, 0xAAAA_AAAA, 0x5555_5555] {
            let memory = Retained::new();
            places(&memory).for_each(|word| word.store(fill, Ordering::Relaxed));
            assert_eq!(memory.load(), None, "{fill:x}");
        }
    }

    #[test]
    fn words_of_another_layout_are_discarded() {
        let other = Copies::<N, 0x1234_5679>::new();
        other.store(&number(1));
        let memory = Retained::new();
        let from = other.copies.iter().flat_map(|copy| copy.words.iter().chain([&copy.checksum]));
        places(&memory)
            .zip(from)
            .for_each(|(to, from)| to.store(from.load(Ordering::Relaxed), Ordering::Relaxed));
        assert_eq!((other.load(), memory.load()), (Some(number(1)), None));
    }

    #[test]
    fn a_write_that_was_cut_short_leaves_the_words_before_or_the_new_ones() {
        for count in 0..=PLACES {
            let memory = with(&number(1));
            memory.store(&number(2));
            store_cut(&memory, &number(3), count);
            assert_eq!(memory.load(), Some(number(if count <= N { 2 } else { 3 })), "{count} words");
        }
    }

    #[test]
    fn two_writes_that_were_cut_short_leave_words_if_they_were_repaired_in_between() {
        let mut lost = 0;
        for (first, second) in (0..=PLACES).flat_map(|first| (0..=PLACES).map(move |second| (first, second)))
        {
            let after = |repairs: bool| {
                let memory = with(&number(1));
                store_cut(&memory, &number(2), first);
                if repairs {
                    memory.repair();
                }
                store_cut(&memory, &number(3), second);
                memory.load()
            };
            let expected = match (first <= N, second <= N) {
                (_, false) => 3,
                (false, true) => 2,
                (true, true) => 1,
            };
            assert_eq!(after(true), Some(number(expected)), "{first}, {second}");
            lost += usize::from(after(false).is_none());
        }
        assert!(lost > 0, "beside a start without a repair");
    }

    #[test]
    fn damage_to_one_copy_brings_back_nothing_older_and_damage_to_both_nothing() {
        for bit in 0..PLACES / 2 * 32 {
            for copy in [0, PLACES / 2 * 32] {
                let memory = with(&number(1));
                memory.store(&number(2));
                flip(&memory, bit + copy);
                assert_eq!(memory.load(), Some(number(2)), "bit {bit}");
                memory.repair();
                flip(&memory, bit + PLACES / 2 * 32 - copy);
                assert_eq!(memory.load(), Some(number(2)), "bit {bit}: of the other one, after a repair");
            }
            let memory = with(&number(2));
            flip(&memory, bit);
            flip(&memory, bit + PLACES / 2 * 32);
            assert_eq!(memory.load(), None, "bit {bit} of both");
            memory.repair();
            assert_eq!(memory.load(), None, "bit {bit} of both, repaired");
        }
    }
}
