//! What is retained of an engine over a reset, and the search for the engine of a record.

use super::data::{Engine, Mode};
use super::life::Finding;
use super::retained::{FALL_EXPECTED, RetainedState, STEADY, WORDS};
use super::run::Run;
use crate::command::{Demand, Order};
use crate::event::LossStage;
use crate::link::Link;
use crate::units::Throttle;
use embassy_time::{Duration, Instant};

/// Shortest duration of a reset. It makes a loop of resets count that is too fast to be measured.
pub(super) const RESET_TAKES: Duration = Duration::from_millis(20);

/// Seconds, rounded up, as a record stores them.
fn seconds(time: Duration) -> u16 {
    u16::try_from(time.as_secs() + 1).unwrap_or(u16::MAX)
}

impl Engine {
    /// The state to retain, packed, if it has changed since the last call.
    pub(crate) fn take_retained(&mut self) -> Option<[u32; WORDS]> {
        if !core::mem::take(&mut self.record_stale) {
            return None;
        }
        let packed = self.record().packed();
        (core::mem::replace(&mut self.last_retained, packed) != packed).then_some(packed)
    }

    /// The state to retain.
    pub fn record(&self) -> RetainedState {
        let by = self.ordered.origin;
        let received = self.source_received();
        let retained = match &self.mode {
            Mode::Listen(_) if self.retained.is_some() => {
                self.retained.unwrap_or(RetainedState::new(Order::Listen, by))
            }
            Mode::Listen(finding) => {
                // A source that was received may be silent again.
                let of = |before| match self.sources.last_command() {
                    Some(last) => self.at.saturating_duration_since(last),
                    None => before + self.at.saturating_duration_since(finding.silent_since),
                };
                // A start that a reset interrupted stays one after another reset.
                let (order, starting) = match finding.started {
                    Some(since) => {
                        let since = since + self.at.saturating_duration_since(finding.since);
                        (Order::Run(Demand::Throttle(Throttle::IDLE)), seconds(since))
                    }
                    None => (Order::Listen, 0),
                };
                RetainedState {
                    ran: finding.ran,
                    exhaust_ignored: finding.given_up,
                    unconfirmed: RetainedState::steps(finding.unconfirmed_at(self.at)),
                    fall_expected: FALL_EXPECTED.round(finding.fall_expected_at(self.at)),
                    after_faults: finding.after_faults,
                    silent: RetainedState::silence(of(finding.lost_for), received),
                    all_silent: RetainedState::silence(of(finding.carried), received),
                    starting,
                    ..RetainedState::new(order, finding.active_source)
                }
            }
            Mode::Stop(by) => RetainedState::new(Order::EmergencyStop, *by),
            Mode::Standby => RetainedState::new(Order::Standby, by),
            Mode::Run(run) => {
                let (limited, loss, ran) = (run.limited, run.stage, run.life.reached());
                let silent = RetainedState::silence(self.silent(run), received);
                let (all_silent, any_received) = match self.sources.last_command() {
                    Some(last) => (self.at.saturating_duration_since(last), true),
                    None => (run.carried.all_silent + self.at.saturating_duration_since(run.began), false),
                };
                let steady = self.sources.steady_for(self.at, run.in_control(), all_silent);
                let all_silent = RetainedState::silence(all_silent, any_received);
                let since = run.carried.started + self.at.saturating_duration_since(run.began);
                let starting = if ran { 0 } else { seconds(since) };
                // Only an ECU that stops its engine without replies gives the time a meaning.
                let unconfirmed = self.link.reply_timeout().and_then(|_| self.unconfirmed(&run.life));
                let unconfirmed =
                    unconfirmed.filter(|_| ran).map_or(Duration::from_ticks(0), |(since, before)| {
                        RetainedState::steps(before + self.at.saturating_duration_since(since))
                    });
                RetainedState {
                    limited,
                    loss,
                    ran,
                    silent,
                    all_silent,
                    starting,
                    unconfirmed,
                    after_gap: run.life.missed_frames(),
                    exhaust_ignored: run.life.ignores_exhaust(),
                    unproven: ran && !run.life.ran(),
                    after_faults: run.life.after_faults(),
                    steady: STEADY.round_up(steady),
                    fall_expected: FALL_EXPECTED.round(run.lowered.fall_expected(self.at)),
                    // After a reset a source that waits to take over is in control: resets do not restart its wait.
                    ..RetainedState::new(self.run_state(run), run.in_control())
                }
            }
            Mode::Pwm { life, .. } => RetainedState { ran: life.ran(), ..RetainedState::new(Order::Pwm, by) },
        };
        let resets = if received { 0 } else { self.resets };
        RetainedState {
            resets,
            armed: self.armed,
            failed: self.failed,
            egt_distrusted: self.exhaust.is_distrusted(),
            link: self.link.record(),
            pump_open: self.pump_may_be_open(),
            arm_commanded: self.arm_commanded.bits(),
            must_disarm: self.must_disarm.bits(),
            ..retained
        }
    }

    /// The search for the engine of a record.
    pub(super) fn search(now: Instant, retained: &RetainedState) -> Finding {
        let RetainedState { ran, silent, all_silent, origin, starting, .. } = *retained;
        let mut finding = Finding::new(now, ran)
            .carrying(all_silent + RESET_TAKES, silent + RESET_TAKES)
            .after_faults(retained.after_faults);
        finding.given_up = retained.exhaust_ignored || retained.unproven;
        finding.unconfirmed = retained.unconfirmed + RESET_TAKES;
        finding.fall_expected = retained.fall_expected;
        match retained.order {
            // A start that the reset interrupted: any source may end it.
            Order::Run(_) | Order::Listen if starting > 0 => {
                finding.in_a_start(Duration::from_secs(starting.into()))
            }
            _ => finding.controlled_by(origin),
        }
    }

    /// Silence of the source in control, or the time since it was lost, resets included: a source that comes and goes does not
    /// restart the stages of loss. One that waits to take over is in control.
    fn silent(&self, run: &Run) -> Duration {
        let since = |at| self.at.saturating_duration_since(at);
        if let Some(last) = run.waits().and_then(|wait| self.sources.last_commanded(wait.origin)) {
            return since(last);
        }
        if run.carried.silent.as_ticks() > 0 {
            return run.carried.silent + since(run.began);
        }
        match (run.silent_since(&self.config), self.sources.last_commanded(run.active_source)) {
            (Some(lost), _) => since(lost) + run.timeout(&self.config),
            (_, Some(last)) => since(last),
            (_, None) => since(run.began),
        }
    }

    fn run_state(&self, run: &Run) -> Order {
        if self.link.status().shutting_down {
            // A reset ends the service command, not the shutdown.
            return Order::Standby;
        }
        // After a loss or a violated limit the reduced demand is retained: a reset must not restore the full one. The same
        // holds for a demand that was not reached yet because of the start, a slew or a take-over: a reset must not jump to it,
        // up or down. But the governor turns an rpm into a throttle.
        let governed =
            matches!((run.demand.shaped, run.demand.commanded), (Demand::Throttle(_), Demand::Rpm(_)))
                && !run.own_speed_control
                && self.config.governor.is_some();
        let shaped = run.stage != LossStage::None || run.limited || !governed;
        let demand = if shaped { run.demand.shaped } else { run.demand.commanded };
        // What was not sent yet has to be commanded again: after a reset a demand rises and does not jump.
        Order::Run(if run.demand.sent.is_below(demand) { run.demand.sent } else { demand })
    }

    /// Whether a source was received since the node started.
    pub(super) fn source_received(&self) -> bool {
        match &self.mode {
            // Commands of a lower source must not prolong the hold of a lost source's demand.
            Mode::Run(run) => self.sources.has_commanded(run.in_control()),
            _ => self.sources.last_command().is_some(),
        }
    }
}
