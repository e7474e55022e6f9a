//! A simulated transmitter with one stick and one switch, and the receiver on it.

use embassy_time::{Duration, Instant, Timer};
use embedded_io_async::{ErrorType, Read};
use jetlink_rc::config::Protocol;
use sim::receiver::{self, Position};
use std::cell::Cell;
use std::convert::Infallible;

/// Time after a return in which a stop has to be held.
const RETURN: Duration = Duration::from_millis(1500);

/// The transmitter.
#[derive(Debug)]
pub struct Transmitter {
    /// The stick, in tenths of a percent.
    pub stick: Cell<u16>,
    /// The switch.
    pub switch: Cell<Position>,
    /// Since when it is on.
    on_since: Cell<Option<Instant>>,
}

impl Transmitter {
    /// The stick at idle, the switch at stop.
    pub const fn new() -> Self {
        Self {
            stick: Cell::new(0),
            switch: Cell::new(Position::Stop),
            on_since: Cell::new(Some(Instant::MIN)),
        }
    }

    /// Turns it on or off.
    pub fn turn(&self, on: bool) {
        self.on_since.set(on.then(|| self.on_since.get().unwrap_or_else(Instant::now)));
    }

    /// Whether it is on.
    pub const fn is_on(&self) -> bool {
        self.on_since.get().is_some()
    }

    /// Whether it has been on for long enough that a stop counts at once.
    pub fn is_steady(&self) -> bool {
        self.on_since.get().is_some_and(|since| Instant::now() >= since + RETURN)
    }

    /// What the receiver sends now; nothing without the transmitter, if the protocol has no flag for that.
    fn frame(&self, protocol: Protocol) -> Option<Vec<u8>> {
        let protocol = match protocol {
            Protocol::Sbus => receiver::Protocol::Sbus,
            Protocol::Crsf => receiver::Protocol::Crsf,
        };
        protocol.frame(receiver::channels(self.stick.get(), self.switch.get()), self.is_on())
    }
}

/// The receiver, as the node's UART has it: each frame arrives as a whole.
#[derive(Debug)]
pub struct Air<'a> {
    transmitter: &'a Transmitter,
    protocol: Protocol,
    next: Instant,
    bytes: Vec<u8>,
}

impl<'a> Air<'a> {
    /// From now on.
    pub fn new(transmitter: &'a Transmitter, protocol: Protocol) -> Self {
        Self { transmitter, protocol, next: Instant::now(), bytes: Vec::new() }
    }
}

impl ErrorType for Air<'_> {
    type Error = Infallible;
}

impl Read for Air<'_> {
    async fn read(&mut self, buffer: &mut [u8]) -> Result<usize, Infallible> {
        let every = match self.protocol {
            Protocol::Sbus => Duration::from_millis(14),
            Protocol::Crsf => Duration::from_millis(7),
        };
        while self.bytes.is_empty() {
            self.next += every;
            Timer::at(self.next).await;
            self.bytes = self.transmitter.frame(self.protocol).unwrap_or_default();
        }
        let count = self.bytes.len().min(buffer.len());
        self.bytes.drain(..count).zip(buffer).for_each(|(byte, slot)| *slot = byte);
        Ok(count)
    }
}
