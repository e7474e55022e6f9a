//! Interface of every ECU protocol beside its codec and its link, for code that does not depend on the protocol.

use core::fmt::Display;

/// Why a line cannot carry a protocol.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[non_exhaustive]
pub enum LineMistake {
    /// The protocol has one stop bit.
    StopBits,
    /// The line is too slow for the status rate.
    TooSlow,
}

/// The mistakes in the configuration of a protocol.
pub trait VendorMistake: Copy {
    /// The mistake, if it is one about the line.
    fn line(self) -> Option<LineMistake>;
}

/// The service commands of a protocol.
pub trait VendorService: Copy {
    /// It moves fuel or heats, so the engine has to be cold and at rest, and it is limited in time.
    fn moves_fuel(self) -> bool {
        false
    }

    /// It ends the effect of one that moves fuel.
    fn closes_pump(self) -> bool {
        false
    }

    /// Whether the ECU has to report a stopped engine first.
    fn needs_stopped_engine(self) -> bool;
}

/// The faults of a protocol: several at once or one code. Displayed as text, `none` if there is none.
pub trait VendorFaults: Copy + Display {
    /// The number on the wire; 0 if there is none.
    fn number(self) -> u8;
}
