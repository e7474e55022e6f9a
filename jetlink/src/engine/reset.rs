//! The retained state of an engine, and its resumption after a reset.
//!
//! If the record has a run in force, the run resumes with its life in doubt: nothing is sent that could start an engine
//! until two reports confirm that it runs. Otherwise no order is in force, and the reports of the ECU decide.

use super::data::{Beginning, Engine, Mode, OpenPump, RESETS_TO_FAIL_SAFE};
use super::life::{Finding, Life};
use super::origins::Origins;
use super::retained::{FALL_EXPECTED, RetainedState, STEADY, WORDS};
use super::run::Run;
use super::sources::Restored;
use crate::command::{Demand, Order, Origin};
use crate::event::{Event, LossStage};
use crate::link::Link;
use crate::units::Throttle;
use embassy_time::{Duration, Instant};

/// Shortest duration of a reset. It makes a loop of resets count that is too fast to be measured.
const RESET_TAKES: Duration = Duration::from_millis(20);

/// Seconds, rounded up, as a record stores them.
fn seconds(time: Duration) -> u16 {
    u16::try_from(time.as_secs() + 1).unwrap_or(u16::MAX)
}

impl Engine {
    /// Restores the state that survived a reset. Call it before any command, so that it does not replace what is commanded before
    /// [`Engine::start`]. After that it does nothing.
    pub fn restore(&mut self, retained: Option<RetainedState>) {
        let Some(retained) = retained.filter(|_| !self.begun) else { return };
        (self.armed, self.failed) = (retained.armed, retained.failed);
        self.arm_commanded = Origins::from_bits(retained.arm_commanded);
        self.must_disarm = Origins::from_bits(retained.must_disarm);
        // This reset is counted until a source is received.
        self.resets = retained.resets.saturating_add(1);
        self.last_retained = retained.packed();
        self.retained = Some(retained);
        self.link.restore(retained.link);
        if retained.egt_distrusted {
            self.exhaust.distrust();
        }
        let now = self.at;
        match retained.order {
            Order::EmergencyStop => {
                self.armed = false;
                self.adopt(Mode::Stop(retained.origin));
            }
            Order::Standby => self.adopt(Mode::Standby),
            _ => self.adopt(Mode::Listen(Self::search(now, &retained))),
        }
        if retained.pump_open {
            let origin = Origin::Node;
            self.pump = Some(OpenPump { origin, last_rx: now, until: now });
        }
    }

    /// Begins after any kind of reset, with what [`Engine::restore`] restored. Once: a second runner of the same engine finds it as
    /// the first one left it, and no run comes into doubt.
    pub fn start(&mut self, now: Instant) {
        if self.begun {
            return;
        }
        self.link.start(now);
        self.touch();
        (self.begun, self.started) = (true, now);
        self.at = self.at.max(now);
        let retained = self.retained.take();
        self.close_pump();
        match self.mode {
            // Commanded before the runner began, or restored.
            Mode::Stop(by) => self.order(now, Order::EmergencyStop, by),
            Mode::Standby => self.order(now, Order::Standby, Origin::Node),
            _ => self.resume(now, retained),
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

    fn resume(&mut self, now: Instant, retained: Option<RetainedState>) {
        let finding = retained.as_ref().map(|retained| Self::search(now, retained));
        self.listen(now, finding.unwrap_or(Finding::new(now, false)));
        let Some(retained) = retained else { return };
        match retained.order {
            Order::Run(demand) if retained.ran => {
                let silent = retained.silent + RESET_TAKES;
                let all_silent = retained.all_silent + RESET_TAKES;
                let low = self.resets >= RESETS_TO_FAIL_SAFE;
                let lost = retained.loss >= LossStage::FailSafe
                    || low && silent >= self.config.timeouts.of(retained.origin);
                // A ramp that only moves between resets might never end. An rpm is at idle in the fail-safe stage.
                let demand = match demand {
                    Demand::Throttle(throttle) if low => {
                        Demand::Throttle(throttle.min(self.config.loss.throttle))
                    }
                    demand => demand,
                };
                let restored = Restored { demand, was_lost: lost, silent, steady: retained.steady };
                self.sources.resume(now, retained.origin, restored);
                let unconfirmed = retained.unconfirmed + RESET_TAKES;
                let resets = self.resets;
                let record = RetainedState { silent, all_silent, unconfirmed, resets, ..retained };
                self.begin(now, demand, retained.origin, Beginning::Reset(record));
                self.update(now);
                if retained.loss != LossStage::None {
                    self.event(Event::SourceLoss(retained.loss));
                }
            }
            Order::Pwm => {
                let life = Life::handed_over(now, retained.ran);
                self.hand_over(life, None, retained.origin);
                self.express(now);
            }
            _ => {}
        }
    }

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

    /// Silence of the source in control, or the time since it was lost, resets included: a source that comes and goes does not
    /// restart the stages of loss. One that waits to take over is in control.
    fn silent(&self, run: &Run) -> Duration {
        let since = |at| self.at.saturating_duration_since(at);
        if let Some(last) = run.taking_over.and_then(|(waits, _)| self.sources.last_commanded(waits)) {
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
        // holds for a demand that was not reached yet because of the start, a slew or a take-over: a reset must not jump to it.
        let behind = match (run.demand.shaped, run.demand.commanded) {
            (Demand::Throttle(_), Demand::Throttle(_)) | (Demand::Rpm(_), Demand::Rpm(_)) => {
                run.demand.shaped.is_below(run.demand.commanded)
            }
            // The governor turns an rpm into a throttle. Otherwise the commanded demand is of the other kind and not in force.
            _ => {
                run.own_speed_control
                    || self.config.governor.is_none()
                    || matches!(run.demand.shaped, Demand::Rpm(_))
            }
        };
        let shaped = run.stage != LossStage::None || run.limited || behind;
        let demand = if shaped { run.demand.shaped } else { run.demand.commanded };
        // What was not sent yet has to be commanded again: after a reset a demand rises and does not jump.
        Order::Run(if run.demand.sent.is_below(demand) { run.demand.sent } else { demand })
    }
}
