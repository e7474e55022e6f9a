//! An ECU of either protocol behind one interface, and its configuration.

use core::any::Any;
use core::fmt;

use crate::amt::{self, AmtConfig, AmtEcu};
use crate::ecu::{Counts, Ecu, LineFault, Nanos};
use crate::line::Line;
use crate::turbine::{Parameters, Phase, Turbine};
use crate::zk::{ZkConfig, ZkEcu};

/// Protocol of an ECU.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Protocol {
    /// AMT.
    Amt,
    /// ZK.
    Zk,
}

impl Protocol {
    /// Whether the ECU's frames have a checksum.
    pub const fn has_checksum(self) -> bool {
        match self {
            Self::Amt => false,
            Self::Zk => true,
        }
    }

    /// Whether the ECU waits for a reply to each of its frames.
    pub const fn has_reply_window(self) -> bool {
        match self {
            Self::Amt => true,
            Self::Zk => false,
        }
    }
}

/// Configuration of an ECU of either protocol.
#[derive(Clone, Debug)]
pub enum AnyConfig {
    /// AMT.
    Amt(AmtConfig),
    /// ZK.
    Zk(ZkConfig),
}

impl AnyConfig {
    /// The AMT ECU of this engine at 2400 baud.
    pub fn amt(engine: amt::EngineModel) -> Self {
        Self::Amt(AmtConfig::new(engine))
    }

    /// A ZK ECU of this protocol version.
    pub fn zk(version: u8) -> Self {
        Self::Zk(ZkConfig::new(version))
    }

    /// Its protocol.
    pub const fn protocol(&self) -> Protocol {
        match self {
            Self::Amt(_) => Protocol::Amt,
            Self::Zk(_) => Protocol::Zk,
        }
    }

    /// The same on another line.
    #[must_use]
    pub fn on(self, line: Line) -> Self {
        match self {
            Self::Amt(config) => Self::Amt(config.on(line)),
            Self::Zk(config) => Self::Zk(config.on(line)),
        }
    }

    /// The same with a log of this many obeyed commands.
    #[must_use]
    pub fn with_log(self, log: usize) -> Self {
        match self {
            Self::Amt(config) => Self::Amt(AmtConfig { log, ..config }),
            Self::Zk(config) => Self::Zk(ZkConfig { log, ..config }),
        }
    }

    /// The same with this reply window, where it has one.
    #[must_use]
    pub fn with_reply_window(self, reply_window: Nanos) -> Self {
        match self {
            Self::Amt(config) => Self::Amt(AmtConfig { reply_window, ..config }),
            Self::Zk(_) => self,
        }
    }

    /// The figures of its turbine.
    pub const fn turbine(&self) -> &Parameters {
        match self {
            Self::Amt(config) => &config.turbine,
            Self::Zk(config) => &config.turbine,
        }
    }

    /// The same, mutable.
    pub const fn turbine_mut(&mut self) -> &mut Parameters {
        match self {
            Self::Amt(config) => &mut config.turbine,
            Self::Zk(config) => &mut config.turbine,
        }
    }

    /// The ECU, not yet powered.
    pub fn ecu(self) -> AnyEcu {
        match self {
            Self::Amt(config) => AmtEcu::new(config).into(),
            Self::Zk(config) => ZkEcu::new(config).into(),
        }
    }
}

/// Its kind, for people.
impl fmt::Display for AnyConfig {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Amt(config) => write!(f, "AMT {}", config.engine),
            Self::Zk(config) => write!(f, "ZK version {}", config.version),
        }
    }
}

impl From<AmtConfig> for AnyConfig {
    fn from(config: AmtConfig) -> Self {
        Self::Amt(config)
    }
}

impl From<ZkConfig> for AnyConfig {
    fn from(config: ZkConfig) -> Self {
        Self::Zk(config)
    }
}

/// An ECU of either protocol.
#[derive(Debug)]
pub enum AnyEcu {
    /// AMT.
    Amt(Box<AmtEcu>),
    /// ZK.
    Zk(Box<ZkEcu>),
}

impl AnyEcu {
    /// The turbine.
    pub fn turbine(&self) -> &Turbine {
        match self {
            Self::Amt(ecu) => ecu.turbine(),
            Self::Zk(ecu) => ecu.turbine(),
        }
    }

    /// The turbine, to make it fail.
    pub fn turbine_mut(&mut self) -> &mut Turbine {
        match self {
            Self::Amt(ecu) => ecu.turbine_mut(),
            Self::Zk(ecu) => ecu.turbine_mut(),
        }
    }

    /// Its protocol.
    pub const fn protocol(&self) -> Protocol {
        match self {
            Self::Amt(_) => Protocol::Amt,
            Self::Zk(_) => Protocol::Zk,
        }
    }

    /// State of the turbine.
    pub fn phase(&self) -> Phase {
        self.turbine().phase()
    }

    /// Numbers of good control frames so far, and of everything else: damaged frames, and bytes outside of frames.
    pub const fn received(&self) -> (u64, u64) {
        match self {
            Self::Amt(ecu) => (ecu.stats.valid, ecu.stats.bad.total() + ecu.stats.stray_bytes),
            Self::Zk(ecu) => (ecu.stats.accepted, ecu.stats.bad.total() + ecu.stats.stray_bytes),
        }
    }

    /// Its counters since its creation.
    pub fn counts(&self) -> Counts {
        match self {
            Self::Amt(ecu) => ecu.stats.counts(),
            Self::Zk(ecu) => ecu.stats.counts(),
        }
    }

    /// What a host that keeps to the protocol never causes, in sentences.
    pub fn host_faults(&self) -> Vec<&'static str> {
        match self {
            Self::Amt(ecu) => ecu.stats.host_faults(),
            Self::Zk(ecu) => ecu.stats.host_faults(),
        }
    }

    /// The [`AmtEcu`] or [`ZkEcu`] inside.
    pub fn inner(&self) -> &dyn Any {
        match self {
            Self::Amt(ecu) => &**ecu,
            Self::Zk(ecu) => &**ecu,
        }
    }

    /// The same, mutable.
    pub fn inner_mut(&mut self) -> &mut dyn Any {
        match self {
            Self::Amt(ecu) => &mut **ecu,
            Self::Zk(ecu) => &mut **ecu,
        }
    }
}

impl From<AmtEcu> for AnyEcu {
    fn from(ecu: AmtEcu) -> Self {
        Self::Amt(Box::new(ecu))
    }
}

impl From<ZkEcu> for AnyEcu {
    fn from(ecu: ZkEcu) -> Self {
        Self::Zk(Box::new(ecu))
    }
}

impl Ecu for AnyEcu {
    fn next_wake(&self) -> Nanos {
        match self {
            Self::Amt(ecu) => ecu.next_wake(),
            Self::Zk(ecu) => ecu.next_wake(),
        }
    }

    fn advance(&mut self, now: Nanos, tx: &mut Vec<u8>) {
        match self {
            Self::Amt(ecu) => ecu.advance(now, tx),
            Self::Zk(ecu) => ecu.advance(now, tx),
        }
    }

    fn receive(&mut self, now: Nanos, byte: Result<u8, LineFault>) {
        match self {
            Self::Amt(ecu) => ecu.receive(now, byte),
            Self::Zk(ecu) => ecu.receive(now, byte),
        }
    }

    fn power(&mut self, now: Nanos, on: bool) {
        match self {
            Self::Amt(ecu) => ecu.power(now, on),
            Self::Zk(ecu) => ecu.power(now, on),
        }
    }
}
