//! What the worlds need from a protocol. Each protocol has a file beside this one, which implements it for the simulated
//! ECU and its configuration.

use crate::history::PilotCommand;
use crate::kind::Kind;
use crate::pilots::Rng;
use jetlink::ecu::{EcuConfig, Service};
use jetlink::units::Millivolts;
use sim::any::AnyEcu;
use sim::ecu::Nanos;

/// Content of a frame that no ECU sent.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Odd {
    /// An engine at rest.
    AtRest,
    /// A shaft at rest, in a frame that reports nothing else about the engine, or a running engine.
    SlowShaft,
    /// A running engine whose shaft is at rest.
    RunsAtRest,
    /// An exhaust temperature beyond every limit.
    HotExhaust,
    /// A later version of the protocol, where it has versions.
    LaterVersion,
}

/// State of an ECU at a sample, besides its turbine.
pub struct Seen {
    /// It reports a fault.
    pub fault: bool,
    /// Its PWM input is in control.
    pub pwm: bool,
    /// Its engine runs, but it reports something else.
    pub hidden: bool,
}

/// An ECU of a world.
pub trait WorldEcu {
    fn seen(&self) -> Seen;

    /// From now on it reports this fault, or none.
    fn report_fault(&mut self, fault: Option<u8>);

    /// A signal on its PWM input, run or standby; `None`: no signal.
    fn pwm_signal(&mut self, _run: Option<bool>) {}

    /// A well-formed but false frame: another state, or another version.
    fn wrong_frame(&self, rng: &mut Rng) -> Vec<u8>;

    /// A well-formed frame that reports this; none, where the protocol has no such frame.
    fn odd_frame(&self, odd: Odd) -> Vec<u8>;

    /// From now on it reports a supply below every limit, or its own.
    fn lower_supply(&mut self, low: bool);
}

/// What the judge may know about an ECU.
pub struct Facts {
    pub kind: Kind,
    /// Time between two frames.
    pub period: Nanos,
    /// Frames until each status has been sent once.
    pub round: u64,
    /// Time without a command after which it stops its engine.
    pub gives_up_after: Nanos,
    /// The node's assumption of that time.
    pub serial_delay: Nanos,
    /// A frame to it on the wire.
    pub frame: Nanos,
    /// An empty command does not prevent that.
    pub gives_up_on_empty: bool,
    pub boot: Nanos,
    /// Tenths of a percent that are sent until full operation.
    pub start_throttle: u32,
    /// Frames with the state before a power-up that follow it.
    pub stale: u64,
}

/// The configuration of an ECU of a world.
pub trait WorldConfig {
    /// Makes what the drills need more frequent; `engine`: the node's configuration for it.
    fn for_drills(&mut self, rng: &mut Rng, engine: &mut EcuConfig);

    /// Changes a setting of the node that no rule depends on.
    fn other_settings(&self, engine: &mut EcuConfig);

    /// `engine`: the node's configuration for it.
    fn facts(&self, engine: EcuConfig) -> Facts;

    /// Whether it holds an rpm itself.
    fn holds_rpm(&self) -> bool;

    /// Another ECU of this protocol, as it is plugged in at rest; the number (1 to 6) decides in what it differs.
    fn another(&self, number: u8) -> AnyEcu;

    /// A limit below its own supply.
    fn low_supply(&self) -> Millivolts;

    /// The node's service command for a pilot's; `None` where the protocol has none for it.
    fn service(&self, command: PilotCommand) -> Option<Service>;

    fn name(&self) -> String;
}
