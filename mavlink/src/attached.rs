//! Other devices attached to the node: a receiver of radio control, fuel valves. The service offers their settings as parameters,
//! and reports their state. [`Nothing`] is a node without them, and adds nothing to an image.

use crate::port::Schedule;
use crate::refusal::Refusal;
use core::fmt::Debug;
use embassy_time::Instant;
use jetlink::setting::Row;

/// Channels of a receiver, in µs, from channel 1 on; `None`: it is silent.
pub type Channels = [Option<u16>; 18];

/// Outputs of an engine: whether each is energised; `None`: there is none.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Outputs {
    /// Fuel valve. Energised is open.
    pub valve: Option<bool>,
    /// Power of starter and ignition.
    pub power: Option<bool>,
}

/// A change of an output.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Change {
    /// Engine, from 0.
    pub engine: usize,
    /// The output and what it does now, for people.
    pub what: &'static str,
    /// Why, for people.
    pub why: &'static str,
    /// It may have stopped an engine that was not ordered to stop, or that did not stop when ordered.
    pub alarming: bool,
}

/// Attached devices. Rows and their order are the same for every engine, and fixed from the start of the node on.
pub trait Attached: Debug {
    /// State that the service keeps for each port.
    type Streams: Streams;

    /// Settings of an engine that are parameters, after all others of its component.
    fn rows(&self) -> &'static [&'static [Row]];

    /// The value of one of them.
    fn number(&self, engine: usize, name: &str) -> Option<i32>;

    /// Changes one of them. Its range has been checked.
    ///
    /// # Errors
    /// Why it was refused. Nothing has changed.
    fn set(&mut self, engine: usize, name: &str, number: i32) -> Result<(), Refusal>;

    /// Begins a calibration of the stick of an engine, or ends it: then the end points seen meanwhile go into the settings
    /// [`Attached::calibrated`].
    ///
    /// # Errors
    /// Why it was refused. No setting has changed.
    fn calibrate(&mut self, _engine: usize, _begin: bool) -> Result<(), Refusal> {
        Err(Refusal::NoReceiver)
    }

    /// The settings that a calibration changes: both ends of the stick.
    fn calibrated(&self) -> [&'static str; 2] {
        [""; 2]
    }

    /// Sets whether the stored settings are damaged. While they are, nothing may start an engine.
    fn set_damaged(&mut self, damaged: bool);

    /// Whether engines have outputs.
    fn has_outputs(&self) -> bool;

    /// The outputs of an engine.
    fn outputs(&self, engine: usize) -> Outputs;

    /// The next change of an output; each is returned once.
    fn next_change(&mut self) -> Option<Change>;

    /// Channels that the receiver of radio control sends; `None`: there is none.
    fn channels(&self, now: Instant) -> Option<Channels>;

    /// Share of radio frames that arrive, in percent; `None`: the receiver does not report it.
    fn link_quality(&self, _now: Instant) -> Option<u8> {
        None
    }
}

/// Streams of the attached devices on a port.
pub trait Streams: sealed::Streams {}

impl<T: sealed::Streams> Streams for T {}

pub(crate) mod sealed {
    use super::{NoStreams, NodeStreams, Schedule};
    use crate::ids::{MESSAGE_RC_CHANNELS, MESSAGE_RELAY_STATUS};
    use embassy_time::Instant;

    pub trait Streams: core::fmt::Debug + Sized {
        fn new(now: Instant) -> Self;
        fn schedule(&mut self, message: u32) -> Option<&mut Schedule>;
    }

    impl Streams for NoStreams {
        fn new(_: Instant) -> Self {
            Self
        }

        fn schedule(&mut self, _: u32) -> Option<&mut Schedule> {
            None
        }
    }

    impl Streams for NodeStreams {
        fn new(now: Instant) -> Self {
            Self { relays: Schedule::new(now), channels: Schedule::new(now) }
        }

        fn schedule(&mut self, message: u32) -> Option<&mut Schedule> {
            match message {
                MESSAGE_RELAY_STATUS => Some(&mut self.relays),
                MESSAGE_RC_CHANNELS => Some(&mut self.channels),
                _ => None,
            }
        }
    }
}

/// No streams.
#[derive(Clone, Copy, Debug)]
pub struct NoStreams;

/// Rates of `RELAY_STATUS` and `RC_CHANNELS` on a port.
#[derive(Clone, Copy, Debug)]
pub struct NodeStreams {
    relays: Schedule,
    channels: Schedule,
}

/// Nothing is attached.
#[derive(Clone, Copy, Debug)]
pub struct Nothing;

impl Attached for Nothing {
    type Streams = NoStreams;

    fn rows(&self) -> &'static [&'static [Row]] {
        &[]
    }

    fn number(&self, _: usize, _: &str) -> Option<i32> {
        None
    }

    fn set(&mut self, _: usize, _: &str, _: i32) -> Result<(), Refusal> {
        Err(Refusal::UnknownSetting)
    }

    fn set_damaged(&mut self, _: bool) {}

    fn has_outputs(&self) -> bool {
        false
    }

    fn outputs(&self, _: usize) -> Outputs {
        Outputs::default()
    }

    fn next_change(&mut self) -> Option<Change> {
        None
    }

    fn channels(&self, _: Instant) -> Option<Channels> {
        None
    }
}
