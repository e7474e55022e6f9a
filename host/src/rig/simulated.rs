//! The simulated ECU of an engine, and what it has counted itself: the node is not its own judge.

use super::engines::{Ecu as Kind, Engine};
use embassy_time::Duration;
use jetlink::ecu::EcuConfig;
use jetlink::ecu::zk::codec::Rate;
use jetlink::line::StopBits;
use sim::any::{AnyConfig, AnyEcu};
use sim::ecu::Nanos;
use sim::line::Line;
use sim::turbine::Parameters;

/// Obeyed commands that an ECU keeps; the rig looks at the line instead.
const COMMANDS_KEPT: usize = 0;

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

/// The ECU of this engine, not yet under power.
pub fn ecu(engine: &Engine) -> AnyEcu {
    config(engine).on(line(engine)).with_log(COMMANDS_KEPT).ecu()
}

fn config(engine: &Engine) -> AnyConfig {
    match engine.ecu {
        Kind::Amt(kind) => AnyConfig::amt(kind),
        Kind::Zk { version, .. } => AnyConfig::zk(version),
    }
}

/// What it has counted.
pub fn counts(ecu: &AnyEcu) -> EcuCounts {
    match ecu {
        AnyEcu::Amt(ecu) => {
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
        AnyEcu::Zk(ecu) => {
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
    *config(engine).turbine()
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
