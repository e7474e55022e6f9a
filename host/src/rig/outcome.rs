//! The outcome of a run, as it is judged and shown.

use super::audit::Audit;
use super::play::action::Action;
use super::play::judge::Verdict;
use embassy_time::{Duration, Instant};
use jetlink::report::{Counters, LinkState};
use jetlink_rc::reception::Reception;
use sim::ecu::Counts;

/// An expected event, and whether it occurred.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct Check {
    /// What.
    pub what: String,
    /// It occurred.
    pub held: bool,
}

/// Outcome of one engine.
#[derive(Clone, Debug)]
pub struct Outcome {
    /// A pilot flies its script; else MAVLink or radio control commands it.
    pub has_pilot: bool,
    /// The engine's name.
    pub name: &'static str,
    /// Its ECU waits for a reply to each of its frames; to another one the node sends in slots.
    pub has_reply_window: bool,
    /// What the pilot did not reach; `None` when it was cut short.
    pub flown: Option<Result<(), String>>,
    /// Verdict if it was played by hand: on events that no pilot can cause.
    pub played: Option<Verdict>,
    /// What the node has counted.
    pub node: Counters,
    /// Commands that the node rejected, except in its first moments, when it only listens.
    pub commands_rejected: u32,
    /// Whether the link is up at the end.
    pub link: LinkState,
    /// What the ECU has counted.
    pub ecu: Counts,
    /// What was seen on the line.
    pub audit: Audit,
    /// Number of uncommanded shutdowns of the engine.
    pub stops: u32,
    /// From the end of the last fault until the link was up.
    pub recovered_after: Option<Duration>,
    /// The line never had a fault.
    pub line_was_clean: bool,
    /// Whether the simulated turbine is starting or running.
    pub is_live: bool,
}

/// How a run ended.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum End {
    /// All was played.
    Complete,
    /// Its time was over before all was played: that of --duration where no pilot flies, or the end of a script file.
    Over,
    /// Before its time, on request.
    Interrupted,
    /// By a panic with this message: a mistake in the rig or in jetlink.
    Panicked(String),
}

/// Outcome of a run.
#[derive(Clone, Debug)]
pub struct Outcomes {
    /// Of each engine.
    pub engines: Vec<Outcome>,
    /// Engine time at the end.
    pub length: Duration,
    /// How it ended.
    pub end: End,
    /// Expected events of a scenario, and whether they occurred.
    pub checks: Vec<Check>,
    /// Frames that each ECU of a scenario may have received damaged.
    pub bad_commands: u64,
    /// What was done by hand.
    pub actions: Vec<(Instant, Action)>,
    /// A key did some of it, not only a script file.
    pub by_key: bool,
    /// Reception of radio control, if there was a receiver.
    pub reception: Option<Reception>,
    /// A scenario was played.
    pub is_scenario: bool,
}

impl Outcomes {
    /// Whether anything was done by hand.
    pub fn is_played(&self) -> bool {
        !self.actions.is_empty()
    }
}
