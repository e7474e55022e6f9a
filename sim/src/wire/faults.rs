//! Faults of a line, and the recording of what happened to each byte.

use crate::ecu::Nanos;

/// Random faults in one direction. The default is a clean line.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Faults {
    /// Probability that a data bit arrives inverted, in millionths.
    pub flip_per_million: u32,
    /// Probability that a byte is lost, in millionths.
    pub lose_per_million: u32,
    /// Probability that a random byte arrives directly after a byte, in millionths.
    pub add_per_million: u32,
    /// Probability that a byte arrives with a framing error, in millionths.
    pub framing_per_million: u32,
    /// Fixed delay of every byte.
    pub delay_ns: Nanos,
    /// Largest random delay of a byte; bytes never overtake each other.
    pub jitter_ns: Nanos,
}

impl Faults {
    /// A line that loses, adds, flips and corrupts about one byte in a thousand each.
    pub const NOISY: Self = Self {
        flip_per_million: 125,
        lose_per_million: 1000,
        add_per_million: 1000,
        framing_per_million: 1000,
        delay_ns: 0,
        jitter_ns: 0,
    };
}

/// Treatment of a byte with a framing error by the node's UART.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum FramingAs {
    /// A byte like any other, with a wrong value: embassy-stm32's `BufferedUart`, which only logs.
    #[default]
    Data,
    /// An error from `read`, in place of the byte: embassy-stm32's `RingBufferedUartRx`.
    Error,
}

/// Garbage that a stuck transmitter sends.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Babble {
    /// Random bytes.
    Random,
    /// These bytes repeatedly, for example the head of a frame; zeros when empty.
    Repeat(Vec<u8>),
}

/// Direction of a byte.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Direction {
    /// From the ECU to the node.
    ToNode,
    /// From the node to the ECU.
    ToEcu,
}

/// Fate of a byte.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fate {
    /// It arrived as it was sent.
    Delivered,
    /// It was lost: at random, by a cut, or because its sender lost power.
    Lost,
    /// It arrived with this value.
    Flipped(u8),
    /// It arrived with a framing error, with this value if at all.
    Framing(u8),
    /// It was not sent, but appeared on the line.
    Added,
}

/// One byte on the line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Entry {
    /// Its direction.
    pub direction: Direction,
    /// The byte as it was sent, before any fault.
    pub byte: u8,
    /// Start of its start bit.
    pub start: Nanos,
    /// End of its last stop bit, at the sender.
    pub end: Nanos,
    /// Its fate.
    pub fate: Fate,
}

impl Entry {
    /// These bytes back to back, which arrived as they were sent.
    pub fn delivered(direction: Direction, from: Nanos, byte_time: Nanos, bytes: &[u8]) -> Vec<Self> {
        let entry = |(i, &byte): (Nanos, &u8)| {
            let start = from + i * byte_time;
            Self { direction, byte, start, end: start + byte_time, fate: Fate::Delivered }
        };
        (0..).zip(bytes).map(entry).collect()
    }
}
