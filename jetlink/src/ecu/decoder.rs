//! Common handling of a chunk of bytes in all decoders.

/// Takes bytes up to the end of the first frame. Returns how many it took, and the frame. `push` takes one byte.
pub(super) fn feed<F>(bytes: &[u8], mut push: impl FnMut(u8) -> Option<F>) -> (usize, Option<F>) {
    for (taken, &byte) in (1..).zip(bytes) {
        if let Some(frame) = push(byte) {
            return (taken, Some(frame));
        }
    }
    (bytes.len(), None)
}
