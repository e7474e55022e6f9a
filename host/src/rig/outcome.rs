//! The outcome of a run, as it is judged and shown.

use super::audit::Audit;
use super::play::action::Action;
use super::play::judge::Verdict;
use embassy_time::{Duration, Instant};
use jetlink::report::{Counters, LinkState};
use jetlink_rc::reception::Reception;
use sim::ecu::Counts;

/// What had to happen, and whether it did.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct Check {
    /// What.
    pub what: String,
    /// It did.
    pub held: bool,
}

/// What came of one engine.
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
    /// Something was done to it by hand: what no pilot can cause.
    pub played: Option<Verdict>,
    /// What the node has counted.
    pub node: Counters,
    /// Commands that the node rejected, but for those of its first moments, when it listens only.
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
    /// Nothing ever was wrong with the line.
    pub line_was_clean: bool,
    /// The turbine turns and burns no more, by its own account.
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

/// What came of a run.
#[derive(Clone, Debug)]
pub struct Outcomes {
    /// Of each engine.
    pub engines: Vec<Outcome>,
    /// Engine time at the end.
    pub length: Duration,
    /// How it ended.
    pub end: End,
    /// What had to happen in a scenario, and whether it did.
    pub checks: Vec<Check>,
    /// Frames that each ECU of a scenario may have received damaged.
    pub bad_commands: u64,
    /// What was done by hand.
    pub actions: Vec<(Instant, Action)>,
    /// What came of all that a receiver of radio control has sent, if there was one.
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
