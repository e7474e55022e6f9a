//! The state of an engine, from the reports of its ECU and their age, never from commands. Each link turns the codes of its
//! protocol into a [`Phase`]; this adds age, switch and faults.

use crate::report::{EcuState, LinkState, Phase, REPORT_MAX_AGE, Report, ReportedSwitch};
use crate::sentence::sentences;
use crate::units::Verbatim;
use embassy_time::Instant;

/// The reported phase, unless its report is missing or old.
pub(super) fn current_phase(now: Instant, report: &Report) -> Option<Phase> {
    report.phase.filter(|phase| phase.age(now) <= REPORT_MAX_AGE).map(|phase| phase.value)
}

/// State of an engine.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[non_exhaustive]
pub enum EngineState {
    /// Nothing is received from the ECU.
    Offline,
    /// The ECU is received, but its last report of a state is missing or old.
    NotKnown,
    /// Off.
    Stopped,
    /// Standby, ready for a start or not yet cleared for one.
    Standby,
    /// Shut down, and still turning or hot.
    Cooling,
    /// The ECU obeys "run" and has not begun.
    StartRequested,
    /// Starting, with the ECU's own state.
    Starting(EcuState),
    /// Running.
    Running,
    /// The ECU obeys "standby" or "stop" and the engine has not stopped yet.
    ShuttingDown,
    /// Test of the ECU.
    Service,
    /// Not running, with a fault reported.
    Fault,
}

impl EngineState {
    /// Whether the ECU reports an engine that is off or in standby.
    pub const fn is_stopped(self) -> bool {
        matches!(self, Self::Stopped | Self::Standby)
    }

    /// State from the ECU's report.
    pub fn of(now: Instant, link: LinkState, report: &Report) -> Self {
        if link != LinkState::Up {
            return Self::Offline;
        }
        let phase = current_phase(now, report);
        let switch = report.switch.map(|switch| switch.value);
        let run = switch == Some(ReportedSwitch::Run);
        let ending = switch.is_some_and(ReportedSwitch::ends_a_run);
        match phase {
            Some(Phase::Running | Phase::Starting) if ending => Self::ShuttingDown,
            // Also with an unnamed switch position: the state suffices.
            Some(Phase::Running) => Self::Running,
            Some(Phase::Starting) => {
                Self::Starting(report.state.map_or(EcuState { code: 0, name: "" }, |state| state.value))
            }
            // An AMT error set carries no state: the fault is all that is known.
            _ if report.is_faulty() => Self::Fault,
            Some(Phase::Stopped) => Self::Stopped,
            Some(Phase::Standby) if run => Self::StartRequested,
            Some(Phase::Standby) => Self::Standby,
            Some(Phase::Cooling) => Self::Cooling,
            Some(Phase::Service) => Self::Service,
            Some(Phase::Unknown) | None => Self::NotKnown,
        }
    }

    /// Number of the state for a protocol or a log; an existing one never changes.
    pub const fn number(self) -> u8 {
        match self {
            Self::Offline => 0,
            Self::NotKnown => 1,
            Self::Stopped => 2,
            Self::Standby => 3,
            Self::Cooling => 4,
            Self::StartRequested => 5,
            Self::Starting(_) => 6,
            Self::Running => 7,
            Self::ShuttingDown => 8,
            Self::Service => 9,
            Self::Fault => 10,
        }
    }

    /// Name in lower case.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Offline => "offline",
            Self::NotKnown => "not known",
            Self::Stopped => "stopped",
            Self::Standby => "standby",
            Self::Cooling => "cooling",
            Self::StartRequested => "start requested",
            Self::Starting(_) => "starting",
            Self::Running => "running",
            Self::ShuttingDown => "shutting down",
            Self::Service => "service",
            Self::Fault => "fault",
        }
    }
}

sentences!(EngineState {
    Self::Offline => "offline";
    Self::NotKnown => "not known";
    Self::Stopped => "stopped";
    Self::Standby => "standby";
    Self::Cooling => "cooling";
    Self::StartRequested => "start requested";
    Self::Running => "running";
    Self::ShuttingDown => "shutting down";
    Self::Service => "service";
    Self::Fault => "fault";
} {
    Self::Starting(state) => "starting ({})", Verbatim(state.name);
});
