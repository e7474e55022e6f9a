//! A simulated transmitter with a stick, a switch and, if a channel is set for it, a hand-over switch; and its receiver.

use embassy_time::{Duration, Instant, Timer};
use embedded_io_async::{ErrorType, Read};
use jetlink_rc::config::Protocol;
use jetlink_rc::runner::MeasuredPulse;
use jetlink_rc::settings::EngineSettings;
use sim::receiver::{self, Position};
use std::cell::Cell;
use std::convert::Infallible;

/// Time from which a transmitter that was turned on can stop engines at once: until 1 s after reception returned, `jetlink-rc` requires
/// that a stop is held.
const STEADY_AFTER: Duration = Duration::from_millis(1500);

/// The transmitter.
#[derive(Debug)]
pub struct Transmitter {
    /// Position of the stick, 0.1 %.
    pub stick: Cell<u16>,
    /// Position of the switch.
    pub switch: Cell<Position>,
    /// The hand-over switch is on: radio control leaves the engines to a lower source.
    pub hands_over: Cell<bool>,
    /// Time at which it was turned on; `None`: it is off.
    on_since: Cell<Option<Instant>>,
    /// Channels of stick, switch and hand-over switch; 0: there is none.
    channels: [u8; 3],
}

impl Transmitter {
    /// The stick at idle, the switch at stop, on the channels of these settings.
    pub const fn new(settings: &EngineSettings) -> Self {
        Self {
            channels: [settings.throttle, settings.switch, settings.hand_over],
            hands_over: Cell::new(false),
            stick: Cell::new(0),
            switch: Cell::new(Position::Stop),
            on_since: Cell::new(Some(Instant::MIN)),
        }
    }

    /// Turns it on or off.
    pub fn turn(&self, on: bool) {
        self.on_since.set(on.then(|| self.on_since.get().unwrap_or_else(Instant::now)));
    }

    /// Whether it has a hand-over switch.
    pub const fn has_hand_over(&self) -> bool {
        let [.., hand_over] = self.channels;
        hand_over != 0
    }

    /// Whether it is on.
    pub const fn is_on(&self) -> bool {
        self.on_since.get().is_some()
    }

    /// Whether it has been on long enough for a stop to take effect at once.
    pub fn is_steady(&self) -> bool {
        self.on_since.get().is_some_and(|since| Instant::now() >= since + STEADY_AFTER)
    }

    /// The frame that the receiver sends now; `None` while the transmitter is off, if the protocol has no flag for that.
    fn frame(&self, protocol: Protocol) -> Option<Vec<u8>> {
        let protocol = match protocol {
            Protocol::Sbus => receiver::Protocol::Sbus,
            Protocol::Crsf => receiver::Protocol::Crsf,
            Protocol::Pwm => return None,
        };
        let [throttle, switch, hand_over] = self.channels;
        let mut channels = receiver::channels_on([throttle, switch], self.stick.get(), self.switch.get());
        if let Some(channel) = usize::from(hand_over).checked_sub(1).and_then(|place| channels.get_mut(place))
        {
            *channel = receiver::steps(self.hand_over_us());
        }
        protocol.frame(channels, self.is_on())
    }

    /// Pulse width of the hand-over switch in µs.
    const fn hand_over_us(&self) -> u16 {
        if self.hands_over.get() { 2000 } else { 1000 }
    }

    /// Number of channels in use.
    fn count(&self) -> usize {
        if self.has_hand_over() { 3 } else { 2 }
    }

    /// The pulse that the receiver outputs now on the channel of the stick (0), of the switch (1) or of the hand-over switch (2).
    fn pulse(&self, place: usize) -> MeasuredPulse {
        let width = match place {
            0 => receiver::throttle_us(self.stick.get()),
            1 => self.switch.get().pulse_us(),
            _ => self.hand_over_us(),
        };
        let period = u32::try_from(PULSES_EVERY.as_micros()).unwrap_or(u32::MAX);
        MeasuredPulse { number: self.channels.get(place).copied().unwrap_or(0), width: width.into(), period }
    }
}

/// Time between two servo pulses of a channel.
const PULSES_EVERY: Duration = Duration::from_millis(20);

/// A receiver with servo pulses, as the node's timer measures them: one channel after the other, none while the transmitter is off.
#[derive(Debug)]
pub struct PulseReceiver<'a> {
    transmitter: &'a Transmitter,
    next: Instant,
    place: usize,
}

impl<'a> PulseReceiver<'a> {
    /// Starts now.
    pub fn new(transmitter: &'a Transmitter) -> Self {
        Self { transmitter, next: Instant::now(), place: 0 }
    }

    /// Waits for the next pulse.
    pub async fn next(&mut self) -> MeasuredPulse {
        loop {
            let count = self.transmitter.count();
            self.next += PULSES_EVERY / count as u32;
            Timer::at(self.next).await;
            self.place = (self.place + 1) % count;
            if self.transmitter.is_on() {
                return self.transmitter.pulse(self.place);
            }
        }
    }
}

/// A receiver with a serial protocol, as the node's UART reads it: each frame arrives as a whole.
#[derive(Debug)]
pub struct SerialReceiver<'a> {
    transmitter: &'a Transmitter,
    protocol: Protocol,
    next: Instant,
    bytes: Vec<u8>,
}

impl<'a> SerialReceiver<'a> {
    /// Starts now.
    pub fn new(transmitter: &'a Transmitter, protocol: Protocol) -> Self {
        Self { transmitter, protocol, next: Instant::now(), bytes: Vec::new() }
    }
}

impl ErrorType for SerialReceiver<'_> {
    type Error = Infallible;
}

impl Read for SerialReceiver<'_> {
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
