//! The simulated ECU of either kind behind one face, and what it has counted itself: the node is not its
//! own judge.

use super::engines::{Ecu as Kind, Engine};
use embassy_time::Duration;
use jetlink::ecu::EcuConfig;
use jetlink::ecu::zk::codec::Rate;
use jetlink::line::StopBits;
use sim::amt::{AmtConfig, AmtEcu};
use sim::ecu::{Ecu, LineFault, Nanos};
use sim::line::Line;
use sim::turbine::{Parameters, Turbine};
use sim::zk::{ZkConfig, ZkEcu};

/// Obeyed commands that an ECU keeps; the rig looks at the line instead.
const COMMANDS_KEPT: usize = 0;

/// A simulated ECU of either kind.
#[derive(Debug)]
pub enum Simulated {
    /// AMT.
    Amt(Box<AmtEcu>),
    /// ZK.
    Zk(Box<ZkEcu>),
}

/// What an ECU has counted itself.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
pub struct EcuCounts {
    /// Frames it sent.
    pub frames: u64,
    /// Commands it accepted.
    pub accepted: u64,
    /// Frames from the node that were none, or came when they may not.
    pub bad: u64,
    /// AMT: replies inside the window. All accepted commands are such.
    pub in_window: u64,
    /// AMT: replies that ended after the window.
    pub late: u64,
    /// AMT: frames that got no reply.
    pub unanswered: u64,
    /// AMT: the smallest time left in the window after a reply.
    pub worst_margin: Option<Duration>,
    /// Stops of a live engine because the host was not heard.
    pub loss_stops: u64,
}

impl Simulated {
    /// The ECU of this engine, not yet under power.
    pub fn new(engine: &Engine) -> Self {
        let line = line(engine);
        match engine.ecu {
            Kind::Amt(kind) => {
                let config = AmtConfig { log: COMMANDS_KEPT, ..AmtConfig::new(kind).on(line) };
                Self::Amt(Box::new(AmtEcu::new(config)))
            }
            Kind::Zk { version, .. } => {
                let config = ZkConfig { log: COMMANDS_KEPT, ..ZkConfig::new(version).on(line) };
                Self::Zk(Box::new(ZkEcu::new(config)))
            }
        }
    }

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

    /// What it has counted.
    pub fn counts(&self) -> EcuCounts {
        match self {
            Self::Amt(ecu) => {
                let stats = &ecu.stats;
                EcuCounts {
                    frames: stats.frames.total(),
                    accepted: stats.in_window,
                    bad: stats.bad.total() + stats.unsolicited,
                    in_window: stats.in_window,
                    late: stats.late,
                    unanswered: stats.none,
                    worst_margin: stats.worst_margin.map(Duration::from_nanos),
                    loss_stops: stats.serial_delay_stops,
                }
            }
            Self::Zk(ecu) => {
                let stats = &ecu.stats;
                EcuCounts {
                    frames: stats.frames_sent(),
                    accepted: stats.accepted,
                    bad: stats.bad.total() + stats.reserved_bits + stats.ignored.version,
                    loss_stops: stats.control_losses,
                    ..EcuCounts::default()
                }
            }
        }
    }
}

impl Ecu for Simulated {
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

    fn heard(&mut self, now: Nanos, byte: Result<u8, LineFault>) {
        match self {
            Self::Amt(ecu) => ecu.heard(now, byte),
            Self::Zk(ecu) => ecu.heard(now, byte),
        }
    }

    fn power(&mut self, now: Nanos, on: bool) {
        match self {
            Self::Amt(ecu) => ecu.power(now, on),
            Self::Zk(ecu) => ecu.power(now, on),
        }
    }
}

/// The line of this engine, in the terms of the simulation.
pub fn line(engine: &Engine) -> Line {
    let stop_bits = match engine.config.line.stop_bits {
        StopBits::One => sim::line::StopBits::One,
        StopBits::Two => sim::line::StopBits::Two,
    };
    Line { baud: engine.config.line.baud, stop_bits }
}

/// The figures of this engine's turbine.
pub fn parameters(engine: &Engine) -> Parameters {
    match engine.ecu {
        Kind::Amt(kind) => AmtConfig::new(kind).turbine,
        Kind::Zk { version, .. } => ZkConfig::new(version).turbine,
    }
}

/// How often the node is to send to this ECU; `None` where it only answers (AMT).
pub fn cadence(engine: &Engine) -> Option<Nanos> {
    let EcuConfig::Zk(config) = engine.config.ecu else { return None };
    Some(
        match config.rate {
            Rate::Hz20 => sim::zk::Rate::Hz20,
            Rate::Hz50 => sim::zk::Rate::Hz50,
            Rate::Hz100 => sim::zk::Rate::Hz100,
        }
        .period(),
    )
}
