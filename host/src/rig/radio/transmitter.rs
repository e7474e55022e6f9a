//! A simulated transmitter with one stick and one switch, and the receiver on it.

use embassy_time::{Duration, Instant, Timer};
use embedded_io_async::{ErrorType, Read};
use jetlink_rc::config::Protocol;
use jetlink_rc::runner::MeasuredPulse;
use jetlink_rc::settings::EngineSettings;
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
    /// Channels of stick and switch.
    channels: [u8; 2],
}

impl Transmitter {
    /// The stick at idle, the switch at stop, on the channels of these settings.
    pub const fn new(settings: &EngineSettings) -> Self {
        Self {
            channels: [settings.throttle, settings.switch],
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
            Protocol::Pwm => return None,
        };
        protocol
            .frame(receiver::channels_on(self.channels, self.stick.get(), self.switch.get()), self.is_on())
    }

    /// The pulse that the receiver gives now on the channel of the stick (0) or of the switch (1).
    fn pulse(&self, place: usize) -> MeasuredPulse {
        let width = match place {
            0 => receiver::throttle_us(self.stick.get()),
            _ => self.switch.get().pulse_us(),
        };
        let period = u32::try_from(PULSES_EVERY.as_micros()).unwrap_or(u32::MAX);
        MeasuredPulse { number: self.channels.get(place).copied().unwrap_or(0), width: width.into(), period }
    }
}

/// Time between two servo pulses of a channel.
const PULSES_EVERY: Duration = Duration::from_millis(20);

/// The receiver with servo pulses, as the node's timer measures them: one channel after the other, and none without the transmitter.
#[derive(Debug)]
pub struct Pulses<'a> {
    transmitter: &'a Transmitter,
    next: Instant,
    place: usize,
}

impl<'a> Pulses<'a> {
    /// From now on.
    pub fn new(transmitter: &'a Transmitter) -> Self {
        Self { transmitter, next: Instant::now(), place: 0 }
    }

    /// The next one.
    pub async fn next(&mut self) -> MeasuredPulse {
        loop {
            self.next += PULSES_EVERY / 2;
            Timer::at(self.next).await;
            self.place = 1 - self.place;
            if self.transmitter.is_on() {
                return self.transmitter.pulse(self.place);
            }
        }
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
            Protocol::Crsf | Protocol::Pwm => Duration::from_millis(7),
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
