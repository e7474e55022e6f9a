//! The fuel pump that a service opened: when it is closed, and whether it still may be open.

use super::data::Engine;
use crate::link::Link;
use embassy_time::Instant;

impl Engine {
    pub(super) fn close_pump(&mut self) {
        if self.pump.take().is_some() {
            self.link.close_pump();
        }
    }

    /// Closes the pump, also one that was closed and still has a voltage: its frames may have been lost.
    pub(super) fn close_pump_again(&mut self) {
        if self.pump.take().is_some() || self.link.service_frames().pump_is_open {
            self.link.close_pump();
        }
    }

    /// Whether a pump that a service opened is open, or may be.
    pub(super) fn pump_may_be_open(&self) -> bool {
        let frames = self.link.service_frames();
        self.pump.is_some() || frames.closing_pump || frames.pump_is_open
    }

    /// Time at which a pump that a service opened is closed: after its maximum time, or the timeout of its source.
    pub(super) fn pump_ends(&self) -> Option<Instant> {
        let pump = self.pump?;
        let last_rx =
            self.sources.last_commanded(pump.origin).map_or(pump.last_rx, |at| at.max(pump.last_rx));
        let silent = last_rx.checked_add(self.config.timeouts.of(pump.origin)).unwrap_or(Instant::MAX);
        Some(silent.min(pump.until))
    }
}
