//! Limits of an engine, and their violations.

use crate::sentence::{names, sentences};
use crate::units::Signed;

/// Action on a violated limit.
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

/// Limit and its action. `None`: not monitored; for the shaft speed: the ECU's own figure.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Limit<T> {
    /// Limit.
    pub at: Option<T>,
    /// Action.
    pub action: Action,
}

impl<T> Limit<T> {
    /// Monitored, and only reported.
    pub const fn report(at: T) -> Self {
        Self { at: Some(at), action: Action::Report }
    }

    /// Not monitored. For the shaft speed: reported at the ECU's own figure.
    pub const NONE: Self = Self { at: None, action: Action::Report };
}

/// Kind of a limit, with the unit of its values.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[non_exhaustive]
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

/// Violation of a limit.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct LimitViolation {
    /// Kind.
    pub kind: LimitKind,
    /// Value, in the unit named at [`LimitKind`].
    pub value: i32,
    /// Limit, in the same unit.
    pub limit: i32,
}

impl LimitViolation {
    #[inline(never)]
    pub(crate) fn new(kind: LimitKind, value: u32, limit: u32) -> Self {
        let signed = |value| i32::try_from(value).unwrap_or(i32::MAX);
        Self { kind, value: signed(value), limit: signed(limit) }
    }
}

names!(LimitKind, "Description in lower case." {
    OverSpeed => "shaft speed too high";
    OverTemperature => "exhaust too hot";
    LowRpm => "shaft speed too low";
    HotStart => "exhaust temperature rises too fast";
    FlameOut => "shaft speed lost";
    SupplyLow => "supply too low";
    Implausible => "shaft speed jumps";
    EcuFault => "the ECU reports a fault";
    StartTimeout => "the start took too long";
});

/// Unit of the values of a limit, as text.
#[derive(Clone, Copy)]
struct UnitOf(LimitKind);

sentences!(UnitOf {
    Self(LimitKind::OverSpeed | LimitKind::LowRpm) => " rpm";
    Self(LimitKind::OverTemperature) => " °C";
    Self(LimitKind::HotStart) => " °C/s";
    Self(LimitKind::FlameOut) => " %";
    Self(LimitKind::SupplyLow) => " mV";
    Self(LimitKind::Implausible) => " rpm/s";
    Self(LimitKind::EcuFault) => "";
    Self(LimitKind::StartTimeout) => " s";
});

impl LimitKind {
    /// Steps of the value in one of the text's unit.
    const fn steps(self) -> i32 {
        match self {
            Self::OverTemperature => 10,
            Self::StartTimeout => 1000,
            _ => 1,
        }
    }
}

sentences!(LimitViolation {
} {
    Self { kind: LimitKind::EcuFault, value, .. } => "{}: {}", LimitKind::EcuFault, Signed(value);
    Self { kind, value, limit, .. } => "{}: {}{}, limit {}{}", kind, Signed(value / kind.steps()), UnitOf(kind), Signed(limit / kind.steps()), UnitOf(kind);
});
