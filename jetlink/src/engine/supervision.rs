//! Supervision: what the time, the sources and the limits do to the order.

use super::data::{Engine, Mode, queue};
use super::run::{Arbitration, Run};
use super::state::{self, EngineState};
use crate::command::{Interlock, Origin, Rejected};
use crate::config::LinkSettings;
use crate::event::Event;
use crate::limit::{Action, LimitKind, LimitViolation};
use crate::link::Link;
use crate::report::LinkState;
use embassy_time::{Duration, Instant};
use heapless::Deque;

/// Grace period in which the ECU may report something other than the order.
pub const OBEY_GRACE: Duration = Duration::from_secs(3);

impl Engine {
    /// Updates the order from the sources, the ECU and the time.
    pub(super) fn update(&mut self, now: Instant) {
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
        self.count_resets();
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
        if self.pump_ends().is_some_and(|at| now >= at) || self.pump.is_some() && self.fuel_is_unsafe(now) {
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
            // A restart by the ECU begins with its report.
            let began = match &self.mode {
                Mode::Run(run) if !run.life.reached() => run.began,
                _ => by.checked_sub(start_time).unwrap_or(by),
            };
            let ms = |until: Instant| {
                i32::try_from(until.saturating_duration_since(began).as_millis()).unwrap_or(i32::MAX)
            };
            let violation = LimitViolation { kind: LimitKind::StartTimeout, value: ms(now), limit: ms(by) };
            // A restart by the ECU that does not succeed is the end of an engine that ran.
            self.failed |= matches!(&self.mode, Mode::Run(run) if run.life.reached());
            self.sources.forget_runs();
            self.standby(now, Origin::Node);
            self.event(Event::Limit(violation));
        } else if unconfirmed {
            self.give_up_order(now);
        }
    }

    /// The active source: of a running engine the one whose demand is in force, of a stopped engine the one that stopped it.
    pub(super) fn active(&self, now: Instant) -> Option<Origin> {
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

    /// Ends the count of resets without a source once one is received, also for an order of which that source is no part.
    fn count_resets(&mut self) {
        if self.source_received() {
            self.resets = 0;
        }
    }

    /// Takes the action of a violated limit, also of one that was violated before the engine ran.
    fn apply_limits(&mut self, now: Instant) {
        let Mode::Run(run) = &mut self.mode else { return };
        match self.limits.in_force(&self.config.limits) {
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

    /// Updates whether an engine that ran has failed: its ECU is silent, or reports faults instead of a state.
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
    pub(super) fn look(&mut self, now: Instant) {
        let more = self.reports_more(now);
        let lowered = match &mut self.mode {
            Mode::Run(run) => {
                if more {
                    run.lowered.not_followed(now);
                }
                run.lowered.open_at()
            }
            _ => now,
        };
        let supply = self.supply();
        let (events, dropped) = (&mut self.events, &mut self.events_dropped);
        let (limits, report) = (&self.config.limits, &self.link.status().report);
        self.limits.observe(limits, now, report, supply, lowered, &mut |violation| {
            queue(events, dropped, Event::Limit(violation));
        });
        let not_obeyed = !self.obeys(now);
        self.not_obeyed_since = if not_obeyed { self.not_obeyed_since.or(Some(now)) } else { None };
        let not_obeyed = self.not_obeyed_since.is_some_and(|since| now >= since + OBEY_GRACE);
        if core::mem::replace(&mut self.not_obeyed, not_obeyed) != not_obeyed {
            self.event(if not_obeyed { Event::NotObeyed } else { Event::ObeyedAgain });
        }
    }

    /// Gives waiting settings to the link, if the engine is at rest.
    fn configure_resting_link(&mut self, now: Instant) {
        if self.link_settings.is_none() {
            return;
        }
        let status = self.link.status();
        let at_rest = matches!(self.mode, Mode::Standby | Mode::Stop(_))
            && EngineState::of(now, status.state, &status.report).is_stopped();
        if at_rest && let Some(LinkSettings { ecu, timing }) = self.link_settings.take() {
            self.ecu = ecu;
            self.link.configure(now, &ecu, self.line, timing);
        }
    }
}
