//! What the AMT document leaves open, as options: a host has to be right for each of them.

use super::telemetry::Status;
use crate::ecu::{Nanos, SECOND};

/// How one AMT ECU behaves where the document does not say.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct AmtTemper {
    /// After power-up OPS = run starts nothing before auto stop or emergency stop was sent once. Default `false`: run
    /// alone starts the engine.
    pub wants_auto_stop_first: bool,
    /// So many normal sets after a power-up still show the state and the switch from before it. Default 0.
    pub last_state_first: u8,
    /// A start begins at any exhaust temperature and with a coasting shaft. Default `false`: the engine is cooled to
    /// [`COOL_EGT`](crate::turbine::COOL_EGT) first.
    pub starts_hot: bool,
    /// How long start clearance lasts before the start. Default 1 s (assumed).
    pub clearance: Nanos,
    /// What a running engine is reported as now and then. Default `None`: full operation throughout.
    pub in_flight: Option<InFlight>,
    /// A trip's error and its lock go away by themselves after so long, and OPS = run that still stands then starts the
    /// engine. Default `None`: only a stop by the host clears them.
    pub trips_clear_after: Option<Nanos>,
}

/// A state that a running engine is reported as now and then.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct InFlight {
    /// The state.
    pub shows: Status,
    /// From one beginning to the next.
    pub every: Nanos,
    /// For so long each time.
    pub lasts: Nanos,
}

impl AmtTemper {
    /// The defaults named at each field.
    pub const DEFAULT: Self = Self {
        wants_auto_stop_first: false,
        last_state_first: 0,
        starts_hot: false,
        clearance: SECOND,
        in_flight: None,
        trips_clear_after: None,
    };
}
