//! What happens to an engine, for logs and ground stations.

use crate::command::{Demand, Ordered, Origin, Rejected};
use crate::ecu::{Faults, Service, amt, zk};
use crate::limit::LimitViolation;
use crate::report::{NotSent, Phase};
use crate::units::Rpm;

/// What happened, for logs and ground stations.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Event {
    /// The ECU is heard.
    LinkUp,
    /// The ECU is not heard for the configured time.
    LinkLost,
    /// The ECU came out of its power-up (AMT set-up set).
    EcuStarted,
    /// The ECU named its engine (AMT).
    EngineIdentified(amt::codec::Engine),
    /// The ECU named an engine that no table has: rpm and voltages have no scale (AMT).
    EngineUnknown,
    /// The ECU gave its protocol version (ZK).
    VersionKnown(zk::codec::Version),
    /// The engine's phase changed.
    Phase(Phase),
    /// The faults that the ECU reports changed.
    Faults(Faults),
    /// The status rate is as configured (ZK-11).
    RateConfirmed(zk::codec::Rate),
    /// The ECU did not take the configured status rate.
    RateNotConfirmed(zk::codec::Rate),
    /// A service command went out.
    ServiceSent(Service),
    /// The ECU shows what a service command set (ZK-13).
    ServiceConfirmed(Service),
    /// The ECU never showed it, or the command could not be sent.
    ServiceFailed(Service),
    /// A transmission did not happen.
    NotSent(NotSent),
    /// What is ordered changed in kind.
    Ordered(Ordered),
    /// The engine was armed or disarmed.
    Armed(bool, Origin),
    /// For 3 s the ECU has reported another switch, or while running another throttle, than what is ordered: a wire to
    /// the ECU may be broken, or another host may command it.
    NotObeyed,
    /// The ECU reports what is ordered again.
    ObeyedAgain,
    /// A command was refused. Repeated refusals for one reason are counted, not repeated here.
    CommandRejected(Rejected, Origin),
    /// The source of commands is silent, or speaks again (`None`).
    SourceLoss(LossStage),
    /// Another source is in control.
    ActiveSource(Origin),
    /// A limit was passed.
    Limit(LimitViolation),
    /// So many other engines of the group have failed: they ran, and stopped or fell silent without a command.
    OtherFailed(u8),
    /// After a reset the engine was found running, and goes on with this demand.
    Resumed(Demand),
    /// The life of the engine that was ordered to run is over: the order is cancelled, and standby goes out.
    RunCancelled(End),
    /// Whether the engine still lives is in doubt: the demand does not reach it until the ECU has reported it running twice.
    LifeInDoubt,
    /// The ECU reports it running again: the demand goes out.
    LifeConfirmed,
    /// A demand beyond the engine's maximum was clamped to it.
    Clamped(Rpm),
    /// For 1 s nothing that was to be sent went out.
    TransmitterFailed,
    /// Transmissions go out again.
    TransmitterWorks,
}

/// How far the loss of the source of commands has gone.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Debug, Default)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum LossStage {
    /// The source is fresh, or none is needed.
    #[default]
    None = 0,
    /// The source is silent: its last demand is held.
    Hold = 1,
    /// The source is silent: the fail-safe throttle rules.
    FailSafe = 2,
    /// The source stayed silent: standby.
    Standby = 3,
}

/// What ended a life.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum End {
    /// The ECU was powered up.
    PowerUp,
    /// The ECU reports an engine at rest.
    AtRest,
    /// The ECU reports an engine that starts again.
    StartsAgain,
    /// The ECU was not heard before it reported starting.
    GapInStart,
    /// The ECU reports faults only, and the exhaust is cold or cools.
    NotBurning,
    /// The ECU reports faults only, in a start.
    FaultInStart,
    /// Nothing has confirmed for too long that the engine runs. It is not shut down: nothing is in force until its ECU
    /// reports what it does.
    Unconfirmed,
}

impl End {
    /// In plain words.
    pub const fn name(self) -> &'static str {
        match self {
            Self::PowerUp => "the ECU was powered up",
            Self::AtRest => "the engine is at rest",
            Self::StartsAgain => "the ECU starts the engine again",
            Self::GapInStart => "the ECU fell silent during the start",
            Self::NotBurning => "the exhaust is cold",
            Self::FaultInStart => "the ECU reported a fault during the start",
            Self::Unconfirmed => "nothing says for too long whether the engine runs",
        }
    }
}
