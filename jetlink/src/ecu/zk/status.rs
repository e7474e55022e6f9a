//! Turns the status frames of a ZK ECU into its report, with the values that decisions depend on debounced.

use super::codec::{Rate, State, Status, StatusFrame, SwitchStatus, Version, VoltageByte};
use crate::consecutive::AGREEING;
use crate::debounce::{Debounced, DebouncedState};
use crate::ecu::Faults;
use crate::event::Event;
use crate::link::{Observation, Outbox, Stage};
use crate::report::{EcuState, Phase, RawFrame, Reading, Report, ReportedSwitch, Timed};
use crate::units::{Rpm, Throttle};
use embassy_time::Instant;

/// Share of the maximum below which a shaft does not count as running, if no idle speed is known.
const HALF_IDLE_SHARE: u32 = 10;
/// The same if no maximum is known either. Below 4000 rpm, the reading of a shaft at rest is noise (field note).
const HALF_IDLE_UNKNOWN: Rpm = Rpm::new(10_000);

/// Reports that have to agree on a later version than the one known. An ECU that keeps talking does not become another one, but
/// CRC-8 lets one damaged frame in 256 through, and a later version allows commands that the ECU does not know.
const LATER_VERSION_REPORTS: u8 = 4;

/// The debounced status of an ECU: two reports have to agree before a value changes. All but the rate is discarded with the link.
#[derive(Clone, Debug)]
pub(super) struct DebouncedStatus {
    identity: Debounced<(Version, Rpm)>,
    idle: Debounced<Rpm>,
    /// Only used for when a frame is due, even while only damaged ones are received and the link counts as lost.
    rate: Debounced<Option<Rate>>,
    state: DebouncedState,
}

impl DebouncedStatus {
    /// Nothing yet.
    pub const fn new() -> Self {
        Self {
            identity: Debounced::new(None),
            idle: Debounced::new(None),
            rate: Debounced::new(None),
            state: DebouncedState::new(),
        }
    }

    /// The link is lost. The ECU that returns may have restarted, or be another one.
    pub fn forget(&mut self, report: &mut Report) {
        *self = Self { rate: self.rate, ..Self::new() };
        (report.phase, report.version, report.max_rpm, report.idle_rpm, report.rate) =
            (None, None, None, None, None);
        (report.startup, report.pressure_requested, report.closed_loop) = (None, None, None);
    }

    /// The status rate.
    pub fn rate(&self) -> Option<Rate> {
        self.rate.get().flatten()
    }

    /// Whether it reports an engine at rest.
    pub fn at_rest(&self) -> bool {
        self.state.phase().is_some_and(Phase::is_stopped)
    }

    /// Takes one frame.
    pub fn see(
        &mut self,
        now: Instant,
        frame: &StatusFrame,
        status: &Status,
        report: &mut Report,
        outbox: &mut Outbox,
    ) {
        let version = report.version.map(|version| version.value);
        let voltage = |byte: VoltageByte| {
            Some(Timed::new(Reading { raw: byte.0, voltage: byte.millivolts(version) }, now))
        };
        report.rpm = Some(Timed::new(frame.rpm(), now));
        match *status {
            Status::Engine { state, error, egt, switch } => {
                report.egt = Some(Timed::new(egt, now));
                let ecu_state = EcuState { code: state.code(), name: state.name() };
                let reports = (ecu_state, phase_of(state), reported(switch));
                self.state.state(now, reports, report, outbox);
                self.state.faults(now, Faults::Zk(error), report, outbox);
            }
            Status::Voltages { radio, power, pump } => {
                report.radio = voltage(radio);
                report.supply = voltage(power);
                report.pump = voltage(pump);
            }
            Status::Throttle { percent, pressure } => {
                if let Ok(throttle) = Throttle::from_percent(percent) {
                    report.set_throttle(now, throttle);
                }
                report.pressure = Some(Timed::new(pressure, now));
            }
            Status::Load { current, thrust } => {
                report.current = Some(Timed::new(current, now));
                if let Some(thrust) = thrust.known(version) {
                    report.thrust = Some(Timed::new(thrust, now));
                }
            }
            Status::Settings { ignition_pump, increase, decrease } => {
                report.ignition_pump = Some(Timed::new(ignition_pump, now));
                report.curve_increase = Some(Timed::new(increase, now));
                report.curve_decrease = Some(Timed::new(decrease, now));
            }
            Status::Identity { max_rpm, max_pump, version, rate } => {
                let max_pump = Reading { raw: max_pump.0, voltage: max_pump.millivolts(Some(version)) };
                report.pump_max = Some(Timed::new(max_pump, now));
                self.identity(now, version, max_rpm, report, outbox);
                report.rate = rate.map(|rate| Timed::new(rate, now));
                if self.rate.get().is_some() {
                    self.rate.see(rate);
                } else {
                    self.rate.set(rate);
                }
            }
            Status::Fuel { flow, total } => {
                report.fuel_flow = Some(Timed::new(flow, now));
                report.fuel_total = Some(Timed::new(total, now));
            }
            Status::Idle { idle_rpm, details } => {
                if self.idle.see(idle_rpm) {
                    report.idle_rpm = Some(Timed::new(idle_rpm, now));
                }
                if let Some(details) = details.known(version) {
                    report.pressure_requested = Some(Timed::new(details.pressure_requested, now));
                    report.closed_loop = Some(Timed::new(details.closed_loop, now));
                    report.startup = Some(Timed::new(details.startup, now));
                }
            }
            Status::Temperature { ecu } => report.ecu_temperature = Some(Timed::new(ecu, now)),
            Status::Unknown => {
                // ZK-15: a frame, not noise.
                report.unknown = Some(Timed::new(RawFrame::new(frame.raw()), now));
            }
        }
    }

    fn identity(
        &mut self,
        now: Instant,
        version: Version,
        max_rpm: Rpm,
        report: &mut Report,
        outbox: &mut Outbox,
    ) {
        let later = self.identity.get().is_some_and(|(known, _)| version > known);
        if !self.identity.see_frames((version, max_rpm), if later { LATER_VERSION_REPORTS } else { AGREEING })
        {
            return;
        }
        report.max_rpm = Some(Timed::new(max_rpm, now));
        let before = report.version.replace(Timed::new(version, now));
        if before.is_none_or(|before| before.value != version) {
            outbox.event(Event::VersionKnown(version));
        }
    }
}

/// Information in one frame about the life of the engine.
pub(super) fn observation_of(frame: &StatusFrame, status: &Status, report: &Report) -> Observation {
    let turning = frame.rpm() >= half_idle(report);
    match status {
        Status::Engine { state, .. } => {
            Observation::State { stage: stage_of(*state), turning: Some(turning), throttle: None }
        }
        _ => Observation::Shaft { turning },
    }
}

/// Half of the engine's idle speed, or an estimate while it is unknown.
fn half_idle(report: &Report) -> Rpm {
    let idle = report.idle_rpm.map(|idle| idle.value.get()).filter(|idle| *idle > 0);
    let max = report.max_rpm.map(|max| max.value.get()).filter(|max| *max > 0);
    match (idle, max) {
        (Some(idle), _) => Rpm::new(idle / 2),
        (None, Some(max)) => Rpm::new(max / HALF_IDLE_SHARE),
        (None, None) => HALF_IDLE_UNKNOWN,
    }
}

pub(super) fn reported(switch: SwitchStatus) -> ReportedSwitch {
    match switch {
        SwitchStatus::Stop => ReportedSwitch::Stop,
        SwitchStatus::Standby => ReportedSwitch::Standby,
        SwitchStatus::Run => ReportedSwitch::Run,
        SwitchStatus::Unknown(code) => ReportedSwitch::Unknown(code),
    }
}

/// Stage of the engine.
const fn stage_of(state: State) -> Stage {
    match state {
        State::Cooling => Stage::Cooling,
        State::Stop
        | State::Standby
        | State::TestGlowPlug
        | State::TestMainValve
        | State::TestIgnitionValve
        | State::TestPump
        | State::TestStarter
        | State::FuelExhaustAir => Stage::Rest,
        // The numbers are not in order: an ECU may preheat before it ignites.
        State::IgnitionMinThrottle | State::Ignition | State::Preheat => Stage::Ignition,
        State::FuelRamp => Stage::FuelRamp,
        State::LearningMax
        | State::LearningMin
        | State::LearningIdle
        | State::RunningMin
        | State::RunningPumpLimit
        | State::Running => Stage::Running,
        State::Restart => Stage::Restart,
        State::Unknown(_) => Stage::Unknown,
    }
}

/// Phase for the ECU's state.
const fn phase_of(state: State) -> Phase {
    match state {
        State::Stop => Phase::Stopped,
        State::Standby => Phase::Standby,
        State::Cooling => Phase::Cooling,
        State::IgnitionMinThrottle | State::Ignition | State::Preheat | State::FuelRamp | State::Restart => {
            Phase::Starting
        }
        State::LearningMax
        | State::LearningMin
        | State::LearningIdle
        | State::RunningMin
        | State::RunningPumpLimit
        | State::Running => Phase::Running,
        State::TestGlowPlug
        | State::TestMainValve
        | State::TestIgnitionValve
        | State::TestPump
        | State::TestStarter
        | State::FuelExhaustAir => Phase::Service,
        State::Unknown(_) => Phase::Unknown,
    }
}
