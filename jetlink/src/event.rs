//! Events of an engine, for logs and ground stations.

use crate::command::{Demand, Ordered, Origin, Rejected};
use crate::ecu::{Faults, Service, amt, zk};
use crate::limit::LimitViolation;
use crate::report::{NotSent, Phase};
use crate::sentence::{names, sentences};
use crate::units::{Rpm, Verbatim, Whole};

/// Event of an engine.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[non_exhaustive]
pub enum Event {
    /// The link to the ECU is up.
    LinkUp,
    /// Nothing was received from the ECU for the configured time.
    LinkLost,
    /// The ECU was powered up (AMT set-up set).
    EcuStarted,
    /// The ECU identified its engine (AMT).
    EngineIdentified(amt::codec::EngineModel),
    /// The ECU identified an unknown engine: rpm and voltages have no scale (AMT).
    EngineUnknown,
    /// The ECU reported its protocol version (ZK).
    VersionKnown(zk::codec::Version),
    /// The engine's phase changed.
    Phase(Phase),
    /// The faults that the ECU reports changed.
    Faults(Faults),
    /// The status rate is as configured (ZK-11).
    RateConfirmed(zk::codec::Rate),
    /// The ECU did not confirm the configured status rate.
    RateNotConfirmed(zk::codec::Rate),
    /// A service command was sent.
    ServiceSent(Service),
    /// The ECU reports the value that a service command set (ZK-13).
    ServiceConfirmed(Service),
    /// The ECU never reported it, or the command could not be sent.
    ServiceFailed(Service),
    /// A transmission was not sent.
    NotSent(NotSent),
    /// The order changed in kind or origin.
    Ordered(Ordered),
    /// The engine was armed or disarmed.
    Armed(bool, Origin),
    /// For 3 s the ECU has reported a different switch than ordered or, while running, a different throttle: a wire to the ECU
    /// may be broken, or another host may command it.
    NotObeyed,
    /// The reports of the ECU match the order again.
    ObeyedAgain,
    /// A command was refused. Repeated refusals for one reason are only counted.
    CommandRejected(Rejected, Origin),
    /// The stage of loss of the source in control changed; `None`: it was received again.
    SourceLoss(LossStage),
    /// Another source is in control.
    ActiveSource(Origin),
    /// A limit was violated.
    Limit(LimitViolation),
    /// Number of other engines of the group that have failed: they ran, and stopped or fell silent without a command.
    OtherFailed(u8),
    /// The engine was found running after a reset, and resumes with this demand.
    Resumed(Demand),
    /// The life of the engine that was ordered to run is over: the run is cancelled, and standby is sent.
    RunCancelled(End),
    /// Whether the engine still runs is in doubt: until the ECU has reported it running twice, the demand is withheld, but for
    /// replies to an AMT ECU whose exhaust or shaft shows a running engine.
    LifeInDoubt,
    /// The ECU confirmed that the engine runs: the demand is sent.
    LifeConfirmed,
    /// A demand beyond the engine's maximum was clamped to it.
    Clamped(Rpm),
    /// No transmission succeeded for 1 s.
    TransmitterFailed,
    /// Transmissions succeed again.
    TransmitterWorks,
}

/// Stage of loss of the source in control.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Debug, Default)]
pub enum LossStage {
    /// The source is fresh, or none is needed.
    #[default]
    None = 0,
    /// The source is lost: its last demand is held.
    Hold = 1,
    /// The source is lost: the demand goes to the fail-safe throttle.
    FailSafe = 2,
    /// The source stayed lost: standby.
    Standby = 3,
}

/// Cause of the end of a life.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[non_exhaustive]
pub enum End {
    /// The ECU was powered up.
    PowerUp,
    /// The ECU reports an engine at rest.
    AtRest,
    /// The ECU reports an engine that starts again.
    StartsAgain,
    /// The ECU fell silent before it reported starting.
    GapInStart,
    /// The ECU reports faults only, and the exhaust is cold or cools.
    NotBurning,
    /// The ECU reports faults only, in a start.
    FaultInStart,
    /// Nothing confirmed in time that the engine runs. It is not shut down: no order is in force until its ECU reports its
    /// state.
    Unconfirmed,
}

names!(End, "Description in lower case." {
    PowerUp => "the ECU was powered up";
    AtRest => "the ECU reports an engine at rest";
    StartsAgain => "the ECU starts the engine again";
    GapInStart => "the ECU fell silent during the start";
    NotBurning => "the exhaust is cold or cools";
    FaultInStart => "the ECU reported a fault during the start";
    Unconfirmed => "nothing confirmed in time that the engine runs";
});

sentences!(LossStage {
    Self::None => "none";
    Self::Hold => "hold the last demand";
    Self::FailSafe => "fail-safe throttle";
    Self::Standby => "standby";
});

sentences!(Event {
    Self::LinkUp => "ECU link up";
    Self::LinkLost => "ECU link lost";
    Self::EcuStarted => "ECU powered up";
    Self::EngineUnknown => "ECU identified an unknown engine: rpm and voltages have no scale";
    Self::Faults(faults) if faults.is_empty() => "ECU reports no fault";
    Self::NotObeyed => "ECU does not obey the order: check the wire to it";
    Self::ObeyedAgain => "ECU obeys the order again";
    Self::SourceLoss(LossStage::None) => "source received again";
    Self::OtherFailed(0) => "no other engine is considered failed";
    Self::LifeInDoubt => "in doubt whether the engine runs: the demand may be withheld";
    Self::LifeConfirmed => "engine confirmed to run: the demand is sent";
    Self::TransmitterFailed => "transmitter failed: nothing was sent for 1 s";
    Self::TransmitterWorks => "transmitter works again";
} {
    Self::EngineIdentified(engine) => "ECU identified the engine as {}", Verbatim(engine.name());
    Self::VersionKnown(version) => "ECU reports protocol version {}", Whole(version.get().into());
    Self::Phase(phase) => "ECU reports {}", phase;
    Self::Faults(faults) => "ECU reports a fault: {}", faults;
    Self::RateConfirmed(rate) => "ECU confirmed the status rate, {} Hz", Whole(rate.hz());
    Self::RateNotConfirmed(rate) => "ECU did not confirm the status rate, {} Hz", Whole(rate.hz());
    Self::ServiceSent(service) => "service command sent: {}", service;
    Self::ServiceConfirmed(service) => "service command confirmed: {}", service;
    Self::ServiceFailed(service) => "service command failed: {}", service;
    Self::NotSent(why) => "not sent: {}", why;
    Self::Ordered(ordered) => "{}", ordered;
    Self::Armed(true, origin) => "armed by {}", origin;
    Self::Armed(false, origin) => "disarmed by {}", origin;
    Self::CommandRejected(why, origin) => "command from {} rejected: {}", origin, why;
    Self::SourceLoss(stage) => "source lost: {}", stage;
    Self::ActiveSource(origin) => "{} in control", origin;
    Self::Limit(violation) => "limit violated: {}", violation;
    Self::OtherFailed(count) => "number of other engines that failed: {}", Whole(count.into());
    Self::Resumed(demand) => "resumed after a reset, {}", demand;
    Self::RunCancelled(end) => "run cancelled: {}", end;
    Self::Clamped(max) => "demand clamped to the maximum, {} rpm", Whole(max.get());
});
