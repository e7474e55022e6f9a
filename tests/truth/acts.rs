//! What happens to an engine and to the node, one event at a time: by a script, or by chance.

use crate::faults::Fault;
use crate::history::{Cause, PilotCommand};

/// What a case or a drill does with an engine.
#[derive(Clone, Copy, PartialEq, Debug)]
pub enum Act {
    /// The source repeats this from now on, every 0.1 s; `None`: it is silent.
    Stream(usize, Option<PilotCommand>),
    /// The source commands this once.
    Once(usize, PilotCommand),
    /// This fault, and its duration, µs.
    Fault(Fault, u64),
    /// The same, in addition to faults that are present already.
    Beside(Fault, u64),
    /// A change of the share to which the demand is reduced while another engine has failed, per mille.
    Share(u16),
    /// Another ECU is plugged in: its number (on ZK its version), and its time without power, µs.
    Swap(u8, u64),
}

/// A reset, and its circumstances.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Blow {
    pub at: u64,
    /// Time without a node.
    pub down: u64,
    pub cause: Cause,
    /// The ECUs lose their power together with the node.
    pub with_ecu: bool,
    /// The node comes back with other settings.
    pub other_settings: bool,
    /// The node begins as one for another engine: the retained state is not its own.
    pub other_engine: bool,
}
