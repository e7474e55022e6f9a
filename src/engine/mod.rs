//! One engine in plain words: what was commanded and by whom, and what is ordered of its ECU.
//!
//! The rules here hold for every ECU:
//!
//! - An emergency stop is latched until it is released with the engine stopped.
//! - A start is two commands, standby and then run, and every interlock has to allow it. A source that goes on sending
//!   `Run` can neither start an engine at power-up nor restart one that stopped.
//! - The highest source that is fresh rules. When none is, the stages of loss begin: hold, fail-safe throttle, and
//!   only if so configured standby. Silence is found by a timer.
//! - The ECU's own state wins: an engine that stopped is ordered to standby, whatever was commanded.
//! - After a reset nothing is ordered until the ECU has said what its engine does. One that runs goes on.

pub mod config;
pub mod keep;
pub mod state;
pub mod watch;

mod commands;
mod demand;
mod governor;
mod ramp;
mod reset;
mod sources;

use self::config::{Action, START_TIMEOUT_MAX, START_TIMEOUT_MIN, Supervision};
use self::demand::{Lowered, Shape, Shaper};
use self::keep::Record;
use self::sources::Sources;
use self::state::{EngineState, STATE_MAX_AGE};
use self::watch::{Passed, Watch, Watched};
use crate::command::{Accepted, Command, Demand, Order, Ordered, Origin, Rejected};
use crate::config::EngineConfig;
use crate::ecu::AnyLink;
use crate::line::LineError;
use crate::link::{Link, Output, earlier};
use crate::telemetry::{Event, LinkState, LossStage, NotSent, Phase, ReportedSwitch, Telemetry, bump};
use crate::units::{Hectopascals, Throttle};
use embassy_time::{Duration, Instant};
use heapless::Deque;

pub use self::config::Loss;

/// For so long the ECU may report something else than what is ordered.
const OBEYS_WITHIN: Duration = Duration::from_secs(3);
/// So far the throttle that it reports may be from the one ordered, in tenths of a percent.
const OBEYED_BAND: u16 = 100;
/// So many reports in a row of a standing engine withdraw an order to run.
const STOPPED_REPORTS: u8 = 3;

/// What is ordered, with what belongs to it and ends with it.
#[derive(Clone, Debug)]
enum Mode {
    /// After a reset: until the ECU has said what its engine does.
    Listen {
        kept: Option<Record>,
        until: Option<Instant>,
        /// When it first reported an engine that stands; a second report has to agree.
        stands: Option<Instant>,
    },
    /// Emergency stop, latched by this source.
    Stop(Origin),
    Standby,
    Run(Run),
    Pwm,
}

/// How an order to run begins.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
enum Beginning {
    /// A start.
    FromStandby,
    /// After a reset, with an engine that runs.
    GoingOn {
        /// A limit had lowered its demand.
        limited: bool,
        /// How far the loss of its source had gone.
        loss: LossStage,
    },
}

impl Mode {
    const fn listen(kept: Option<Record>) -> Self {
        Self::Listen { kept, until: None, stands: None }
    }
}

/// An engine that is ordered to run.
#[derive(Clone, Debug)]
struct Run {
    /// When it was ordered.
    began: Instant,
    /// When it has to run by.
    start_by: Option<Instant>,
    /// The ECU reported it starting or running under this order.
    came_alive: bool,
    /// The ECU reports it running, in two reports in a row: the demand goes out. One report otherwise, perhaps of a damaged
    /// frame, and a state without a name do not end that.
    running: bool,
    /// The report before.
    before: Option<Phase>,
    seen: Option<Instant>,
    /// Reports in a row that the engine stands.
    stopped_reports: u8,
    /// Whose demand is in force.
    ruler: Origin,
    /// That demand, before it is shaped.
    demand: Demand,
    /// Another source waits to take over, until then at the latest.
    taking_over: Option<(Origin, Instant)>,
    /// No source is fresh: when the fail-safe stage begins, or has begun.
    fail_safe_at: Option<Instant>,
    stage: LossStage,
    /// A limit was passed whose action is the fail-safe throttle.
    limited: bool,
    shaper: Shaper,
    /// When the demand on the wire was last lowered.
    lowered: Lowered,
    /// When the shaped demand moves on.
    next: Option<Instant>,
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
    /// Standby was commanded, and no run since: the next run may start the engine.
    start_allowed: bool,
    /// When the last start was asked for.
    last_start: Option<Instant>,
    /// The last stage of loss brought it to standby.
    ended_by_loss: bool,
    /// It ran, and stopped or fell silent without a command.
    failed: bool,
    /// So many other engines of the group have failed.
    others_failed: u8,
    watch: Watch,
    given_to_keep: Option<Record>,
    /// The last ruler that was told.
    ruler_told: Option<Origin>,
    /// Since when the ECU has reported something else than what is ordered.
    disobeys_since: Option<Instant>,
    /// That was told.
    disobeys: bool,
    commands_rejected: u32,
    /// The last refusal of each source, in the order of [`Origin::ALL`].
    last_rejection: [Option<Rejected>; Origin::ALL.len()],
    /// When it asked to be woken last.
    wake: Option<Instant>,
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
            mode: Mode::listen(None),
            ordered: Ordered { order: Order::Listen, origin: Origin::Node },
            armed: false,
            start_allowed: false,
            last_start: None,
            ended_by_loss: false,
            failed: false,
            others_failed: 0,
            watch: Watch::new(config.supervision.limits),
            given_to_keep: None,
            ruler_told: None,
            disobeys_since: None,
            disobeys: false,
            commands_rejected: 0,
            last_rejection: [None; Origin::ALL.len()],
            wake: None,
            unseen: None,
            events: Deque::new(),
            events_lost: 0,
        }
    }

    /// A good frame came that nobody has looked at yet: [`Engine::poll`] does.
    pub const fn has_unseen_frame(&self) -> bool {
        self.unseen.is_some()
    }

    /// Bytes came from the ECU; see [`Link::receive`]. The reply says what is ordered by now; what the frame itself changes
    /// is found when the reply has been handed out, and is in the next one.
    pub fn receive(&mut self, now: Instant, bytes: &[u8]) -> usize {
        if self.wake.is_some_and(|at| at <= now) {
            self.update(now);
        }
        // Not the time of the last frame: several can come at once.
        let before = self.link.frames();
        let taken = self.link.receive(now, bytes);
        if self.link.frames() != before {
            self.unseen = Some(now);
        }
        taken
    }

    /// The UART saw a fault.
    pub fn line_error(&mut self, error: LineError) {
        self.link.line_error(error);
    }

    /// See [`Link::sent`].
    pub fn sent(&mut self, now: Instant) {
        self.link.sent(now);
    }

    /// See [`Link::not_sent`].
    pub fn not_sent(&mut self, now: Instant, why: NotSent) {
        self.link.not_sent(now, why);
    }

    /// See [`Link::timeout`]. What is ordered is brought up to date first, so that a turn of the link carries it.
    pub fn timeout(&mut self, now: Instant) {
        self.update(now);
        self.link.timeout(now);
        self.update(now);
    }

    /// See [`Link::poll`].
    pub fn poll(&mut self) -> Output {
        let mut output = self.link.poll();
        if matches!(output, Output::Wait(_))
            && let Some(now) = self.unseen.take()
        {
            self.look(now);
            self.update(now);
            output = self.link.poll();
        }
        match output {
            Output::Wait(deadline) => match self.events.pop_front() {
                Some(event) => Output::Event(event),
                None => {
                    self.wake = earlier(deadline, self.deadline());
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
    pub fn keeps_others_from_start(&self, now: Instant) -> bool {
        let starting = match &self.mode {
            Mode::Run(run) => run.start_by.is_some(),
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
        let mut counters = self.link.counters();
        counters.commands_rejected = self.commands_rejected;
        counters.events_lost = counters.events_lost.wrapping_add(self.events_lost);
        let run = match &self.mode {
            Mode::Run(run) => Some(run),
            _ => None,
        };
        let ruler = self.ruler(now).unwrap_or(self.ordered.origin);
        let ended = if self.ended_by_loss { LossStage::Standby } else { LossStage::None };
        Telemetry {
            at: now,
            link: self.link.state(),
            heard: self.link.heard(),
            state: EngineState::of(now, self.link.state(), self.link.report()),
            report: *self.link.report(),
            ordered: self.ordered,
            obeyed: !self.disobeys,
            ruler,
            source_heard: self.sources.last_heard(ruler),
            asked: run.map(|run| run.demand),
            waiting: run.and_then(|run| run.taking_over).map(|(origin, _)| origin),
            loss: run.map_or(ended, |run| run.stage),
            limited: run.is_some_and(|run| run.limited),
            armed: self.armed,
            stop_latched: matches!(self.mode, Mode::Stop(_)),
            start_by: run.and_then(|run| run.start_by),
            failed: self.failed,
            others_failed: self.others_failed,
            counters,
        }
    }

    // -----------------------------------------------------------------------------------------
    // What is ordered
    // -----------------------------------------------------------------------------------------

    fn stop(&mut self, now: Instant, origin: Origin) {
        // Whoever latched it first, or a higher one, holds it; also if that was before a reset.
        let before = match self.mode {
            Mode::Stop(by) => Some(by),
            Mode::Listen { kept: Some(Record { order: Order::EmergencyStop, origin, .. }), .. } => {
                Some(origin)
            }
            _ => None,
        };
        let by = before.filter(|by| by.priority() > origin.priority()).unwrap_or(origin);
        self.mode = Mode::Stop(by);
        self.start_allowed = false;
        self.failed = false;
        self.ended_by_loss = false;
        self.order(now, Order::EmergencyStop, by);
    }

    fn standby(&mut self, now: Instant, origin: Origin) {
        self.mode = Mode::Standby;
        self.start_allowed = false;
        self.ended_by_loss = false;
        self.order(now, Order::Standby, origin);
    }

    /// Orders a run: a start, or going on after a reset.
    fn begin(&mut self, now: Instant, demand: Demand, origin: Origin, beginning: Beginning) {
        let timeout = match self.link.report().startup {
            // The ECU's own figure, doubled, where it has one.
            Some(startup) if startup.value.as_ticks() > 0 => {
                (startup.value * 2).clamp(START_TIMEOUT_MIN, START_TIMEOUT_MAX)
            }
            _ => self.config.start.timeout,
        };
        let from_standby = beginning == Beginning::FromStandby;
        let phase = self.phase();
        // An ECU with a fault that does not say what its engine does counts as running here, as it did before.
        let runs = !from_standby && phase != Some(Phase::Starting);
        let (limited, stage) = match beginning {
            Beginning::FromStandby => (false, LossStage::None),
            Beginning::GoingOn { limited, loss } => (limited, loss),
        };
        let fail_safe_at = match stage {
            LossStage::None => None,
            LossStage::Hold => Some(now + self.config.loss.hold),
            // It had begun before the reset, and does not begin anew.
            LossStage::FailSafe | LossStage::Standby => Some(now),
        };
        self.mode = Mode::Run(Run {
            began: now,
            start_by: (!runs).then(|| now + timeout),
            came_alive: !from_standby,
            running: runs,
            before: runs.then_some(Phase::Running),
            seen: None,
            stopped_reports: 0,
            ruler: origin,
            demand,
            taking_over: None,
            fail_safe_at,
            stage,
            limited,
            shaper: Shaper::new(now, demand),
            lowered: Lowered::new(now, demand),
            next: None,
        });
        self.start_allowed = false;
        self.ended_by_loss = false;
        if !runs {
            self.last_start = Some(now);
        }
        self.update(now);
    }

    /// Brings what is ordered up to date: with the sources, the ECU and the time.
    fn update(&mut self, now: Instant) {
        if matches!(self.mode, Mode::Listen { .. }) {
            self.listen(now);
        }
        self.follow(now);
        self.keep_limits(now);
        self.rule(now);
        self.shape(now);
        if let Some(ruler) = self.ruler(now)
            && self.ruler_told.replace(ruler) != Some(ruler)
        {
            self.event(Event::Ruler(ruler));
        }
    }

    /// Who rules: of a running engine the source whose demand is in force, of a stopped one whoever stopped it.
    fn ruler(&self, now: Instant) -> Option<Origin> {
        match &self.mode {
            Mode::Listen { .. } => None,
            Mode::Stop(by) => Some(*by),
            Mode::Run(run) => Some(run.ruler),
            Mode::Standby | Mode::Pwm => self.sources.ruler(now).map(|(ruler, _)| ruler),
        }
    }

    /// Finds whose demand is in force, and how far a loss has gone.
    fn rule(&mut self, now: Instant) {
        let Mode::Run(run) = &mut self.mode else { return };
        let mut told: Deque<Event, 4> = Deque::new();
        let standby_by = run.rule(now, &self.sources, &self.config, &mut told);
        for event in &told {
            self.event(*event);
        }
        if let Some(origin) = standby_by {
            self.standby(now, origin);
            self.ended_by_loss = origin == Origin::Node;
        }
    }

    /// Does what a limit asks for that is passed. Also for one that was passed before the engine ran.
    fn keep_limits(&mut self, now: Instant) {
        let Mode::Run(run) = &mut self.mode else { return };
        match self.watch.in_force() {
            Some((_, Action::FailSafe)) => run.limited = true,
            Some((_, Action::Standby)) => {
                self.failed = run.came_alive && run.start_by.is_none();
                self.sources.forget_runs();
                self.standby(now, Origin::Node);
            }
            _ => {}
        }
    }

    /// The ECU's own state wins over what was commanded.
    fn follow(&mut self, now: Instant) {
        let phase = self.link.report().phase;
        let link = self.link.state();
        let Mode::Run(run) = &mut self.mode else { return };
        if let Some(phase) = phase.filter(|phase| run.seen.replace(phase.at) != Some(phase.at)) {
            run.came_alive |= phase.value.is_alive();
            let before = run.before.replace(phase.value);
            run.running = match phase.value {
                Phase::Running => run.running || before == Some(Phase::Running),
                Phase::Unknown => run.running,
                _ => run.running && matches!(before, Some(Phase::Running | Phase::Unknown)),
            };
            if run.running {
                run.start_by = None;
            }
            run.stopped_reports =
                if phase.value.is_stopped() { run.stopped_reports.saturating_add(1) } else { 0 };
        }
        let ran = run.came_alive && run.start_by.is_none();
        // On a noisy line one or two damaged frames can say so of an engine that runs.
        let stopped = run.came_alive && run.stopped_reports >= STOPPED_REPORTS;
        let gone = !run.came_alive && link == LinkState::Lost;
        let late = run.start_by.filter(|by| now >= *by);
        // With a fault an AMT ECU says no more what its engine does (AMT-8).
        let old = phase.is_none_or(|phase| phase.age(now) > STATE_MAX_AGE);
        let only_faults = old && self.link.report().faults.is_some_and(|faults| !faults.value.is_empty());
        let said_lately =
            phase.is_some_and(|phase| self.link.up_since().is_some_and(|since| phase.at > since));
        if ran && (link == LinkState::Lost || only_faults) {
            self.failed = true;
        } else if ran && said_lately && run.stopped_reports == 0 {
            self.failed = false;
        }
        if stopped || gone {
            self.failed = ran && !self.link.shutting_down();
            self.sources.forget_runs();
            self.standby(now, Origin::Node);
            self.event(Event::RunWithdrawn);
        } else if let Some(by) = late {
            let ms = |until: Instant| {
                let taken = until.saturating_duration_since(run.began).as_millis();
                i32::try_from(taken).unwrap_or(i32::MAX)
            };
            let passed = Passed { what: Watched::StartTimeout, value: ms(now), limit: ms(by), at: now };
            self.sources.forget_runs();
            self.standby(now, Origin::Node);
            self.event(Event::Limit(passed));
        }
    }

    /// Orders the demand, as far as ramps, slew and limits let it go.
    fn shape(&mut self, now: Instant) {
        let idle_rpm = self.link.report().idle_rpm.map(|idle| idle.value);
        let shape = Shape {
            running: matches!(&self.mode, Mode::Run(run) if run.running),
            idle_rpm,
            max_rpm: self.link.report().max_rpm.map(|max| max.value),
            rpm: self.link.report().rpm,
            throttle: self.link.report().throttle.map(|throttle| throttle.value),
            reduced_to: self.config.when_other_fails.filter(|_| self.others_failed > 0),
            governed: self.link.speed_control().is_err(),
        };
        let config = self.config;
        let Mode::Run(run) = &mut self.mode else { return };
        let plan = run.plan();
        let (demand, next) = run.shaper.demand(now, plan, &shape, &config);
        run.next = next;
        run.lowered.see(now, demand);
        let origin = if run.stage == LossStage::None { run.ruler } else { Origin::Node };
        // An ECU that changed its maximum may refuse an rpm; no link refuses a throttle.
        for demand in [demand, Demand::Throttle(Throttle::IDLE)] {
            if self.link.order(now, Order::Run(demand)).is_ok() {
                self.note_order(Order::Run(demand), origin);
                break;
            }
        }
    }

    /// Looks for limits that were passed, and whether the ECU obeys.
    fn look(&mut self, now: Instant) {
        let lowered = match &self.mode {
            Mode::Run(run) => run.lowered.at(),
            _ => now,
        };
        self.watch.see(now, self.link.report(), lowered);
        while let Some(passed) = self.watch.found() {
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
        let report = self.link.report();
        let switch = report.switch.filter(|switch| switch.age(now) <= STATE_MAX_AGE);
        let stands = self.phase().is_some_and(Phase::is_stopped);
        let switch_obeys = switch.is_none_or(|switch| match (self.ordered.order, switch.value) {
            (Order::Listen | Order::Pwm, _) | (_, ReportedSwitch::Unknown(_)) => true,
            // It may end there by itself.
            (Order::EmergencyStop | Order::Standby, _) if stands => true,
            (Order::EmergencyStop, switch) => switch == ReportedSwitch::Stop,
            (Order::Standby, switch) => switch != ReportedSwitch::Run,
            (Order::Run(_), switch) => switch == ReportedSwitch::Run,
        });
        let throttle = report.throttle.filter(|throttle| throttle.age(now) <= STATE_MAX_AGE);
        let throttle_obeys = match (self.ordered.order, throttle) {
            (Order::Run(Demand::Throttle(ordered)), Some(reported))
                if self.phase() == Some(Phase::Running) && !self.link.shutting_down() =>
            {
                ordered.tenths().abs_diff(reported.value.tenths()) <= OBEYED_BAND
            }
            _ => true,
        };
        switch_obeys && throttle_obeys
    }

    fn deadline(&self) -> Option<Instant> {
        match &self.mode {
            // Once it has reported an engine that stands, the next report decides.
            Mode::Listen { until, stands, .. } => until.filter(|_| stands.is_none()),
            Mode::Run(run) => {
                let now = self.ordered_at();
                let loss = run.loss_deadline(&self.config);
                let take_over = run.taking_over.map(|(_, at)| at);
                [self.sources.deadline(now), loss, take_over, run.start_by, run.next]
                    .into_iter()
                    .flatten()
                    .min()
            }
            _ => None,
        }
    }

    /// The time of the last update: deadlines before it have been dealt with.
    fn ordered_at(&self) -> Instant {
        match &self.mode {
            Mode::Run(run) => run.shaper.at(),
            _ => Instant::MIN,
        }
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
        self.link.report().phase.map(|phase| phase.value)
    }

    fn event(&mut self, event: Event) {
        if self.events.push_back(event).is_err() {
            bump(&mut self.events_lost);
        }
    }
}
