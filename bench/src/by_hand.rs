//! Drives a link or an engine by hand: no clock, no task. The bench plays the runner and the UART.

use embassy_time::{Duration, Instant};
use jetlink::command::{Order, Rejected};
use jetlink::config::EngineConfig;
use jetlink::engine::Engine;
use jetlink::event::Event;
use jetlink::line::Line;
use jetlink::link::{Link, Output, Transmission};
use jetlink::report::NotSent;
use std::ops::{Deref, DerefMut};

/// What a link and an engine have in common, as the runner sees it.
pub trait Machine {
    fn start(&mut self, now: Instant);
    fn receive(&mut self, now: Instant, bytes: &[u8]) -> usize;
    fn sent(&mut self, now: Instant);
    fn not_sent(&mut self, now: Instant, why: NotSent);
    fn timeout(&mut self, now: Instant);
    fn poll(&mut self) -> Output;
    /// What an engine does with a frame when its reply is handed out.
    fn supervise(&mut self) {}
}

impl<L: Link> Machine for L {
    fn start(&mut self, now: Instant) {
        Link::start(self, now);
    }

    fn receive(&mut self, now: Instant, bytes: &[u8]) -> usize {
        Link::receive(self, now, bytes)
    }

    fn sent(&mut self, now: Instant) {
        Link::sent(self, now);
    }

    fn not_sent(&mut self, now: Instant, why: NotSent) {
        Link::not_sent(self, now, why);
    }

    fn timeout(&mut self, now: Instant) {
        Link::timeout(self, now);
    }

    fn poll(&mut self) -> Output {
        self.compose();
        Link::poll(self)
    }
}

/// An engine on a bench. It acts as the [`Engine`] that it is.
#[derive(Clone, Debug)]
pub struct BenchEngine(Engine);

impl Deref for BenchEngine {
    type Target = Engine;

    fn deref(&self) -> &Engine {
        &self.0
    }
}

impl DerefMut for BenchEngine {
    fn deref_mut(&mut self) -> &mut Engine {
        &mut self.0
    }
}

impl Machine for BenchEngine {
    fn start(&mut self, now: Instant) {
        self.0.start(now);
    }

    fn receive(&mut self, now: Instant, bytes: &[u8]) -> usize {
        self.0.receive(now, bytes)
    }

    fn sent(&mut self, now: Instant) {
        self.0.sent(now);
    }

    fn not_sent(&mut self, now: Instant, why: NotSent) {
        self.0.not_sent(now, why);
    }

    fn timeout(&mut self, now: Instant) {
        self.0.timeout(now);
    }

    fn poll(&mut self) -> Output {
        self.0.compose();
        self.0.poll()
    }

    fn supervise(&mut self) {
        self.0.supervise();
    }
}

/// An instant from microseconds.
pub fn at_us(micros: u64) -> Instant {
    Instant::from_micros(micros)
}

/// One machine on one UART. Times are in microseconds.
#[derive(Clone, Debug)]
pub struct Bench<M> {
    pub machine: M,
    line: Line,
    now: u64,
    /// A transmission is with the UART; `Some(t)`: its last stop bit is out at `t`.
    busy: Option<Option<u64>>,
    /// The bench reports "sent" by itself after the time that the bytes take on the line.
    auto_sent: bool,
    deadline: Option<u64>,
    frames: Vec<(u64, Transmission)>,
    events: Vec<(u64, Event)>,
}

impl<M: Machine> Bench<M> {
    /// Started at 0; "sent" comes by itself.
    pub fn new(machine: M, line: Line) -> Self {
        let mut bench = Self {
            machine,
            line,
            now: 0,
            busy: None,
            auto_sent: true,
            deadline: None,
            frames: Vec::new(),
            events: Vec::new(),
        };
        bench.machine.start(at_us(0));
        bench.drain();
        bench
    }

    /// "sent" comes only when the test says so.
    pub fn by_hand(mut self) -> Self {
        self.auto_sent = false;
        self.busy = self.busy.map(|_| None);
        self
    }

    pub fn now_us(&self) -> u64 {
        self.now
    }

    pub fn busy(&self) -> bool {
        self.busy.is_some()
    }

    /// Time of the last `Output::Wait`.
    pub fn deadline_us(&self) -> Option<u64> {
        self.deadline
    }

    /// Takes every output until `Wait`. Panics if a second transmission is handed out before the first is
    /// over, or if the machine never waits.
    pub fn drain(&mut self) {
        for _ in 0..64 {
            match self.machine.poll() {
                Output::Transmit(transmission) => {
                    assert!(self.busy.is_none(), "two transmissions at once at {} µs", self.now);
                    let bytes = u32::try_from(transmission.as_bytes().len()).expect("short");
                    let over = self.now + self.line.time_of(bytes).as_micros();
                    self.busy = Some(self.auto_sent.then_some(over));
                    self.frames.push((self.now, transmission));
                }
                Output::Event(event) => self.events.push((self.now, event)),
                Output::Wait(deadline) => {
                    self.deadline = deadline.map(|at| at.as_micros());
                    return;
                }
            }
        }
        panic!("never waits");
    }

    /// Lets time pass: calls `sent` and `timeout` when they are due, up to and including `t`.
    pub fn run_to_us(&mut self, t: u64) {
        loop {
            let over = self.busy.flatten();
            let next = [over, self.deadline].into_iter().flatten().min();
            let Some(next) = next.filter(|next| *next <= t) else { break };
            self.now = self.now.max(next);
            if over == Some(next) {
                self.busy = None;
                self.machine.sent(at_us(self.now));
            } else {
                self.machine.timeout(at_us(self.now));
                self.drain();
                let deadline = self.deadline;
                assert!(
                    deadline.is_none_or(|at| at > self.now),
                    "timeout at {} µs left a deadline that is over: {deadline:?}",
                    self.now
                );
                continue;
            }
            self.drain();
        }
        self.jump_to_us(t);
    }

    /// Sets the time without handling deadlines in between.
    pub fn jump_to_us(&mut self, t: u64) {
        assert!(t >= self.now, "time runs forward: {t} after {}", self.now);
        self.now = t;
    }

    /// Does something with the machine now, and drains.
    pub fn act<T>(&mut self, act: impl FnOnce(&mut M, Instant) -> T) -> T {
        let answer = act(&mut self.machine, at_us(self.now));
        self.drain();
        answer
    }

    /// Bytes whose last stop bit came now.
    pub fn receive(&mut self, mut bytes: &[u8]) {
        while !bytes.is_empty() {
            let taken = self.act(|machine, now| machine.receive(now, bytes));
            self.act(|machine, _| machine.supervise());
            assert!((1..=bytes.len()).contains(&taken), "took {taken} of {}", bytes.len());
            bytes = &bytes[taken..];
        }
    }

    /// Bytes at a time.
    pub fn rx_at_us(&mut self, t: u64, bytes: &[u8]) {
        self.run_to_us(t);
        self.receive(bytes);
    }

    /// A late or an early wake-up at a time, with nothing done in between.
    pub fn timeout_at_us(&mut self, t: u64) {
        self.jump_to_us(t);
        self.act(|machine, now| machine.timeout(now));
    }

    /// The last stop bit is out at a time.
    pub fn sent_at_us(&mut self, t: u64) {
        self.run_to_us(t);
        assert!(self.busy.take().is_some(), "nothing is being sent at {t} µs");
        self.act(|machine, now| machine.sent(now));
    }

    /// The transmission failed at a time.
    pub fn not_sent_at_us(&mut self, t: u64, why: NotSent) {
        self.run_to_us(t);
        assert!(self.busy.take().is_some(), "nothing is being sent at {t} µs");
        self.act(|machine, now| machine.not_sent(now, why));
    }

    /// The frames since the last call: when they were handed out, and their bytes.
    pub fn frames(&mut self) -> Vec<(u64, Vec<u8>)> {
        self.transmissions().into_iter().map(|(at, frame)| (at, frame.as_bytes().to_vec())).collect()
    }

    /// How many frames there are since they were last taken.
    pub fn waiting_frames(&self) -> usize {
        self.frames.len()
    }

    /// The same without the times.
    pub fn bytes(&mut self) -> Vec<Vec<u8>> {
        self.frames().into_iter().map(|(_, bytes)| bytes).collect()
    }

    /// The same as they were handed out.
    pub fn transmissions(&mut self) -> Vec<(u64, Transmission)> {
        core::mem::take(&mut self.frames)
    }

    /// The events since the last call, with their times.
    pub fn events(&mut self) -> Vec<(u64, Event)> {
        core::mem::take(&mut self.events)
    }

    /// The same without the times.
    pub fn event_kinds(&mut self) -> Vec<Event> {
        self.events().into_iter().map(|(_, event)| event).collect()
    }
}

impl Bench<BenchEngine> {
    /// An engine on its line.
    pub fn engine(config: &EngineConfig) -> Self {
        Self::new(BenchEngine(Engine::new(config)), config.line)
    }
}

impl<L: Link> Bench<L> {
    /// An order at a time.
    pub fn order_at_us(&mut self, t: u64, order: Order) -> Result<(), Rejected> {
        self.run_to_us(t);
        self.act(|link, now| link.order(now, order))
    }
}

/// A duration from microseconds.
pub fn micros(micros: u64) -> Duration {
    Duration::from_micros(micros)
}
