//! The conversation with an AMT ECU: one reply to every frame, within its window, and nothing else.
//!
//! An ECU that gets no replies stops its turbine after a time set in it (AMT-12). So jetlink sends no keep-alive,
//! and a reply always carries the order in force when it is handed out. Where nothing may be sent that could start an
//! engine ([`Order::Listen`], [`Order::Doubt`]), the reply is withheld.
//!
//! ```text
//!          ECU frame                       ECU frame
//! ────┤FF d1 d2 d3 d4 d5├──────────────────┤FF …        ECU to host
//!                       │
//!                       ├FF o t o t┤                    host to ECU
//!                       │◄── 30 ms ──►│                 the last stop bit is sent before this (AMT-11)
//! ```

use super::codec::{
    Control, Decoder, EngineModel, ErrorBits, FRAME_LEN, Frame, Message, Ops, State, SwitchPosition,
    VoltageScale,
};
use super::config::{Config, REPLY_WINDOW, Service};
use crate::command::{Demand, Order, Rejected};
use crate::debounce::{Debounced, DebouncedState};
use crate::ecu::{Faults, Service as AnyService};
use crate::event::Event;
use crate::line::{Line, LineError, Timing};
use crate::link::{
    Damage, GapDetector, Link, LinkMonitor, LinkStatus, Observation, Outbox, Output, Speaks, Stage,
    Transmission,
};
use crate::report::{EcuState, NotSent, Phase, RawFrame, Reading, ReportedSwitch, Timed, bump};
use crate::units::{Hectopascals, Rpm, Throttle};
use embassy_time::{Duration, Instant};

/// Interval between two sets of an ECU at 2400 baud (AMT-12: about eight per second). No document gives one for other rates.
const SET_INTERVAL: Duration = Duration::from_millis(125);

/// The conversation with one AMT ECU.
#[derive(Clone, Debug)]
pub struct AmtLink {
    config: Config,
    /// `None` if no reply fits the window: the link then only listens, and every reply counts as missed.
    slack: Option<Duration>,
    monitor: LinkMonitor,
    decoder: Decoder,
    status: LinkStatus,
    outbox: Outbox,
    order: Order,
    gaps: GapDetector,
    observation: Option<Observation>,
    /// The transmission of CTF was reported.
    ctf_ordered: bool,
    damage: Damage,
    /// End of the window of the reply that is being sent.
    sending: Option<Instant>,
    /// Time at which the last answered set was complete.
    replied: Option<Instant>,
    /// End of the window of a frame that has no reply yet.
    due: Option<Instant>,
    state: DebouncedState,
    /// The engine runs, so the demand is sent; until then the start throttle is (AMT-14).
    released: bool,
    /// `Some(None)`: the ECU reported an engine that is in no table.
    engine: Debounced<Option<EngineModel>>,
}

impl AmtLink {
    /// A link on a line with these settings.
    pub fn new(config: Config, line: Line, timing: Timing) -> Self {
        Self {
            config,
            slack: config.reply_slack(line),
            monitor: LinkMonitor::new(timing),
            decoder: Decoder::new(),
            status: LinkStatus::default(),
            outbox: Outbox::default(),
            order: Order::Listen,
            gaps: GapDetector::new(FRAME_LEN as u8, line, SET_INTERVAL),
            observation: None,
            ctf_ordered: false,
            damage: Damage::default(),
            sending: None,
            replied: None,
            due: None,
            state: DebouncedState::new(),
            released: false,
            engine: Debounced::new(config.engine.map(Some)),
        }
    }

    fn frame(&mut self, now: Instant, frame: &Frame) {
        // There is no checksum, so only a line error distinguishes a damaged frame from a good one. The frame's
        // values are discarded, but it is still answered. A line that damages every frame counts as lost.
        if self.damage.reaches_back(frame.raw().len()) {
            bump(&mut self.status.counters.damaged_frames);
            self.observation = Some(Observation::Damaged);
        } else {
            self.note_frame(now);
            self.use_values(now, frame);
        }
        self.answer(now);
    }

    fn note_frame(&mut self, now: Instant) {
        self.gaps.frame(now);
        // A silence that has lasted long enough was a loss, even if this frame is handled before the timer.
        if self.monitor.timeout(now, &mut self.status) {
            self.outbox.event(Event::LinkLost);
        }
        if self.monitor.frame(now, &mut self.status) {
            self.outbox.event(Event::LinkUp);
        }
    }

    fn use_values(&mut self, now: Instant, frame: &Frame) {
        match frame.message() {
            Message::Normal { switch, state, rpm, egt, throttle, vout } => {
                self.state(now, state, switch, rpm);
                self.observation = Some(Observation::State {
                    stage: stage_of(state),
                    turning: Some(rpm >= self.config.half_idle),
                    throttle: throttle.throttle(),
                });
                self.rpm(now, rpm);
                self.common(now, egt, throttle, vout);
                self.faults(now, ErrorBits(0));
            }
            Message::Error { errors, egt, throttle, vout } => {
                self.observation = Some(Observation::Faulted {
                    throttle: throttle.throttle(),
                    egt: (!errors.egt()).then(|| egt.celsius()),
                });
                self.common(now, egt, throttle, vout);
                self.faults(now, errors);
            }
            Message::Alternate { engine_id, idle, max, battery, external } => {
                self.observation = Some(Observation::Stateless);
                // An ID that is in no table is also another engine: its scale is then unknown (AMT-4).
                let certain = self.engine.get().is_none();
                self.identify(now, EngineModel::from_id(engine_id), certain);
                let engine = self.engine();
                let vout = engine.and_then(EngineModel::vout_scale);
                self.status.report.pump_idle = Some(Timed::new(reading(idle, vout), now));
                self.status.report.pump_max = Some(Timed::new(reading(max, vout), now));
                let battery = reading(battery, engine.and_then(EngineModel::battery_scale));
                self.status.report.supply = Some(Timed::new(battery, now));
                let external = reading(external, engine.and_then(EngineModel::external_scale));
                self.status.report.external_battery = Some(Timed::new(external, now));
            }
            Message::Setup(setup) => {
                // AMT-9: its text is long enough to be accepted at once.
                if let Some(engine) = setup.engine() {
                    self.identify(now, Some(engine), true);
                }
                self.status.report.amt_setup = Some(Timed::new(setup, now));
                // It is only sent after a power-up, so its engine is at rest.
                self.status.report.powered_up = Some(now);
                self.observation = Some(Observation::PowerUp);
                self.outbox.event(Event::EcuStarted);
            }
            Message::Unknown => {
                self.observation = Some(Observation::Stateless);
                self.status.report.unknown = Some(Timed::new(RawFrame::new(frame.raw()), now));
            }
        }
    }

    fn state(&mut self, now: Instant, state: State, switch: SwitchPosition, rpm: u8) {
        let ecu_state = EcuState { code: state.code(), name: state.name() };
        let switch_reported = match switch {
            SwitchPosition::EmergencyStop => ReportedSwitch::Stop,
            SwitchPosition::AutoStop => ReportedSwitch::Standby,
            SwitchPosition::Run => ReportedSwitch::Run,
        };
        let reports = (ecu_state, phase_of(state, switch, rpm), switch_reported);
        self.state.state(now, reports, &mut self.status.report, &mut self.outbox);
    }

    fn rpm(&mut self, now: Instant, raw: u8) {
        self.status.report.rpm_raw = Some(Timed::new(raw, now));
        // AMT-5: without a scale there is no rpm, and an old one would be wrong.
        self.status.report.rpm = self
            .engine()
            .and_then(EngineModel::rpm_step)
            .map(|step| Timed::new(Rpm::new(u32::from(raw) * step), now));
    }

    fn common(
        &mut self,
        now: Instant,
        egt: super::codec::EgtByte,
        throttle: super::codec::ThrottleByte,
        vout: u8,
    ) {
        self.status.report.egt = Some(Timed::new(egt.celsius(), now));
        if let Some(throttle) = throttle.throttle() {
            self.status.report.set_throttle(now, throttle);
        }
        let scale = self.engine().and_then(EngineModel::vout_scale);
        self.status.report.pump = Some(Timed::new(reading(vout, scale), now));
    }

    fn faults(&mut self, now: Instant, bits: ErrorBits) {
        self.state.faults(now, Faults::Amt(bits), &mut self.status.report, &mut self.outbox);
    }

    fn identify(&mut self, now: Instant, engine: Option<EngineModel>, certain: bool) {
        let before = self.engine.get();
        if certain {
            self.engine.set(engine);
        } else {
            self.engine.see(engine);
        }
        let changed = self.engine.get() != before;
        let reported = self.status.report.amt_engine.map(|engine| engine.value);
        if self.engine() != engine {
            // A single frame that contradicts the known state is debounced.
            return;
        }
        self.status.report.amt_engine = engine.map(|engine| Timed::new(engine, now));
        if changed || reported != engine {
            self.outbox.event(match engine {
                Some(engine) => Event::EngineIdentified(engine),
                None => Event::EngineUnknown,
            });
        }
    }

    fn engine(&self) -> Option<EngineModel> {
        self.engine.get().flatten()
    }

    fn count(&mut self) {
        let decoder = self.decoder.counters();
        let counters = &mut self.status.counters;
        counters.frames = decoder.frames;
        counters.unknown_frames = decoder.unknown_frames;
        counters.truncated = decoder.truncated.wrapping_add(decoder.malformed);
        counters.bytes_skipped = decoder.bytes_skipped;
    }

    /// AMT-11: one reply to this frame, right now or not at all. Its content is decided when it is handed out, so that it
    /// takes into account what this frame reports about the engine.
    fn answer(&mut self, now: Instant) {
        let in_time = self.slack.is_some();
        if self.due.take().is_some() || !in_time {
            self.missed();
        }
        self.due = in_time.then(|| now + REPLY_WINDOW);
    }

    /// Latest time for the first start bit of a reply.
    fn start_by(&self, window_end: Instant) -> Option<Instant> {
        self.slack.map(|slack| window_end - REPLY_WINDOW + slack)
    }

    fn missed(&mut self) {
        bump(&mut self.status.counters.replies_missed);
        self.outbox.event(Event::NotSent(NotSent::TooLate));
    }

    /// Content of the reply; `None` if it is withheld.
    fn control(&self) -> Option<Control> {
        let (ops, throttle) = match self.order {
            Order::Listen | Order::Doubt(_) => return None,
            Order::EmergencyStop => (Ops::EmergencyStop, Throttle::IDLE),
            Order::Run(Demand::Throttle(throttle)) => {
                // AMT-14: until full operation, the start throttle.
                (Ops::Run, if self.released { throttle } else { self.config.start_throttle })
            }
            // `order` refuses an rpm and a hand-over.
            Order::Standby | Order::Pwm | Order::Run(Demand::Rpm(_)) => (Ops::AutoStop, Throttle::IDLE),
        };
        // AMT-13: only as a separate command, and never instead of an emergency stop.
        let ops = if self.status.shutting_down && ops != Ops::EmergencyStop { Ops::Ctf } else { ops };
        Some(Control { ops, throttle })
    }

    fn transmission_over(&mut self, now: Instant) {
        self.sending = None;
        self.outbox.done();
        if let Some(window_end) = self.due
            && self.start_by(window_end).is_none_or(|start_by| now > start_by)
        {
            self.due = None;
            self.missed();
        }
    }
}

impl Speaks for Config {
    type Link = AmtLink;

    fn link(self, line: Line, timing: Timing) -> AmtLink {
        AmtLink::new(self, line, timing)
    }

    fn configure(self, link: &mut AmtLink, _now: Instant, line: Line, timing: Timing) {
        link.config = self;
        link.slack = self.reply_slack(line);
        link.monitor.configure(timing);
    }
}

impl Link for AmtLink {
    fn start(&mut self, now: Instant) {
        self.monitor.start(now);
        self.gaps.start(now);
    }

    fn receive(&mut self, now: Instant, bytes: &[u8]) -> usize {
        if self.gaps.broke_off(now) {
            // Bytes of another set would complete this one, which has an old state.
            self.decoder.byte_lost();
        }
        let (taken, frame) = self.decoder.feed(bytes);
        self.damage.received(taken, bytes.len());
        self.gaps.bytes(now, taken);
        self.count();
        if let Some(frame) = frame {
            self.frame(now, &frame);
        }
        taken
    }

    fn line_error(&mut self, error: LineError) {
        self.damage.line_error();
        self.status.counters.line_error(error);
    }

    fn byte_lost(&mut self, error: LineError) {
        // The frame that it was in is never complete. Between two frames, it damages neither.
        self.decoder.byte_lost();
        self.count();
        self.status.counters.line_error(error);
    }

    fn order(&mut self, _now: Instant, order: Order) -> Result<(), Rejected> {
        match order {
            Order::Run(Demand::Rpm(_)) => return Err(Rejected::NoSpeedControl),
            Order::Pwm => return Err(Rejected::NotSupported),
            Order::EmergencyStop
            | Order::Standby
            | Order::Listen
            | Order::Doubt(_)
            | Order::Run(Demand::Throttle(_)) => {}
        }
        self.order = order;
        // AMT-13: new demands do not cancel CTF, so that a source that streams them cannot.
        if !matches!(order, Order::Run(_) | Order::Doubt(_)) {
            self.status.shutting_down = false;
        }
        Ok(())
    }

    fn speed_control(&self) -> Result<(), Rejected> {
        Err(Rejected::NoSpeedControl)
    }

    fn service(&mut self, _now: Instant, service: AnyService) -> Result<(), Rejected> {
        match service {
            AnyService::Amt(Service::Ctf) if matches!(self.order, Order::Run(_) | Order::Doubt(_)) => {
                self.status.shutting_down = true;
                self.ctf_ordered = false;
                Ok(())
            }
            AnyService::Amt(Service::Ctf) => Err(Rejected::NotOrderedToRun),
            _ => Err(Rejected::NotSupported),
        }
    }

    fn pressure(&mut self, _now: Instant, _pressure: Hectopascals) {
        // An AMT ECU never requests it.
    }

    fn sent(&mut self, now: Instant) {
        bump(&mut self.status.counters.sent);
        if let Some(window_end) = self.sending {
            // A reply that was not sent does not keep an engine running.
            self.replied = Some(window_end - REPLY_WINDOW);
            match window_end.checked_duration_since(now) {
                Some(margin) => {
                    let worst = self.status.counters.worst_reply_margin.get_or_insert(margin);
                    *worst = margin.min(*worst);
                }
                None => bump(&mut self.status.counters.replies_late),
            }
        }
        self.transmission_over(now);
    }

    fn not_sent(&mut self, now: Instant, why: NotSent) {
        self.status.counters.not_sent(why);
        bump(&mut self.status.counters.replies_missed);
        self.outbox.event(Event::NotSent(why));
        self.transmission_over(now);
    }

    fn timeout(&mut self, now: Instant) {
        if self.monitor.timeout(now, &mut self.status) {
            self.outbox.event(Event::LinkLost);
        }
    }

    fn compose(&mut self) {
        if self.outbox.busy() {
            return;
        }
        let Some(window_end) = self.due.take() else { return };
        let Some(control) = self.control() else { return };
        if control.ops == Ops::Ctf && !core::mem::replace(&mut self.ctf_ordered, true) {
            self.outbox.event(Event::ServiceSent(AnyService::Amt(Service::Ctf)));
        }
        self.sending = Some(window_end);
        self.outbox.put(Transmission::new(control.encode(), self.start_by(window_end)));
    }

    fn poll(&mut self) -> Output {
        self.outbox.poll(&mut self.status).unwrap_or(Output::Wait(self.monitor.deadline()))
    }

    fn take_observation(&mut self) -> Option<Observation> {
        self.observation.take()
    }

    fn release(&mut self, released: bool) -> Option<Throttle> {
        self.released = released;
        self.gaps.bridge(released);
        (!released).then_some(self.config.start_throttle)
    }

    fn gap_at(&self) -> Option<Instant> {
        self.gaps.gap_at()
    }

    fn gap(&mut self) {
        self.gaps.gap();
    }

    fn answers_frames(&self) -> bool {
        true
    }

    fn reply_timeout(&self) -> Option<Duration> {
        Some(self.config.serial_delay)
    }

    fn last_reply(&self) -> Option<Instant> {
        self.replied
    }

    fn status(&self) -> &LinkStatus {
        &self.status
    }
}

/// Stage of the engine (AMT-3).
const fn stage_of(state: State) -> Stage {
    match state {
        State::NoStartClearance => Stage::Rest,
        State::StartClearance => Stage::Clearance,
        State::Starting => Stage::Starting,
        State::StartedUp => Stage::StartedUp,
        State::IdleCalibration => Stage::Calibrating,
        State::FullOperation | State::MaxRpm | State::MaxRpmField => Stage::Running,
        State::Unknown(_) => Stage::Unknown,
    }
}

/// Phase for the ECU's state (AMT-3).
fn phase_of(state: State, switch: SwitchPosition, rpm: u8) -> Phase {
    match state {
        State::NoStartClearance | State::StartClearance if rpm > 0 && switch != SwitchPosition::Run => {
            // The document names no state for this: shut down, and the shaft still turns.
            Phase::Cooling
        }
        State::NoStartClearance if switch == SwitchPosition::EmergencyStop => Phase::Stopped,
        State::NoStartClearance | State::StartClearance => Phase::Standby,
        State::Starting | State::StartedUp | State::IdleCalibration => Phase::Starting,
        State::FullOperation | State::MaxRpm | State::MaxRpmField => Phase::Running,
        State::Unknown(_) => Phase::Unknown,
    }
}

fn reading(raw: u8, scale: Option<VoltageScale>) -> Reading {
    Reading { raw, voltage: scale.map(|scale| scale.millivolts(raw)) }
}
