//! A receiver of radio control at the far end of a UART: one stick, one switch, frames at its own pace.

use sim::ecu::{Ecu, LineFault, MILLIS, Nanos};
use sim::line::Line;
use sim::receiver::{CHANNELS, crsf, sbus, steps};

/// Protocol of a receiver.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Protocol {
    /// SBUS, a frame every 14 ms.
    Sbus,
    /// CRSF, a frame every 4 ms.
    Crsf,
}

/// Position of the switch, as a pulse width in µs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[expect(missing_docs, reason = "as in docs/rc.md")]
pub enum Position {
    Stop = 1000,
    Standby = 1500,
    Run = 2000,
}

/// A receiver, which has power with the board.
#[derive(Debug)]
pub struct Receiver {
    protocol: Protocol,
    next: Nanos,
    plugged: bool,
    /// Throttle in percent: channel 3, 1100 to 1900 µs.
    pub stick: u16,
    /// Switch: channel 5.
    pub switch: Position,
    /// The transmitter is on. Without it an SBUS frame says so, and no CRSF frame comes.
    pub transmitter: bool,
}

impl Receiver {
    /// The stick at idle, the switch at stop, the transmitter on.
    pub fn new(protocol: Protocol) -> Self {
        Self { protocol, next: 0, plugged: true, stick: 0, switch: Position::Stop, transmitter: true }
    }

    /// Its line.
    pub fn line(&self) -> Line {
        match self.protocol {
            Protocol::Sbus => Line::e2(100_000),
            Protocol::Crsf => Line::n1(420_000),
        }
    }

    /// Time between two frames.
    pub fn period(&self) -> Nanos {
        match self.protocol {
            Protocol::Sbus => 14 * MILLIS,
            Protocol::Crsf => 4 * MILLIS,
        }
    }

    /// What it sends now.
    pub fn frame(&self) -> Vec<u8> {
        let mut channels = [steps(1500); CHANNELS];
        channels[2] = steps(1100 + self.stick * 8);
        channels[4] = steps(self.switch as u16);
        match (self.protocol, self.transmitter) {
            (Protocol::Sbus, true) => sbus(channels, 0),
            // Frame lost, and fail-safe.
            (Protocol::Sbus, false) => sbus(channels, 0x0C),
            (Protocol::Crsf, true) => crsf(channels),
            (Protocol::Crsf, false) => Vec::new(),
        }
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
