//! A snapshot of one engine: what its ECU has said, what is commanded, and how the two stand to one another.

use crate::command::{Demand, Ordered, Origin};
use crate::engine::state::EngineState;
use crate::event::LossStage;
use crate::report::{Counters, LinkState, Report, Timed};
use embassy_time::{Duration, Instant};

/// Older values are not shown as current.
const CURRENT: Duration = Duration::from_secs(3);

/// A snapshot of one engine.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Telemetry {
    /// When it was taken.
    pub at: Instant,
    /// Whether the ECU is heard.
    pub link: LinkState,
    /// When the last good frame was complete.
    pub last_rx: Option<Instant>,
    /// What the engine does, in plain words.
    pub state: EngineState,
    /// What the ECU has said.
    pub report: Report,
    /// What is ordered, and by whom.
    pub ordered: Ordered,
    /// The ECU reports what is ordered; see [`crate::event::Event::NotObeyed`].
    pub obeyed: bool,
    /// Who rules: of a running engine the source whose demand is in force, else the highest that is fresh, or whoever
    /// ordered last when none is.
    pub active_source: Origin,
    /// When it last spoke.
    pub source_last_rx: Option<Instant>,
    /// What it asked a running engine for, before ramps, slew and limits.
    pub commanded: Option<Demand>,
    /// A source that is about to take over, or the one that was lost and speaks again: the demand is held meanwhile.
    pub waiting: Option<Origin>,
    /// How far the loss of that source has gone.
    pub loss: LossStage,
    /// A limit has lowered the demand to the fail-safe throttle, where it stays until standby is commanded.
    pub limited: bool,
    /// Since when it is in doubt whether the engine that was ordered to run still lives: what is commanded does not reach it.
    pub in_doubt: Option<Instant>,
    /// A start waits while another engine of the group starts, until then at the latest.
    pub start_waits_until: Option<Instant>,
    /// For 1 s nothing that was to be sent went out.
    pub transmitter_failed: bool,
    /// The engine is armed.
    pub armed: bool,
    /// An emergency stop is latched.
    pub stop_latched: bool,
    /// A start is under way: the engine has to run by then.
    pub start_by: Option<Instant>,
    /// It ran, and stopped or fell silent without a command.
    pub failed: bool,
    /// So many other engines of the group have failed.
    pub others_failed: u8,
    /// What was counted.
    pub counters: Counters,
}

impl Telemetry {
    /// A value, if it came within the last 3 s: what an ECU said before it fell silent is not what its engine does now.
    pub fn current<T: Copy>(&self, value: Option<Timed<T>>) -> Option<T> {
        value.filter(|value| value.age(self.at) <= CURRENT).map(|value| value.value)
    }

    /// Whether somebody has to look at this engine: what the status LED shows.
    pub fn needs_attention(&self) -> bool {
        self.link != LinkState::Up
            || self.loss != LossStage::None
            || self.in_doubt.is_some()
            || self.limited
            || !self.obeyed
            || self.transmitter_failed
            || self.stop_latched
            || self.report.faults.is_some_and(|faults| !faults.value.is_empty())
    }
}
