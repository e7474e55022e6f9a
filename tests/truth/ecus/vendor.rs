//! What the worlds need of a protocol. Each has a file beside this one, which implements it for the simulated ECU and its
//! configuration.

use crate::history::{Kind, PilotCommand};
use crate::pilots::Rng;
use jetlink::ecu::{EcuConfig, Service};
use sim::any::AnyEcu;
use sim::ecu::Nanos;

/// What a frame reports that no ECU sent.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Odd {
    /// An engine at rest.
    AtRest,
    /// A shaft that does not turn, in a frame that reports nothing else of the engine, or a running engine.
    SlowShaft,
    /// An exhaust beyond every limit.
    HotExhaust,
    /// A later version of the protocol, where it has versions.
    LaterVersion,
}

/// What a look at an ECU shows beside its turbine.
pub struct Seen {
    /// It reports a fault.
    pub fault: bool,
    /// Its PWM input is in control.
    pub pwm: bool,
    /// Its engine runs, and it reports something else.
    pub hidden: bool,
}

/// An ECU of a world.
pub trait WorldEcu {
    fn seen(&self) -> Seen;

    /// It reports this fault from now on, or none.
    fn report_fault(&mut self, fault: Option<u8>);

    /// A signal on its PWM input, run or standby; `None`: no signal.
    fn pwm_signal(&mut self, _run: Option<bool>) {}

    /// A frame that is well formed and not true: another state, or another version.
    fn wrong_frame(&self, rng: &mut Rng) -> Vec<u8>;

    /// A frame that is well formed, and reports this; none, where the protocol has no such frame.
    fn odd_frame(&self, odd: Odd) -> Vec<u8>;

    /// It reports a supply below every limit from now on, or its own, where it is known how it reports one.
    fn lower_supply(&mut self, _low: bool) {}
}

/// What the judge may know of an ECU.
pub struct Facts {
    pub kind: Kind,
    /// Time between two frames.
    pub period: Nanos,
    /// Frames until each status was sent once.
    pub round: u64,
    /// It stops its engine by itself without a command for this long.
    pub gives_up_after: Nanos,
    /// What the node assumes of it.
    pub serial_delay: Nanos,
    /// A frame to it on the wire.
    pub frame: Nanos,
    /// A command without content does not prevent that.
    pub gives_up_on_empty: bool,
    pub boot: Nanos,
    /// Tenths of a percent that are sent until full operation.
    pub start_throttle: u32,
    /// Frames with the state before a power-up that follow it.
    pub stale: u64,
}

/// The configuration of an ECU of a world.
pub trait WorldConfig {
    /// `engine`: how the node is configured for it.
    fn facts(&self, engine: &EcuConfig) -> Facts;

    /// Whether it holds an rpm by itself.
    fn holds_rpm(&self) -> bool;

    /// Another one of the kind, the same engine on an ECU of this version; `None` if it has no versions.
    fn another(&self, version: u8) -> Option<AnyEcu>;

    /// The node's service command for a pilot's; `None` where the protocol has none for it.
    fn service(&self, command: PilotCommand) -> Option<Service>;

    fn name(&self) -> String;
}
