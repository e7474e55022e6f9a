//! The conversation with a toy ECU: a command in every send slot.

use super::codec::{Control, Decoder, FRAME_LEN, Frame, State};
use super::config::{Config, Service};
use crate::command::{Demand, Order, Rejected};
use crate::debounce::DebouncedState;
use crate::ecu::{Faults, Service as AnyService};
use crate::event::Event;
use crate::line::{Line, LineError, Timing};
use crate::link::{
    GapDetector, Link, LinkMonitor, LinkStatus, Observation, Outbox, Output, ServiceFrames, Speaks, Stage,
    Transmission, earlier,
};
use crate::report::{EcuState, NotSent, Phase, ReportedSwitch, Timed, bump};
use crate::units::{Hectopascals, Throttle};
use embassy_time::{Duration, Instant};

/// Interval between two frames of the ECU.
const FRAMES_EVERY: Duration = Duration::from_millis(100);

/// The conversation with one toy ECU.
#[derive(Clone, Debug)]
pub struct ToyLink {
    config: Config,
    decoder: Decoder,
    status: LinkStatus,
    monitor: LinkMonitor,
    gaps: GapDetector,
    outbox: Outbox,
    state: DebouncedState,
    order: Order,
    /// Takes the place of the order in the next send slot.
    service: Option<Service>,
    observation: Option<Observation>,
    next_slot: Option<Instant>,
}

impl ToyLink {
    fn frame(&mut self, now: Instant, frame: Frame) {
        self.gaps.frame(now);
        self.status.counters.frames += 1;
        if self.monitor.frame(now, &mut self.status) {
            self.outbox.event(Event::LinkUp);
        }
        let (stage, phase) = match frame.state {
            State::Rest => (Stage::Rest, Phase::Standby),
            State::Running => (Stage::Running, Phase::Running),
            State::Unknown(_) => (Stage::Unknown, Phase::Unknown),
        };
        self.observation =
            Some(Observation::State { stage, turning: Some(stage == Stage::Running), throttle: None });
        let state = EcuState { code: frame.state.code(), name: frame.state.name() };
        // It does not report its switch.
        let reports = (state, phase, ReportedSwitch::Unknown(0));
        self.state.state(now, reports, &mut self.status.report, &mut self.outbox);
        self.state.faults(now, Faults::Toy(frame.faults), &mut self.status.report, &mut self.outbox);
        self.status.report.egt = Some(Timed::new(frame.egt, now));
    }
}

impl Speaks for Config {
    type Link = ToyLink;

    fn link(self, line: Line, timing: Timing) -> ToyLink {
        ToyLink {
            config: self,
            decoder: Decoder::default(),
            status: LinkStatus::default(),
            monitor: LinkMonitor::new(timing),
            gaps: GapDetector::new(FRAME_LEN as u8, line, FRAMES_EVERY),
            outbox: Outbox::default(),
            state: DebouncedState::new(),
            order: Order::Listen,
            service: None,
            observation: None,
            next_slot: None,
        }
    }

    fn configure(self, link: &mut ToyLink, _now: Instant, _line: Line, timing: Timing) {
        link.config = self;
        link.monitor.configure(timing);
    }
}

impl Link for ToyLink {
    fn start(&mut self, now: Instant) {
        self.monitor.start(now);
        self.next_slot = Some(now);
    }
    fn receive(&mut self, now: Instant, bytes: &[u8]) -> usize {
        let (taken, frame) = self.decoder.feed(bytes);
        self.gaps.bytes(now, taken);
        if let Some(frame) = frame {
            self.frame(now, frame);
        }
        taken
    }
    fn line_error(&mut self, _error: LineError) {}
    fn order(&mut self, _now: Instant, order: Order) -> Result<(), Rejected> {
        match order {
            Order::Run(Demand::Rpm(_)) => Err(Rejected::NoSpeedControl),
            Order::Pwm => Err(Rejected::NotSupported),
            order => {
                self.order = order;
                Ok(())
            }
        }
    }
    fn speed_control(&self) -> Result<(), Rejected> {
        Err(Rejected::NoSpeedControl)
    }
    fn service(&mut self, _now: Instant, service: AnyService) -> Result<(), Rejected> {
        let AnyService::Toy(service) = service else { return Err(Rejected::NotSupported) };
        self.service = Some(service);
        Ok(())
    }
    fn pressure(&mut self, _now: Instant, _pressure: Hectopascals) {}
    fn sent(&mut self, _now: Instant) {
        bump(&mut self.status.counters.sent);
        self.outbox.done();
    }
    fn not_sent(&mut self, _now: Instant, why: NotSent) {
        self.status.counters.not_sent(why);
        self.outbox.event(Event::NotSent(why));
        self.outbox.done();
    }
    fn timeout(&mut self, now: Instant) {
        if self.monitor.timeout(now, &mut self.status) {
            self.outbox.event(Event::LinkLost);
        }
        let Some(due) = self.next_slot.filter(|due| now >= *due) else { return };
        self.next_slot = Some(due + self.config.send_every);
        let service = self.service.take_if(|_| self.order == Order::Standby);
        let control = match self.order {
            _ if service.is_some() => Control::Prime,
            Order::Standby => Control::Standby,
            Order::Run(_) => Control::Run,
            Order::EmergencyStop => Control::EmergencyStop,
            Order::Listen | Order::Doubt(_) | Order::Pwm => Control::Nothing,
        };
        if let Some(service) = service {
            self.outbox.event(Event::ServiceSent(AnyService::Toy(service)));
        }
        self.outbox.put(Transmission::new(control.encode(), None));
    }
    fn poll(&mut self) -> Output {
        let wait = Output::Wait(earlier(self.next_slot, self.monitor.deadline()));
        self.outbox.poll(&mut self.status).unwrap_or(wait)
    }
    fn take_observation(&mut self) -> Option<Observation> {
        self.observation.take()
    }
    fn release(&mut self, released: bool) -> Option<Throttle> {
        self.gaps.bridge(released);
        None
    }

    fn gap_at(&self) -> Option<Instant> {
        self.gaps.gap_at()
    }
    fn gap(&mut self) {
        self.gaps.gap();
    }
    fn answers_frames(&self) -> bool {
        false
    }
    fn reply_timeout(&self) -> Option<Duration> {
        None
    }
    fn close_pump(&mut self) {
        // It primes once for each command.
        self.service = None;
    }
    fn service_frames(&self) -> ServiceFrames {
        ServiceFrames { command: self.service.is_some(), ..ServiceFrames::default() }
    }
    fn status(&self) -> &LinkStatus {
        &self.status
    }
}
