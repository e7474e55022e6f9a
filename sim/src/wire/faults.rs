//! What can be wrong with a line, and the record of what happened to each byte.

use crate::ecu::Nanos;

/// Faults that strike at random in one direction. The default is a clean line.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Faults {
    /// Chance of each data bit to arrive inverted, in millionths.
    pub flip_per_million: u32,
    /// Chance of each byte not to arrive, in millionths.
    pub lose_per_million: u32,
    /// Chance that a byte of random value arrives directly after a byte, in millionths.
    pub add_per_million: u32,
    /// Chance of each byte to arrive with a framing error, in millionths.
    pub framing_per_million: u32,
    /// Every byte arrives so much later.
    pub delay_ns: Nanos,
    /// Every byte arrives later by a random time up to this; bytes never overtake each other.
    pub jitter_ns: Nanos,
}

impl Faults {
    /// A line that loses, adds, flips and breaks about one byte in a thousand each.
    pub const NOISY: Self = Self {
        flip_per_million: 125,
        lose_per_million: 1000,
        add_per_million: 1000,
        framing_per_million: 1000,
        delay_ns: 0,
        jitter_ns: 0,
    };
}

/// What the node's UART makes of a byte with a framing error.
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
    /// These bytes over and over, for example the head of a frame; zeros when empty.
    Repeat(Vec<u8>),
}

/// Which way a byte went.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Direction {
    /// From the ECU to the node.
    ToNode,
    /// From the node to the ECU.
    ToEcu,
}

/// What became of a byte.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fate {
    /// It arrived as it was sent.
    Delivered,
    /// It did not arrive: lost at random, cut off, or its sender lost power.
    Lost,
    /// It arrived as this value.
    Flipped(u8),
    /// It arrived with a framing error, as this value if at all.
    Framing(u8),
    /// Nobody sent it: it appeared on the line.
    Added,
}

/// One byte on the line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Entry {
    /// Which way it went.
    pub direction: Direction,
    /// The byte as it was sent, before any fault.
    pub byte: u8,
    /// The beginning of its start bit.
    pub start: Nanos,
    /// The end of its last stop bit, where the sender is.
    pub end: Nanos,
    /// What became of it.
    pub fate: Fate,
}
