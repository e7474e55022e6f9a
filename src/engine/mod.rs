//! One engine in plain words: what was commanded and by whom, and what is ordered of its ECU.
//!
//! The rules here hold for every ECU:
//!
//! - An emergency stop is latched until it is released with the engine stopped.
//! - A start is two commands, standby and then run. A source that goes on sending `Run` can neither start an
//!   engine at power-up nor restart one that stopped.
//! - A source that rules a running engine has an age limit. After `hold` the fail-safe throttle rules, and only
//!   if so configured standby after that. Silence is found by a timer.
//! - The ECU's own state wins: an engine that stopped is ordered to standby, whatever was commanded.

use crate::command::{Command, Demand, Order, Ordered, Origin, Rejected};
use crate::config::EngineConfig;
use crate::ecu::AnyLink;
use crate::line::LineError;
use crate::link::{Link, Output, earlier};
use crate::telemetry::{Event, LinkState, LossStage, NotSent, Phase, Telemetry, bump};
use crate::units::{Hectopascals, Throttle};
use embassy_time::{Duration, Instant};
use heapless::Deque;

/// So many reports in a row of a standing engine withdraw an order to run.
const STOPPED_REPORTS: u8 = 3;
/// An older phase is no longer what the engine does.
const PHASE_MAX_AGE: Duration = Duration::from_secs(3);

/// What happens when the source of commands falls silent while its engine runs.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[cfg_attr(target_os = "none", derive(defmt::Format))]
pub struct Loss {
    /// The last demand is held for so long.
    pub hold: Duration,
    /// Then this throttle rules. It only ever lowers: a lower demand stays. An rpm demand goes to the
    /// engine's idle rpm.
    pub throttle: Throttle,
    /// Then, after this more, standby. `None`: never.
    pub standby_after: Option<Duration>,
}

impl Loss {
    /// Hold 1 s, then idle, never standby.
    pub const DEFAULT: Self =
        Self { hold: Duration::from_secs(1), throttle: Throttle::IDLE, standby_after: None };
}

/// One engine: its link, and what is commanded.
#[derive(Clone, Debug)]
pub struct Engine {
    link: AnyLink,
    loss: Loss,
    ordered: Ordered,
    /// The last demand of the source, while the order is to run.
    demand: Option<Demand>,
    source_heard: Instant,
    stage: LossStage,
    stop_latched: bool,
    /// Standby was commanded, and no run since: the next run may start the engine.
    start_allowed: bool,
    /// The ECU reported an engine starting or running under this order to run.
    came_alive: bool,
    /// Reports in a row, up to the one of this instant, that the engine stands.
    stopped_reports: u8,
    stopped_at: Option<Instant>,
    commands_rejected: u32,
    last_rejection: Option<(Rejected, Origin)>,
    events: Deque<Event, 4>,
    events_lost: u32,
}

impl Engine {
    /// An engine in standby, ordered by nobody.
    pub fn new(config: &EngineConfig) -> Self {
        Self {
            link: AnyLink::new(&config.ecu, config.line, config.timing),
            loss: config.loss,
            ordered: Ordered { order: Order::Standby, origin: Origin::Node },
            demand: None,
            source_heard: Instant::MIN,
            stage: LossStage::None,
            stop_latched: false,
            start_allowed: false,
            came_alive: false,
            stopped_reports: 0,
            stopped_at: None,
            commands_rejected: 0,
            last_rejection: None,
            events: Deque::new(),
            events_lost: 0,
        }
    }

    /// Begins. No engine ever starts by itself: the first order is standby, or the emergency stop that was
    /// commanded before.
    pub fn start(&mut self, now: Instant) {
        self.source_heard = now;
        self.link.start(now);
        if !self.stop_latched {
            self.order(now, Order::Standby, Origin::Node);
        }
    }

    /// When the last good frame of the ECU was complete.
    pub fn heard(&self) -> Option<Instant> {
        self.link.heard()
    }

    /// Bytes came from the ECU; see [`Link::receive`].
    pub fn receive(&mut self, now: Instant, bytes: &[u8]) -> usize {
        let taken = self.link.receive(now, bytes);
        self.follow(now);
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

    /// See [`Link::timeout`].
    pub fn timeout(&mut self, now: Instant) {
        self.link.timeout(now);
        self.follow(now);
        if self.loss_deadline().is_some_and(|deadline| now >= deadline) {
            self.lose_source(now);
        }
    }

    /// See [`Link::poll`].
    pub fn poll(&mut self) -> Output {
        if let Some(event) = self.events.pop_front() {
            return Output::Event(event);
        }
        match self.link.poll() {
            Output::Wait(deadline) => Output::Wait(earlier(deadline, self.loss_deadline())),
            output => output,
        }
    }

    /// The atmospheric pressure, for an ECU that asks for it (ZK-14).
    pub fn pressure(&mut self, now: Instant, pressure: Hectopascals) {
        self.link.pressure(now, pressure);
    }

    /// A command. The latest wins, and a stop pre-empts whatever waits.
    ///
    /// # Errors
    /// [`Rejected`] with the reason; what was commanded before stays in force.
    pub fn command(&mut self, now: Instant, command: Command, origin: Origin) -> Result<(), Rejected> {
        let answer = match command {
            Command::EmergencyStop => {
                self.stop_latched = true;
                self.start_allowed = false;
                self.order(now, Order::EmergencyStop, origin);
                Ok(())
            }
            Command::ReleaseStop => self.release(now, origin),
            _ if self.stop_latched => Err(Rejected::StopLatched),
            Command::Standby => {
                self.order(now, Order::Standby, origin);
                self.start_allowed = true;
                Ok(())
            }
            Command::Run(demand) => self.run(now, demand, origin),
            Command::HandOverToPwm => self.link.order(now, Order::Pwm).map(|()| {
                self.start_allowed = false;
                self.demand = None;
                self.note_order(Order::Pwm, origin);
            }),
            Command::Service(service) => {
                if service.needs_stopped_engine() { self.require_stopped() } else { Ok(()) }
                    .and_then(|()| self.link.service(now, service))
            }
        };
        match answer {
            Ok(()) => self.last_rejection = None,
            Err(why) => {
                bump(&mut self.commands_rejected);
                if self.last_rejection.replace((why, origin)) != Some((why, origin)) {
                    self.event(Event::CommandRejected(why, origin));
                }
            }
        }
        answer
    }

    /// A snapshot.
    pub fn telemetry(&self, now: Instant) -> Telemetry {
        let mut counters = self.link.counters();
        counters.commands_rejected = self.commands_rejected;
        counters.events_lost = counters.events_lost.wrapping_add(self.events_lost);
        Telemetry {
            at: now,
            link: self.link.state(),
            heard: self.link.heard(),
            report: *self.link.report(),
            ordered: self.ordered,
            source_heard: self.source_heard,
            loss: self.stage,
            stop_latched: self.stop_latched,
            counters,
        }
    }

    fn release(&mut self, now: Instant, origin: Origin) -> Result<(), Rejected> {
        if self.stop_latched {
            // Standby is no start, so a phase that the ECU no longer tells does not keep the stop: an AMT error
            // set carries none.
            let told = self.link.report().phase.is_some_and(|phase| phase.age(now) <= PHASE_MAX_AGE);
            if told {
                self.require_stopped()?;
            }
            self.stop_latched = false;
            self.order(now, Order::Standby, origin);
        }
        Ok(())
    }

    fn run(&mut self, now: Instant, demand: Demand, origin: Origin) -> Result<(), Rejected> {
        let running = matches!(self.ordered.order, Order::Run(_));
        if !running {
            if !self.start_allowed {
                return Err(Rejected::StandbyFirst);
            }
            if self.link.state() != LinkState::Up {
                return Err(Rejected::NoLink);
            }
        }
        self.link.order(now, Order::Run(demand))?;
        if !running {
            self.start_allowed = false;
            self.came_alive = false;
            self.stopped_reports = 0;
        }
        self.demand = Some(demand);
        self.source_heard = now;
        self.stage(LossStage::None);
        self.note_order(Order::Run(demand), origin);
        self.follow(now);
        Ok(())
    }

    fn require_stopped(&self) -> Result<(), Rejected> {
        if self.link.state() != LinkState::Up {
            return Err(Rejected::NoLink);
        }
        match self.phase() {
            Some(phase) if phase.is_stopped() => Ok(()),
            _ => Err(Rejected::NotStopped),
        }
    }

    /// An order that no link refuses.
    fn order(&mut self, now: Instant, order: Order, origin: Origin) {
        if self.link.order(now, order).is_ok() {
            self.demand = None;
            self.stage(LossStage::None);
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

    /// The ECU's own state wins over what was commanded.
    fn follow(&mut self, now: Instant) {
        let Order::Run(_) = self.ordered.order else { return };
        if let Some(phase) = self.link.report().phase {
            self.came_alive |= phase.value.is_alive();
            if !phase.value.is_stopped() {
                self.stopped_reports = 0;
            } else if self.stopped_at.replace(phase.at) != Some(phase.at) {
                self.stopped_reports = self.stopped_reports.saturating_add(1);
            }
        }
        // On a noisy line one or two damaged frames can say so of an engine that runs.
        let stopped = self.came_alive && self.stopped_reports >= STOPPED_REPORTS;
        let gone = !self.came_alive && self.link.state() == LinkState::Lost;
        if stopped || gone {
            self.order(now, Order::Standby, Origin::Node);
            self.event(Event::RunWithdrawn);
        }
    }

    fn phase(&self) -> Option<Phase> {
        self.link.report().phase.map(|phase| phase.value)
    }

    fn loss_deadline(&self) -> Option<Instant> {
        self.demand?;
        let fail_safe_at = self.source_heard + self.loss.hold;
        match self.stage {
            LossStage::None => Some(fail_safe_at),
            LossStage::FailSafe => self.loss.standby_after.map(|after| fail_safe_at + after),
            LossStage::Standby => None,
        }
    }

    fn lose_source(&mut self, now: Instant) {
        match self.stage {
            LossStage::None => {
                self.stage(LossStage::FailSafe);
                let safe = match self.demand {
                    Some(Demand::Throttle(demand)) => Demand::Throttle(demand.min(self.loss.throttle)),
                    // Without an idle rpm the throttle takes over, at idle: no rpm can be guessed.
                    Some(Demand::Rpm(demand)) => match self.link.report().idle_rpm {
                        Some(idle) => Demand::Rpm(demand.min(idle.value)),
                        None => Demand::Throttle(Throttle::IDLE),
                    },
                    None => Demand::Throttle(Throttle::IDLE),
                };
                // An ECU that changed its maximum may refuse the rpm; no link refuses a throttle.
                let idle = Demand::Throttle(Throttle::IDLE);
                for safe in [safe, idle] {
                    if self.link.order(now, Order::Run(safe)).is_ok() {
                        self.note_order(Order::Run(safe), Origin::Node);
                        break;
                    }
                }
            }
            LossStage::FailSafe => {
                self.stage(LossStage::Standby);
                if self.link.order(now, Order::Standby).is_ok() {
                    self.demand = None;
                    self.note_order(Order::Standby, Origin::Node);
                }
            }
            LossStage::Standby => {}
        }
    }

    fn stage(&mut self, stage: LossStage) {
        if self.stage != stage {
            self.stage = stage;
            self.event(Event::SourceLoss(stage));
        }
    }

    fn event(&mut self, event: Event) {
        if self.events.push_back(event).is_err() {
            bump(&mut self.events_lost);
        }
    }
}
