//! Interface between an ECU and its line: bytes with times, without IO or a clock.
//!
//! The same models are used on the simulated [`wire`](crate::wire) and can be used on any other
//! carrier of bytes, for example the UART of an emulated board.

/// A time or a duration in nanoseconds. The owner of the clock defines zero.
pub type Nanos = u64;

/// One millisecond.
pub const MILLIS: Nanos = 1_000_000;

/// One second.
pub const SECOND: Nanos = 1_000_000_000;

/// Counters that every ECU has, in the same terms for either protocol. Those of replies stay 0 without a reply window.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counts {
    /// Frames sent.
    pub frames: u64,
    /// Commands accepted.
    pub accepted: u64,
    /// Invalid frames, and valid ones that its version or the time does not allow.
    pub bad: u64,
    /// Replies that were completed in the window.
    pub in_window: u64,
    /// Replies that were completed after the window.
    pub late: u64,
    /// Frames without a reply.
    pub unanswered: u64,
    /// The smallest time left in the window after a reply.
    pub worst_margin: Option<Nanos>,
    /// Stops of a live engine because no commands were received.
    pub loss_stops: u64,
    /// The shortest and the longest time between two accepted commands, for an ECU whose host sends unprompted.
    pub intervals: Option<(Nanos, Nanos)>,
}

/// Error of a byte that a UART received.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LineFault {
    /// The stop bit was missing.
    Framing,
    /// The samples within one bit did not agree.
    Noise,
}

/// An ECU, seen from its serial line.
///
/// The times passed to one ECU never run backwards.
pub trait Ecu {
    /// Latest time for the next [`advance`](Ecu::advance); never in the past after `advance(now)`.
    fn next_wake(&self) -> Nanos;

    /// The time is now `now`. Bytes pushed to `tx` start on the line now, back to back, in order.
    ///
    /// May be called at any time, even before [`next_wake`](Ecu::next_wake): the behaviour of the ECU
    /// must not depend on how often it is called.
    fn advance(&mut self, now: Nanos, tx: &mut Vec<u8>);

    /// One byte from the host, at the end of its stop bit; `Err` for a byte received with an error.
    fn receive(&mut self, now: Nanos, byte: Result<u8, LineFault>);

    /// Switches the ECU's supply. Switching it on restarts the ECU; it has no effect if already on.
    fn power(&mut self, now: Nanos, on: bool);
}

impl<E: Ecu + ?Sized> Ecu for Box<E> {
    fn next_wake(&self) -> Nanos {
        (**self).next_wake()
    }

    fn advance(&mut self, now: Nanos, tx: &mut Vec<u8>) {
        (**self).advance(now, tx);
    }

    fn receive(&mut self, now: Nanos, byte: Result<u8, LineFault>) {
        (**self).receive(now, byte);
    }

    fn power(&mut self, now: Nanos, on: bool) {
        (**self).power(now, on);
    }
}
