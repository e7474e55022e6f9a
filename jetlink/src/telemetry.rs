//! Snapshot of one engine: the report of its ECU, its order and sources, and the state of its supervision.

use crate::command::{Demand, Order, Ordered, Origin};
use crate::engine::state::EngineState;
use crate::event::LossStage;
use crate::indication::Indication;
use crate::report::{Counters, LinkState, REPORT_MAX_AGE, Report, Timed};
use crate::units::Millivolts;
use embassy_time::Instant;

/// Shaft speed below which an engine is considered at rest.
const REST_RPM: u32 = 1000;

/// A snapshot of one engine.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub struct Telemetry {
    /// Time of the snapshot.
    pub at: Instant,
    /// State of the link to the ECU.
    pub link: LinkState,
    /// Time at which the last good frame was complete.
    pub last_rx: Option<Instant>,
    /// State of the engine.
    pub state: EngineState,
    /// Report of the ECU.
    pub report: Report,
    /// Supply voltage: the ECU's, or the board's where the ECU reports none.
    pub supply: Option<Timed<Millivolts>>,
    /// Order in force, and its origin.
    pub ordered: Ordered,
    /// Whether the reports of the ECU match the order; see [`crate::event::Event::NotObeyed`].
    pub obeyed: bool,
    /// Active source: of a running engine the one whose demand is in force, otherwise the highest fresh one, or the origin of
    /// the order if none is fresh.
    pub active_source: Origin,
    /// Time of its last command.
    pub source_last_rx: Option<Instant>,
    /// Its demand for a running engine, before ramps, slew and limits.
    pub commanded: Option<Demand>,
    /// Source that waits to take over, or that has returned after a loss: the demand is held meanwhile.
    pub waiting: Option<Origin>,
    /// Stage of loss of the active source.
    pub loss: LossStage,
    /// A limit has lowered the demand to the fail-safe throttle, where it stays until standby is commanded.
    pub limited: bool,
    /// Time since which it has been in doubt whether the engine still runs: the demand is withheld, but for replies to an AMT ECU
    /// whose exhaust or shaft shows a running engine.
    pub in_doubt: Option<Instant>,
    /// End of the wait of a start for another engine of the group.
    pub start_waits_until: Option<Instant>,
    /// No transmission has succeeded for 1 s.
    pub transmitter_failed: bool,
    /// The engine is armed.
    pub armed: bool,
    /// An emergency stop is latched.
    pub stop_latched: bool,
    /// A service that moves fuel or heats is permitted: the ECU may have a pump open or a valve.
    pub fuel_service: bool,
    /// Latest time to reach running, while a start is under way.
    pub start_by: Option<Instant>,
    /// The engine ran, and stopped or fell silent without a command.
    pub failed: bool,
    /// Number of other engines of the group that have failed.
    pub others_failed: u8,
    /// Counters of the link and of commands.
    pub counters: Counters,
}

impl Telemetry {
    /// A value, if it was received within the last 3 s: an older one no longer describes the engine.
    pub fn current<T: Copy>(&self, value: Option<Timed<T>>) -> Option<T> {
        value.filter(|value| self.is_current(value.at)).map(|value| value.value)
    }

    /// Not inlined: it would be in an image some 30 times.
    #[inline(never)]
    fn is_current(&self, at: Instant) -> bool {
        self.at.saturating_duration_since(at) <= REPORT_MAX_AGE
    }

    /// Whether a current shaft speed is 1000 rpm or above; `None` without one.
    pub fn shaft_turns(&self) -> Option<bool> {
        self.current(self.report.rpm).map(|rpm| rpm.get() >= REST_RPM)
    }

    /// Whether the engine turns, or is ordered to. One that is no longer received, or of which only error sets are, counts as turning if
    /// its last shaft speed was 1000 rpm or above.
    pub fn turns(&self) -> bool {
        let ordered = matches!(self.ordered.order, Order::Run(_) | Order::Doubt(_) | Order::Pwm);
        let state = matches!(
            self.state,
            EngineState::StartRequested
                | EngineState::Starting(_)
                | EngineState::Running
                | EngineState::ShuttingDown
        );
        let shaft = self.report.rpm.is_some_and(|rpm| rpm.value.get() >= REST_RPM);
        ordered || state || shaft
    }

    /// What the status LED shows of the engine.
    pub fn indication(&self) -> Indication {
        let fault = self.link != LinkState::Up
            || self.in_doubt.is_some()
            || self.limited
            || !self.obeyed
            || self.transmitter_failed
            || self.report.is_faulty();
        match () {
            () if fault => Indication::Fault,
            () if self.stop_latched => Indication::StopLatched,
            () if self.loss != LossStage::None => Indication::SourceLost,
            () if self.turns() => Indication::Running,
            () if self.armed => Indication::Armed,
            () => Indication::AtRest,
        }
    }

    /// Whether the engine needs attention.
    pub fn needs_attention(&self) -> bool {
        self.indication() >= Indication::SourceLost
    }
}
