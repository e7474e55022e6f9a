//! What a node knows of its own board, beside what it knows of its engines.

use core::sync::atomic::{AtomicU8, Ordering};

/// What the board's clocks are made from, and with them every baud rate and the node's own time.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[repr(u8)]
pub enum ClockSource {
    /// Nobody has said.
    #[default]
    Unknown,
    /// The board's crystal, or the clock that comes in its place.
    Crystal,
    /// The chip's own oscillator, because the crystal does not run: off by a percent or more, with the temperature.
    Internal,
}

/// The state of a node's board.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Health {
    /// What the clocks are made from.
    pub clock: ClockSource,
}

impl Health {
    /// Whether a person should look at the board.
    pub const fn needs_attention(&self) -> bool {
        matches!(self.clock, ClockSource::Internal)
    }
}

/// Holds a node's [`Health`]; the board's firmware writes it, telemetry reads it.
#[derive(Debug)]
pub(crate) struct HealthCell {
    clock: AtomicU8,
}

impl HealthCell {
    pub(crate) const fn new() -> Self {
        Self { clock: AtomicU8::new(ClockSource::Unknown as u8) }
    }

    pub(crate) fn set_clock(&self, clock: ClockSource) {
        self.clock.store(clock as u8, Ordering::Relaxed);
    }

    pub(crate) fn get(&self) -> Health {
        let known = [ClockSource::Crystal, ClockSource::Internal];
        let stored = self.clock.load(Ordering::Relaxed);
        let clock = known.into_iter().find(|&clock| clock as u8 == stored).unwrap_or_default();
        Health { clock }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_the_internal_oscillator_needs_attention() {
        let cell = HealthCell::new();
        assert_eq!(cell.get(), Health { clock: ClockSource::Unknown });
        for (clock, attention) in
            [(ClockSource::Crystal, false), (ClockSource::Internal, true), (ClockSource::Unknown, false)]
        {
            cell.set_clock(clock);
            assert_eq!(cell.get(), Health { clock });
            assert_eq!(cell.get().needs_attention(), attention, "{clock:?}");
        }
    }
}
