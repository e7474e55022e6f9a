//! What a protocol provides for [`any`](crate::any). Each implements it in its own folder.

use crate::ecu::{Counts, Ecu, Nanos};
use crate::line::Line;
use crate::turbine::{Parameters, Turbine};
use core::any::Any;
use core::fmt;

/// Configuration of an ECU. Displayed as its kind, for people.
pub trait VendorConfig: Clone + fmt::Debug + fmt::Display {
    /// The ECU.
    type Ecu: VendorEcu;

    /// Whether the ECU's frames have a checksum.
    const HAS_CHECKSUM: bool;

    /// Whether the ECU waits for a reply to each of its frames.
    const HAS_REPLY_WINDOW: bool;

    /// The usual ECU of the engine with this number. Without such an engine, and for 0: that of the usual engine.
    fn of_engine(number: u8) -> Self;

    /// The same with this version of the protocol, if it has versions.
    #[must_use]
    fn with_version(self, _version: u8) -> Self {
        self
    }

    /// The same on another line.
    #[must_use]
    fn on(self, line: Line) -> Self;

    /// The same with a log of this many obeyed commands.
    #[must_use]
    fn with_log(self, log: usize) -> Self;

    /// The same with this reply window, if it has one.
    #[must_use]
    fn with_reply_window(self, _reply_window: Nanos) -> Self {
        self
    }

    /// The figures of its turbine.
    fn turbine(&self) -> &Parameters;

    /// The same, mutable.
    fn turbine_mut(&mut self) -> &mut Parameters;

    /// The ECU, not yet powered.
    fn ecu(self) -> Self::Ecu;
}

/// An ECU, apart from its line.
pub trait VendorEcu: Ecu + Any + fmt::Debug {
    /// The turbine.
    fn turbine(&self) -> &Turbine;

    /// The turbine, to make it fail.
    fn turbine_mut(&mut self) -> &mut Turbine;

    /// Number of good control frames so far, and of everything else: damaged frames, and bytes outside of frames.
    fn received(&self) -> (u64, u64);

    /// Its counters since its creation.
    fn counts(&self) -> Counts;

    /// Faults that a host following the protocol never causes, in sentences.
    fn host_faults(&self) -> Vec<&'static str>;

    /// Sets whether it reports a low supply, if the protocol has such a fault.
    fn report_low_supply(&mut self, _low: bool) {}

    /// Good control frames that its version does not know, if the protocol has versions.
    fn unknown_to_version(&self) -> u64 {
        0
    }
}
