//! One port: frames in, a queue of frames out, and its share of telemetry.
//!
//! Telemetry stays below a quarter of the port, and is the first to be dropped, what was requested the next: the answer to a command finds
//! space as long as the port transmits at all. Heartbeats and texts are always sent and use up this quarter first.

use crate::frame::{Address, Decoder, MAX_FRAME, Received, encode_payload};
use crate::sent::Payload;
use crate::signing::{SIGNATURE, Seal};
use embassy_time::{Duration, Instant};
use heapless::{Deque, Vec};

/// Bytes that wait for the port.
const QUEUE: usize = 1024;
/// Bytes that may wait when something requested is added: it may be requested at the rate of the line. The rest has space for the heartbeats of
/// six engines, signed.
const REQUESTED_QUEUE: usize = QUEUE - 256;
/// Bytes that may wait when telemetry is added. The rest is for answers.
const TELEMETRY_QUEUE: usize = 384;
/// Telemetry that may be sent at once, as a time of the port's quarter.
const BURST: Duration = Duration::from_millis(400);

/// Longest time for which heartbeats and texts that exceed a quarter of the port keep other telemetry from it.
const DEBT: Duration = Duration::from_secs(5);

/// Time between what two engines send.
const STAGGER: Duration = Duration::from_millis(130);

/// A port.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct PortConfig {
    /// Capacity, bytes per second. A UART at 57 600 baud: 5760.
    pub bytes_per_second: u32,
    /// Whether only a person at the board can use it. Its frames need no signature, and may set the key.
    pub usb: bool,
}

impl PortConfig {
    /// A UART, with 10 bits per byte.
    pub const fn uart(baud: u32) -> Self {
        Self { bytes_per_second: baud / 10, usb: false }
    }

    /// USB: everything is sent at 10 Hz.
    pub const fn usb() -> Self {
        Self { bytes_per_second: 100_000, usb: true }
    }

    /// A network: as fast as USB, but anybody may be on it.
    pub const fn network() -> Self {
        Self { usb: false, ..Self::usb() }
    }

    /// Whether it carries everything at 10 Hz.
    pub(crate) const fn is_wide(self) -> bool {
        self.bytes_per_second >= 20_000
    }
}

/// Counters of a port. All wrap.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct PortCounters {
    /// Counters of what was received.
    pub received: Received,
    /// Frames that were queued for sending.
    pub queued: u32,
    /// Frames of telemetry that were dropped.
    pub telemetry_dropped: u32,
    /// Answers, heartbeats and texts that were dropped: the port does not transmit, or more is requested than it carries.
    pub answers_dropped: u32,
}

/// Purpose of a frame.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) enum Class {
    /// The answer to a command.
    Answer,
    /// A parameter or a message on request.
    Requested,
    /// A heartbeat or a text: sent like an answer, and counted as telemetry.
    Always,
    Telemetry,
}

/// Rate of one message on a port.
#[derive(Clone, Copy, Debug)]
pub struct Schedule {
    pub(crate) interval: Interval,
    pub(crate) next: Instant,
}

#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) enum Interval {
    Default,
    Off,
    Every(Duration),
}

impl Schedule {
    pub(crate) const fn new(now: Instant) -> Self {
        Self { interval: Interval::Default, next: now }
    }

    /// Sets its interval. It counts from now on: nothing waits for the end of the old one.
    pub(crate) const fn set(&mut self, now: Instant, interval: Interval) {
        *self = Self { interval, next: now };
    }

    /// Whether it is due, with this interval by default. `None`: off by default.
    pub(crate) fn is_due(&mut self, now: Instant, default: Option<Duration>) -> bool {
        let every = match self.interval {
            Interval::Default => default,
            Interval::Off => None,
            Interval::Every(every) => Some(every),
        };
        let Some(every) = every else { return false };
        if now < self.next {
            return false;
        }
        // On schedule, but never more than one interval behind.
        let next = self.next.checked_add(every).unwrap_or(Instant::MAX);
        self.next = if next <= now { now.checked_add(every).unwrap_or(Instant::MAX) } else { next };
        true
    }
}

/// What one engine sends on a port.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Streams {
    pub efi: Schedule,
    pub values: Schedule,
    pub quality: crate::report::LinkQuality,
    sequence: u8,
}

impl Streams {
    fn new(now: Instant, engine: usize) -> Self {
        // Not all at the same time.
        let offset = STAGGER * (engine as u32 + 1);
        Self {
            efi: Schedule::new(now + offset),
            values: Schedule::new(now + offset),
            quality: crate::report::LinkQuality::default(),
            sequence: 0,
        }
    }
}

/// A list of parameters that is being sent, and those that wait.
#[derive(Clone, Copy, Debug)]
pub(crate) struct List {
    /// Place of the component: 0 is the node, then the engines.
    pub place: usize,
    pub index: u16,
    /// A bit for each place whose list waits. A ground station may request all components at once.
    pub waiting: u32,
    pub next: Instant,
}

impl List {
    /// The bit of a place. A node has fewer engines than there are bits.
    pub fn bit(place: usize) -> u32 {
        1_u32.checked_shl(place as u32).unwrap_or(0)
    }

    /// Begins the list of the next place that waits: the one that follows, and behind the last one the first. So each one has its turn, whatever is
    /// requested again meanwhile. None: none waits.
    pub fn following(self) -> Option<Self> {
        let above = u32::MAX.checked_shl(self.place as u32).unwrap_or(0) & self.waiting; // 32 places
        let bits = if above != 0 { above } else { self.waiting };
        // Without its lowest bit.
        let rest = bits & bits.checked_sub(1)?;
        let waiting = self.waiting & !(bits ^ rest);
        Some(Self { place: bits.trailing_zeros() as usize, index: 0, waiting, ..self })
    }
}

#[derive(Debug)]
pub(crate) struct Port<const N: usize> {
    pub config: PortConfig,
    pub decoder: Decoder,
    pub streams: Vec<Streams, N>,
    pub list: Option<List>,
    /// Somebody may receive what is sent.
    is_open: bool,
    queue: Deque<u8, QUEUE>,
    /// Time up to which telemetry has used its share.
    used_until: Instant,
    sequence: u8,
    counters: PortCounters,
}

impl<const N: usize> Port<N> {
    #[inline(never)]
    pub fn new(now: Instant, config: PortConfig, engines: usize) -> Self {
        let mut streams = Vec::new();
        for engine in 0..engines.min(N) {
            // There is space for each.
            let _ = streams.push(Streams::new(now, engine));
        }
        Self {
            config,
            decoder: Decoder::new(),
            streams,
            list: None,
            is_open: true,
            queue: Deque::new(),
            used_until: now,
            sequence: 0,
            counters: PortCounters::default(),
        }
    }

    /// Starts over, for a new peer or without one.
    pub fn set_open(&mut self, now: Instant, is_open: bool) {
        self.is_open = is_open;
        self.decoder.clear();
        self.list = None;
        self.queue.clear();
        self.used_until = now;
        for (engine, streams) in self.streams.iter_mut().enumerate() {
            *streams = Streams { sequence: streams.sequence, ..Streams::new(now, engine) };
        }
    }

    pub const fn is_open(&self) -> bool {
        self.is_open
    }

    pub fn counters(&self) -> PortCounters {
        PortCounters { received: self.decoder.counters(), ..self.counters }
    }

    /// Queues a frame. `engine`: which one sends it; `None`: the node. `seal`: signs it.
    pub fn send(
        &mut self,
        now: Instant,
        from: Address,
        engine: Option<usize>,
        class: Class,
        message: &Payload,
        seal: Option<Seal<'_>>,
    ) -> bool {
        let sequence = match engine {
            Some(engine) => match self.streams.get(engine) {
                Some(stream) => stream.sequence,
                None => return false,
            },
            None => self.sequence,
        };
        let mut frame = encode_payload(from, sequence, message, seal.is_some());
        let length = frame.len() + if seal.is_some() { SIGNATURE } else { 0 };
        let most = match class {
            Class::Answer | Class::Always => QUEUE,
            Class::Requested => REQUESTED_QUEUE,
            Class::Telemetry if self.used_until > now + BURST => 0,
            // It is empty again before the next check of the engines.
            Class::Telemetry if self.config.is_wide() => REQUESTED_QUEUE,
            Class::Telemetry => TELEMETRY_QUEUE,
        };
        if self.queue.len() + length > most {
            let count = match class {
                Class::Telemetry => &mut self.counters.telemetry_dropped,
                _ => &mut self.counters.answers_dropped,
            };
            *count = count.wrapping_add(1);
            return false;
        }
        if matches!(class, Class::Always | Class::Telemetry) {
            self.used_until = (self.used_until.max(now) + self.quarter(length)).min(now + DEBT);
        }
        let sequence = match engine.and_then(|engine| self.streams.get_mut(engine)) {
            Some(stream) => &mut stream.sequence,
            None => &mut self.sequence,
        };
        *sequence = sequence.wrapping_add(1);
        self.counters.queued = self.counters.queued.wrapping_add(1);
        // No hash is computed for a dropped frame.
        if let Some(seal) = seal {
            seal.sign(&mut frame);
        }
        self.push(&frame);
        true
    }

    /// Time in which a quarter of the port carries these bytes.
    pub fn quarter(&self, bytes: usize) -> Duration {
        let rate = u64::from(self.config.bytes_per_second).max(4);
        Duration::from_micros(bytes as u64 * 4_000_000 / rate)
    }

    fn push(&mut self, frame: &Vec<u8, MAX_FRAME>) {
        for byte in frame {
            // There is space for the whole frame.
            let _ = self.queue.push_back(*byte);
        }
    }

    /// Takes bytes that are to be sent.
    pub fn transmit(&mut self, bytes: &mut [u8]) -> usize {
        let mut count = 0;
        for slot in bytes {
            let Some(byte) = self.queue.pop_front() else { break };
            *slot = byte;
            count += 1;
        }
        count
    }

    pub fn is_waiting(&self) -> bool {
        !self.queue.is_empty()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dialect::{COMMAND_ACK_DATA, NAMED_VALUE_FLOAT_DATA};

    const FROM: Address = Address { system: 1, component: 25 };

    #[test]
    fn telemetry_stays_below_a_quarter_and_answers_go_out() {
        let start = Instant::from_secs(10);
        let mut port: Port<1> = Port::new(start, PortConfig::uart(57_600), 1);
        let value =
            Payload::of(&NAMED_VALUE_FLOAT_DATA { value: 1.0, time_boot_ms: u32::MAX, ..Default::default() });
        let mut bytes = [0; 64];
        let mut sent = 0;
        for ms in 0..10_000 {
            let now = start + Duration::from_millis(ms);
            port.send(now, FROM, Some(0), Class::Telemetry, &value, None);
            while let count @ 1.. = port.transmit(&mut bytes) {
                sent += count;
            }
        }
        // 14 400 bytes in 10 s, and the burst.
        assert!((14_000..15_100).contains(&sent), "{sent}");
        assert!(port.counters().telemetry_dropped > 9000);

        // Nothing is transmitted: telemetry leaves space for answers.
        let now = start + Duration::from_secs(60);
        (0..100).for_each(|i| {
            port.send(now + Duration::from_secs(i), FROM, Some(0), Class::Telemetry, &value, None);
        });
        assert!(port.queue.len() <= TELEMETRY_QUEUE);
        let ack = Payload::of(&COMMAND_ACK_DATA { command: 223, ..Default::default() });
        assert!((0..20).all(|_| port.send(now, FROM, None, Class::Answer, &ack, None)));
        assert_eq!(port.counters().answers_dropped, 0);
        (0..100).for_each(|_| {
            port.send(now, FROM, None, Class::Answer, &ack, None);
        });
        assert!(port.counters().answers_dropped > 0);
    }
}
