//! Health of a node's own board.

use core::sync::atomic::{AtomicU8, Ordering};

/// Source of the board's clocks, and so of every baud rate and of the node's time.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[repr(u8)]
pub enum ClockSource {
    /// Not set.
    #[default]
    Unknown,
    /// The board's crystal or external clock.
    Crystal,
    /// The chip's own oscillator, because the crystal does not run: wrong by 1 % or more, depending on temperature.
    Internal,
}

/// Health of a node's board.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub struct Health {
    /// Source of the clocks.
    pub clock: ClockSource,
}

impl Health {
    /// Whether the board needs attention.
    pub const fn needs_attention(&self) -> bool {
        matches!(self.clock, ClockSource::Internal)
    }
}

/// Storage of a node's [`Health`], written by the firmware and read for telemetry.
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
