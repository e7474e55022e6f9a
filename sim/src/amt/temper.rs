//! Behaviour that the AMT document leaves open, as options: a host has to work with all of them.

use super::telemetry::Status;
use crate::ecu::{Nanos, SECOND};

/// Behaviour of one AMT ECU where the document does not specify it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct AmtTemper {
    /// After power-up, OPS = run has no effect until auto stop or emergency stop was sent once. Default `false`: run alone
    /// starts the engine.
    pub wants_auto_stop_first: bool,
    /// Number of normal sets after a power-up that still show the state and the switch from before it. Default 0.
    pub last_state_first: u8,
    /// A start begins at any exhaust temperature and with a coasting shaft. Default `false`: the engine is cooled to
    /// [`COOL_EGT`](crate::turbine::COOL_EGT) first.
    pub starts_hot: bool,
    /// Duration of start clearance before the start. Default 1 s (assumed).
    pub clearance: Nanos,
    /// State in which a running engine is reported now and then. Default `None`: always full operation.
    pub in_flight: Option<InFlight>,
    /// Time after which a trip's error and its lock clear by themselves; if OPS is still run, the engine then starts.
    /// Default `None`: only a stop by the host clears them.
    pub trips_clear_after: Option<Nanos>,
    /// An engine that the ECU stopped because no command arrived starts again as soon as OPS = run arrives. Default `false`: only after a stop by
    /// the host.
    pub starts_after_silence: bool,
}

/// A state in which a running engine is reported now and then.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct InFlight {
    /// The state.
    pub shows: Status,
    /// Interval between starts.
    pub every: Nanos,
    /// Duration.
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
        starts_after_silence: false,
    };
}
