//! Behaviour that the ZK document leaves open, as options: a host has to work with all of them.

/// Behaviour of one ZK ECU where the document does not specify it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ZkTemper {
    /// After power-up, a switch at run has no effect until it was at stop or standby once. Default `false`: SW 3 alone
    /// starts the engine.
    pub wants_standby_first: bool,
    /// Number of ID 1 status frames after a power-up that still show the state and the switch from before it. Default 0.
    pub last_state_first: u8,
    /// A start begins at any exhaust temperature and with a coasting shaft. Default `false`: the engine is cooled to
    /// [`COOL_EGT`](crate::turbine::COOL_EGT) first.
    pub starts_hot: bool,
    /// Number of automatic relights in one run after a flame-out, and after a relight that does not light, reported as state 13
    /// (restart) until the engine runs. A start after a loss of power in flight is then also reported as state 13. Default 0: a
    /// flame-out is error 6.
    pub relights: u8,
    /// Service commands are also obeyed while the engine is cooled. Default `false`.
    pub services_while_cooling: bool,
    /// The state is standby while OpenPump holds the pump open. Default `false`: it is that of the pump's test.
    pub standby_while_pump_is_open: bool,
    /// The tests of main valve and ignition valve let fuel through. Default `false`.
    pub valves_pass_fuel: bool,
    /// ID 0 prevents a loss of the control signal, up to version 4. Default `true`: "keep the connection". Otherwise an
    /// engine that is switched to run is shut down after [`ZkConfig::control_loss`](super::ZkConfig::control_loss) of
    /// ID 0 alone.
    pub empty_keeps_control: bool,
}

impl ZkTemper {
    /// The defaults named at each field.
    pub const DEFAULT: Self = Self {
        wants_standby_first: false,
        last_state_first: 0,
        starts_hot: false,
        relights: 0,
        services_while_cooling: false,
        standby_while_pump_is_open: false,
        valves_pass_fuel: false,
        empty_keeps_control: true,
    };
}
