//! What the ZK document leaves open, as options: a host has to be right for each of them.

/// How one ZK ECU behaves where the document does not say.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ZkTemper {
    /// After power-up a switch at run starts nothing before it was at stop or standby once. Default `false`: SW 3 alone
    /// starts the engine.
    pub wants_standby_first: bool,
    /// So many status frames ID 1 after a power-up still show the state and the switch from before it. Default 0.
    pub last_state_first: u8,
    /// A start begins at any exhaust temperature and with a coasting shaft. Default `false`: the engine is cooled to
    /// [`COOL_EGT`](crate::turbine::COOL_EGT) first.
    pub starts_hot: bool,
    /// So many times in one run it relights by itself after a flame-out, and reports state 13 (restart) until it runs. A
    /// start after power was lost in flight is then reported as state 13, too. Default 0: a flame-out is error 6.
    pub relights: u8,
    /// Service commands are obeyed while the engine is cooled, too. Default `false`.
    pub services_while_cooling: bool,
    /// The tests of main valve and ignition valve let fuel through. Default `false`.
    pub valves_pass_fuel: bool,
    /// ID 0 keeps the control signal from counting as lost, up to version 4. Default `true`: "keep the connection".
    /// Otherwise an engine that is switched to run is given up after
    /// [`ZkConfig::control_loss`](super::ZkConfig::control_loss) of nothing but ID 0.
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
        valves_pass_fuel: false,
        empty_keeps_control: true,
    };
}
