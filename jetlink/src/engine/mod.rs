//! One engine in plain words: what was commanded and by whom, and what is ordered of its ECU.
//!
//! The rules here hold for every ECU; `docs/failsafe.md` has them as tables:
//!
//! - An emergency stop is latched until it is released with the engine stopped. It disarms.
//! - A start is a permission that is used once: one source's own standby, then its own `Run` at idle, armed, with every
//!   interlock true at that instant. A refusal uses it up (`commands.rs`).
//! - A run belongs to one life of an engine ([`life`]). In doubt nothing goes out that could start one; when the life is
//!   over, the order ends.
//! - The highest source that is fresh is in control. When none is, the stages of loss begin: hold, fail-safe throttle, and
//!   standby where configured or where no engine is known to live. Silence is found by a timer, and resets do not end it.
//! - The ECU's own state wins over what was commanded.

pub mod config;
pub mod limits;
pub mod retained;
pub mod state;

mod commands;
mod exhaust;
mod governor;
pub mod life;
mod ramp;
mod reset;
mod run;
mod shaper;
mod sources;

use self::config::{START_TIMEOUT_MAX, START_TIMEOUT_MIN, Supervision};
use self::exhaust::{Burning, Exhaust};
use self::life::{Finding, Life};
use self::limits::LimitMonitor;
use self::retained::RetainedState;
use self::run::{Arbitration, RUN_OUT, Run};
use self::shaper::{Lowered, Shape, Shaper};
use self::sources::Sources;
use self::state::{EngineState, STATE_MAX_AGE};
use crate::command::{Accepted, Command, Demand, Interlock, Order, Ordered, Origin, Rejected};
use crate::config::EngineConfig;
use crate::ecu::any::AnyLink;
use crate::event::{End, Event, LossStage};
use crate::limit::Action;
use crate::limit::{LimitKind, LimitViolation};
use crate::line::LineError;
use crate::link::{Link, Output, Sign, Stage, earlier};
use crate::report::{LinkState, NotSent, Phase, ReportedSwitch, bump};
use crate::setting::SettingId;
use crate::telemetry::Telemetry;
use crate::units::{Hectopascals, Throttle};
use embassy_time::{Duration, Instant};
use heapless::Deque;

pub use self::config::Loss;

/// Resets in a row without a source after which an engine is resumed at the fail-safe stage.
const RESETS_MAX: u8 = 3;

/// For so long the ECU may report something else than what is ordered.
const OBEYS_WITHIN: Duration = Duration::from_secs(3);
/// So far the throttle that it reports may be from the one ordered, in tenths of a percent.
const OBEYED_BAND: u16 = 100;
/// Where nothing is known of whose an engine is, a stream of standby counts only after all sources had this time to speak.
const LISTEN_TO_SOURCES: Duration = Duration::from_secs(1);
/// A transmitter that fails for this long is reported, and to be opened anew.
pub(crate) const TRANSMITTER_FAILED: Duration = Duration::from_secs(1);

/// What is ordered, with what belongs to it and ends with it.
#[derive(Clone, Debug)]
#[allow(clippy::large_enum_variant, reason = "nothing allocates, and one engine has one mode")]
enum Mode {
    /// Nothing is in force: until the ECU has reported what its engine does.
    Listen(Finding),
    /// Emergency stop, latched by this source.
    Stop(Origin),
    Standby,
    Run(Run),
    /// Handed over to the ECU's PWM input.
    Pwm {
        life: Life,
        /// When the engine has to run by.
        start_by: Option<Instant>,
    },
}

/// How an order to run begins.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
enum Beginning {
    /// A start.
    FromStandby,
    /// Nothing was in force, and the ECU reports a running engine.
    Found {
        /// Two reports say so; otherwise the exhaust does.
        confirmed: bool,
        /// It is in a start, this far, that was ordered so long ago.
        starting: Option<(Stage, Duration)>,
        /// Since when no source has wanted anything.
        silent_since: Instant,
    },
    /// After a reset of the node, with an order in force: in doubt until two reports confirm it.
    Reset(RetainedState),
}

/// A start that waits while another engine of the group starts.
#[derive(Clone, Copy, Debug)]
struct StartWait {
    origin: Origin,
    until: Instant,
}

/// A service that may have opened the fuel.
#[derive(Clone, Copy, Debug)]
struct OpenPump {
    origin: Origin,
    /// When its source last spoke.
    heard: Instant,
    until: Instant,
}

/// One engine: its link, and what is commanded.
#[derive(Clone, Debug)]
pub struct Engine {
    link: AnyLink,
    config: Supervision,
    sources: Sources,
    mode: Mode,
    ordered: Ordered,
    armed: bool,
    /// The sources whose own standby permits their own next run to start the engine, in the order of [`Origin::ALL`].
    permitted: [bool; Origin::ALL.len()],
    /// The sources whose last word about arming was "arm", and those that have to say "disarm" before it counts again.
    arm_commanded: [bool; Origin::ALL.len()],
    must_disarm: [bool; Origin::ALL.len()],
    start_wait: Option<StartWait>,
    /// When the last start was asked for.
    last_start: Option<Instant>,
    /// When the ECU was last not heard for three expected frames, or said that it was powered up: it has, or may have, restarted.
    last_gap: Option<Instant>,
    pump: Option<OpenPump>,
    /// The last stage of loss brought it to standby.
    ended_by_loss: bool,
    /// It ran, and stopped or fell silent without a command.
    failed: bool,
    /// So many other engines of the group have failed.
    others_failed: u8,
    limits: LimitMonitor,
    exhaust: Exhaust,
    /// Resets in a row in which no source has spoken, this one counted.
    resets: u8,
    /// Since when nothing that was to be sent went out; and that was reported.
    transmitter: Option<Instant>,
    transmitter_failed: bool,
    /// [`Engine::start`] was called: until then what survived a reset stays as it is.
    begun: bool,
    /// When that was.
    started: Instant,
    /// What survived the reset, until the engine begins.
    kept: Option<RetainedState>,
    last_retained: Option<RetainedState>,
    /// The last ruler that was told.
    reported_source: Option<Origin>,
    /// A demand beyond the maximum was reported.
    clamp_reported: bool,
    /// Since when the ECU has reported something else than what is ordered.
    disobeys_since: Option<Instant>,
    /// That was told.
    disobeys: bool,
    commands_rejected: u32,
    /// The last refusal of each source, in the order of [`Origin::ALL`].
    last_rejection: [Option<Rejected>; Origin::ALL.len()],
    /// The time of the last update: deadlines before it have been dealt with.
    at: Instant,
    /// When it asked to be woken last.
    wake: Option<Instant>,
    /// Something has happened since that was found, and since the record was last looked at: most bytes are the middle of a
    /// frame, and change neither.
    wake_stale: bool,
    record_stale: bool,
    /// A frame came then that nobody has looked at yet.
    unseen: Option<Instant>,
    events: Deque<Event, 12>,
    events_lost: u32,
}

impl Engine {
    /// An engine of which nothing is ordered yet.
    pub fn new(config: &EngineConfig) -> Self {
        Self {
            link: AnyLink::new(&config.ecu, config.line, config.timing),
            config: config.supervision,
            sources: Sources::new(&config.supervision),
            mode: Mode::Listen(Finding::new(Instant::MIN, false)),
            ordered: Ordered { order: Order::Listen, origin: Origin::Node },
            armed: false,
            permitted: [false; Origin::ALL.len()],
            arm_commanded: [false; Origin::ALL.len()],
            must_disarm: [false; Origin::ALL.len()],
            start_wait: None,
            last_start: None,
            last_gap: None,
            pump: None,
            ended_by_loss: false,
            failed: false,
            others_failed: 0,
            limits: LimitMonitor::new(config.supervision.limits),
            exhaust: Exhaust::new(config.supervision.burning_egt),
            resets: 0,
            transmitter: None,
            transmitter_failed: false,
            begun: false,
            started: Instant::MIN,
            kept: None,
            last_retained: None,
            reported_source: None,
            clamp_reported: false,
            disobeys_since: None,
            disobeys: false,
            commands_rejected: 0,
            last_rejection: [None; Origin::ALL.len()],
            at: Instant::MIN,
            wake: None,
            wake_stale: true,
            record_stale: true,
            unseen: None,
            events: Deque::new(),
            events_lost: 0,
        }
    }

    /// A good frame was received that [`Engine::supervise`] has not looked at.
    pub const fn has_frame_to_supervise(&self) -> bool {
        self.unseen.is_some()
    }

    /// Bytes came from the ECU; see [`Link::receive`]. What the frame says about the life of the engine is judged before
    /// its reply is handed out; everything else is left to [`Engine::supervise`], and is in the next one.
    pub fn receive(&mut self, now: Instant, bytes: &[u8]) -> usize {
        if self.wake.is_some_and(|at| at <= now) {
            self.update(now);
        }
        let taken = self.link.receive(now, bytes);
        if let Some(sign) = self.link.take_sign() {
            self.touch();
            self.unseen = Some(now);
            self.judge(now, sign);
        }
        taken
    }

    /// The UART saw a fault.
    pub fn line_error(&mut self, error: LineError) {
        self.link.line_error(error);
    }

    /// See [`Link::byte_lost`].
    pub fn byte_lost(&mut self, error: LineError) {
        self.link.byte_lost(error);
    }

    /// See [`Link::sent`].
    pub fn sent(&mut self, now: Instant) {
        self.link.sent(now);
        if let Mode::Run(run) = &mut self.mode {
            run.sent = run.handed_out.take().or(run.sent);
        }
        self.touch();
        self.transmitter = None;
        if core::mem::take(&mut self.transmitter_failed) {
            self.event(Event::TransmitterWorks);
        }
    }

    /// See [`Link::not_sent`].
    pub fn not_sent(&mut self, now: Instant, why: NotSent) {
        self.link.not_sent(now, why);
        self.touch();
        if why == NotSent::TooLate {
            return;
        }
        let since = *self.transmitter.get_or_insert(now);
        let failed = now >= since + TRANSMITTER_FAILED;
        if failed && !core::mem::replace(&mut self.transmitter_failed, true) {
            self.event(Event::TransmitterFailed);
        }
    }

    /// See [`Link::timeout`]. What is ordered is brought up to date first, so that a turn of the link carries it.
    pub fn timeout(&mut self, now: Instant) {
        self.update(now);
        self.link.timeout(now);
        self.update(now);
    }

    /// Looks at the frame that [`Engine::receive`] has taken: limits, sources, stages of loss. Call it when the outputs of that
    /// input are drained, so that the reply to a frame does not wait for it; then drain again.
    pub fn supervise(&mut self) {
        if let Some(now) = self.unseen.take() {
            self.touch();
            self.look(now);
            self.update(now);
        }
    }

    /// See [`Link::poll`]. It only drains: everything is decided in the inputs.
    pub fn poll(&mut self) -> Output {
        let output = self.link.poll();
        if let (Output::Transmit(_), Mode::Run(run)) = (&output, &mut self.mode) {
            run.handed_out = Some(run.shaped);
        }
        match output {
            Output::Wait(deadline) => match self.events.pop_front() {
                Some(event) => Output::Event(event),
                None => {
                    if core::mem::take(&mut self.wake_stale) {
                        self.wake = earlier(deadline, self.deadline());
                    }
                    Output::Wait(self.wake)
                }
            },
            output => output,
        }
    }

    /// The atmospheric pressure, for an ECU that asks for it (ZK-14).
    pub fn pressure(&mut self, now: Instant, pressure: Hectopascals) {
        self.link.pressure(now, pressure);
    }

    /// New settings of the supervision. They hold from the next frame, command or deadline on.
    ///
    /// # Errors
    /// The first setting that is out of its range; nothing is changed then.
    pub fn configure(&mut self, now: Instant, config: &Supervision) -> Result<(), SettingId> {
        config.validate()?;
        self.touch();
        self.config = *config;
        self.sources.configure(config);
        self.limits.configure(config.limits);
        self.exhaust.configure(config.burning_egt);
        self.update(now);
        Ok(())
    }

    /// A command. The latest of a source wins, the highest fresh source rules, and a stop pre-empts everything.
    /// `others_allow_start`: no other engine of the group is starting.
    ///
    /// # Errors
    /// [`Rejected`] with the reason; what was in force stays in force.
    pub fn command(
        &mut self,
        now: Instant,
        command: Command,
        origin: Origin,
        others_allow_start: bool,
    ) -> Result<Accepted, Rejected> {
        self.touch();
        let answer = self.obey(now, command, origin, others_allow_start);
        match answer {
            Ok(_) => {
                self.note_rejection(origin, None);
            }
            Err(why) => {
                bump(&mut self.commands_rejected);
                if self.note_rejection(origin, Some(why)) != Some(why) {
                    self.event(Event::CommandRejected(why, origin));
                }
            }
        }
        self.update(now);
        answer
    }

    /// Whether another engine of the group has to wait with its start.
    pub fn blocks_other_starts(&self, now: Instant) -> bool {
        let starting = match &self.mode {
            Mode::Run(run) => !run.life.reached(),
            Mode::Pwm { life, .. } => !life.reached(),
            _ => false,
        };
        starting || self.last_start.is_some_and(|at| now < at + self.config.start.gap)
    }

    /// Whether it ran, and stopped or fell silent without a command.
    pub const fn failed(&self) -> bool {
        self.failed
    }

    /// Another engine of the group failed, or no longer has.
    pub fn other_failed(&mut self, now: Instant, failed: bool) {
        self.others_failed =
            if failed { self.others_failed.saturating_add(1) } else { self.others_failed.saturating_sub(1) };
        self.event(Event::OtherFailed(self.others_failed));
        self.update(now);
    }

    /// A snapshot.
    pub fn telemetry(&self, now: Instant) -> Telemetry {
        let mut counters = self.link.status().counters;
        counters.commands_rejected = self.commands_rejected;
        counters.events_lost = counters.events_lost.wrapping_add(self.events_lost);
        let run = match &self.mode {
            Mode::Run(run) => Some(run),
            _ => None,
        };
        let active_source = self.active(now).unwrap_or(self.ordered.origin);
        let ended = if self.ended_by_loss { LossStage::Standby } else { LossStage::None };
        Telemetry {
            at: now,
            link: self.link.status().state,
            last_rx: self.link.status().last_rx,
            state: EngineState::of(now, self.link.status().state, &self.link.status().report),
            report: self.link.status().report,
            ordered: self.ordered,
            obeyed: !self.disobeys,
            active_source,
            source_last_rx: self.sources.last_rx(active_source),
            commanded: run.map(|run| run.demand),
            waiting: run.and_then(|run| run.taking_over).map(|(origin, _)| origin),
            loss: run.map_or(ended, |run| run.stage),
            limited: run.is_some_and(|run| run.limited),
            in_doubt: match &self.mode {
                Mode::Run(Run { life, .. }) | Mode::Pwm { life, .. } => life.in_doubt(),
                _ => None,
            },
            start_waits_until: self.start_wait.map(|wait| wait.until),
            transmitter_failed: self.transmitter_failed,
            armed: self.armed,
            stop_latched: matches!(self.mode, Mode::Stop(_)),
            start_by: run.filter(|run| !run.life.reached()).and_then(|run| run.start_by),
            failed: self.failed,
            others_failed: self.others_failed,
            counters,
        }
    }

    // -----------------------------------------------------------------------------------------
    // What is ordered
    // -----------------------------------------------------------------------------------------

    /// Emergency stop, latched. It disarms, and arming again needs a change from disarmed to armed.
    fn stop(&mut self, now: Instant, origin: Origin) {
        // Whoever latched it first, or a higher one, holds it.
        let by = match self.mode {
            Mode::Stop(by) if by.priority() > origin.priority() => by,
            _ => origin,
        };
        self.end();
        self.mode = Mode::Stop(by);
        self.failed = false;
        for (must, said) in self.must_disarm.iter_mut().zip(self.arm_commanded) {
            *must |= said;
        }
        if core::mem::take(&mut self.armed) {
            self.event(Event::Armed(false, by));
        }
        self.order(now, Order::EmergencyStop, by);
    }

    fn standby(&mut self, now: Instant, origin: Origin) {
        self.end();
        self.mode = Mode::Standby;
        self.order(now, Order::Standby, origin);
    }

    /// What a stop and a standby both end: permissions, a start that waits, fuel that a service opened.
    fn end(&mut self) {
        self.permitted = [false; Origin::ALL.len()];
        self.start_wait = None;
        self.ended_by_loss = false;
        self.link.release(false);
        self.close_pump();
    }

    fn close_pump(&mut self) {
        if self.pump.take().is_some() {
            self.link.close_pump();
        }
    }

    /// When a pump that a service opened is closed: after its time, or the silence of its source.
    fn pump_ends(&self) -> Option<Instant> {
        let pump = self.pump?;
        let heard = self.sources.last_wanted(pump.origin).map_or(pump.heard, |at| at.max(pump.heard));
        let silent = heard.checked_add(self.config.ages.of(pump.origin)).unwrap_or(Instant::MAX);
        Some(silent.min(pump.until))
    }

    /// Orders a run: a start, or going on with an engine that runs.
    fn begin(&mut self, now: Instant, demand: Demand, origin: Origin, beginning: Beginning) {
        let life = match beginning {
            Beginning::FromStandby => Life::ordered(),
            Beginning::Found { starting: Some((stage, _)), .. } => Life::found_starting(stage),
            Beginning::Found { confirmed: true, .. } => Life::found_running(),
            Beginning::Found { confirmed: false, .. } | Beginning::Reset(_) => Life::after_reset(now),
        };
        let (limited, stage, (carried, all_carried), resumed_low) = match beginning {
            Beginning::Reset(record) => {
                let low = record.resets >= RESETS_MAX;
                let stage = if low { record.loss.max(LossStage::FailSafe) } else { record.loss };
                (record.limited, stage, (record.silent, record.all_silent), low)
            }
            _ => (false, LossStage::None, Default::default(), false),
        };
        let fail_safe_at = match stage {
            LossStage::None | LossStage::Hold => None,
            // It had begun before the reset, and does not begin anew.
            LossStage::FailSafe | LossStage::Standby => Some(now),
        };
        let fail_safe_at = match beginning {
            // The stages of loss go on where they were when the order was given up.
            Beginning::Found { silent_since, .. } if silent_since < now => {
                Some(silent_since + self.config.loss.hold)
            }
            _ => fail_safe_at,
        };
        let started = beginning == Beginning::FromStandby;
        let started_before = match beginning {
            Beginning::Found { starting: Some((_, before)), .. } => before,
            _ => Duration::from_ticks(0),
        };
        self.mode = Mode::Run(Run {
            began: now,
            started_before,
            life,
            start_by: (!life.reached()).then(|| {
                let left = self.start_time().as_ticks().saturating_sub(started_before.as_ticks());
                now + Duration::from_ticks(left)
            }),
            ruler: origin,
            demand,
            shaped: demand,
            handed_out: None,
            sent: None,
            taking_over: None,
            fail_safe_at,
            stage,
            carried,
            all_carried,
            resumed: matches!(beginning, Beginning::Reset(_)),
            // Where the switch went by ID 6, an rpm was the ECU's own to hold.
            own_speed_control: matches!(
                beginning,
                Beginning::Reset(RetainedState { order: Order::Run(Demand::Rpm(_)), by_id6: true, .. })
            ),
            resumed_low,
            limited,
            shaper: Shaper::new(now, demand),
            lowered: Lowered::new(now, demand),
            next: None,
        });
        self.permitted = [false; Origin::ALL.len()];
        self.start_wait = None;
        self.ended_by_loss = false;
        if started {
            self.last_start = Some(now);
        }
        self.update(now);
    }

    /// The time that a start may take: the ECU's own figure, doubled, where it has one.
    fn start_time(&self) -> Duration {
        match self.link.status().report.startup {
            Some(startup) if startup.value.as_ticks() > 0 => {
                (startup.value * 2).clamp(START_TIMEOUT_MIN, START_TIMEOUT_MAX)
            }
            _ => self.config.start.timeout,
        }
    }

    /// One frame, before its reply is handed out: what it says about the life of the engine.
    fn judge(&mut self, now: Instant, sign: Sign) {
        if sign == Sign::PowerUp {
            self.last_gap = Some(now);
        }
        self.see_exhaust(now, sign);
        let exhaust = self.exhaust.burning();
        let answers = self.link.answers_frames();
        match &mut self.mode {
            Mode::Stop(_) | Mode::Standby => {}
            Mode::Run(Run { life, .. }) | Mode::Pwm { life, .. } => {
                let doubted = life.in_doubt().is_some();
                let end = life.see(now, sign, exhaust);
                let doubts = life.in_doubt().is_some();
                match end {
                    Some(end) => self.life_over(now, end),
                    None => {
                        self.report_doubt(doubted, doubts);
                        if doubts {
                            // What is answered to a set of a doubtful engine depends on that set.
                            self.shape(now);
                        } else {
                            self.express(now);
                        }
                    }
                }
            }
            Mode::Listen(finding) => {
                let found = finding.see(sign, exhaust, answers);
                self.found(now, found, sign);
            }
        }
    }

    fn see_exhaust(&mut self, now: Instant, sign: Sign) {
        let egt = match sign {
            Sign::State { .. } => {
                self.link.status().report.egt.filter(|egt| egt.at == now).map(|egt| egt.value)
            }
            Sign::Faulted { egt, .. } => egt,
            _ => return,
        };
        let lowered = match &self.mode {
            Mode::Run(run) => run.lowered.last(),
            _ => None,
        };
        self.exhaust.see(now, egt, lowered);
    }

    /// The life that the run belongs to is over: the order ends.
    fn life_over(&mut self, now: Instant, end: End) {
        let reached = match &self.mode {
            Mode::Run(Run { life, .. }) | Mode::Pwm { life, .. } => life.reached(),
            _ => false,
        };
        let failed = reached && !self.link.status().shutting_down;
        self.sources.forget_runs();
        self.standby(now, Origin::Node);
        self.failed = failed;
        self.event(Event::RunCancelled(end));
    }

    fn report_doubt(&mut self, doubted: bool, doubts: bool) {
        match (doubted, doubts) {
            (false, true) => self.event(Event::LifeInDoubt),
            (true, false) => {
                let mut event = Event::LifeConfirmed;
                if let Mode::Run(run) = &mut self.mode {
                    run.shaper.rise();
                    if core::mem::take(&mut run.resumed) {
                        event = Event::Resumed(run.shaped);
                    }
                }
                self.event(event);
            }
            _ => {}
        }
    }

    const fn touch(&mut self) {
        self.wake_stale = true;
        self.record_stale = true;
    }

    /// Brings what is ordered up to date: with the sources, the ECU and the time.
    fn update(&mut self, now: Instant) {
        self.touch();
        if !self.begun {
            return;
        }
        self.at = self.at.max(now);
        self.find_gap(now);
        self.expire(now);
        self.note_failure(now);
        self.keep_limits(now);
        self.rule(now);
        self.shape(now);
        if let Some(ruler) = self.active(now)
            && self.reported_source.replace(ruler) != Some(ruler)
        {
            self.event(Event::ActiveSource(ruler));
        }
    }

    /// Three expected frames did not come: whatever lived is in doubt, at once.
    fn find_gap(&mut self, now: Instant) {
        if self.link.gap_at().is_none_or(|at| now < at) {
            return;
        }
        self.link.gap();
        self.last_gap = Some(now);
        match &mut self.mode {
            Mode::Run(Run { life, .. }) | Mode::Pwm { life, .. } => {
                let doubted = life.in_doubt().is_some();
                match life.gap(now) {
                    Some(end) => self.life_over(now, end),
                    None => {
                        self.report_doubt(doubted, true);
                        if let Mode::Run(run) = &mut self.mode
                            && let Some(sent) = run.sent
                        {
                            run.shaper.fall_back(now, sent);
                        }
                    }
                }
            }
            Mode::Listen(finding) => finding.gap(),
            Mode::Stop(_) | Mode::Standby => {}
        }
    }

    /// Ends what has had its time.
    fn expire(&mut self, now: Instant) {
        if self.pump_ends().is_some_and(|at| now >= at) {
            self.close_pump();
        }
        if let Some(wait) = self.start_wait
            && (!self.sources.in_control(now, wait.origin) || now >= wait.until)
        {
            self.use_up(wait.origin);
            self.event(Event::CommandRejected(Rejected::Start(Interlock::OtherStarting), wait.origin));
        }
        let start_time = self.start_time();
        let (late, unconfirmed) = match &self.mode {
            Mode::Run(Run { life, start_by, .. }) | Mode::Pwm { life, start_by } => {
                let restart = life.restarting().map(|since| since + start_time);
                let by = if life.reached() { restart } else { *start_by };
                let doubt = life.in_doubt().and_then(|since| self.link.doubt_ends(since));
                (by.filter(|by| now >= *by), doubt.is_some_and(|ends| now >= ends))
            }
            Mode::Listen(finding) => {
                if self.listened_out(now, *finding).is_some_and(|at| now >= at) {
                    self.standby(now, Origin::Node);
                    self.ended_by_loss = true;
                }
                return;
            }
            Mode::Stop(_) | Mode::Standby => return,
        };
        if let Some(by) = late {
            let began = match &self.mode {
                Mode::Run(run) => run.began,
                _ => by,
            };
            let ms = |until: Instant| {
                i32::try_from(until.saturating_duration_since(began).as_millis()).unwrap_or(i32::MAX)
            };
            let passed =
                LimitViolation { what: LimitKind::StartTimeout, value: ms(now), limit: ms(by), at: now };
            self.sources.forget_runs();
            self.standby(now, Origin::Node);
            self.event(Event::Limit(passed));
        } else if unconfirmed {
            self.give_up_order(now);
        }
    }

    /// Nothing has confirmed the life in time: permission and order are gone, the engine is not. Should the ECU report a
    /// running engine, however late, it goes on as one that was found running. A start ends.
    fn give_up_order(&mut self, now: Instant) {
        let (reached, pwm, silent_since, ruler) = match &self.mode {
            Mode::Run(run) => (run.life.reached(), false, run.silent_since(&self.config), run.ruler),
            // ID 0 leaves the PWM input in charge for as long as it takes.
            Mode::Pwm { life, .. } => (life.reached(), true, None, Origin::Node),
            _ => return,
        };
        if pwm && reached {
            return;
        }
        if !reached {
            self.life_over(now, End::GapInStart);
            return;
        }
        self.failed = true;
        // The stages of loss go on where they were.
        let silent_since = silent_since.unwrap_or(now);
        self.mode = Mode::Listen(Finding::new(now, true).silent_since(silent_since).controlled_by(ruler));
        self.order(now, Order::Listen, Origin::Node);
        self.event(Event::RunCancelled(End::Unconfirmed));
    }

    /// When nothing is in force and no source has wanted anything: standby goes out then. A ZK ECU from version 5 would keep
    /// running otherwise (ZK-10).
    fn listened_out(&self, now: Instant, finding: Finding) -> Option<Instant> {
        let silent_from = match self.sources.all_silent_from(now)? {
            // It spoke since nothing is in force.
            Some(from) if from > finding.since => from,
            _ => finding.silent_since,
        };
        let after = self.config.loss.hold + self.config.loss.standby_after.unwrap_or(RUN_OUT);
        silent_from
            .checked_add(Duration::from_ticks(after.as_ticks().saturating_sub(finding.carried.as_ticks())))
    }

    /// Who rules: of a running engine the source whose demand is in force, of a stopped one whoever stopped it.
    fn active(&self, now: Instant) -> Option<Origin> {
        match &self.mode {
            Mode::Listen(_) => None,
            Mode::Stop(by) => Some(*by),
            Mode::Run(run) => Some(run.ruler),
            Mode::Standby | Mode::Pwm { .. } => self.sources.active(now).map(|(ruler, _)| ruler),
        }
    }

    /// Finds whose demand is in force, and how far a loss has gone.
    fn rule(&mut self, now: Instant) {
        let living = self.lives();
        let Mode::Run(run) = &mut self.mode else { return };
        let mut told: Deque<Event, 4> = Deque::new();
        let doubted = run.life.in_doubt();
        let by = Arbitration { sources: &self.sources, config: &self.config, living, doubted };
        let standby_by = run.rule(now, by, &mut told);
        for event in &told {
            self.event(*event);
        }
        if let Some(origin) = standby_by {
            self.standby(now, origin);
            self.ended_by_loss = origin == Origin::Node;
            self.permit(origin);
        }
    }

    /// The ECU reports a running engine, and nothing puts that in doubt; or it reports faults only, and the exhaust burns.
    fn lives(&self) -> bool {
        let Mode::Run(Run { life, .. }) = &self.mode else { return false };
        let burns = life.only_faults() && !life.after_gap() && self.exhaust.burning() == Burning::Yes;
        life.reached() && (life.in_doubt().is_none() || burns)
    }

    /// All sources had time to speak since the node started.
    fn settled(&self, now: Instant) -> bool {
        now >= self.started + LISTEN_TO_SOURCES
    }

    /// The source's own standby is in force: its own next run may start the engine.
    fn permit(&mut self, origin: Origin) {
        if let Some(permitted) = slot(&mut self.permitted, origin) {
            *permitted = origin != Origin::Node;
        }
    }

    /// Does what a limit asks for that is passed. Also for one that was passed before the engine ran.
    fn keep_limits(&mut self, now: Instant) {
        let Mode::Run(run) = &mut self.mode else { return };
        match self.limits.in_force() {
            Some((_, Action::FailSafe)) => run.limited = true,
            Some((_, Action::Standby)) => {
                let failed = run.life.reached();
                self.sources.forget_runs();
                self.standby(now, Origin::Node);
                self.failed = failed;
            }
            _ => {}
        }
    }

    /// Whether an engine that ran counts as failed: its ECU is not heard, or reports faults in place of a state.
    fn note_failure(&mut self, now: Instant) {
        let Mode::Run(run) = &self.mode else { return };
        if !run.life.reached() {
            return;
        }
        let phase = self.link.status().report.phase;
        let old = phase.is_none_or(|phase| phase.age(now) > STATE_MAX_AGE);
        let only_faults =
            old && self.link.status().report.faults.is_some_and(|faults| !faults.value.is_empty());
        if self.link.status().state == LinkState::Lost || only_faults {
            self.failed = true;
        } else if run.life.in_doubt().is_none() && !old {
            self.failed = false;
        }
    }

    /// Orders the demand, as far as ramps, slew and limits let it go.
    fn shape(&mut self, now: Instant) {
        let idle_rpm = self.link.status().report.idle_rpm.map(|idle| idle.value);
        let shape = Shape {
            running: matches!(&self.mode, Mode::Run(run) if run.life.reached()),
            living: self.lives(),
            received: matches!(&self.mode, Mode::Run(run) if self.sources.has_wanted(run.ruler)),
            idle_rpm,
            max_rpm: self.link.status().report.max_rpm.map(|max| max.value),
            rpm: self.link.status().report.rpm,
            throttle: self
                .link
                .status()
                .report
                .throttle
                .filter(|throttle| throttle.age(now) <= STATE_MAX_AGE)
                .map(|throttle| throttle.value),
            reduced_to: self.config.when_other_fails.filter(|_| self.others_failed > 0),
            governed: !matches!(&self.mode, Mode::Run(run) if run.own_speed_control)
                && self.link.speed_control().is_err(),
        };
        let config = self.config;
        let speed_control = self.link.speed_control().is_ok();
        let Mode::Run(run) = &mut self.mode else { return };
        run.own_speed_control |= speed_control;
        let plan = run.plan();
        let (demand, next) = run.shaper.demand(now, plan, &shape, &config);
        run.next = next;
        run.lowered.see(now, demand);
        run.shaped = demand;
        self.express(now);
    }

    /// Gives the link what may go out now: the demand, or, while the life of the engine is in doubt, nothing that could
    /// start one.
    fn express(&mut self, now: Instant) {
        match &self.mode {
            Mode::Run(run) => {
                let origin = if run.stage == LossStage::None { run.ruler } else { Origin::Node };
                let (doubts, demand) = (run.life.in_doubt().is_some(), run.shaped);
                let open = !doubts || (self.link.answers_frames() && run.life.answers());
                self.link.release(run.life.reached());
                let sent = if open { self.order_demand(now, demand) } else { self.order_doubt(now, demand) };
                self.note_order(if doubts { Order::Doubt(demand) } else { sent }, origin);
            }
            Mode::Pwm { life, start_by } => {
                // After a reset it is ID 0 for good: what flies the engine by its PWM input goes on, and is not handed over anew.
                let resumed = start_by.is_none();
                let order = if resumed || life.in_doubt().is_some() { Order::Listen } else { Order::Pwm };
                let origin = self.ordered.origin;
                self.order(now, order, origin);
            }
            Mode::Listen(_) | Mode::Stop(_) | Mode::Standby => {}
        }
    }

    fn order_demand(&mut self, now: Instant, demand: Demand) -> Order {
        if self.link.order(now, Order::Run(demand)).is_ok() {
            return Order::Run(demand);
        }
        // An ECU that came back has not given its version yet: it keeps its rpm until it has.
        if self.waits_for_version() && matches!(&self.mode, Mode::Run(run) if run.life.reached()) {
            return self.order_doubt(now, demand);
        }
        // An ECU that changed its maximum may refuse an rpm; no link refuses a throttle.
        let idle = Order::Run(Demand::Throttle(Throttle::IDLE));
        let _ = self.link.order(now, idle);
        idle
    }

    /// The ECU has not given its version yet: whether it holds an rpm by itself is not known.
    fn waits_for_version(&self) -> bool {
        matches!(self.link.speed_control(), Err(Rejected::NeedsVersion { known: None, .. }))
    }

    fn order_doubt(&mut self, now: Instant, demand: Demand) -> Order {
        let order = Order::Doubt(demand);
        // No link refuses it.
        let _ = self.link.order(now, order);
        order
    }

    /// Looks for limits that were passed, and whether the ECU obeys.
    fn look(&mut self, now: Instant) {
        let lowered = match &self.mode {
            Mode::Run(run) => run.lowered.at(),
            _ => now,
        };
        self.limits.see(now, &self.link.status().report, lowered);
        while let Some(passed) = self.limits.found() {
            self.event(Event::Limit(passed));
        }
        let disobeys = !self.obeys(now);
        self.disobeys_since = if disobeys { self.disobeys_since.or(Some(now)) } else { None };
        let disobeys = self.disobeys_since.is_some_and(|since| now >= since + OBEYS_WITHIN);
        if core::mem::replace(&mut self.disobeys, disobeys) != disobeys {
            self.event(if disobeys { Event::NotObeyed } else { Event::ObeyedAgain });
        }
    }

    /// Whether what the ECU reports is what is ordered. What it has not said lately is.
    fn obeys(&self, now: Instant) -> bool {
        let report = &self.link.status().report;
        let switch = report.switch.filter(|switch| switch.age(now) <= STATE_MAX_AGE);
        let at_rest = self.phase().is_some_and(Phase::is_stopped);
        let switch_obeys = switch.is_none_or(|switch| match (self.ordered.order, switch.value) {
            (Order::Listen | Order::Doubt(_) | Order::Pwm, _) | (_, ReportedSwitch::Unknown(_)) => true,
            // It may end there by itself.
            (Order::EmergencyStop | Order::Standby, _) if at_rest => true,
            (Order::EmergencyStop, switch) => switch == ReportedSwitch::Stop,
            (Order::Standby, switch) => switch != ReportedSwitch::Run,
            (Order::Run(_), switch) => switch == ReportedSwitch::Run,
        });
        let throttle = report.throttle.filter(|throttle| throttle.age(now) <= STATE_MAX_AGE);
        let throttle_obeys = match (self.ordered.order, throttle) {
            (Order::Run(Demand::Throttle(ordered)), Some(reported))
                if self.phase() == Some(Phase::Running) && !self.link.status().shutting_down =>
            {
                ordered.tenths().abs_diff(reported.value.tenths()) <= OBEYED_BAND
            }
            _ => true,
        };
        switch_obeys && throttle_obeys
    }

    fn deadline(&self) -> Option<Instant> {
        let now = self.at;
        let gap = self.link.gap_at();
        let wait = self.start_wait.map(|wait| wait.until);
        let pump = self.pump_ends();
        let sources = self.sources.deadline(now);
        let of_mode = match &self.mode {
            Mode::Listen(finding) => self.listened_out(now, *finding),
            Mode::Run(run) => {
                let (living, doubted) = (self.lives(), run.life.in_doubt());
                let by = Arbitration { sources: &self.sources, config: &self.config, living, doubted };
                let take_over = run.taking_over.map(|(_, at)| at);
                [run.loss_deadline(&by), take_over, run.next, self.life_deadline(&run.life, run.start_by)]
                    .into_iter()
                    .flatten()
                    .min()
            }
            Mode::Pwm { life, start_by } => self.life_deadline(life, *start_by),
            Mode::Stop(_) | Mode::Standby => None,
        };
        // One that is over has been dealt with, and comes again with what it waits for.
        [gap, wait, pump, sources, of_mode].into_iter().flatten().filter(|at| *at > now).min()
    }

    /// When the start, a restart of the ECU's own, or the wait for a confirmation has had its time.
    fn life_deadline(&self, life: &Life, start_by: Option<Instant>) -> Option<Instant> {
        let start = start_by.filter(|_| !life.reached());
        let restart = life.restarting().map(|since| since + self.start_time());
        let doubt = life.in_doubt().and_then(|since| self.link.doubt_ends(since));
        [start, restart, doubt].into_iter().flatten().min()
    }

    /// An order that no link refuses.
    fn order(&mut self, now: Instant, order: Order, origin: Origin) {
        if self.link.order(now, order).is_ok() {
            self.note_order(order, origin);
        }
    }

    /// Keeps what is ordered; told only when it changes in kind, not at each new throttle.
    fn note_order(&mut self, order: Order, origin: Origin) {
        let before = self.ordered;
        self.ordered = Ordered { order, origin };
        let same_kind = core::mem::discriminant(&before.order) == core::mem::discriminant(&order);
        if !same_kind || before.origin != origin {
            self.event(Event::Ordered(self.ordered));
        }
    }

    fn phase(&self) -> Option<Phase> {
        self.link.status().report.phase.map(|phase| phase.value)
    }

    fn event(&mut self, event: Event) {
        if self.events.push_back(event).is_err() {
            bump(&mut self.events_lost);
        }
    }
}

/// The place of a source in a table in the order of [`Origin::ALL`].
fn slot<T>(table: &mut [T; Origin::ALL.len()], origin: Origin) -> Option<&mut T> {
    Origin::ALL.into_iter().zip(table).find(|(place, _)| *place == origin).map(|(_, slot)| slot)
}
