//! One engine: commands from its sources in, one order to its ECU out.
//!
//! The rules here hold for every ECU; `docs/failsafe.md` has them as tables:
//!
//! - An emergency stop is latched until it is released with the engine stopped. It disarms.
//! - A source starts an engine with its own standby, then its own `Run` at idle, armed, with every interlock satisfied at
//!   that instant. The permission is used once, also by a refusal (`commands.rs`).
//! - A run belongs to one life of an engine (`life.rs`). While that life is in doubt, nothing is sent that could start an
//!   engine. When it is over, the order ends.
//! - The highest fresh source is in control. Without one the stages of loss follow: hold, fail-safe throttle, and standby
//!   where configured or where no engine is known to run. A timer detects silence, and a reset does not end it.
//! - The state that the ECU reports takes precedence over what was commanded.

pub mod config;
mod limits;
pub mod retained;
pub mod state;

mod commands;
mod configure;
mod exhaust;
mod governor;
mod life;
mod lives;
mod pump;
mod ramp;
mod reset;
mod run;
mod sending;
mod shaper;
mod sources;
mod supply;

use self::config::{START_TIMEOUT, Supervision};
use self::exhaust::Exhaust;
use self::life::{Finding, Life};
use self::limits::LimitMonitor;
use self::retained::RetainedState;
use self::run::{Arbitration, Run};
use self::shaper::{Lowered, Shaper};
use self::sources::Sources;
use self::state::EngineState;
use crate::command::{Accepted, Command, Demand, Interlock, Order, Ordered, Origin, Rejected};
use crate::config::{EngineConfig, LinkSettings};
use crate::ecu::EcuConfig;
use crate::ecu::any::AnyLink;
use crate::event::{Event, LossStage};
use crate::limit::{Action, LimitKind, LimitViolation};
use crate::line::{Line, LineError};
use crate::link::{Link, Output, Stage, earlier};
use crate::report::{LinkState, NotSent, Phase, Timed, bump};
use crate::telemetry::Telemetry;
use crate::units::{Hectopascals, Millivolts};
use embassy_time::{Duration, Instant};
use heapless::Deque;

pub use self::config::Loss;

/// Consecutive resets without a source after which an engine resumes at the fail-safe stage.
const RESETS_MAX: u8 = 3;

/// Grace period in which the ECU may report something other than the order.
const OBEY_GRACE: Duration = Duration::from_secs(3);
/// Time that all sources get to be received before a stream of standby counts, while it is not known which source was in
/// control.
const LISTEN_TO_SOURCES: Duration = Duration::from_secs(1);
/// Time without a transmission after which the transmitter is reported as failed and has to be opened again.
pub(crate) const TRANSMITTER_FAILED: Duration = Duration::from_secs(1);

/// The order, with the state that ends with it.
#[derive(Clone, Debug)]
#[allow(clippy::large_enum_variant, reason = "nothing allocates, and one engine has one mode")]
enum Mode {
    /// No order is in force until the ECU has reported what its engine does.
    Listen(Finding),
    /// Emergency stop, latched by this source.
    Stop(Origin),
    Standby,
    Run(Run),
    /// Handed over to the ECU's PWM input.
    Pwm {
        life: Life,
        /// Latest time to reach running.
        start_by: Option<Instant>,
    },
}

/// How a run begins.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
enum Beginning {
    /// A start.
    FromStandby,
    /// No order was in force, and the ECU reports a running engine.
    Found {
        /// Two reports confirm it; otherwise only the exhaust temperature does.
        confirmed: bool,
        /// Stage of a start that is under way, and time since it was ordered.
        starting: Option<(Stage, Duration)>,
        /// Time for which no source has been in control.
        lost_for: Duration,
    },
    /// The node was reset with an order in force: in doubt until two reports confirm it.
    Reset(RetainedState),
}

/// A start that waits until another engine of the group has started.
#[derive(Clone, Copy, Debug)]
struct StartWait {
    origin: Origin,
    until: Instant,
}

/// A service command that may have opened the fuel pump.
#[derive(Clone, Copy, Debug)]
struct OpenPump {
    origin: Origin,
    /// Last command of its source.
    last_rx: Instant,
    until: Instant,
}

/// Services that move fuel or heat, repeated without a pause. They share one time, so that a stream of them has an end.
#[derive(Clone, Copy, Debug)]
struct FuelService {
    since: Instant,
    last_rx: Instant,
}

/// One engine: its link, its sources and its order.
#[derive(Clone, Debug)]
pub struct Engine {
    link: AnyLink,
    line: Line,
    ecu: EcuConfig,
    /// Settings of the link that wait until the engine is at rest.
    link_settings: Option<LinkSettings>,
    config: Supervision,
    sources: Sources,
    mode: Mode,
    ordered: Ordered,
    armed: bool,
    /// Sources whose standby permits their next run to start the engine, in the order of [`Origin::ALL`].
    permitted: [bool; Origin::ALL.len()],
    /// Sources that last commanded "arm", and those that have to disarm before their "arm" counts again.
    arm_commanded: [bool; Origin::ALL.len()],
    must_disarm: [bool; Origin::ALL.len()],
    start_wait: Option<StartWait>,
    /// Time of the last start.
    last_start: Option<Instant>,
    /// Last time at which three expected frames were missing or the ECU reported its power-up: it may have restarted.
    last_gap: Option<Instant>,
    pump: Option<OpenPump>,
    /// Supply voltage that the board measures.
    board_supply: Option<Timed<Millivolts>>,
    fuel_service: Option<FuelService>,
    /// The last stage of loss ended the run.
    ended_by_loss: bool,
    /// The engine ran, and stopped or fell silent without a command.
    failed: bool,
    /// Number of failed engines in the rest of the group.
    others_failed: u8,
    limits: LimitMonitor,
    exhaust: Exhaust,
    /// Consecutive resets without a source, this one included.
    resets: u8,
    /// Time of the first failed transmission since the last good one, and whether that was reported.
    transmitter: Option<Instant>,
    transmitter_failed: bool,
    /// [`Engine::start`] was called. Until then the retained state is left unchanged.
    begun: bool,
    /// Time of that call.
    started: Instant,
    /// State that survived the reset, until the engine begins.
    retained: Option<RetainedState>,
    last_retained: Option<RetainedState>,
    /// Active source that was last reported.
    reported_source: Option<Origin>,
    /// A clamped demand was reported.
    clamp_reported: bool,
    /// Time since which the ECU has reported something other than the order.
    not_obeyed_since: Option<Instant>,
    /// That was reported.
    not_obeyed: bool,
    commands_rejected: u32,
    /// The last refusal of each source, in the order of [`Origin::ALL`].
    last_rejection: [Option<Rejected>; Origin::ALL.len()],
    /// Time of the last update. Deadlines before it have been handled.
    at: Instant,
    /// Wake-up time that was last handed out.
    wake: Option<Instant>,
    /// Whether the wake-up time and the record have to be computed again. Most bytes are in the middle of a frame and change
    /// neither.
    wake_stale: bool,
    record_stale: bool,
    /// Time of a frame that [`Engine::supervise`] has not handled yet.
    pending_frame: Option<Instant>,
    events: Deque<Event, 12>,
    events_dropped: u32,
}

impl Engine {
    /// An engine without an order.
    pub fn new(config: &EngineConfig) -> Self {
        Self {
            link: AnyLink::new(&config.ecu, config.line, config.timing),
            line: config.line,
            ecu: config.ecu,
            link_settings: None,
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
            board_supply: None,
            fuel_service: None,
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
            retained: None,
            last_retained: None,
            reported_source: None,
            clamp_reported: false,
            not_obeyed_since: None,
            not_obeyed: false,
            commands_rejected: 0,
            last_rejection: [None; Origin::ALL.len()],
            at: Instant::MIN,
            wake: None,
            wake_stale: true,
            record_stale: true,
            pending_frame: None,
            events: Deque::new(),
            events_dropped: 0,
        }
    }

    /// Whether a good frame waits for [`Engine::supervise`].
    pub const fn has_frame_to_supervise(&self) -> bool {
        self.pending_frame.is_some()
    }

    /// Takes bytes from the ECU; see [`Link::receive`]. Whether the engine still runs is judged before the reply to the frame
    /// is handed out. Everything else is left to [`Engine::supervise`] and takes effect with the next reply.
    pub fn receive(&mut self, now: Instant, bytes: &[u8]) -> usize {
        if self.wake.is_some_and(|at| at <= now) {
            self.update(now);
        }
        let taken = self.link.receive(now, bytes);
        if let Some(sign) = self.link.take_sign() {
            self.touch();
            self.pending_frame = Some(now);
            self.judge(now, sign);
        }
        taken
    }

    /// Counts a fault that the UART detected.
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
            run.sent = run.handed_out.take().unwrap_or(run.sent);
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
        // What has not reached the ECU must not jump when the transmitter works again.
        if let Mode::Run(run) = &mut self.mode {
            run.shaper.fall_back(now, run.sent);
            run.shaper.rise();
        }
        let since = *self.transmitter.get_or_insert(now);
        let failed = now >= since + TRANSMITTER_FAILED;
        if failed && !core::mem::replace(&mut self.transmitter_failed, true) {
            self.event(Event::TransmitterFailed);
        }
    }

    /// See [`Link::timeout`]. The order is updated first, so that a send slot of the link carries it.
    pub fn timeout(&mut self, now: Instant) {
        self.update(now);
        self.link.timeout(now);
        self.update(now);
    }

    /// Handles the frame that [`Engine::receive`] has taken: limits, sources, stages of loss. Call it after draining the
    /// outputs of that input, so that the reply to a frame does not wait for it; then drain again.
    pub fn supervise(&mut self) {
        if let Some(now) = self.pending_frame.take() {
            self.touch();
            self.look(now);
            self.update(now);
        }
    }

    /// See [`Link::compose`].
    pub fn compose(&mut self) {
        self.link.compose();
    }

    /// See [`Link::poll`]. It decides nothing: the inputs and [`Engine::compose`] do.
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

    /// The atmospheric pressure, for an ECU that requests it (ZK-14).
    pub fn pressure(&mut self, now: Instant, pressure: Hectopascals) {
        self.link.pressure(now, pressure);
    }

    /// Takes a command. The latest command of a source replaces its earlier one, the highest fresh source is in control, and a
    /// stop pre-empts everything. `others_allow_start`: no other engine of the group is starting.
    ///
    /// # Errors
    /// [`Rejected`] with the reason. The order does not change.
    pub fn command(
        &mut self,
        now: Instant,
        command: Command,
        origin: Origin,
        others_allow_start: bool,
    ) -> Result<Accepted, Rejected> {
        self.touch();
        let answer = self.execute(now, command, origin, others_allow_start);
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

    /// Whether the engine ran, and stopped or fell silent without a command.
    pub const fn failed(&self) -> bool {
        self.failed
    }

    /// Counts another engine of the group that failed or has recovered.
    pub fn other_failed(&mut self, now: Instant, failed: bool) {
        self.others_failed =
            if failed { self.others_failed.saturating_add(1) } else { self.others_failed.saturating_sub(1) };
        self.event(Event::OtherFailed(self.others_failed));
        self.update(now);
    }

    /// Takes a snapshot.
    pub fn telemetry(&self, now: Instant) -> Telemetry {
        let mut counters = self.link.status().counters;
        counters.commands_rejected = self.commands_rejected;
        counters.events_dropped = counters.events_dropped.wrapping_add(self.events_dropped);
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
            supply: self.supply(),
            ordered: self.ordered,
            obeyed: !self.not_obeyed,
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
            fuel_service: self.pump.is_some(),
            start_by: run.filter(|run| !run.life.reached()).and_then(|run| run.start_by),
            failed: self.failed,
            others_failed: self.others_failed,
            counters,
        }
    }

    // -----------------------------------------------------------------------------------------
    // The order
    // -----------------------------------------------------------------------------------------

    /// Latches an emergency stop. It disarms, and arming again needs a change from disarmed to armed.
    fn stop(&mut self, now: Instant, origin: Origin) {
        // The stop belongs to the highest source that commanded it.
        let by = match self.mode {
            Mode::Stop(by) if by.priority() > origin.priority() => by,
            _ => origin,
        };
        self.end();
        self.mode = Mode::Stop(by);
        self.failed = false;
        for (must, armed) in self.must_disarm.iter_mut().zip(self.arm_commanded) {
            *must |= armed;
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

    /// Ends permissions, a waiting start and an open fuel pump: common to stop and standby.
    fn end(&mut self) {
        self.permitted = [false; Origin::ALL.len()];
        self.start_wait = None;
        self.ended_by_loss = false;
        self.link.release(false);
        // A stop that is repeated is no new one.
        if matches!(self.mode, Mode::Stop(_)) { self.close_pump() } else { self.close_pump_again() }
    }

    /// Orders a run: a start, or the resumption of a running engine.
    fn begin(&mut self, now: Instant, demand: Demand, origin: Origin, beginning: Beginning) {
        let life = match beginning {
            Beginning::FromStandby => Life::ordered(),
            Beginning::Found { starting: Some((stage, _)), .. } => Life::found_starting(stage),
            Beginning::Found { confirmed: true, .. } => Life::found_running(),
            Beginning::Found { confirmed: false, .. } => Life::found_burning(now),
            Beginning::Reset(record) => Life::resumed(now, record.unconfirmed, record.after_gap),
        };
        let (limited, stage, (carried, all_carried), resumed_low) = match beginning {
            Beginning::Reset(record) => {
                let low = record.resets >= RESETS_MAX;
                let stage = if low { record.loss.max(LossStage::FailSafe) } else { record.loss };
                (record.limited, stage, (record.silent, record.all_silent), low)
            }
            // Of a time within the hold, the rest of it is left.
            Beginning::Found { lost_for, .. } if lost_for > self.config.loss.hold => {
                (false, LossStage::None, (lost_for, lost_for), false)
            }
            _ => (false, LossStage::None, Default::default(), false),
        };
        let fail_safe_at = match stage {
            LossStage::None | LossStage::Hold => None,
            // It began before the reset and does not begin again.
            LossStage::FailSafe | LossStage::Standby => Some(now),
        };
        let fail_safe_at = match beginning {
            // The stages of loss continue from where they were.
            Beginning::Found { lost_for, .. } if lost_for.as_ticks() > 0 => {
                let left = self.config.loss.hold.as_ticks().saturating_sub(lost_for.as_ticks());
                Some(now + Duration::from_ticks(left))
            }
            _ => fail_safe_at,
        };
        let fall_expected = match beginning {
            Beginning::Reset(record) => record.fall_expected,
            _ => Duration::from_ticks(0),
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
            active_source: origin,
            demand,
            shaped: demand,
            handed_out: None,
            // What the ECU has, until this run sends its own: idle, or what was in force before a reset.
            sent: demand,
            taking_over: None,
            fail_safe_at,
            stage,
            carried,
            all_carried,
            resumed: matches!(beginning, Beginning::Reset(_)),
            own_speed_control: self.link.may_hold_rpm()
                && matches!(
                    beginning,
                    Beginning::Reset(RetainedState { order: Order::Run(Demand::Rpm(_)), .. })
                ),
            resumed_low,
            limited,
            shaper: Shaper::new(now, demand),
            lowered: Lowered::new(now, demand, fall_expected),
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

    /// Longest time for a start: twice the ECU's own figure, where it has one.
    fn start_time(&self) -> Duration {
        match self.link.status().report.startup {
            Some(startup) if startup.value.as_ticks() > 0 => {
                let (min, max) = START_TIMEOUT;
                (startup.value * 2).clamp(min, max)
            }
            _ => self.config.start.timeout,
        }
    }

    const fn touch(&mut self) {
        self.wake_stale = true;
        self.record_stale = true;
    }

    /// Updates the order from the sources, the ECU and the time.
    fn update(&mut self, now: Instant) {
        self.touch();
        if !self.begun {
            return;
        }
        self.at = self.at.max(now);
        self.find_gap(now);
        self.expire(now);
        self.note_failure(now);
        self.apply_limits(now);
        self.arbitrate(now);
        self.shape(now);
        self.configure_resting_link(now);
        if let Some(active_source) = self.active(now)
            && self.reported_source.replace(active_source) != Some(active_source)
        {
            self.event(Event::ActiveSource(active_source));
        }
    }

    /// Ends what has timed out.
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
                (by.filter(|by| now >= *by), self.doubt_ends(life).is_some_and(|ends| now >= ends))
            }
            Mode::Listen(finding) => {
                if self.listen_ends(now, *finding).is_some_and(|at| now >= at) {
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
            let violation =
                LimitViolation { kind: LimitKind::StartTimeout, value: ms(now), limit: ms(by), at: now };
            self.sources.forget_runs();
            self.standby(now, Origin::Node);
            self.event(Event::Limit(violation));
        } else if unconfirmed {
            self.give_up_order(now);
        }
    }

    /// The active source: of a running engine the one whose demand is in force, of a stopped engine the one that stopped it.
    fn active(&self, now: Instant) -> Option<Origin> {
        match &self.mode {
            Mode::Listen(_) => None,
            Mode::Stop(by) => Some(*by),
            Mode::Run(run) => Some(run.active_source),
            Mode::Standby | Mode::Pwm { .. } => {
                self.sources.active(now).map(|(active_source, _)| active_source)
            }
        }
    }

    /// Determines the active source and the stage of loss.
    fn arbitrate(&mut self, now: Instant) {
        let living = self.lives();
        let Mode::Run(run) = &mut self.mode else { return };
        let mut events: Deque<Event, 4> = Deque::new();
        let doubted = run.life.in_doubt();
        let by = Arbitration { sources: &self.sources, config: &self.config, living, doubted };
        let standby_by = run.arbitrate(now, by, &mut events);
        for event in &events {
            self.event(*event);
        }
        if let Some(origin) = standby_by {
            self.standby(now, origin);
            self.ended_by_loss = origin == Origin::Node;
            self.permit(origin);
        }
    }

    /// Whether all sources had time to be received since the node started.
    fn settled(&self, now: Instant) -> bool {
        now >= self.started + LISTEN_TO_SOURCES
    }

    /// Permits the next run of this source to start the engine: its standby is in force.
    fn permit(&mut self, origin: Origin) {
        if let Some(permitted) = slot(&mut self.permitted, origin) {
            *permitted = origin != Origin::Node;
        }
    }

    /// Takes the action of a violated limit, also of one that was violated before the engine ran.
    fn apply_limits(&mut self, now: Instant) {
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

    /// Updates whether an engine that ran counts as failed: its ECU is silent, or reports faults instead of a state.
    fn note_failure(&mut self, now: Instant) {
        let Mode::Run(run) = &self.mode else { return };
        if !run.life.reached() {
            return;
        }
        let status = self.link.status();
        let reported = state::current_phase(now, &status.report).is_some();
        if status.state == LinkState::Lost || !reported && status.report.is_faulty() {
            self.failed = true;
        } else if run.life.in_doubt().is_none() && reported {
            self.failed = false;
        }
    }

    /// Checks the limits, and whether the ECU obeys.
    fn look(&mut self, now: Instant) {
        let lowered = match &self.mode {
            Mode::Run(run) => run.lowered.at(),
            _ => now,
        };
        let supply = self.supply();
        let (events, dropped) = (&mut self.events, &mut self.events_dropped);
        self.limits.observe(now, &self.link.status().report, supply, lowered, &mut |violation| {
            queue(events, dropped, Event::Limit(violation));
        });
        let not_obeyed = !self.obeys(now);
        self.not_obeyed_since = if not_obeyed { self.not_obeyed_since.or(Some(now)) } else { None };
        let not_obeyed = self.not_obeyed_since.is_some_and(|since| now >= since + OBEY_GRACE);
        if core::mem::replace(&mut self.not_obeyed, not_obeyed) != not_obeyed {
            self.event(if not_obeyed { Event::NotObeyed } else { Event::ObeyedAgain });
        }
    }

    fn deadline(&self) -> Option<Instant> {
        let now = self.at;
        let gap = self.link.gap_at();
        let wait = self.start_wait.map(|wait| wait.until);
        let pump = self.pump_ends();
        let sources = self.sources.deadline(now);
        let of_mode = match &self.mode {
            Mode::Listen(finding) => self.listen_ends(now, *finding),
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
        // A past deadline has been handled. It is set again by the input that it waits for.
        [gap, wait, pump, sources, of_mode].into_iter().flatten().filter(|at| *at > now).min()
    }

    fn phase(&self) -> Option<Phase> {
        self.link.status().report.phase.map(|phase| phase.value)
    }

    fn event(&mut self, event: Event) {
        queue(&mut self.events, &mut self.events_dropped, event);
    }
}

/// Queues an event, or counts it as dropped if the queue is full.
fn queue(events: &mut Deque<Event, 12>, dropped: &mut u32, event: Event) {
    if events.push_back(event).is_err() {
        bump(dropped);
    }
}

/// The entry of a source in a table in the order of [`Origin::ALL`].
fn slot<T>(table: &mut [T; Origin::ALL.len()], origin: Origin) -> Option<&mut T> {
    Origin::ALL.into_iter().zip(table).find(|(place, _)| *place == origin).map(|(_, slot)| slot)
}
