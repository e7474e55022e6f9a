//! What can be asked of an engine, by whom, and why it may be refused.

use crate::ecu::Service;
use crate::limit::LimitKind;
use crate::units::{Celsius, Millivolts, Rpm, Throttle};

/// What a running engine shall do.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Demand {
    /// A throttle, on every ECU.
    Throttle(Throttle),
    /// A shaft speed, where the ECU has a speed control of its own (ZK from version 4).
    Rpm(Rpm),
}

impl Demand {
    /// Whether it is less than another of its kind. Nothing says how the two kinds compare.
    pub(crate) fn is_below(self, other: Self) -> bool {
        match (self, other) {
            (Self::Throttle(a), Self::Throttle(b)) => a < b,
            (Self::Rpm(a), Self::Rpm(b)) => a < b,
            _ => false,
        }
    }
}

/// What somebody asks of an engine. The latest wins; nothing is queued.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Command {
    /// Stop at once, without cooling. Latched: it stays on the wire until [`Command::ReleaseStop`].
    EmergencyStop,
    /// Release a latched emergency stop; the engine is then in standby. Accepted from the source that stopped it or a higher
    /// one, with its demand at idle, the ECU heard, and no running engine reported in the last 3 s.
    ReleaseStop,
    /// Standby, with cooling: a word of a stream. In standby it is the first step to a start, and permits the source's own
    /// next `Run` to start the engine, once. An engine that has reached running is shut down by two of them within the
    /// source's age limit, or within two of its own periods if those are longer: one stray word of a lost stream does not.
    Standby,
    /// Standby, with cooling: the explicit order of a person, obeyed at the first word. Permits no start.
    ShutDown,
    /// Run. From standby it asks for a start, which needs the permission of the same source's own [`Command::Standby`] and
    /// every interlock at that instant. A refusal uses the permission up, so that a source that keeps sending `Run` can
    /// never start an engine later. A demand beyond the engine's maximum is clamped to it.
    Run(Demand),
    /// The source is present and wants nothing. It is then not in control, holds no demand and means no standby.
    Present,
    /// Allow a start. Running engines are not touched by it. Any source may arm and disarm. After an emergency stop a
    /// source that has said `Arm` all along has to say `Disarm` first.
    Arm,
    /// Allow no start, and end one that has not reached running. Running engines are not touched by it: a throttle dip at
    /// disarming would stop a turbine.
    Disarm,
    /// Hand the engine to whatever is on the ECU's PWM input (ZK SW 0, ZK-8). Never sent otherwise. Refused while a higher
    /// source rules.
    HandOverToPwm,
    /// A service command of the ECU. Refused while a higher source rules.
    Service(Service),
}

/// Who gives a command.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Origin {
    /// The node itself: at power-up, and when a stage of loss is reached.
    Node,
    /// A test rig or bench program.
    Bench,
    /// MAVLink.
    Mavlink,
    /// Radio control.
    Rc,
    /// A local emergency input.
    Emergency,
}

impl Origin {
    /// All of them.
    pub const ALL: [Self; 5] = [Self::Node, Self::Bench, Self::Mavlink, Self::Rc, Self::Emergency];
    /// Those that command, highest priority first.
    pub const SOURCES: [Self; 4] = [Self::Emergency, Self::Rc, Self::Mavlink, Self::Bench];

    /// Name in lower case.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Node => "node",
            Self::Bench => "bench",
            Self::Mavlink => "mavlink",
            Self::Rc => "rc",
            Self::Emergency => "emergency",
        }
    }

    /// The higher rules.
    pub const fn priority(self) -> u8 {
        match self {
            Self::Node => 0,
            Self::Bench => 1,
            Self::Mavlink => 2,
            Self::Rc => 3,
            Self::Emergency => 4,
        }
    }
}

/// What became of a command that was not refused.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Accepted {
    /// It is in force.
    InForce,
    /// It waits: this source is held until its demand is close to the one in force, or has spoken for long enough
    /// after it was lost.
    Held,
    /// It waits behind this source, which is in control.
    Behind(Origin),
    /// The start waits while another engine of the group starts; see [`crate::telemetry::Telemetry::start_waits_until`].
    StartWaits,
    /// One word of standby to a running engine: the second within the source's age limit shuts it down.
    OneMore,
}

/// What is ordered of an engine now, and by whom.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Ordered {
    /// The order.
    pub order: Order,
    /// Who gave it.
    pub origin: Origin,
}

/// What a link keeps on the wire.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Order {
    /// Emergency stop.
    EmergencyStop,
    /// Standby.
    Standby,
    /// Run.
    Run(Demand),
    /// The ECU's PWM input rules (ZK-8).
    Pwm,
    /// Nothing, and nothing is in force: until the ECU has reported what its engine does. ZK: ID 0. AMT: replies are
    /// withheld.
    Listen,
    /// This demand stays in force, but whether it still belongs to a living engine is in doubt: nothing goes out that
    /// could start one. ZK: ID 0, and in mode 3 ID 7 in turn with it, because an ECU that restarted ignores it (ZK-9).
    /// AMT: replies are withheld.
    Doubt(Demand),
}

/// Why a command was refused. Nothing changes when one is.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Rejected {
    /// An emergency stop is latched.
    StopLatched,
    /// A start has to begin with a command to standby.
    StandbyFirst,
    /// The source has said `Arm` since before the emergency stop was released: it has to say `Disarm` first.
    DisarmFirst,
    /// Only the source that commanded the emergency stop, or one above it, may release it.
    NotYours(Origin),
    /// The node still listens to what the engine does after a reset.
    Listening,
    /// An interlock keeps the engine from a start.
    Start(Interlock),
    /// A higher source rules, and this cannot wait for its silence.
    Behind(Origin),
    /// The ECU is not heard: a stop cannot be released, nor a service command given, and after a reset nothing be ordered.
    NoLink,
    /// The ECU does not report a stopped engine.
    NotStopped,
    /// The engine is not ordered to run.
    NotOrderedToRun,
    /// The ECU's protocol version is too low (ZK-7).
    NeedsVersion {
        /// Lowest version that knows the command.
        needed: u8,
        /// Version of the ECU, `None` while it is not known.
        known: Option<u8>,
    },
    /// The ECU has no speed control: command a throttle.
    NoSpeedControl,
    /// The governor cannot hold an rpm that the ECU does not report in units, or not lately.
    RpmNotKnown,
    /// More than the engine's maximum rpm.
    AboveMaxRpm {
        /// The maximum as the ECU reports it.
        max: Rpm,
    },
    /// The line cannot carry this status rate (ZK-11).
    RateTooFast,
    /// The ECU of this engine has no such command.
    NotSupported,
    /// An earlier service command still waits for its confirmation.
    Busy,
}

/// What keeps an engine from a start.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Interlock {
    /// It is not armed.
    NotArmed,
    /// The demand is above idle.
    NotIdle,
    /// The link is not up, or not for long enough.
    Link,
    /// The ECU does not report standby.
    NotStandby,
    /// The ECU reports a fault.
    Fault,
    /// The exhaust temperature is not known.
    EgtUnknown,
    /// The exhaust is too hot: let it cool in standby.
    TooHot(Celsius),
    /// The supply voltage is too low.
    SupplyLow(Millivolts),
    /// A limit whose action is more than to be told is passed.
    Limit(LimitKind),
    /// A fuel pump that a service command opened is not closed yet.
    PumpOpen,
    /// Another engine of the group starts, or was started less than the configured gap ago.
    OtherStarting,
}

impl core::fmt::Display for Interlock {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::NotArmed => f.write_str("arm the engine before a start"),
            Self::NotIdle => f.write_str("bring the demand to idle first"),
            Self::Link => f.write_str("the ECU is not heard, or not for long enough"),
            Self::NotStandby => f.write_str("the ECU does not report standby"),
            Self::Fault => f.write_str("the ECU reports a fault"),
            Self::EgtUnknown => f.write_str("the exhaust temperature is not known"),
            Self::TooHot(egt) => {
                write!(f, "the exhaust has {} °C: let it cool in standby", egt.tenths() / 10)
            }
            Self::SupplyLow(supply) => write!(f, "the supply has only {} mV", supply.get()),
            Self::Limit(watched) => write!(f, "a limit is passed: {}", watched.name()),
            Self::PumpOpen => f.write_str("the fuel pump is open: it is being closed, command standby again"),
            Self::OtherStarting => {
                f.write_str("another engine of the group is starting, or was started just now")
            }
        }
    }
}

impl core::fmt::Display for Rejected {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::StopLatched => {
                f.write_str("an emergency stop is latched: release it when the engine has stopped")
            }
            Self::StandbyFirst => f.write_str("command standby before a start"),
            Self::DisarmFirst => f.write_str("disarm, then arm: the emergency stop has ended the arming"),
            Self::NotYours(origin) => {
                write!(
                    f,
                    "the emergency stop came from {}, which has to release it, or a higher source",
                    origin.name()
                )
            }
            Self::Listening => f.write_str("the node has just started and listens to what the engine does"),
            Self::Start(interlock) => interlock.fmt(f),
            Self::NoLink => f.write_str("the ECU is not heard: check its power and wiring"),
            Self::Behind(ruler) => write!(f, "{} rules: its silence cannot be waited for", ruler.name()),
            Self::NotStopped => f.write_str("the engine has to be stopped for this"),
            Self::NotOrderedToRun => f.write_str("the engine has to be ordered to run for this"),
            Self::NeedsVersion { needed, known: Some(known) } => {
                write!(f, "this needs protocol version {needed}, the ECU has version {known}")
            }
            Self::NeedsVersion { needed, known: None } => {
                write!(f, "this needs protocol version {needed}, the ECU has not given its version yet")
            }
            Self::NoSpeedControl => {
                f.write_str("this ECU has no speed control: command a throttle instead of an rpm")
            }
            Self::RpmNotKnown => f.write_str("the shaft speed is not known in rpm: command a throttle"),
            Self::AboveMaxRpm { max } => {
                write!(f, "the ECU gives {} rpm as the engine's maximum", max.get())
            }
            Self::RateTooFast => f.write_str("the line is too slow for this status rate"),
            Self::NotSupported => f.write_str("the ECU of this engine has no such command"),
            Self::Busy => f.write_str("an earlier service command still waits for its confirmation"),
        }
    }
}

impl core::error::Error for Rejected {}
