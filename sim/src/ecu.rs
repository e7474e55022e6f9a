//! What an ECU is to the line it hangs on: bytes at times, no IO and no clock of its own.
//!
//! The same models hang on the simulated [`wire`](crate::wire) and can hang on any other carrier of
//! bytes, for example the UART of an emulated board.

/// A time or a length of time in nanoseconds. Zero is wherever the owner of the clock puts it.
pub type Nanos = u64;

/// One millisecond.
pub const MILLIS: Nanos = 1_000_000;

/// One second.
pub const SECOND: Nanos = 1_000_000_000;

/// What was wrong with a byte that a UART received.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LineFault {
    /// The stop bit was not there.
    Framing,
    /// The samples within one bit did not agree.
    Noise,
}

/// An ECU, seen from its serial line.
///
/// All times given to one ECU never run backwards.
pub trait Ecu {
    /// When it wants [`advance`](Ecu::advance) at the latest; never in the past after
    /// `advance(now)`.
    fn next_wake(&self) -> Nanos;

    /// The time is now `now`. Bytes pushed to `tx` start on the line now, back to back, in order.
    ///
    /// May be called at any time, also earlier than [`next_wake`](Ecu::next_wake) asks for: what
    /// the ECU does must not depend on how often it is called.
    fn advance(&mut self, now: Nanos, tx: &mut Vec<u8>);

    /// One byte from the host, at the end of its stop bit; `Err` for a byte that arrived broken.
    fn heard(&mut self, now: Nanos, byte: Result<u8, LineFault>);

    /// Switches the ECU's supply. Switching it on starts it anew; on while on does nothing.
    fn power(&mut self, now: Nanos, on: bool);
}

impl<E: Ecu + ?Sized> Ecu for Box<E> {
    fn next_wake(&self) -> Nanos {
        (**self).next_wake()
    }

    fn advance(&mut self, now: Nanos, tx: &mut Vec<u8>) {
        (**self).advance(now, tx);
    }

    fn heard(&mut self, now: Nanos, byte: Result<u8, LineFault>) {
        (**self).heard(now, byte);
    }

    fn power(&mut self, now: Nanos, on: bool) {
        (**self).power(now, on);
    }
}
