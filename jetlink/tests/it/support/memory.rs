//! The words of a record, to leave them as a reset during a write would.

use jetlink::engine::retained::RetainedMemory;
use std::sync::atomic::AtomicU32;

/// Words of one copy of a record.
pub const WORDS: usize = 6;

/// The words of both copies.
pub fn words(memory: &RetainedMemory) -> &[AtomicU32; 2 * WORDS] {
    const { assert!(size_of::<RetainedMemory>() == size_of::<[AtomicU32; 2 * WORDS]>()) };
    // SAFETY: a `RetainedMemory` is two copies of six atomic words and nothing else, as the assertion on its size checks, and
    // atomic words may be shared and take any value.
    unsafe { &*std::ptr::from_ref(memory).cast() }
}
