//! Commands, their sources, and the reasons for a refusal.

use crate::ecu::Service;
use crate::limit::LimitKind;
use crate::sentence::{names, sentences};
use crate::units::{Celsius, Millivolts, Rpm, Signed, Throttle, Whole};

/// Demand for a running engine.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Demand {
    /// A throttle, on every ECU.
    Throttle(Throttle),
    /// A shaft speed, if the ECU has its own speed control (ZK from version 4).
    Rpm(Rpm),
}

impl Demand {
    /// Whether it is less than another of its kind. The two kinds do not compare.
    #[inline(never)]
    pub(crate) fn is_below(self, other: Self) -> bool {
        match (self, other) {
            (Self::Throttle(a), Self::Throttle(b)) => a < b,
            (Self::Rpm(a), Self::Rpm(b)) => a < b,
            _ => false,
        }
    }
}

/// Command to an engine. The latest replaces the previous one; nothing is queued.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[non_exhaustive]
pub enum Command {
    /// Stop at once, without cooling. Latched: sent until [`Command::ReleaseStop`].
    EmergencyStop,
    /// Release a latched emergency stop; the engine is then in standby. Accepted from the source that stopped it or a higher
    /// one, with its demand at idle, the link up, and no running engine reported in the last 3 s.
    ReleaseStop,
    /// Standby, with cooling, as one command of a stream. In standby it is the first step to a start, and permits the
    /// source's own next `Run` to start the engine, once. Shutting down a running engine takes two of them within the source's
    /// timeout, or within two of its own periods if those are longer: one stray command of a lost stream is not enough.
    Standby,
    /// Standby, with cooling, as the explicit order of a person: obeyed at once. Permits no start.
    ShutDown,
    /// Run. From standby it starts the engine, with the permission of the same source's own [`Command::Standby`] and every
    /// interlock satisfied at that instant. A refusal uses the permission up, so that a source that keeps sending `Run`
    /// cannot start an engine later. A demand beyond the engine's maximum is clamped to it.
    Run(Demand),
    /// The source is present without a command. It is then not in control, holds no demand and commands no standby.
    Present,
    /// Allow a start. It does not affect running engines. Any source may arm and disarm. After an emergency stop a source
    /// that keeps commanding `Arm` has to command `Disarm` first.
    Arm,
    /// Prevent starts, and end one that has not reached running. It does not affect running engines: a throttle dip at
    /// disarming would stop a turbine.
    Disarm,
    /// Hand the engine over to the ECU's PWM input (ZK SW 0, ZK-8). Never sent otherwise. Refused while a higher source is in
    /// control.
    HandOverToPwm,
    /// Service command of the ECU. Refused while a higher source is in control.
    Service(Service),
}

/// Origin of a command.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[non_exhaustive]
pub enum Origin {
    /// The node itself: at power-up, and in a stage of loss.
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
    /// The sources of commands, highest priority first.
    pub const SOURCES: [Self; 4] = [Self::Emergency, Self::Rc, Self::Mavlink, Self::Bench];

    /// Priority: the source with the higher number takes precedence.
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

/// Effect of a command that was not refused.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[non_exhaustive]
pub enum Accepted {
    /// It is in force.
    InForce,
    /// It waits until its demand is close to the one in force or, after a loss, until its source has been received without a
    /// gap for long enough.
    Held,
    /// It waits behind this source, which is in control.
    Behind(Origin),
    /// The start waits while another engine of the group starts; see [`crate::telemetry::Telemetry::start_waits_until`].
    StartWaits,
    /// First standby to a running engine: a second one within the source's timeout shuts it down.
    RepeatStandby,
}

/// Order in force, and its origin.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Ordered {
    /// Order.
    pub order: Order,
    /// Its origin.
    pub origin: Origin,
}

/// Order that a link keeps sending.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Order {
    /// Emergency stop.
    EmergencyStop,
    /// Standby.
    Standby,
    /// Run.
    Run(Demand),
    /// The ECU's PWM input is in control (ZK-8).
    Pwm,
    /// No order is in force until the ECU has reported the state of its engine. ZK: ID 0. AMT: no replies.
    Listen,
    /// This demand stays in force, but it is in doubt whether its engine still runs: nothing is sent that could start one.
    /// ZK: ID 0, in mode 3 alternating with ID 7, which an ECU that restarted ignores (ZK-9). AMT: no replies.
    Doubt(Demand),
}

/// Reason for refusing a command. A refused command does not change the order in force; a refused start uses up its permission.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[non_exhaustive]
pub enum Rejected {
    /// An emergency stop is latched.
    StopLatched,
    /// A start has to begin with a command to standby.
    StandbyFirst,
    /// The source has commanded `Arm` ever since the emergency stop: it has to command `Disarm` first. The answer to `Arm`, and to a
    /// start of an engine that is not armed.
    DisarmFirst,
    /// Only the source that commanded the emergency stop, or one above it, may release it.
    NotYours(Origin),
    /// No order is in force yet: the node waits for the report of the ECU.
    Listening,
    /// An interlock keeps the engine from a start.
    Start(Interlock),
    /// A higher source is in control, and this command cannot wait for its silence.
    Behind(Origin),
    /// The link is not up: no release of a stop, no service command and, after a reset, no run.
    NoLink,
    /// The ECU does not report a stopped engine.
    NotStopped,
    /// The engine is not ordered to run.
    NotOrderedToRun,
    /// The ECU's protocol version is too low (ZK-7).
    NeedsVersion {
        /// Lowest version that supports the command.
        needed: u8,
        /// Version of the ECU, `None` while it is unknown.
        known: Option<u8>,
    },
    /// The ECU has no speed control: command a throttle.
    NoSpeedControl,
    /// The governor has no recent shaft speed in rpm.
    RpmNotKnown,
    /// The demand is above the engine's maximum rpm.
    AboveMaxRpm {
        /// Maximum reported by the ECU.
        max: Rpm,
    },
    /// The line cannot carry this status rate (ZK-11).
    RateTooFast,
    /// The ECU does not support this command.
    NotSupported,
    /// An earlier service command is not confirmed yet.
    Busy,
    /// Services that move fuel or heat were repeated for as long as they may last.
    ServiceTime,
}

/// Interlock that keeps an engine from a start.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[non_exhaustive]
pub enum Interlock {
    /// The engine is not armed.
    NotArmed,
    /// The demand is above idle.
    NotIdle,
    /// The link is not up, or has not been for long enough.
    Link,
    /// The ECU does not report standby.
    NotStandby,
    /// The ECU reports a fault.
    Fault,
    /// The exhaust temperature is unknown.
    EgtUnknown,
    /// The exhaust is too hot: let it cool in standby.
    TooHot(Celsius),
    /// The supply voltage is too low.
    SupplyLow(Millivolts),
    /// A limit is violated whose action is more than a report.
    Limit(LimitKind),
    /// The fuel pump that a service command opened is not closed yet.
    PumpOpen,
    /// Another engine of the group is starting, or was started less than the configured gap ago.
    OtherStarting,
}

sentences!(Demand {
} {
    Self::Throttle(throttle) => "throttle {}.{} %", Whole(u32::from(throttle.tenths()) / 10), Whole(u32::from(throttle.tenths()) % 10);
    Self::Rpm(rpm) => "{} rpm", Whole(rpm.get());
});

sentences!(Command {
    Self::EmergencyStop => "emergency stop";
    Self::ReleaseStop => "release of the emergency stop";
    Self::Standby => "standby";
    Self::ShutDown => "shut down";
    Self::Present => "present";
    Self::Arm => "arm";
    Self::Disarm => "disarm";
    Self::HandOverToPwm => "hand-over to the PWM input";
} {
    Self::Run(demand) => "run, {}", demand;
    Self::Service(service) => "service command: {}", service;
});

names!(Origin, "Name in lower case." {
    Node => "node";
    Bench => "bench";
    Mavlink => "mavlink";
    Rc => "rc";
    Emergency => "emergency";
});

sentences!(Accepted {
    Self::InForce => "in force";
    Self::Held => "held until its demand is close to the one in force, or its source is in control again";
    Self::StartWaits => "the start waits for another engine of the group";
    Self::RepeatStandby => "repeat standby to shut the engine down";
} {
    Self::Behind(active) => "behind {}, which is in control", active;
});

sentences!(Ordered {
} {
    Self { order, origin } => "{}, from {}", order, origin;
});

sentences!(Order {
    Self::EmergencyStop => "emergency stop";
    Self::Standby => "standby";
    Self::Pwm => "PWM input";
    Self::Listen => "no order";
} {
    Self::Run(demand) => "run, {}", demand;
    Self::Doubt(demand) => "run in doubt, {}", demand;
});

sentences!(Interlock {
    Self::NotArmed => "arm the engine before a start";
    Self::NotIdle => "bring the demand to idle first";
    Self::Link => "wait until the ECU is received without a gap";
    Self::NotStandby => "wait until the ECU reports standby";
    Self::Fault => "the ECU reports a fault: clear it first";
    Self::EgtUnknown => "the exhaust temperature is unknown: check the thermocouple";
    Self::PumpOpen => "the fuel pump is being closed: command standby again";
    Self::OtherStarting => "wait until another engine of the group has started";
} {
    Self::TooHot(egt) => "the exhaust is at {} °C: let it cool in standby", Signed(i32::from(egt.tenths()) / 10);
    Self::SupplyLow(supply) => "the supply voltage is {} mV: charge the battery", Whole(supply.get());
    Self::Limit(kind) => "a limit is violated: {}", kind;
});

sentences!(Rejected {
    Self::StopLatched => "an emergency stop is latched: release it when the engine has stopped";
    Self::StandbyFirst => "command standby before a start";
    Self::DisarmFirst => "after an emergency stop, disarm and arm again";
    Self::Listening => "the node has just started and waits for the ECU's report: try again";
    Self::NoLink => "nothing is received from the ECU: check its power and wiring";
    Self::NotStopped => "stop the engine first";
    Self::NotOrderedToRun => "the engine is not ordered to run";
    Self::NoSpeedControl => "this ECU has no speed control: command a throttle";
    Self::RpmNotKnown => "the shaft speed is unknown: command a throttle";
    Self::RateTooFast => "the line is too slow for this status rate: command a lower one";
    Self::NotSupported => "the ECU of this engine does not support this command";
    Self::ServiceTime => "the time of the service is over: pause its command, then try again";
    Self::Busy => "the ECU has not confirmed the previous service command yet: try again";
} {
    Self::NotYours(origin) => "the emergency stop came from {}: that source or a higher one has to release it", origin;
    Self::Start(interlock) => "{}", interlock;
    Self::Behind(active) => "{} is in control: try again when it has fallen silent", active;
    Self::NeedsVersion { needed, known: Some(known) } => "this needs protocol version {}, the ECU has version {}", Whole(needed.into()), Whole(known.into());
    Self::NeedsVersion { needed, known: None } => "this needs protocol version {}, the ECU has not reported its version yet", Whole(needed.into());
    Self::AboveMaxRpm { max } => "the maximum of this engine is {} rpm: command less", Whole(max.get());
});

impl core::error::Error for Rejected {}
