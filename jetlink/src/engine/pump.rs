//! Fuel into an engine at rest: whether it is cold, and when the pump that a service opened is closed.

use super::data::{Engine, Mode};
use super::exhaust::Exhaust;
use crate::command::Interlock;
use crate::link::Link;
use crate::report::Phase;
use embassy_time::{Duration, Instant};

impl Engine {
    pub(super) fn close_pump(&mut self) {
        if self.pump.take().is_some() {
            self.link.close_pump();
        }
    }

    /// Closes the pump, also one that was closed and still has a voltage: its frames may have been lost.
    pub(super) fn close_pump_again(&mut self) {
        if self.pump.take().is_some() || self.pump_has_voltage() {
            self.link.close_pump();
        }
    }

    /// Whether a pump that a service opened is open, or may be.
    pub(super) fn pump_may_be_open(&self) -> bool {
        self.pump.is_some() || self.link.service_frames().closing_pump || self.pump_has_voltage()
    }

    /// Whether a pump that was closed still has a voltage. That of an engine that is ordered to run, or may run, is its own.
    fn pump_has_voltage(&self) -> bool {
        matches!(self.mode, Mode::Standby | Mode::Stop(_)) && self.link.service_frames().pump_is_open
    }

    /// Time at which a pump that a service opened is closed: after its maximum time, or the timeout of its source.
    pub(super) fn pump_ends(&self) -> Option<Instant> {
        let pump = self.pump?;
        let last_rx =
            self.sources.last_commanded(pump.origin).map_or(pump.last_rx, |at| at.max(pump.last_rx));
        let silent = last_rx.checked_add(self.config.timeouts.of(pump.origin)).unwrap_or(Instant::MAX);
        Some(silent.min(pump.until))
    }

    /// Whether the engine is hot or has left standby since a service that moves fuel or heats was permitted. A service in progress is
    /// not standby either. An unknown EGT counts as not hot.
    pub(super) fn fuel_is_unsafe(&self, now: Instant) -> bool {
        let phase = self.link.status().report.phase.map(|phase| phase.value);
        let left = matches!(phase, Some(Phase::Cooling | Phase::Starting | Phase::Running));
        left || matches!(self.cold(now), Err(Interlock::TooHot(_)))
    }

    /// Whether the exhaust is cool in two consecutive values: AMT frames carry no checksum.
    pub(super) fn cold(&self, now: Instant) -> Result<(), Interlock> {
        let rules = &self.config.start;
        let max_age = rules.link_stable.max(Duration::from_secs(1));
        let egt = self.link.status().report.egt.filter(|egt| egt.age(now) <= max_age);
        // A broken thermocouple reads −50 °C, which must not pass as cool.
        let Some(egt) = egt.filter(|egt| Exhaust::is_plausible(egt.value)) else {
            return Err(Interlock::EgtUnknown);
        };
        let hottest = self.limits.hottest().unwrap_or(egt.value).max(egt.value);
        if hottest > rules.egt_max { Err(Interlock::TooHot(hottest)) } else { Ok(()) }
    }
}
