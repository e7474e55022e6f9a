//! The conversation with an AMT ECU: one reply to every frame, inside its window, and none otherwise.
//!
//! An ECU without replies stops its turbine by itself after a time set in it (AMT-12). So there is no keep-alive
//! of our own, and a reply always carries what is ordered now.
//!
//! ```text
//!          ECU frame                       ECU frame
//! ────┤FF d1 d2 d3 d4 d5├──────────────────┤FF …        ECU to host
//!                       │
//!                       ├FF o t o t┤                    host to ECU
//!                       │◄── 30 ms ──►│                 the last stop bit is out before this (AMT-11)
//! ```

use super::codec::{CONTROL_LEN, VoltageScale};
use super::codec::{Control, Decoder, Engine, ErrorBits, Frame, Message, Ops, State, SwitchPosition};
use crate::command::{Demand, Order, Rejected};
use crate::ecu::{Faults, Service as AnyService};
use crate::line::{Line, LineError};
use crate::link::{Agreed, Link, Outbox, Output, Presence, Timing, Transmission};
use crate::telemetry::{
    Counters, EcuState, Event, LinkState, NotSent, Phase, RawFrame, Reading, Report, ReportedSwitch, Timed,
    bump,
};
use crate::units::{Hectopascals, Rpm, Throttle};
use embassy_time::{Duration, Instant};

/// From the last stop bit of an ECU frame to the last stop bit of its reply (AMT-11).
pub const REPLY_WINDOW: Duration = Duration::from_millis(30);

/// How an AMT ECU is spoken to.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[cfg_attr(target_os = "none", derive(defmt::Format))]
pub struct Config {
    /// The engine, if its scale shall be known before the ECU names it. What the ECU says wins.
    pub engine: Option<Engine>,
    /// Throttle sent with "run" until the ECU reports full operation: some want the stick up for a start
    /// (AMT-14).
    pub start_throttle: Throttle,
    /// Left free at the end of the reply window, for the difference between two clocks.
    pub reply_guard: Duration,
}

impl Config {
    /// Engine not known, start throttle 0 %, guard 0.5 ms.
    pub const DEFAULT: Self =
        Self { engine: None, start_throttle: Throttle::IDLE, reply_guard: Duration::from_micros(500) };

    /// Heard after two frames, because they carry no checksum; lost after 1 s, eight frames at 2400 baud.
    pub const TIMING: Timing = Timing { up_after: 2, lost_after: Duration::from_secs(1) };

    /// Time for the first start bit of a reply, counted from the last stop bit of the ECU's frame.
    /// 9.1 ms less the guard at 2400 baud; `None` where a reply does not fit the window at all.
    pub const fn reply_slack(&self, line: Line) -> Option<Duration> {
        let needed = line.time_of(CONTROL_LEN as u32).as_ticks().saturating_add(self.reply_guard.as_ticks());
        if needed >= REPLY_WINDOW.as_ticks() {
            return None;
        }
        Some(Duration::from_ticks(REPLY_WINDOW.as_ticks() - needed))
    }
}

/// Service commands of an AMT ECU.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[cfg_attr(target_os = "none", derive(defmt::Format))]
pub enum Service {
    /// CTF: while running, the ECU stops the engine after its serial delay time. Refused unless the engine is ordered to
    /// run. Sent until standby or a stop is ordered; new demands do not call it off. Never used for a normal stop (AMT-13).
    Ctf,
}

impl Service {
    pub(crate) const fn needs_stopped_engine(self) -> bool {
        match self {
            Self::Ctf => false,
        }
    }
}

/// The conversation with one AMT ECU.
#[derive(Clone, Debug)]
pub struct AmtLink {
    config: Config,
    /// `None` where no reply fits the window: the line is then listened to, and every reply counts as missed.
    slack: Option<Duration>,
    presence: Presence,
    decoder: Decoder,
    report: Report,
    outbox: Outbox,
    counters: Counters,
    order: Order,
    /// What the ECU says it obeys, in two sets in a row: said back to it while nothing is ordered, which changes
    /// nothing. One odd set must not be said back: it could say emergency stop, or run.
    mirror: Agreed<Control>,
    ctf: bool,
    /// That it went out was told.
    ctf_told: bool,
    /// The UART saw a fault in the frame that is coming in: its values will not be believed.
    damaged: bool,
    /// End of the window of the reply that is going out.
    sending: Option<Instant>,
    /// End of the window of a frame that came while the reply before it was still going out.
    due: Option<Instant>,
    phase: Agreed<Phase>,
    switch: Agreed<ReportedSwitch>,
    /// Whether the sets are error sets. One odd set is no fault.
    faulty: Agreed<bool>,
    /// Full operation was reported, and nothing below it since: the demand goes out (AMT-14). A state
    /// without a name does not end it.
    released: bool,
    /// `Some(None)`: the ECU named an engine that no table has.
    engine: Agreed<Option<Engine>>,
}

impl AmtLink {
    /// A link on a line of this setting.
    pub fn new(config: Config, line: Line, timing: Timing) -> Self {
        Self {
            config,
            slack: config.reply_slack(line),
            presence: Presence::new(timing),
            decoder: Decoder::new(),
            report: Report::default(),
            outbox: Outbox::default(),
            counters: Counters::default(),
            order: Order::Listen,
            mirror: Agreed::new(None),
            ctf: false,
            ctf_told: false,
            damaged: false,
            sending: None,
            due: None,
            phase: Agreed::new(None),
            switch: Agreed::new(None),
            faulty: Agreed::new(Some(false)),
            released: false,
            engine: Agreed::new(config.engine.map(Some)),
        }
    }

    fn frame(&mut self, now: Instant, frame: &Frame) {
        // There is no checksum, so a line error is all that can tell a damaged frame from a good one. It
        // costs the frame's values, never the reply. A line that damages every frame is as good as lost.
        if core::mem::take(&mut self.damaged) {
            bump(&mut self.counters.damaged_frames);
        } else {
            self.hear(now);
            self.believe(now, frame);
        }
        self.answer(now);
    }

    fn hear(&mut self, now: Instant) {
        // Silence that has lasted long enough was a loss, also if this frame comes before the timer.
        if self.presence.timeout(now) {
            self.outbox.event(Event::LinkLost);
        }
        if self.presence.frame(now) {
            self.outbox.event(Event::LinkUp);
        }
    }

    fn believe(&mut self, now: Instant, frame: &Frame) {
        match frame.message() {
            Message::Normal { switch, state, rpm, egt, throttle, vout } => {
                self.state(now, state, switch, rpm);
                self.mirror.see(Control {
                    ops: match switch {
                        SwitchPosition::EmergencyStop => Ops::EmergencyStop,
                        SwitchPosition::AutoStop => Ops::AutoStop,
                        SwitchPosition::Run => Ops::Run,
                    },
                    throttle: Throttle::from_tenths(throttle.tenths()).unwrap_or(Throttle::IDLE),
                });
                self.rpm(now, rpm);
                self.common(now, egt, throttle, vout);
                self.faults(now, ErrorBits(0));
            }
            Message::Error { errors, egt, throttle, vout } => {
                self.common(now, egt, throttle, vout);
                self.faults(now, errors);
            }
            Message::Alternate { engine_id, idle, max, battery, external } => {
                // An ID that no table has is another engine all the same: its scale is then not known (AMT-4).
                let certain = self.engine.get().is_none();
                self.identify(now, Engine::from_id(engine_id), certain);
                let engine = self.engine();
                let vout = engine.and_then(Engine::vout_scale);
                self.report.pump_idle = Some(Timed::new(reading(idle, vout), now));
                self.report.pump_max = Some(Timed::new(reading(max, vout), now));
                let battery = reading(battery, engine.and_then(Engine::battery_scale));
                self.report.supply = Some(Timed::new(battery, now));
                let external = reading(external, engine.and_then(Engine::external_scale));
                self.report.external_battery = Some(Timed::new(external, now));
            }
            Message::Setup(setup) => {
                // AMT-9: its text is long enough to believe it at once.
                if let Some(engine) = setup.engine() {
                    self.identify(now, Some(engine), true);
                }
                self.report.amt_setup = Some(Timed::new(setup, now));
                // It comes after a power-up only, so its engine stands.
                self.report.powered_up = Some(now);
                self.mirror.set(Control { ops: Ops::AutoStop, throttle: Throttle::IDLE });
                self.outbox.event(Event::EcuStarted);
            }
            Message::Unknown => {
                self.report.unknown = Some(Timed::new(RawFrame::new(frame.raw()), now));
            }
        }
    }

    fn state(&mut self, now: Instant, state: State, switch: SwitchPosition, rpm: u8) {
        let ecu_state = EcuState { code: state.code(), name: state.name() };
        self.report.state = Some(Timed::new(ecu_state, now));
        let switch_reported = match switch {
            SwitchPosition::EmergencyStop => ReportedSwitch::Stop,
            SwitchPosition::AutoStop => ReportedSwitch::Standby,
            SwitchPosition::Run => ReportedSwitch::Run,
        };
        self.switch.see(switch_reported);
        if self.switch.get() == Some(switch_reported) {
            self.report.switch = Some(Timed::new(switch_reported, now));
        }
        let seen = phase_of(state, switch, rpm);
        if self.phase.see(seen)
            && let Some(phase) = self.phase.get()
        {
            self.outbox.event(Event::Phase(phase));
            self.released = phase == Phase::Running || (phase == Phase::Unknown && self.released);
        }
        // A frame that says otherwise does not make the phase any newer.
        if self.phase.get() == Some(seen) {
            self.report.phase = Some(Timed::new(seen, now));
        }
    }

    fn rpm(&mut self, now: Instant, raw: u8) {
        self.report.rpm_raw = Some(Timed::new(raw, now));
        // AMT-5: without a scale there is no rpm, and an old one would be a lie.
        self.report.rpm = self
            .engine()
            .and_then(Engine::rpm_step)
            .map(|step| Timed::new(Rpm::new(u32::from(raw) * step), now));
    }

    fn common(
        &mut self,
        now: Instant,
        egt: super::codec::EgtByte,
        throttle: super::codec::ThrottleByte,
        vout: u8,
    ) {
        self.report.egt = Some(Timed::new(egt.celsius(), now));
        if let Ok(throttle) = Throttle::from_tenths(throttle.tenths()) {
            self.report.throttle = Some(Timed::new(throttle, now));
        }
        let scale = self.engine().and_then(Engine::vout_scale);
        self.report.pump = Some(Timed::new(reading(vout, scale), now));
    }

    fn faults(&mut self, now: Instant, bits: ErrorBits) {
        self.faulty.see(bits.0 != 0);
        if self.faulty.get() != Some(bits.0 != 0) {
            return;
        }
        let faults = Faults::Amt(bits);
        let before = self.report.faults.map_or(Faults::Amt(ErrorBits(0)), |faults| faults.value);
        self.report.faults = Some(Timed::new(faults, now));
        if faults != before {
            self.outbox.event(Event::Faults(faults));
        }
    }

    fn identify(&mut self, now: Instant, engine: Option<Engine>, certain: bool) {
        let changed = if certain { self.engine.set(engine) } else { self.engine.see(engine) };
        let told = self.report.amt_engine.map(|told| told.value);
        if self.engine() != engine {
            // One frame against what was known: not yet believed.
            return;
        }
        self.report.amt_engine = engine.map(|engine| Timed::new(engine, now));
        if changed || told != engine {
            self.outbox.event(match engine {
                Some(engine) => Event::EngineIdentified(engine),
                None => Event::EngineUnknown,
            });
        }
    }

    fn engine(&self) -> Option<Engine> {
        self.engine.get().flatten()
    }

    /// AMT-11: one reply to this frame, right now or not at all.
    fn answer(&mut self, now: Instant) {
        if self.order == Order::Listen && self.mirror.get().is_none() {
            // After a reset, and the ECU has not said yet what it obeys. A wrong answer could stop a running engine;
            // no answer does not, for the ECU's serial delay time.
            return;
        }
        let window_end = now + REPLY_WINDOW;
        if self.outbox.idle() {
            self.reply(now, window_end);
        } else if self.due.replace(window_end).is_some() {
            self.missed();
        }
    }

    fn reply(&mut self, now: Instant, window_end: Instant) {
        let start_by = self.slack.map(|slack| window_end - REPLY_WINDOW + slack);
        match start_by {
            Some(start_by) if now <= start_by => {
                self.sending = Some(window_end);
                let control = self.control();
                if control.ops == Ops::Ctf && !core::mem::replace(&mut self.ctf_told, true) {
                    self.outbox.event(Event::ServiceSent(AnyService::Amt(Service::Ctf)));
                }
                self.outbox.put(Transmission::new(control.encode(), Some(start_by)));
            }
            _ => self.missed(),
        }
    }

    fn missed(&mut self) {
        bump(&mut self.counters.replies_missed);
        self.outbox.event(Event::NotSent(NotSent::TooLate));
    }

    /// What the reply says.
    fn control(&self) -> Control {
        let (ops, throttle) = match self.order {
            Order::EmergencyStop => (Ops::EmergencyStop, Throttle::IDLE),
            Order::Run(Demand::Throttle(throttle)) => {
                // AMT-14: until full operation, the start throttle.
                (Ops::Run, if self.released { throttle } else { self.config.start_throttle })
            }
            Order::Listen => match self.mirror.get() {
                Some(Control { ops, throttle }) => (ops, throttle),
                None => (Ops::AutoStop, Throttle::IDLE),
            },
            // An rpm is refused by `order`, a hand-over too.
            Order::Standby | Order::Pwm | Order::Run(Demand::Rpm(_)) => (Ops::AutoStop, Throttle::IDLE),
        };
        // AMT-13: asked for by its own name, and never instead of an emergency stop.
        let ops = if self.ctf && ops != Ops::EmergencyStop { Ops::Ctf } else { ops };
        Control { ops, throttle }
    }

    fn transmission_over(&mut self, now: Instant) {
        self.sending = None;
        self.outbox.done();
        if let Some(window_end) = self.due.take() {
            self.reply(now, window_end);
        }
    }
}

impl Link for AmtLink {
    fn start(&mut self, now: Instant) {
        self.presence.start(now);
    }

    fn receive(&mut self, now: Instant, bytes: &[u8]) -> usize {
        let (taken, frame) = self.decoder.feed(bytes);
        if let Some(frame) = frame {
            self.frame(now, &frame);
        } else if self.decoder.pending() == 0 {
            // The fault was in a byte between frames, as every power-up of an ECU makes them.
            self.damaged = false;
        }
        taken
    }

    fn line_error(&mut self, error: LineError) {
        self.damaged = true;
        self.counters.line_error(error);
    }

    fn order(&mut self, _now: Instant, order: Order) -> Result<(), Rejected> {
        match order {
            Order::Run(Demand::Rpm(_)) => return Err(Rejected::NoSpeedControl),
            Order::Pwm => return Err(Rejected::NotSupported),
            Order::EmergencyStop | Order::Standby | Order::Listen | Order::Run(Demand::Throttle(_)) => {}
        }
        // Going on after a reset with an ECU that sends nothing but error sets: it runs as far as anybody knows, and
        // the start throttle would be a dip.
        let only_faults = self.report.faults.is_some_and(|faults| !faults.value.is_empty());
        self.released |= self.order == Order::Listen && self.phase.get().is_none() && only_faults;
        self.order = order;
        // AMT-13: new demands do not call CTF off, so that a source that streams them cannot.
        if !matches!(order, Order::Run(_)) {
            self.ctf = false;
        }
        let control = self.control();
        self.outbox.rewrite(|| control.encode());
        Ok(())
    }

    fn speed_control(&self) -> Result<(), Rejected> {
        Err(Rejected::NoSpeedControl)
    }

    fn service(&mut self, _now: Instant, service: AnyService) -> Result<(), Rejected> {
        match service {
            AnyService::Amt(Service::Ctf) if matches!(self.order, Order::Run(_)) => {
                self.ctf = true;
                self.ctf_told = false;
                Ok(())
            }
            AnyService::Amt(Service::Ctf) => Err(Rejected::NotOrderedToRun),
            AnyService::Zk(_) => Err(Rejected::NotSupported),
        }
    }

    fn pressure(&mut self, _now: Instant, _pressure: Hectopascals) {
        // An AMT ECU never asks for it.
    }

    fn sent(&mut self, now: Instant) {
        bump(&mut self.counters.sent);
        if let Some(window_end) = self.sending {
            match window_end.checked_duration_since(now) {
                Some(margin) => {
                    let worst = self.counters.worst_reply_margin.get_or_insert(margin);
                    *worst = margin.min(*worst);
                }
                None => bump(&mut self.counters.replies_late),
            }
        }
        self.transmission_over(now);
    }

    fn not_sent(&mut self, now: Instant, why: NotSent) {
        self.counters.not_sent(why);
        bump(&mut self.counters.replies_missed);
        self.outbox.event(Event::NotSent(why));
        self.transmission_over(now);
    }

    fn timeout(&mut self, now: Instant) {
        if self.presence.timeout(now) {
            self.outbox.event(Event::LinkLost);
        }
    }

    fn poll(&mut self) -> Output {
        self.outbox.poll().unwrap_or(Output::Wait(self.presence.deadline()))
    }

    fn report(&self) -> &Report {
        &self.report
    }

    fn state(&self) -> LinkState {
        self.presence.state()
    }

    fn heard(&self) -> Option<Instant> {
        self.presence.heard()
    }

    fn up_since(&self) -> Option<Instant> {
        self.presence.up_since()
    }

    fn shutting_down(&self) -> bool {
        self.ctf
    }

    fn frames(&self) -> u32 {
        self.decoder.counters().frames
    }

    fn counters(&self) -> Counters {
        let decoder = self.decoder.counters();
        Counters {
            frames: decoder.frames,
            unknown_frames: decoder.unknown_frames,
            truncated: decoder.truncated.wrapping_add(decoder.malformed),
            bytes_skipped: decoder.bytes_skipped,
            events_lost: self.outbox.events_lost,
            ..self.counters
        }
    }
}

/// The ECU's state in plain words (AMT-3).
fn phase_of(state: State, switch: SwitchPosition, rpm: u8) -> Phase {
    match state {
        State::NoStartClearance | State::StartClearance if rpm > 0 && switch != SwitchPosition::Run => {
            // The document names no state for it: shut down, and the shaft still turns.
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
