//! A simulated transmitter with one stick and one switch, and the receiver on it.

use super::choice::Kind;
use embassy_time::{Duration, Instant, Timer};
use embedded_io_async::{ErrorType, Read};
use sim::receiver::{CHANNELS, crsf, sbus, steps};
use std::cell::Cell;
use std::convert::Infallible;

/// Places of throttle and switch among the channels, from 0: the defaults of the settings, channels 3 and 5.
const THROTTLE: usize = 2;
const SWITCH: usize = 4;
/// Time after a return in which a stop has to be held.
const RETURN: Duration = Duration::from_millis(1500);
/// Flags of an SBUS receiver without its transmitter: frame lost, and fail-safe.
const LOST: u8 = 0x0C;

/// Position of the switch.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Position {
    /// Stop.
    Stop,
    /// Standby.
    Standby,
    /// Run allowed.
    Run,
}

impl Position {
    const fn pulse(self) -> u16 {
        match self {
            Self::Stop => 1000,
            Self::Standby => 1500,
            Self::Run => 2000,
        }
    }

    /// Name in lower case.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Stop => "stop",
            Self::Standby => "standby",
            Self::Run => "run allowed",
        }
    }
}

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
    fn frame(&self, kind: Kind) -> Option<Vec<u8>> {
        let mut channels = [steps(1500); CHANNELS];
        channels[THROTTLE] = steps(1100 + self.stick.get() * 8 / 10);
        channels[SWITCH] = steps(self.switch.get().pulse());
        match (kind, self.is_on()) {
            (Kind::Sbus, on) => Some(sbus(channels, if on { 0 } else { LOST })),
            (Kind::Crsf, true) => Some(crsf(channels)),
            (Kind::Crsf, false) => None,
        }
    }
}

/// The receiver, as the node's UART has it: each frame arrives as a whole.
#[derive(Debug)]
pub struct Air<'a> {
    transmitter: &'a Transmitter,
    kind: Kind,
    next: Instant,
    bytes: Vec<u8>,
}

impl<'a> Air<'a> {
    /// From now on.
    pub fn new(transmitter: &'a Transmitter, kind: Kind) -> Self {
        Self { transmitter, kind, next: Instant::now(), bytes: Vec::new() }
    }
}

impl ErrorType for Air<'_> {
    type Error = Infallible;
}

impl Read for Air<'_> {
    async fn read(&mut self, buffer: &mut [u8]) -> Result<usize, Infallible> {
        let every = match self.kind {
            Kind::Sbus => Duration::from_millis(14),
            Kind::Crsf => Duration::from_millis(7),
        };
        while self.bytes.is_empty() {
            self.next += every;
            Timer::at(self.next).await;
            self.bytes = self.transmitter.frame(self.kind).unwrap_or_default();
        }
        let count = self.bytes.len().min(buffer.len());
        self.bytes.drain(..count).zip(buffer).for_each(|(byte, slot)| *slot = byte);
        Ok(count)
    }
}
