//! The far end of one UART: an ECU of `sim`, virtual time in, timed bytes out, and a record of every byte.
//!
//! The emulated UART times every byte itself, at the rate that the firmware has set it to, and requests the
//! next one when a byte ends. So a wrong rate garbles nothing here; it shows only in the record, where
//! [`audit`](crate::audit) finds it.

use std::any::Any;
use std::collections::VecDeque;
use std::fmt::Debug;

use rigless::chip::{Timeline, uart};
use rigless::snapshot::Store;
use rigless::time::VirtualNanos;
use sim::any::{AnyEcu, Protocol};
use sim::control::{Frame, Reader};
use sim::ecu::{Ecu, LineFault, Nanos};
use sim::line::{Line, StopBits};
use sim::wire::{Direction, Entry};

use crate::capture::Capture;

/// What can be connected to a wire: any ECU of `sim`. That of an engine is an [`AnyEcu`], so that its turbine is known.
pub trait Far: Ecu + Any + Debug + Send {}

impl<E: Ecu + Any + Debug + Send> Far for E {}

/// The fate of a byte on its way to the board.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Fate {
    /// The UART received it, damaged or not.
    Received,
    /// The UART was off, or a reset came in between.
    Lost,
    /// The wire was cut.
    Cut,
}

/// A byte from the ECU.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Rx {
    /// Start of the start bit.
    pub start: Nanos,
    /// End of the last stop bit.
    pub end: Nanos,
    /// As the ECU sent it.
    pub byte: u8,
    /// The last byte of a burst of the ECU.
    pub last: bool,
    /// Its fate.
    pub fate: Fate,
}

/// A byte from the board.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Tx {
    /// End of the last stop bit.
    pub end: Nanos,
    /// The byte.
    pub byte: u8,
}

#[derive(Clone, Copy, Debug)]
struct Queued {
    due: Nanos,
    byte: u8,
    last: bool,
}

/// An ECU on a UART.
#[derive(Debug)]
pub struct Wire {
    ecu: Box<dyn Far>,
    line: Line,
    head_start: Nanos,
    queue: VecDeque<Queued>,
    /// Time at which everything queued has been sent.
    free_at: Nanos,
    on_the_line: Option<Rx>,
    pub(crate) cut: bool,
    /// The part requests the next byte after the first stop bit (and starts it after the second).
    second_stop_bit: Nanos,
    babble: Option<VecDeque<u8>>,
    /// Bytes per million that are damaged on their way to the ECU, and the state of the random draw.
    garble: (u32, u64),
    recording: bool,
    capture: Option<Capture>,
    /// Since when its engine has been cold and at rest, or has not; empty where nothing has an engine here.
    pub(crate) cold: Vec<(Nanos, bool)>,
    /// From the ECU, in the order of time.
    pub rx: Vec<Rx>,
    /// From the board, in the order of time.
    pub tx: Vec<Tx>,
}

impl Wire {
    /// An ECU that is switched on `head_start` before the board.
    pub fn new(ecu: Box<dyn Far>, line: Line, head_start: Nanos) -> Self {
        let mut wire = Self {
            ecu,
            line,
            head_start,
            queue: VecDeque::new(),
            free_at: 0,
            on_the_line: None,
            cut: false,
            second_stop_bit: 0,
            babble: None,
            garble: (0, 0),
            recording: true,
            capture: None,
            cold: Vec::new(),
            rx: Vec::new(),
            tx: Vec::new(),
        };
        // Bytes sent before the board had power were not received.
        let mut discarded = Vec::new();
        wire.ecu.advance(0, &mut discarded);
        while wire.ecu.next_wake() < head_start {
            wire.ecu.advance(wire.ecu.next_wake(), &mut discarded);
        }
        wire
    }

    /// A wire with nothing on it.
    pub(crate) fn empty() -> Self {
        Self::new(Box::new(Nobody), Line::n1(2400), 0)
    }

    /// This wire is connected to a part that accepts a byte after its first stop bit.
    pub(crate) fn requested_early(&mut self) {
        if self.line.stop_bits == StopBits::Two {
            self.second_stop_bit = 1_000_000_000 / u64::from(self.line.baud);
        }
    }

    /// How the ECU's UART is set.
    pub fn line(&self) -> Line {
        self.line
    }

    /// The ECU.
    ///
    /// # Panics
    /// If it is of another kind.
    pub fn ecu<E: Far>(&self) -> &E {
        let ecu: &dyn Any = &*self.ecu;
        let ecu = ecu.downcast_ref().map_or(ecu, AnyEcu::inner);
        ecu.downcast_ref().expect("the ECU on this port is of another kind")
    }

    /// The ECU, to change something about it.
    ///
    /// # Panics
    /// If it is of another kind.
    pub fn ecu_mut<E: Far>(&mut self) -> &mut E {
        let mut ecu: &mut dyn Any = &mut *self.ecu;
        if ecu.is::<AnyEcu>() {
            ecu = ecu.downcast_mut::<AnyEcu>().expect("it is one").inner_mut();
        }
        ecu.downcast_mut().expect("the ECU on this port is of another kind")
    }

    /// The control frames that the board sent, each with its bytes.
    pub fn frames(&self, protocol: Protocol) -> Vec<(Frame, &[Tx])> {
        let byte = self.line.byte_ns(1);
        let mut reader = Reader::new(protocol);
        let frames = self.tx.iter().enumerate().filter_map(|(last, tx)| {
            let frame = reader.entry(&Entry {
                direction: Direction::ToEcu,
                byte: tx.byte,
                start: tx.end - byte,
                end: tx.end,
                fate: sim::wire::Fate::Delivered,
            });
            let frame = frame?.frame()?;
            let bytes = &self.tx[last + 1 - frame.bytes().len()..=last];
            Some((frame, bytes))
        });
        frames.collect()
    }

    /// Switches the ECU's supply.
    pub(crate) fn power(&mut self, now: Nanos, on: bool) {
        self.ecu.power(now + self.head_start, on);
        self.queue.clear();
        self.free_at = now;
    }

    /// From now on the ECU sends these bytes repeatedly without a pause, in place of its own; with `None`,
    /// its own again.
    pub(crate) fn babble(&mut self, now: Nanos, bytes: Option<&[u8]>) {
        self.babble = bytes.map(|bytes| bytes.iter().copied().collect());
        self.queue.clear();
        self.free_at = now;
    }

    /// Damages this number of bytes per million on their way to the ECU.
    pub(crate) fn garble(&mut self, per_million: u32, seed: u64) {
        self.garble = (per_million, seed);
    }

    /// Keeps no record, for an endless run.
    pub(crate) fn forget(&mut self) {
        self.recording = false;
    }

    /// Writes the bytes of both directions into these files.
    pub(crate) fn capture(&mut self, capture: Capture) {
        self.capture = Some(capture);
    }

    /// When the run has to stop for this wire, after `now`. A byte that is due needs no stop: the UART requests
    /// it when its receiver is free.
    pub(crate) fn next(&self, now: Nanos) -> Option<Nanos> {
        let front = self.queue.front().filter(|_| self.on_the_line.is_none());
        let byte = front.map(|queued| queued.due).filter(|&due| due > now);
        // A stop comes a few ns late while the core is busy, so overdue bytes still need one.
        let wake = self.wake().map(|at| at.max(now + 1));
        byte.into_iter().chain(wake).min()
    }

    /// When this end next has something to send.
    fn wake(&self) -> Option<Nanos> {
        let ecu = self.ecu.next_wake();
        let ecu = (ecu != Nanos::MAX).then(|| ecu.saturating_sub(self.head_start));
        ecu.into_iter().chain(self.babble.as_ref().map(|_| self.babble_on_at())).min()
    }

    /// When a babbling ECU needs more bytes: eight bytes before it would pause.
    fn babble_on_at(&self) -> Nanos {
        self.free_at.saturating_sub(self.line.byte_ns(8))
    }

    /// The time is `now`.
    pub(crate) fn reached(&mut self, now: Nanos) {
        let mut bytes = Vec::new();
        if self.ecu.next_wake() <= now + self.head_start {
            self.ecu.advance(now + self.head_start, &mut bytes);
        }
        self.look(now);
        let more = now >= self.babble_on_at();
        match &mut self.babble {
            None => self.push(now, &bytes),
            Some(babble) if more => {
                let endless: Vec<u8> = babble.iter().copied().cycle().take(32).collect();
                let sent = endless.len() % babble.len();
                babble.rotate_left(sent);
                self.push(now, &endless);
            }
            Some(_) => {}
        }
    }

    /// Checks whether the engine is cold and at rest, with the resolution of a report.
    fn look(&mut self, now: Nanos) {
        let ecu: &dyn Any = &*self.ecu;
        let Some(turbine) = ecu.downcast_ref().map(AnyEcu::turbine) else { return };
        let cold = !turbine.phase().is_live() && turbine.egt() < 108.0 && turbine.rpm() < 1600.0;
        if self.recording && self.cold.last().is_none_or(|(_, before)| *before != cold) {
            self.cold.push((now, cold));
        }
    }

    /// Puts bytes on the line, back to back.
    fn push(&mut self, now: Nanos, bytes: &[u8]) {
        let start = self.free_at.max(now);
        for (i, &byte) in bytes.iter().enumerate() {
            // The UART requests a byte at the end of each byte by its own rate, which may be slightly faster
            // than the ECU's: a byte that follows without a gap is due 2 % of a byte time earlier.
            let early = if i == 0 { 0 } else { self.line.byte_ns(1) / 50 };
            let due = start + self.line.byte_ns(i as u64) - early;
            self.queue.push_back(Queued { due, byte, last: i + 1 == bytes.len() });
        }
        self.free_at = start + self.line.byte_ns(bytes.len() as u64);
    }

    /// Bytes that were due while no UART fetched them: the F4's does not while it is off. The line does not keep them. Half a bit late
    /// is not missed: a stop comes a little late while the core is busy.
    fn skip_missed(&mut self, now: Nanos) {
        let half_a_bit = self.line.byte_ns(1) / 20;
        while let Some(&Queued { due, byte: value, last }) = self.queue.front()
            && due + half_a_bit < now
        {
            self.queue.pop_front();
            if self.recording {
                self.rx.push(Rx { start: due, end: due, byte: value, last, fate: Fate::Lost });
            }
        }
    }

    fn over(&mut self, end: Nanos, fate: Fate) {
        let Some(rx) = self.on_the_line.take() else { return };
        if let Some(capture) = &mut self.capture
            && fate == Fate::Received
        {
            capture.received(rx.byte);
        }
        if self.recording {
            self.rx.push(Rx { end, fate, ..rx });
        }
    }
}

impl Store for Wire {} // no snapshots

impl uart::Peer for Wire {
    fn receive(&mut self, word: u16, timeline: &mut Timeline<'_, '_>) {
        let (end, byte) = (timeline.now().0, word as u8);
        if self.recording {
            self.tx.push(Tx { end, byte });
        }
        if let Some(capture) = &mut self.capture {
            capture.sent(byte);
        }
        let (per_million, state) = &mut self.garble;
        // Knuth's generator: enough to draw which bytes are hit.
        *state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        let broken = (*state >> 33) % 1_000_000 < u64::from(*per_million);
        self.ecu.receive(end + self.head_start, if broken { Err(LineFault::Framing) } else { Ok(byte) });
    }

    fn restarted(&mut self, timeline: &mut Timeline<'_, '_>) {
        self.over(timeline.now().0, Fate::Lost);
    }

    /// The UART requests the next byte: when the receiver is free, and at every stop of the run.
    fn transmit(&mut self, now: VirtualNanos) -> Option<u16> {
        let now = now.0;
        if let Some(rx) = self.on_the_line {
            let fate = match rx.start >= now {
                _ if self.cut => Fate::Cut,
                true => Fate::Lost, // taken without any time
                false => Fate::Received,
            };
            let rest = if fate == Fate::Received { self.second_stop_bit } else { 0 };
            self.over(now + rest, fate);
        } else {
            self.skip_missed(now);
        }
        let queued = *self.queue.front().filter(|queued| queued.due <= now)?;
        self.queue.pop_front();
        let start = self.rx.last().map_or(now, |before| before.end.max(now));
        self.on_the_line =
            Some(Rx { start, end: start, byte: queued.byte, last: queued.last, fate: Fate::Lost });
        Some(u16::from(queued.byte))
    }
}

/// Nothing on the wire.
#[derive(Debug)]
struct Nobody;

impl Ecu for Nobody {
    fn next_wake(&self) -> Nanos {
        Nanos::MAX
    }
    fn advance(&mut self, _: Nanos, _: &mut Vec<u8>) {}
    fn receive(&mut self, _: Nanos, _: Result<u8, LineFault>) {}
    fn power(&mut self, _: Nanos, _: bool) {}
}
