//! The ECUs jetlink speaks to, each in a folder of its own, and what is common to them: configuration, services, faults.

pub mod amt;
pub mod any;
pub mod zk;

use crate::sentence::sentences;

/// Which ECU is on a port, and how it is spoken to.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum EcuConfig {
    /// AMT serial control.
    Amt(amt::config::Config),
    /// ZK-Protocol.
    Zk(zk::config::Config),
}

/// A service command: done once, in the ECU's own terms.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Service {
    /// Of an AMT ECU.
    Amt(amt::config::Service),
    /// Of a ZK ECU.
    Zk(zk::config::Service),
}

impl Service {
    /// It moves fuel or heats, so the engine has to be cold and at rest, and it is ended after a time.
    pub const fn moves_fuel(self) -> bool {
        match self {
            Self::Amt(_) => false,
            Self::Zk(service) => service.moves_fuel(),
        }
    }

    /// It ends what one that moves fuel began.
    pub const fn closes_pump(self) -> bool {
        matches!(self, Self::Zk(zk::config::Service::Action(zk::codec::Action::ClosePump)))
    }

    /// Whether the ECU has to report a stopped engine first.
    pub const fn needs_stopped_engine(self) -> bool {
        match self {
            Self::Amt(service) => service.needs_stopped_engine(),
            Self::Zk(service) => service.needs_stopped_engine(),
        }
    }
}

/// The faults that an ECU reports.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Faults {
    /// Of an AMT ECU: several at once.
    Amt(amt::codec::ErrorBits),
    /// Of a ZK ECU: one code.
    Zk(zk::codec::ErrorCode),
}

impl Faults {
    /// Whether it reports none.
    pub const fn is_empty(self) -> bool {
        match self {
            Self::Amt(bits) => bits.0 == 0,
            Self::Zk(code) => code.code() == 0,
        }
    }
}

impl Faults {
    /// The number on the wire: AMT a set of bits, ZK a code.
    pub const fn number(self) -> u8 {
        match self {
            Self::Amt(bits) => bits.0,
            Self::Zk(code) => code.code(),
        }
    }
}

impl core::fmt::Display for Faults {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::Amt(bits) if bits.0 == 0 => f.write_str("none"),
            Self::Amt(bits) => {
                for (i, name) in bits.names().enumerate() {
                    if i > 0 {
                        f.write_str(", ")?;
                    }
                    f.write_str(name)?;
                }
                Ok(())
            }
            Self::Zk(zk::codec::ErrorCode::Unknown(code)) => write!(f, "unknown error {code}"),
            Self::Zk(code) => f.write_str(code.name()),
        }
    }
}

#[cfg(feature = "defmt")]
impl defmt::Format for Faults {
    fn format(&self, f: defmt::Formatter<'_>) {
        match self {
            Self::Amt(bits) if bits.0 == 0 => defmt::write!(f, "none"),
            Self::Amt(bits) => {
                for (i, name) in bits.names().enumerate() {
                    defmt::write!(f, "{=str}{=str}", if i > 0 { ", " } else { "" }, name);
                }
            }
            Self::Zk(zk::codec::ErrorCode::Unknown(code)) => defmt::write!(f, "unknown error {=u8}", code),
            Self::Zk(code) => defmt::write!(f, "{=istr}", code.interned()),
        }
    }
}

sentences!(Service {
    Self::Amt(amt::config::Service::Ctf) => "CTF";
    Self::Zk(zk::config::Service::IgnitionPump(_)) => "ignition pump voltage";
    Self::Zk(zk::config::Service::Curve(_)) => "acceleration curve";
} {
    Self::Zk(zk::config::Service::Action(action)) => "action {}", action.parameter();
});
