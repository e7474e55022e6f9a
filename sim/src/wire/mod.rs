//! The two directions between one UART of the node and one ECU, byte by byte in real line time.
//!
//! [`connect`] returns the node's halves, which behave like embassy-stm32's `BufferedUart`: `write`
//! puts bytes into a ring and returns, `flush` waits for the last stop bit, and a reader is woken
//! at every byte. The third part, the [`Plug`], moves the bytes and injects faults.
//!
//! Inside, all times are exact nanoseconds; the node sees each byte at the first tick (1 µs) after
//! the end of its stop bit, never before it.

mod faults;
mod lane;
mod node;

use core::cell::RefCell;
use core::convert::Infallible;
use core::future::poll_fn;
use core::task::Poll;
use std::rc::Rc;

use crate::clock;
use crate::ecu::{Ecu, LineFault, Nanos};
use crate::line::Line;

pub use self::faults::{Babble, Direction, Entry, Fate, Faults, FramingAs};
use self::lane::{Arrival, Ends, Lane};
use self::node::{FramingHandler, Port};
pub use self::node::{WireError, WireRx, WireTx};

/// Configuration of a connection.
#[derive(Clone, Copy, Debug)]
pub struct Settings {
    /// Configuration of the node's UART.
    pub node: Line,
    /// Configuration of the ECU's UART.
    pub ecu: Line,
    /// Bytes in the node's transmit ring.
    pub tx_ring: usize,
    /// Bytes in the node's receive ring; more are dropped, as `BufferedUart` does.
    pub rx_ring: usize,
    /// Seed of all random events on this wire.
    pub seed: u64,
}

impl Settings {
    /// Both ends configured alike, with rings of 64 and 256 bytes.
    pub const fn new(line: Line, seed: u64) -> Self {
        Self { node: line, ecu: line, tx_ring: 64, rx_ring: 256, seed }
    }
}

/// Connects a UART of the node with an ECU; both ends are set to `line`.
pub fn connect<E: Ecu>(ecu: E, line: Line, seed: u64) -> (WireRx, WireTx, Plug<E>) {
    connect_with(ecu, Settings::new(line, seed))
}

/// As [`connect`], with the two ends configured differently, to test a wrong configuration.
pub fn connect_mismatched<E: Ecu>(
    ecu: E,
    node: Line,
    ecu_line: Line,
    seed: u64,
) -> (WireRx, WireTx, Plug<E>) {
    connect_with(ecu, Settings { ecu: ecu_line, ..Settings::new(node, seed) })
}

/// As [`connect`], with a full configuration.
pub fn connect_with<E: Ecu>(ecu: E, settings: Settings) -> (WireRx, WireTx, Plug<E>) {
    let port = Rc::new(RefCell::new(Port::new(settings.tx_ring, settings.rx_ring)));
    let mut seeds = fastrand::Rng::with_seed(settings.seed);
    let ends = |sender: Line, receiver: Line| Ends { sender, matched: receiver.understands(sender) };
    let mut wire = Wire {
        ecu,
        port: port.clone(),
        to_node: Lane::new(Direction::ToNode, ends(settings.ecu, settings.node), seeds.u64(..)),
        to_ecu: Lane::new(Direction::ToEcu, ends(settings.node, settings.ecu), seeds.u64(..)),
        babble_rng: seeds.fork(),
        babble: None,
        babbled: 0,
        echo: false,
        record: None,
        scratch: Vec::new(),
        not_before: 0,
    };
    // Pass the time to the ECU: a new one is powered up now.
    wire.advance_ecu(clock::now_ns());
    let plug = Plug { wire: Rc::new(RefCell::new(wire)) };
    (WireRx::new(port.clone()), WireTx::new(port), plug)
}

#[derive(Debug)]
struct Wire<E> {
    ecu: E,
    port: Rc<RefCell<Port>>,
    to_node: Lane,
    to_ecu: Lane,
    babble: Option<Babble>,
    babbled: usize,
    babble_rng: fastrand::Rng,
    echo: bool,
    record: Option<Vec<Entry>>,
    scratch: Vec<u8>,
    /// Time until which the node's transmitter was stalled.
    not_before: Nanos,
}

impl<E: Ecu> Wire<E> {
    /// Processes all events up to and including `now`, in chronological order.
    fn settle(&mut self, now: Nanos) {
        self.start_node_byte(self.not_before);
        while let Some(at) = self.next_event().filter(|&at| at <= now) {
            self.step(at);
        }
    }

    fn next_event(&self) -> Option<Nanos> {
        let ecu = self.ecu.next_wake();
        [self.to_node.next_event(), self.to_ecu.next_event()]
            .into_iter()
            .flatten()
            .chain((ecu != Nanos::MAX).then_some(ecu))
            .min()
    }

    fn step(&mut self, at: Nanos) {
        if let Some(sent) = self.to_ecu.end_byte(at, self.record.as_mut()) {
            if self.echo && !self.to_ecu.is_cut() {
                self.port.borrow_mut().receive(Arrival::Good(sent));
            }
            self.port.borrow_mut().shifting = false;
            // The ring's next byte follows without a gap.
            self.start_node_byte(at);
            self.port.borrow().wake_writer();
        }
        while let Some(arrival) = self.to_ecu.arrived(at) {
            self.ecu.receive(
                at,
                match arrival {
                    Arrival::Good(byte) => Ok(byte),
                    Arrival::Framing(_) => Err(LineFault::Framing),
                },
            );
        }

        self.to_node.end_byte(at, self.record.as_mut());
        while let Some(arrival) = self.to_node.arrived(at) {
            self.port.borrow_mut().receive(arrival);
        }
        if self.ecu.next_wake() <= at {
            self.advance_ecu(at);
            assert!(self.ecu.next_wake() > at, "an ECU whose next wake is in the past never ends");
        }
        self.start_ecu_byte(at);
    }

    fn advance_ecu(&mut self, at: Nanos) {
        self.ecu.advance(at, &mut self.scratch);
        if self.babble.is_some() {
            // The transmitter is stuck: the ECU's bytes are never sent.
            self.scratch.clear();
        }
        self.to_node.queue.extend(self.scratch.drain(..));
        self.start_ecu_byte(at);
    }

    fn start_ecu_byte(&mut self, at: Nanos) {
        if self.to_node.is_sending() {
            return;
        }
        let byte = match &self.babble {
            None => self.to_node.queue.pop_front(),
            Some(Babble::Random) => Some(self.babble_rng.u8(..)),
            Some(Babble::Repeat(bytes)) => {
                let byte = bytes.get(self.babbled % bytes.len().max(1)).copied();
                self.babbled += 1;
                Some(byte.unwrap_or(0))
            }
        };
        if let Some(byte) = byte {
            self.to_node.start_byte(at, byte);
        }
    }

    /// `free` is the time at which the shifter became free; a byte cannot start before it was written.
    fn start_node_byte(&mut self, free: Nanos) {
        let mut port = self.port.borrow_mut();
        if port.stalled || self.to_ecu.is_sending() {
            return;
        }
        if let Some((byte, written)) = port.tx.pop_front() {
            self.to_ecu.start_byte(free.max(written), byte);
            port.shifting = true;
            port.wake_writer();
        }
    }
}

/// Moves the bytes of one connection, and gives access to its ECU and its faults.
///
/// Clones are handles to the same connection.
#[derive(Debug)]
pub struct Plug<E> {
    wire: Rc<RefCell<Wire<E>>>,
}

impl<E> Clone for Plug<E> {
    fn clone(&self) -> Self {
        Self { wire: self.wire.clone() }
    }
}

impl<E: Ecu> Plug<E> {
    /// Drives the ECU and both directions forever; join it with the node's future.
    pub async fn run(&self) -> Infallible {
        poll_fn(|cx| {
            let mut wire = self.wire.borrow_mut();
            let now = clock::now_ns();
            wire.settle(now);
            // The end of a byte is between two ticks: check again at the first tick after it.
            let next = wire.next_event().map_or(u64::MAX, |at| at.div_ceil(1000));
            embassy_time_driver::schedule_wake(next, cx.waker());
            wire.port.borrow_mut().set_runner(cx);
            Poll::Pending
        })
        .await
    }

    /// Processes all events up to now, makes the change, and then wakes the runner.
    fn change<T>(&self, change: impl FnOnce(&mut Wire<E>) -> T) -> T {
        let mut wire = self.wire.borrow_mut();
        wire.settle(clock::now_ns());
        let result = change(&mut wire);
        wire.port.borrow().wake_runner();
        result
    }

    /// Gives access to the ECU in its state at this instant.
    pub fn ecu<T>(&self, look: impl FnOnce(&mut E) -> T) -> T {
        self.change(|wire| {
            wire.advance_ecu(clock::now_ns());
            look(&mut wire.ecu)
        })
    }

    /// Switches the ECU's supply; the rest of a frame that was being sent is not sent.
    pub fn power(&self, on: bool) {
        self.change(|wire| {
            wire.ecu.power(clock::now_ns(), on);
            if !on {
                wire.to_node.queue.clear();
                wire.to_node.spoil();
            }
        });
    }

    /// Resets the node: the content of its UART is lost, and the byte being sent is cut short. Returns the halves
    /// for the node that starts; the old ones must have been dropped.
    pub fn reset_node(&self) -> (WireRx, WireTx) {
        self.change(|wire| {
            wire.to_ecu.spoil();
            wire.port.borrow_mut().reset();
        });
        let port = self.wire.borrow().port.clone();
        (WireRx::new(port.clone()), WireTx::new(port))
    }

    /// Sets the random faults from now on, in each direction.
    pub fn set_faults(&self, to_node: Faults, to_ecu: Faults) {
        self.change(|wire| {
            wire.to_node.faults = to_node;
            wire.to_ecu.faults = to_ecu;
        });
    }

    /// Sets what the UART's interrupt does at each byte with a framing error that arrives as data, like one that counts the
    /// flags of its status register.
    pub fn on_framing_error(&self, count: impl Fn() + 'static) {
        self.change(|wire| wire.port.borrow_mut().framing_handler = Some(FramingHandler(Box::new(count))));
    }

    /// Sets how the node's UART treats bytes with a framing error.
    pub fn framing(&self, framing: FramingAs) {
        self.change(|wire| wire.port.borrow_mut().framing = framing);
    }

    /// Cuts the line in both directions, or reconnects it. A byte being sent at that instant is lost.
    ///
    /// A cut line idles high: neither side receives anything, and the node's UART detects nothing.
    pub fn cut(&self, cut: bool) {
        self.change(|wire| {
            wire.to_node.set_cut(cut);
            wire.to_ecu.set_cut(cut);
        });
    }

    /// The same for one of the two wires.
    pub fn cut_one(&self, direction: Direction, cut: bool) {
        self.change(|wire| match direction {
            Direction::ToNode => wire.to_node.set_cut(cut),
            Direction::ToEcu => wire.to_ecu.set_cut(cut),
        });
    }

    /// Plugs in another ECU with its engine and powers it up now. Returns the previous one.
    pub fn replace_ecu(&self, ecu: E) -> E {
        self.change(|wire| {
            let before = core::mem::replace(&mut wire.ecu, ecu);
            wire.to_node.queue.clear();
            wire.to_node.spoil();
            wire.advance_ecu(clock::now_ns());
            before
        })
    }

    /// Hangs the transmitter: while `true`, no flush of the node ever returns, nor does a write that finds the ring full.
    ///
    /// The byte in the shifter is still sent. Bytes written meanwhile wait in the ring, as in a driver with a buffer.
    pub fn stall_tx(&self, stalled: bool) {
        self.change(|wire| {
            wire.not_before = clock::now_ns();
            let mut port = wire.port.borrow_mut();
            port.stalled = stalled;
            port.wake_writer();
        });
    }

    /// Sets whether the node receives its own bytes, as on an accidental half-duplex line. Unlike on a
    /// real one, simultaneous bytes of both sides do not disturb each other here.
    pub fn echo(&self, echo: bool) {
        self.change(|wire| wire.echo = echo);
    }

    /// Sets whether the ECU's transmitter sends garbage without a pause, and which. Its own frames are
    /// lost meanwhile; it still receives the host.
    pub fn babble(&self, babble: Option<Babble>) {
        self.change(|wire| {
            let now = clock::now_ns();
            if babble.is_some() {
                wire.to_node.queue.clear();
            }
            wire.babbled = 0;
            wire.babble = babble;
            wire.start_ecu_byte(now);
        });
    }

    /// Sends these bytes to the node as if from the ECU, after the bytes that it is sending.
    pub fn inject_to_node(&self, bytes: &[u8]) {
        self.change(|wire| {
            wire.to_node.queue.extend(bytes);
            wire.start_ecu_byte(clock::now_ns());
        });
    }

    /// Passes these bytes to the ECU at once, as if from another host on the line.
    pub fn inject_to_ecu(&self, bytes: &[u8]) {
        self.change(|wire| {
            for &byte in bytes {
                wire.ecu.receive(clock::now_ns(), Ok(byte));
            }
        });
    }

    /// Sets whether to record every byte in both directions. Starting again clears the recording.
    pub fn record(&self, record: bool) {
        self.change(|wire| wire.record = record.then(Vec::new));
    }

    /// The recording so far, in the order in which the bytes ended.
    pub fn log(&self) -> Vec<Entry> {
        self.change(|wire| wire.record.clone().unwrap_or_default())
    }

    /// Takes the recording so far; recording continues.
    pub fn take_log(&self) -> Vec<Entry> {
        self.change(|wire| wire.record.as_mut().map(core::mem::take).unwrap_or_default())
    }

    /// Bytes that the node lost because it did not read in time.
    pub fn overruns(&self) -> u64 {
        self.change(|wire| wire.port.borrow().overruns)
    }
}

#[cfg(test)]
mod tests;
