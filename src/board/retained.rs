//! The RAM that survives a reset: a region of its own (`memory/retained.x`), left alone by start-up and by bootloaders.
//!
//! It holds the record of each port's engine, and single words of the board's own. After a loss of power it holds
//! anything, so nothing is believed that does not say so itself.

use super::PORTS;
#[cfg(feature = "stm32")]
use core::sync::atomic::{AtomicU32, Ordering};
use jetlink::engine::retained::RetainedMemory;

/// The record of the engine on each port. Aligned to the 64-bit words of an H7's RAM, the unit of its checksum.
#[repr(C, align(8))]
pub struct Engines(pub [RetainedMemory; PORTS.len()]);

// SAFETY: the linker puts the section `.retained` into RAM that start-up leaves as it is. Every bit pattern is a valid
// `RetainedMemory` (it is atomics throughout), and what it holds is only believed with a right checksum.
#[unsafe(link_section = ".retained")]
pub static ENGINES: Engines = Engines([const { RetainedMemory::new() }; PORTS.len()]);

/// A word that survives a reset, believed only beside its inverse. A static of this type belongs into a section `.retained.*`.
///
/// An H7 writes 64 bits of this RAM at a time, and holds the last of them in a buffer until others are written: a reset
/// loses it (AN5342). So each write is followed by one to the next 64 bits.
#[cfg(feature = "stm32")]
#[repr(C, align(8))]
pub struct RetainedWord {
    word: AtomicU32,
    inverse: AtomicU32,
    flush: [AtomicU32; 2],
}

#[cfg(feature = "stm32")]
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
