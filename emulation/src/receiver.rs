//! A receiver of radio control at the far end of a UART: one stick, one switch, frames at its own pace.

use sim::ecu::{Ecu, LineFault, MILLIS, Nanos};
use sim::line::Line;
use sim::receiver::steps;
pub use sim::receiver::{Position, Protocol};

/// A receiver, which has power with the board.
#[derive(Debug)]
pub struct Receiver {
    protocol: Protocol,
    next: Nanos,
    plugged: bool,
    /// Throttle in percent.
    pub stick: u16,
    /// Switch.
    pub switch: Position,
    /// The transmitter is on.
    pub transmitter: bool,
    /// Its line is inverted. Only the inverter of a board's socket takes notice of it.
    pub inverted: bool,
    /// Pulses of other channels, in µs, by their numbers from 1.
    pub others: Vec<(u8, u16)>,
}

impl Receiver {
    /// The stick at idle, the switch at stop, the transmitter on.
    pub fn new(protocol: Protocol) -> Self {
        Self {
            protocol,
            next: 0,
            plugged: true,
            stick: 0,
            switch: Position::Stop,
            transmitter: true,
            inverted: protocol == Protocol::Sbus,
            others: Vec::new(),
        }
    }

    /// Its line.
    pub fn line(&self) -> Line {
        self.protocol.line()
    }

    /// Time between two frames.
    pub fn period(&self) -> Nanos {
        match self.protocol {
            Protocol::Sbus => 14 * MILLIS,
            Protocol::Crsf => 4 * MILLIS,
        }
    }

    /// Frame that it sends now.
    pub fn frame(&self) -> Vec<u8> {
        let mut channels = sim::receiver::channels(self.stick * 10, self.switch);
        for (number, pulse) in &self.others {
            channels[usize::from(*number) - 1] = steps(*pulse);
        }
        self.protocol.frame(channels, self.transmitter).unwrap_or_default()
    }
}

impl Ecu for Receiver {
    fn next_wake(&self) -> Nanos {
        if self.plugged { self.next } else { Nanos::MAX }
    }

    fn advance(&mut self, now: Nanos, tx: &mut Vec<u8>) {
        if self.plugged && now >= self.next {
            tx.extend(self.frame());
            self.next = now + self.period();
        }
    }

    fn receive(&mut self, _: Nanos, _: Result<u8, LineFault>) {}

    /// Unplugs it, or plugs it in.
    fn power(&mut self, now: Nanos, on: bool) {
        (self.plugged, self.next) = (on, now);
    }
}
