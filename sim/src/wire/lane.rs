//! One direction of the wire: a sender that shifts bytes out, the faults on the way, and the times
//! at which the bytes arrive.

use std::collections::VecDeque;

use super::faults::{Direction, Entry, Fate, Faults};
use crate::ecu::Nanos;
use crate::line::Line;

/// Configuration of the two ends of one direction.
#[derive(Clone, Copy, Debug)]
pub(super) struct Ends {
    pub(super) sender: Line,
    /// Whether the receiver's baud rate matches the sender's.
    pub(super) matched: bool,
}

/// Byte as received.
#[derive(Clone, Copy, Debug)]
pub(super) enum Arrival {
    Good(u8),
    /// No stop bit in its place; the value is as sampled.
    Framing(u8),
}

#[derive(Clone, Copy, Debug)]
struct Sending {
    byte: u8,
    start: Nanos,
    end: Nanos,
    spoilt: bool,
}

/// Bytes sent without a gap; their ends are calculated from the start of the run, so that rounding
/// errors do not accumulate.
#[derive(Clone, Copy, Debug)]
struct Run {
    start: Nanos,
    bytes: u64,
    end: Nanos,
}

#[derive(Debug)]
pub(super) struct Lane {
    direction: Direction,
    ends: Ends,
    /// Bytes that wait to be sent. The node's lane leaves this empty: there the ring is the queue.
    pub(super) queue: VecDeque<u8>,
    sending: Option<Sending>,
    run: Option<Run>,
    /// Taken only from the front: a byte with a shorter delay waits for the previous one.
    arrivals: VecDeque<(Nanos, Arrival)>,
    cut: bool,
    pub(super) faults: Faults,
    rng: fastrand::Rng,
}

impl Lane {
    pub(super) fn new(direction: Direction, ends: Ends, seed: u64) -> Self {
        Self {
            direction,
            ends,
            queue: VecDeque::new(),
            sending: None,
            run: None,
            arrivals: VecDeque::new(),
            cut: false,
            faults: Faults::default(),
            rng: fastrand::Rng::with_seed(seed),
        }
    }

    pub(super) fn is_sending(&self) -> bool {
        self.sending.is_some()
    }

    pub(super) fn is_cut(&self) -> bool {
        self.cut
    }

    pub(super) fn set_cut(&mut self, cut: bool) {
        // A byte with its first or second half missing is lost.
        self.spoil();
        self.cut = cut;
    }

    /// The byte in the shifter will not arrive.
    pub(super) fn spoil(&mut self) {
        if let Some(sending) = &mut self.sending {
            sending.spoilt = true;
        }
    }

    pub(super) fn start_byte(&mut self, at: Nanos, byte: u8) {
        debug_assert!(self.sending.is_none(), "the shifter holds one byte");
        let mut run = match self.run {
            Some(run) if run.end == at => run,
            _ => Run { start: at, bytes: 0, end: at },
        };
        run.bytes += 1;
        run.end = run.start + self.ends.sender.byte_ns(run.bytes);
        self.run = Some(run);
        self.sending = Some(Sending { byte, start: at, end: run.end, spoilt: self.cut });
    }

    pub(super) fn next_event(&self) -> Option<Nanos> {
        let end = self.sending.map(|sending| sending.end);
        let arrival = self.arrivals.front().map(|&(at, _)| at);
        match (end, arrival) {
            (Some(a), Some(b)) => Some(a.min(b)),
            (a, b) => a.or(b),
        }
    }

    /// Completes the byte in the shifter if it ends now, and puts it on the line.
    pub(super) fn end_byte(&mut self, at: Nanos, record: Option<&mut Vec<Entry>>) -> Option<u8> {
        let Sending { byte, start, end, spoilt } = self.sending.take_if(|sending| sending.end <= at)?;
        let arrival = end + self.faults.delay_ns + self.random_up_to(self.faults.jitter_ns);

        let fate = self.fate(byte, spoilt);
        let received = match fate {
            Fate::Delivered => Some(Arrival::Good(byte)),
            Fate::Flipped(value) => Some(Arrival::Good(value)),
            Fate::Framing(value) => Some(Arrival::Framing(value)),
            Fate::Lost | Fate::Added => None,
        };
        self.arrive(arrival, received);
        let added = (!self.cut && self.strikes(self.faults.add_per_million)).then(|| self.rng.u8(..));
        self.arrive(arrival, added.map(Arrival::Good));

        if let Some(record) = record {
            let direction = self.direction;
            record.push(Entry { direction, byte, start, end, fate });
            if let Some(byte) = added {
                record.push(Entry { direction, byte, start: end, end, fate: Fate::Added });
            }
        }
        Some(byte)
    }

    fn fate(&mut self, byte: u8, spoilt: bool) -> Fate {
        if spoilt || self.strikes(self.faults.lose_per_million) {
            return Fate::Lost;
        }
        if !self.ends.matched {
            // Sampled at the wrong times: garbage, but the same for the same byte.
            return Fate::Framing(byte.rotate_left(3) ^ 0x5A);
        }
        if self.strikes(self.faults.framing_per_million) {
            return Fate::Framing(self.rng.u8(..));
        }
        let mut value = byte;
        if self.faults.flip_per_million > 0 {
            for bit in 0..8 {
                value ^= u8::from(self.strikes(self.faults.flip_per_million)) << bit;
            }
        }
        if value == byte { Fate::Delivered } else { Fate::Flipped(value) }
    }

    fn arrive(&mut self, at: Nanos, received: Option<Arrival>) {
        if let Some(received) = received {
            self.arrivals.push_back((at, received));
        }
    }

    /// The next byte that has arrived by now.
    pub(super) fn arrived(&mut self, now: Nanos) -> Option<Arrival> {
        self.arrivals.front().filter(|(at, _)| *at <= now)?;
        self.arrivals.pop_front().map(|(_, arrival)| arrival)
    }

    fn strikes(&mut self, per_million: u32) -> bool {
        per_million > 0 && self.rng.u32(..1_000_000) < per_million
    }

    fn random_up_to(&mut self, most: Nanos) -> Nanos {
        if most == 0 { 0 } else { self.rng.u64(..=most) }
    }
}
