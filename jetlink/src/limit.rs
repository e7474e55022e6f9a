//! Limits of an engine, and what is reported when one is passed.

use embassy_time::Instant;

/// What is done when a limit is passed.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Debug, Default)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Action {
    /// Only reported.
    #[default]
    Report = 0,
    /// The demand goes to the fail-safe throttle and stays there until standby is commanded.
    FailSafe = 1,
    /// Standby.
    Standby = 2,
}

/// A limit and what is done when it is passed. `None` as the limit: not monitored; of the shaft speed: the ECU's own figure.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Limit<T> {
    /// The limit.
    pub at: Option<T>,
    /// What is done.
    pub action: Action,
}

impl<T> Limit<T> {
    /// Monitored, and only reported.
    pub const fn report(at: T) -> Self {
        Self { at: Some(at), action: Action::Report }
    }

    /// Not monitored. Of the shaft speed: reported at the ECU's own figure.
    pub const NONE: Self = Self { at: None, action: Action::Report };
}

/// What a limit is of.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum LimitKind {
    /// Shaft speed above its limit, in rpm.
    OverSpeed,
    /// Exhaust temperature above its limit, in 0.1 °C.
    OverTemperature,
    /// Shaft speed below its limit while running, in rpm.
    LowRpm,
    /// Exhaust temperature rises too fast during a start, in °C a second.
    HotStart,
    /// Shaft speed lost within 2 s without a lower demand, in percent.
    FlameOut,
    /// Supply voltage below its limit, in mV.
    SupplyLow,
    /// Shaft speed changed faster than any turbine can, in rpm a second.
    Implausible,
    /// The ECU reports a fault; the value is its number.
    EcuFault,
    /// The start took too long, in ms.
    StartTimeout,
}

impl LimitKind {
    /// Name in plain words.
    pub const fn name(self) -> &'static str {
        match self {
            Self::OverSpeed => "shaft speed too high",
            Self::OverTemperature => "exhaust too hot",
            Self::LowRpm => "shaft speed too low",
            Self::HotStart => "exhaust temperature rises too fast",
            Self::FlameOut => "shaft speed lost",
            Self::SupplyLow => "supply too low",
            Self::Implausible => "shaft speed jumps",
            Self::EcuFault => "the ECU reports a fault",
            Self::StartTimeout => "the start took too long",
        }
    }
}

/// A limit that was passed.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct LimitViolation {
    /// Which.
    pub what: LimitKind,
    /// The value, in the unit named at [`LimitKind`].
    pub value: i32,
    /// The limit, in the same unit.
    pub limit: i32,
    /// When.
    pub at: Instant,
}

impl LimitViolation {
    pub(crate) fn new(what: LimitKind, value: u32, limit: u32, at: Instant) -> Self {
        let signed = |value| i32::try_from(value).unwrap_or(i32::MAX);
        Self { what, value: signed(value), limit: signed(limit), at }
    }
}
