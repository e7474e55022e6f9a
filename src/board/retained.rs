//! Single words of the board code that survive a reset, in the region of RAM (`memory/retained.x`) that start-up and
//! bootloaders do not touch. Its content is arbitrary after a loss of power, so only words with their own check are used.

use core::sync::atomic::{AtomicU32, Ordering};

/// A word that survives a reset, valid only with its inverse. Place a static of this type in a section `.retained.*`.
///
/// An H7 writes this RAM in units of 64 bits and buffers the last unit until another is written; a reset loses the buffer
/// (AN5342). So each write is followed by one to the next 64 bits.
#[repr(C, align(8))]
pub struct RetainedWord {
    word: AtomicU32,
    inverse: AtomicU32,
    flush: [AtomicU32; 2],
}

impl RetainedWord {
    /// For a static; start-up does not initialise it.
    pub const fn new() -> Self {
        Self { word: AtomicU32::new(0), inverse: AtomicU32::new(0), flush: [const { AtomicU32::new(0) }; 2] }
    }

    /// The word that was written last, if it is intact.
    pub fn get(&self) -> Option<u32> {
        let word = self.word.load(Ordering::Relaxed);
        (self.inverse.load(Ordering::Relaxed) == !word).then_some(word)
    }

    /// Writes a word, so that a reset right after this finds it. A reset during this leaves neither the old word nor the new:
    /// what has to survive that needs two words, written in turn.
    pub fn set(&self, word: u32) {
        // Three stores in this order, each completed before the next: a reset in between leaves no valid pair.
        self.word.store(word, Ordering::SeqCst);
        self.inverse.store(!word, Ordering::SeqCst);
        self.flush[0].store(word, Ordering::SeqCst);
    }
}
