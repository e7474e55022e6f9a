//! Counting.

/// Counts one, wrapping.
pub(crate) const fn count(counter: &mut u32) {
    *counter = counter.wrapping_add(1);
}
