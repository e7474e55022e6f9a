//! The kinds of ECU, and the traits of each protocol that the rules depend on. A new protocol is a variant and its [`Traits`].

/// Which ECU it is.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Kind {
    Amt,
    /// ZK with this protocol version.
    Zk(u8),
}

/// What a protocol's document makes of its ECUs.
#[derive(PartialEq, Debug)]
pub struct Traits {
    /// Its frames have a checksum: a damaged one is never taken for another.
    pub checksum: bool,
    /// The node sends only replies to its frames. Otherwise the node has send slots of its own.
    pub replies_only: bool,
    /// Its node gives an order up once it could not be sent for the serial delay.
    pub serial_delay: bool,
    /// Each status ID has a turn, and one of them the state. Otherwise nearly every frame has the state.
    pub rounds: bool,
    /// A frame that reports a fault has neither the state nor the speed.
    pub faults_hide_state: bool,
    /// It reports that it was powered up.
    pub reports_power_up: bool,
    /// It reports each stage of a start, and cooling.
    pub reports_stages: bool,
    /// It reports how long its last start took.
    pub reports_start_time: bool,
    /// Frames in which it reports its supply once, where that is not once in a round.
    pub supply_every: u64,
    /// It has services, and a PWM input that can be in control.
    pub services: bool,
    /// It has CTF.
    pub ctf: bool,
    /// It has versions, and not all have speed control.
    pub versions: bool,
    /// A shaft below this part of its idle speed turns as in a start.
    pub slow: f64,
}

const AMT: Traits = Traits {
    checksum: false,
    replies_only: true,
    serial_delay: true,
    rounds: false,
    faults_hide_state: true,
    reports_power_up: true,
    reports_stages: false,
    reports_start_time: false,
    // An alternate set follows ten others (AMT-2).
    supply_every: 11,
    services: false,
    ctf: true,
    versions: false,
    // A setting of 10 000 rpm in 36 000.
    slow: 0.25,
};

const ZK: Traits = Traits {
    checksum: true,
    replies_only: false,
    serial_delay: false,
    rounds: true,
    faults_hide_state: false,
    reports_power_up: false,
    reports_stages: true,
    reports_start_time: true,
    supply_every: 0,
    services: true,
    ctf: false,
    versions: true,
    slow: 0.45,
};

impl Kind {
    pub const fn traits(self) -> &'static Traits {
        match self {
            Self::Amt => &AMT,
            Self::Zk(_) => &ZK,
        }
    }

    /// The protocol version; 0 where there are none.
    pub const fn version(self) -> u8 {
        match self {
            Self::Amt => 0,
            Self::Zk(version) => version,
        }
    }

    /// It continues unchanged when the wire to it is cut.
    pub const fn continues_without_commands(self) -> bool {
        match self {
            Self::Amt => false,
            Self::Zk(version) => version >= 5,
        }
    }

    /// It sends frames without receiving any.
    pub const fn sends_unprompted(self) -> bool {
        match self {
            Self::Amt => true,
            Self::Zk(version) => version >= 5,
        }
    }
}
