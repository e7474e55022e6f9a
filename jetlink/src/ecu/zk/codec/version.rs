//! Protocol versions of ZK ECUs, and the functions that each introduced (ZK-7).

use crate::units::ranged;

ranged!(
    /// Protocol version of an ECU, from status ID 6 (0..=63).
    Version(u8), new, get, "the version", 0..=63
);

impl Version {
    /// The lowest. Every ECU supports its commands, including one whose version is unknown.
    pub const FIRST: Self = Self(1);
    /// It introduced the fuel statistics and the thrust sensor (ZK-7).
    pub const V2: Self = Self(2);
    /// It introduced modes 2 and 3, steps of 0.2 V, and most of status ID 8 (ZK-6, ZK-7).
    pub const V4: Self = Self(4);
    /// It introduced the pump that is held open (ZK-7).
    pub const V5: Self = Self(5);

    /// From the six bits on the wire; higher ones are cut off.
    pub(super) const fn from_bits(bits: u8) -> Self {
        Self(bits & 0x3F)
    }

    /// Whether an ECU supports functions introduced by version `since`, given its known version; `None` if it is unknown.
    pub const fn knows(known: Option<Self>, since: Self) -> Option<bool> {
        match known {
            Some(version) => Some(version.0 >= since.0),
            None => None,
        }
    }
}
