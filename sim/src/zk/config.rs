//! Configuration of a simulated ZK ECU.

use super::status::since_version;
use super::temper::ZkTemper;
use crate::ecu::{MILLIS, Nanos, SECOND};
use crate::line::Line;
use crate::turbine::{Parameters, Switch};

/// Rate of status frames (ZK-11).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Rate {
    /// 20 Hz.
    Hz20,
    /// 50 Hz.
    Hz50,
    /// 100 Hz.
    Hz100,
}

impl Rate {
    /// Interval between frames.
    pub const fn period(self) -> Nanos {
        match self {
            Self::Hz20 => 50 * MILLIS,
            Self::Hz50 => 20 * MILLIS,
            Self::Hz100 => 10 * MILLIS,
        }
    }

    pub(super) const fn bits(self) -> u8 {
        match self {
            Self::Hz20 => 0,
            Self::Hz50 => 1,
            Self::Hz100 => 2,
        }
    }
}

/// Signal at the ECU's PWM input, which is in control while the UART sends SW = 0.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Pwm {
    /// The switch channel.
    pub switch: Switch,
    /// The throttle channel, 0..=1000.
    pub throttle: u16,
}

/// Configuration of a ZK ECU.
#[derive(Clone, Debug, PartialEq)]
pub struct ZkConfig {
    /// Protocol version, 1 to 6; higher ones behave as 6.
    pub version: u8,
    /// Behaviour that the document leaves open and in which ECUs may differ.
    pub temper: ZkTemper,
    /// Its serial line (ZK-12).
    pub line: Line,
    /// Status rate.
    pub rate: Rate,
    /// The turbine behind it.
    pub turbine: Parameters,
    /// Whether it has no air pressure sensor and requests the pressure from the host (ZK-14).
    pub esr: bool,
    /// Status IDs in the order in which they are repeated. IDs without a meaning here are sent with
    /// zeros as data.
    pub ids: Vec<u8>,
    /// Time from power-up to the first frame, or until it listens (not printed).
    pub boot: Nanos,
    /// Time from the end of a command to the answer (not printed).
    pub answer_delay: Nanos,
    /// Whether answers of versions up to 4 are limited to the status rate.
    pub rate_bounds_answers: bool,
    /// Time without a command after which the control signal is lost, up to version 4 (not printed).
    pub control_loss: Nanos,
    /// Duration of a service test (not printed).
    pub service_time: Nanos,
    /// Whether a start waits until the throttle is down.
    pub start_needs_low_throttle: bool,
    /// Ignition pump voltage in steps of 0.02 V.
    pub ignition_voltage: u8,
    /// Acceleration curve, 10..=70.
    pub curve_up: u8,
    /// Deceleration curve.
    pub curve_down: u8,
    /// "Radio" voltage in V.
    pub radio_v: f64,
    /// Supply voltage in V.
    pub supply_v: f64,
    /// Temperature of the ECU in °C.
    pub ecu_temperature: f64,
    /// Number of obeyed commands to log.
    pub log: usize,
}

impl ZkConfig {
    /// An ECU of this version, at 9600 8N1 and 20 Hz.
    pub fn new(version: u8) -> Self {
        Self {
            version,
            temper: ZkTemper::DEFAULT,
            line: Line::n1(9600),
            rate: Rate::Hz20,
            turbine: Parameters::ZK_160K,
            esr: false,
            ids: (1..=10).filter(|&id| since_version(id) <= version).collect(),
            boot: 300 * MILLIS,
            answer_delay: MILLIS / 2,
            rate_bounds_answers: false,
            control_loss: SECOND,
            service_time: 3 * SECOND,
            start_needs_low_throttle: true,
            ignition_voltage: 75,
            curve_up: 30,
            curve_down: 30,
            radio_v: 5.0,
            supply_v: 11.1,
            ecu_temperature: 35.0,
            log: 4096,
        }
    }

    /// The same on another line.
    #[must_use]
    pub fn on(self, line: Line) -> Self {
        Self { line, ..self }
    }

    /// The same at another rate.
    pub fn at(self, rate: Rate) -> Self {
        Self { rate, ..self }
    }
}
