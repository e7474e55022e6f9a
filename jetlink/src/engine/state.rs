//! What an engine does, in plain words: from what its ECU reports and how old that is, never from what was
//! commanded. Each protocol's codes become a [`Phase`] in its own link; this puts age, switch and faults to it.

use crate::report::{EcuState, LinkState, Phase, Report, ReportedSwitch};
use embassy_time::{Duration, Instant};

/// An older state is not believed.
pub(super) const STATE_MAX_AGE: Duration = Duration::from_secs(3);

/// What an engine does.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum EngineState {
    /// The ECU is not heard.
    Offline,
    /// The ECU is heard and has not said, or not lately, what its engine does.
    NotKnown,
    /// Off.
    Stopped,
    /// Standby, ready for a start or not yet cleared for one.
    Standby,
    /// Shut down, and still turning or hot.
    Cooling,
    /// The ECU obeys "run" and has not begun.
    StartRequested,
    /// Starting; the ECU's own state is the step.
    Starting(EcuState),
    /// Running.
    Running,
    /// The ECU obeys "standby" or "stop" and the engine has not stopped yet.
    ShuttingDown,
    /// A test of the ECU's.
    Service,
    /// It does not run, and the ECU reports a fault.
    Fault,
}

impl EngineState {
    /// From what the ECU has said by now.
    pub fn of(now: Instant, link: LinkState, report: &Report) -> Self {
        if link != LinkState::Up {
            return Self::Offline;
        }
        let faulty = report.faults.is_some_and(|faults| !faults.value.is_empty());
        let phase = report.phase.filter(|phase| phase.age(now) <= STATE_MAX_AGE).map(|phase| phase.value);
        let switch = report.switch.map(|switch| switch.value);
        let run = switch == Some(ReportedSwitch::Run);
        let ending = matches!(switch, Some(ReportedSwitch::Standby | ReportedSwitch::Stop));
        match phase {
            Some(Phase::Running | Phase::Starting) if ending => Self::ShuttingDown,
            // Also with a switch that the document does not name: the state says enough.
            Some(Phase::Running) => Self::Running,
            Some(Phase::Starting) => {
                Self::Starting(report.state.map_or(EcuState { code: 0, name: "" }, |state| state.value))
            }
            // An AMT error set carries no state: a fault is then all that is known.
            _ if faulty => Self::Fault,
            Some(Phase::Stopped) => Self::Stopped,
            Some(Phase::Standby) if run => Self::StartRequested,
            Some(Phase::Standby) => Self::Standby,
            Some(Phase::Cooling) => Self::Cooling,
            Some(Phase::Service) => Self::Service,
            Some(Phase::Unknown) | None => Self::NotKnown,
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
