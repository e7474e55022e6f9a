//! What every ECU protocol offers beside its codec and its link, for whoever does not know which protocol it is.

use core::fmt::Display;

/// The service commands of a protocol.
pub trait VendorService: Copy {
    /// It moves fuel or heats, so the engine has to be cold and at rest, and it is ended after a time.
    fn moves_fuel(self) -> bool {
        false
    }

    /// It ends what one that moves fuel began.
    fn closes_pump(self) -> bool {
        false
    }

    /// Whether the ECU has to report a stopped engine first.
    fn needs_stopped_engine(self) -> bool;
}

/// The faults of a protocol: several at once or one code. Displayed as a text for people, `none` where there is none.
pub trait VendorFaults: Copy + Display {
    /// The number on the wire; 0 where there is none.
    fn number(self) -> u8;
}
