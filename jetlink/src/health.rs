//! Health of a node's own board.

use core::sync::atomic::{AtomicBool, AtomicU8, Ordering};

/// Source of the board's clocks, and so of every baud rate and of the node's time.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[repr(u8)]
#[non_exhaustive]
pub enum ClockSource {
    /// Not set.
    #[default]
    Unknown,
    /// The board's crystal or external clock.
    Crystal,
    /// The internal oscillator, because the crystal does not run: wrong by 1 % or more, depending on temperature.
    Internal,
}

/// Health of a node's board.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub struct Health {
    /// Source of the clocks.
    pub clock: ClockSource,
    /// The stored settings are damaged, and nobody has confirmed the present ones.
    pub settings_damaged: bool,
}

impl Health {
    /// Whether the board needs attention.
    pub const fn needs_attention(&self) -> bool {
        matches!(self.clock, ClockSource::Internal) || self.settings_damaged
    }
}

/// Storage of a node's [`Health`], written by the firmware and read for telemetry.
#[derive(Debug)]
pub(crate) struct HealthCell {
    clock: AtomicU8,
    settings_damaged: AtomicBool,
}

impl HealthCell {
    pub(crate) const fn new() -> Self {
        Self { clock: AtomicU8::new(ClockSource::Unknown as u8), settings_damaged: AtomicBool::new(false) }
    }

    pub(crate) fn set_clock(&self, clock: ClockSource) {
        self.clock.store(clock as u8, Ordering::Relaxed);
    }

    pub(crate) fn set_settings_damaged(&self, damaged: bool) {
        self.settings_damaged.store(damaged, Ordering::Relaxed);
    }

    pub(crate) fn get(&self) -> Health {
        let known = [ClockSource::Crystal, ClockSource::Internal];
        let stored = self.clock.load(Ordering::Relaxed);
        let clock = known.into_iter().find(|&clock| clock as u8 == stored).unwrap_or_default();
        Health { clock, settings_damaged: self.settings_damaged.load(Ordering::Relaxed) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_internal_oscillator_and_damaged_settings_need_attention() {
        let cell = HealthCell::new();
        assert_eq!(cell.get(), Health::default());
        cell.set_settings_damaged(true);
        assert!(cell.get().settings_damaged && cell.get().needs_attention());
        cell.set_settings_damaged(false);
        for (clock, attention) in
            [(ClockSource::Crystal, false), (ClockSource::Internal, true), (ClockSource::Unknown, false)]
        {
            cell.set_clock(clock);
            assert_eq!(cell.get(), Health { clock, settings_damaged: false });
            assert_eq!(cell.get().needs_attention(), attention, "{clock:?}");
        }
    }
}
