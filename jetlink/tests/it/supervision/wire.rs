//! The node's frames on the wire, in the judge's terms.

use core::fmt;
use sim::control::LONGEST;
pub use sim::control::Switch;

#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Frame {
    /// Switch and throttle in tenths of a percent: every AMT message, ZK ID 1.
    Full(Switch, u16),
    /// ZK ID 6: the switch and RPM_X.
    Mode(Switch, u8),
    /// ZK ID 7.
    RpmCode(u16),
    /// Any other: it does not command a running engine.
    Other(u8),
    /// Not a frame of the document.
    Bad([u8; LONGEST]),
}

impl fmt::Display for Frame {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Full(switch, tenths) => write!(f, "{switch}, throttle {}", percent(*tenths)),
            Self::Mode(switch, factor) => write!(f, "ID 6: {switch}, RPM_X {factor}"),
            Self::RpmCode(code) => write!(f, "ID 7: rpm / 10 / RPM_X = {code}"),
            Self::Other(id) => write!(f, "ID {id}"),
            Self::Bad(bytes) => write!(f, "{bytes:02x?}, which is no control frame"),
        }
    }
}

/// Tenths of a percent, for a reader.
pub fn percent(tenths: impl Into<u32>) -> String {
    let tenths = tenths.into();
    format!("{}.{} %", tenths / 10, tenths % 10)
}
