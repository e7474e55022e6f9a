//! Single words of the board's own that survive a reset, in the region of RAM (`memory/retained.x`) that start-up and
//! bootloaders leave alone. After a loss of power it holds anything, so only words that carry their own check are used.

use core::sync::atomic::{AtomicU32, Ordering};

/// A word that survives a reset, valid only beside its inverse. A static of this type belongs into a section `.retained.*`.
///
/// An H7 writes 64 bits of this RAM at a time, and holds the last of them in a buffer until others are written: a reset
/// loses it (AN5342). So each write is followed by one to the next 64 bits.
#[repr(C, align(8))]
pub struct RetainedWord {
    word: AtomicU32,
    inverse: AtomicU32,
    flush: [AtomicU32; 2],
}

impl RetainedWord {
    /// For a static; nothing of it is written at the start.
    pub const fn new() -> Self {
        Self { word: AtomicU32::new(0), inverse: AtomicU32::new(0), flush: [const { AtomicU32::new(0) }; 2] }
    }

    /// What was written last, if it is whole.
    pub fn get(&self) -> Option<u32> {
        let word = self.word.load(Ordering::Relaxed);
        (self.inverse.load(Ordering::Relaxed) == !word).then_some(word)
    }

    /// Writes a word, so that a reset right after this finds it.
    pub fn set(&self, word: u32) {
        // Three stores in this order, and none before it is complete: a reset in between leaves no pair.
        self.word.store(word, Ordering::SeqCst);
        self.inverse.store(!word, Ordering::SeqCst);
        self.flush[0].store(word, Ordering::SeqCst);
    }
}
