//! The two directions between one UART of the node and one ECU, byte by byte in real line time.
//!
//! [`connect`] gives the node's halves, which behave like embassy-stm32's `BufferedUart`: `write`
//! puts bytes into a ring and returns, `flush` waits for the last stop bit, and a reader is woken
//! at every byte. The third part, the [`Plug`], moves the bytes and is where faults are switched.
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

/// Everything about a connection that is set before it is made.
#[derive(Clone, Copy, Debug)]
pub struct Settings {
    /// How the node's UART is set.
    pub node: Line,
    /// How the ECU's UART is set.
    pub ecu: Line,
    /// Bytes in the node's transmit ring.
    pub tx_ring: usize,
    /// Bytes in the node's receive ring; more are dropped, as `BufferedUart` does.
    pub rx_ring: usize,
    /// All that is random on this wire comes from this number.
    pub seed: u64,
}

impl Settings {
    /// Both ends set alike, with rings of 64 and 256 bytes.
    pub const fn new(line: Line, seed: u64) -> Self {
        Self { node: line, ecu: line, tx_ring: 64, rx_ring: 256, seed }
    }
}

/// Connects a UART of the node with an ECU; both ends are set to `line`.
pub fn connect<E: Ecu>(ecu: E, line: Line, seed: u64) -> (WireRx, WireTx, Plug<E>) {
    connect_with(ecu, Settings::new(line, seed))
}

/// As [`connect`], with the two ends set differently: a mistake in somebody's configuration.
pub fn connect_mismatched<E: Ecu>(
    ecu: E,
    node: Line,
    ecu_line: Line,
    seed: u64,
) -> (WireRx, WireTx, Plug<E>) {
    connect_with(ecu, Settings { ecu: ecu_line, ..Settings::new(node, seed) })
}

/// As [`connect`], with everything settable.
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
    // The ECU learns what time it is: a fresh one is powered up now.
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
    /// The node's transmitter was stalled until then.
    not_before: Nanos,
}

impl<E: Ecu> Wire<E> {
    /// Does everything that happens up to and including `now`, in the order of time.
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
            self.ecu.heard(
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
            assert!(self.ecu.next_wake() > at, "an ECU that wants to be woken in the past never ends");
        }
        self.start_ecu_byte(at);
    }

    fn advance_ecu(&mut self, at: Nanos) {
        self.ecu.advance(at, &mut self.scratch);
        if self.babble.is_some() {
            // The transmitter is stuck: what the ECU wants to say never gets out.
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

    /// `free` is when the shifter got free; a byte cannot start before it was written.
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

/// Moves the bytes of one connection, and is the handle to its ECU and to its faults.
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
    /// Drives the ECU and both directions for ever; join it with the node's future.
    pub async fn run(&self) -> Infallible {
        poll_fn(|cx| {
            let mut wire = self.wire.borrow_mut();
            let now = clock::now_ns();
            wire.settle(now);
            // The end of a byte lies between two ticks: look again at the first tick after it.
            let next = wire.next_event().map_or(u64::MAX, |at| at.div_ceil(1000));
            embassy_time_driver::schedule_wake(next, cx.waker());
            wire.port.borrow_mut().set_runner(cx);
            Poll::Pending
        })
        .await
    }

    /// Everything up to this instant happens first, then the change, then the runner looks again.
    fn change<T>(&self, change: impl FnOnce(&mut Wire<E>) -> T) -> T {
        let mut wire = self.wire.borrow_mut();
        wire.settle(clock::now_ns());
        let result = change(&mut wire);
        wire.port.borrow().wake_runner();
        result
    }

    /// Looks at the ECU, or does something to it, as it is at this instant.
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

    /// The node is reset: what its UART held is gone, and the byte under way is cut short. Gives the halves
    /// for the node that starts; the old ones must be gone.
    pub fn reset_node(&self) -> (WireRx, WireTx) {
        self.change(|wire| {
            wire.to_ecu.spoil();
            wire.port.borrow_mut().reset();
        });
        let port = self.wire.borrow().port.clone();
        (WireRx::new(port.clone()), WireTx::new(port))
    }

    /// What goes wrong at random from now on, in each direction.
    pub fn set_faults(&self, to_node: Faults, to_ecu: Faults) {
        self.change(|wire| {
            wire.to_node.faults = to_node;
            wire.to_ecu.faults = to_ecu;
        });
    }

    /// At each byte with a framing error that arrives as data, the UART's interrupt does this, as one that counts the flags of
    /// its status register.
    pub fn on_framing_error(&self, count: impl Fn() + 'static) {
        self.change(|wire| wire.port.borrow_mut().framing_handler = Some(FramingHandler(Box::new(count))));
    }

    /// What the node's UART makes of bytes with a framing error.
    pub fn framing(&self, framing: FramingAs) {
        self.change(|wire| wire.port.borrow_mut().framing = framing);
    }

    /// Cuts the line, both ways, or joins it again. A byte under way at that instant is lost.
    ///
    /// A cut line idles high: nobody hears anything, and the node's UART notices nothing.
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

    /// Another ECU, with the engine behind it, is plugged in and powered up now. Gives the one before.
    pub fn replace_ecu(&self, ecu: E) -> E {
        self.change(|wire| {
            let before = core::mem::replace(&mut wire.ecu, ecu);
            wire.to_node.queue.clear();
            wire.to_node.spoil();
            wire.advance_ecu(clock::now_ns());
            before
        })
    }

    /// A UART whose transmitter hangs: while `true`, no flush of the node ever ends, and no write that finds the ring full.
    ///
    /// The byte in the shifter still goes out. What is written meanwhile waits in the ring, as it does in a driver with a buffer.
    pub fn stall_tx(&self, stalled: bool) {
        self.change(|wire| {
            wire.not_before = clock::now_ns();
            let mut port = wire.port.borrow_mut();
            port.stalled = stalled;
            port.wake_writer();
        });
    }

    /// Whether the node hears its own bytes: a half-duplex line by mistake. Bytes of both sides at
    /// the same time do not disturb each other here, as they would on a real one.
    pub fn echo(&self, echo: bool) {
        self.change(|wire| wire.echo = echo);
    }

    /// Whether garbage comes from the ECU's transmitter without a pause, and which. Its own frames
    /// are lost meanwhile; it still hears the host.
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

    /// Sends these bytes to the node as if the ECU did, after what it is sending.
    pub fn inject_to_node(&self, bytes: &[u8]) {
        self.change(|wire| {
            wire.to_node.queue.extend(bytes);
            wire.start_ecu_byte(clock::now_ns());
        });
    }

    /// Lets the ECU hear these bytes at once, as if somebody else were on the line.
    pub fn inject_to_ecu(&self, bytes: &[u8]) {
        self.change(|wire| {
            for &byte in bytes {
                wire.ecu.heard(clock::now_ns(), Ok(byte));
            }
        });
    }

    /// Whether to write down every byte of both directions. Starting anew forgets what was written.
    pub fn record(&self, record: bool) {
        self.change(|wire| wire.record = record.then(Vec::new));
    }

    /// What was recorded so far, in the order in which the bytes ended.
    pub fn log(&self) -> Vec<Entry> {
        self.change(|wire| wire.record.clone().unwrap_or_default())
    }

    /// What was recorded so far; the record goes on empty.
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
