//! What survives a reset, and how an engine goes on after one.
//!
//! With an order in force in the record, the run goes on with its life in doubt: nothing goes out that could start an
//! engine, until two reports say that it runs. Without one, nothing is in force, and what the ECU reports decides.

use super::life::{Finding, Found};
use super::retained::RetainedState;
use super::run::Run;
use super::sources::Intent;
use super::{Beginning, Engine, Mode, OpenPump, RESETS_MAX};
use crate::command::{Demand, Order, Origin};
use crate::event::{Event, LossStage};
use crate::link::{Link, Sign, Stage};
use crate::units::Throttle;
use embassy_time::{Duration, Instant};

/// What a reset takes at least: a loop of resets that is too short to be measured still counts.
const RESET_TAKES: Duration = Duration::from_millis(20);
/// A throttle that the ECU reported longer ago is not what it obeys now.
const THROTTLE_MAX_AGE: Duration = Duration::from_secs(3);

/// A flag for each source from a bit each.
fn flags(mask: u8) -> [bool; Origin::ALL.len()] {
    core::array::from_fn(|place| mask >> place & 1 == 1)
}

/// A bit for each source from a flag each.
fn mask(flags: [bool; Origin::ALL.len()]) -> u8 {
    flags.iter().rev().fold(0, |mask, flag| mask << 1 | u8::from(*flag))
}

/// Seconds that have begun, as a record keeps them.
fn seconds(time: Duration) -> u16 {
    u16::try_from(time.as_secs() + 1).unwrap_or(u16::MAX)
}

impl Engine {
    /// This survived the reset. Before anything is commanded, so that a command which comes before [`Engine::start`]
    /// does not take its place.
    pub fn keep(&mut self, kept: Option<RetainedState>) {
        let Some(kept) = kept else { return };
        (self.armed, self.failed) = (kept.armed, kept.failed);
        self.arm_commanded = flags(kept.arm_commanded);
        self.must_disarm = flags(kept.must_disarm);
        // This reset counts, until a source speaks.
        self.resets = kept.resets.saturating_add(1);
        self.last_retained = Some(kept);
        self.kept = Some(kept);
        if kept.by_id6 {
            self.link.resume_switch_by_id6();
        }
        let now = self.at;
        match kept.order {
            Order::EmergencyStop => {
                self.armed = false;
                self.mode = Mode::Stop(kept.origin);
            }
            Order::Standby => self.mode = Mode::Standby,
            _ => self.mode = Mode::Listen(Finding::new(now, kept.ran).controlled_by(kept.origin)),
        }
        if kept.pump_open {
            let origin = Origin::Node;
            self.pump = Some(OpenPump { origin, heard: now, until: now });
        }
    }

    /// Begins, after a reset of whatever kind, with what survived it.
    pub fn start(&mut self, now: Instant, kept: Option<RetainedState>) {
        self.link.start(now);
        self.touch();
        (self.begun, self.started) = (true, now);
        self.at = self.at.max(now);
        if self.kept.is_none() {
            self.keep(kept);
        }
        let kept = self.kept.take();
        self.close_pump();
        match self.mode {
            // Commanded before the runner began, or retained.
            Mode::Stop(by) => self.order(now, Order::EmergencyStop, by),
            Mode::Standby => self.order(now, Order::Standby, Origin::Node),
            _ => self.go_on(now, kept),
        }
    }

    fn go_on(&mut self, now: Instant, kept: Option<RetainedState>) {
        let ran = kept.is_some_and(|kept| kept.ran);
        let silent = kept.map_or(Duration::from_ticks(0), |kept| kept.silent + RESET_TAKES);
        let all_silent = kept.map_or(Duration::from_ticks(0), |kept| kept.all_silent + RESET_TAKES);
        let ruler = kept.map_or(Origin::Node, |kept| kept.origin);
        let finding = Finding::new(now, ran).carrying(all_silent, silent);
        self.mode = Mode::Listen(finding.controlled_by(ruler));
        self.order(now, Order::Listen, Origin::Node);
        let Some(kept) = kept else { return };
        match kept.order {
            Order::Run(demand) if ran => {
                let low = self.resets >= RESETS_MAX;
                let lost = low || kept.loss >= LossStage::FailSafe;
                // After resets in a row without a word it is not waited for once more.
                let counts_as_silent = if low { Duration::MAX } else { silent };
                // A ramp that goes on only while the node runs would come to no stated end. An rpm is at idle with the fail-safe.
                let demand = match demand {
                    Demand::Throttle(throttle) if low => {
                        Demand::Throttle(throttle.min(self.config.loss.throttle))
                    }
                    demand => demand,
                };
                self.sources.resume(now, kept.origin, demand, lost, counts_as_silent);
                let record = RetainedState { silent, all_silent, resets: self.resets, ..kept };
                self.begin(now, demand, kept.origin, Beginning::Reset(record));
                if kept.loss != LossStage::None {
                    self.event(Event::SourceLoss(kept.loss));
                }
            }
            // A start that the reset has cut short.
            Order::Run(_) | Order::Listen if kept.starting > 0 => {
                let since = Duration::from_secs(kept.starting.into());
                self.mode = Mode::Listen(finding.in_a_start(since));
            }
            Order::Run(_) => self.mode = Mode::Listen(finding),
            Order::Pwm => {
                let life = super::life::Life::after_reset(now);
                self.mode = Mode::Pwm { life, start_by: None };
                self.note_order(Order::Pwm, kept.origin);
                self.express(now);
            }
            _ => {}
        }
    }

    /// What shall survive a reset, if it is not what the last call gave.
    pub fn take_retained(&mut self) -> Option<RetainedState> {
        if !core::mem::take(&mut self.record_stale) {
            return None;
        }
        let record = self.record();
        (self.last_retained.replace(record) != Some(record)).then_some(record)
    }

    /// What shall survive a reset.
    pub fn record(&self) -> RetainedState {
        let by = self.ordered.origin;
        let kept = match &self.mode {
            Mode::Listen(_) if self.kept.is_some() => {
                self.kept.unwrap_or(RetainedState::new(Order::Listen, by))
            }
            Mode::Listen(finding) => {
                let since = self.at.saturating_duration_since(finding.silent_since);
                let received = self.sources.any_received();
                let of = |before| if received { Duration::from_ticks(0) } else { before + since };
                // Another reset in a start that one has cut short already leaves it one.
                let (order, starting) = match finding.started {
                    Some(since) => {
                        let since = since + self.at.saturating_duration_since(finding.since);
                        (Order::Run(Demand::Throttle(Throttle::IDLE)), seconds(since))
                    }
                    None => (Order::Listen, 0),
                };
                RetainedState {
                    ran: finding.ran,
                    silent: RetainedState::steps(of(finding.lost_for)),
                    all_silent: RetainedState::steps(of(finding.carried)),
                    starting,
                    ..RetainedState::new(order, finding.ruler)
                }
            }
            Mode::Stop(by) => RetainedState::new(Order::EmergencyStop, *by),
            Mode::Standby => RetainedState::new(Order::Standby, by),
            Mode::Run(run) => {
                let (limited, loss, ran) = (run.limited, run.stage, run.life.reached());
                let silent = self.silent(run);
                let received = self.sources.has_wanted(run.ruler);
                let silent =
                    if received { RetainedState::coarse_steps(silent) } else { RetainedState::steps(silent) };
                let all_silent = match self.sources.last_word() {
                    Some(word) => RetainedState::coarse_steps(self.at.saturating_duration_since(word)),
                    None => {
                        RetainedState::steps(run.all_carried + self.at.saturating_duration_since(run.began))
                    }
                };
                let since = run.started_before + self.at.saturating_duration_since(run.began);
                let starting = if ran { 0 } else { seconds(since) };
                RetainedState {
                    limited,
                    loss,
                    ran,
                    silent,
                    all_silent,
                    starting,
                    ..RetainedState::new(self.run_state(run), run.ruler)
                }
            }
            Mode::Pwm { life, .. } => {
                RetainedState { ran: life.reached(), ..RetainedState::new(Order::Pwm, by) }
            }
        };
        // A lower source that speaks is none that a dead one's demand may be held for.
        let received = match &self.mode {
            Mode::Run(run) => self.sources.has_wanted(run.ruler),
            _ => self.sources.any_received(),
        };
        let resets = if received { 0 } else { self.resets };
        RetainedState {
            armed: self.armed,
            failed: self.failed,
            by_id6: self.link.switch_by_id6(),
            pump_open: self.pump.is_some() || self.link.closing_pump(),
            resets,
            arm_commanded: mask(self.arm_commanded),
            must_disarm: mask(self.must_disarm),
            ..kept
        }
    }

    /// How long the source in control has been silent, resets included.
    fn silent(&self, run: &Run) -> Duration {
        match (self.sources.last_wanted(run.ruler), run.silent_since(&self.config)) {
            (Some(word), _) => self.at.saturating_duration_since(word),
            (None, Some(since)) if run.ruler == Origin::Node => self.at.saturating_duration_since(since),
            (None, _) => run.carried + self.at.saturating_duration_since(run.began),
        }
    }

    fn run_state(&self, run: &Run) -> Order {
        if self.link.status().shutting_down {
            // A reset ends the service command, not the shutdown.
            return Order::Standby;
        }
        // Where the source is lost or a limit was passed, what is left of its demand: a reset must not bring the rest
        // back. A demand that has not come to pass, because the engine does not run yet, by a slew, or because another
        // source takes over, is none to jump to.
        let behind = match (run.shaped, run.demand) {
            (Demand::Throttle(_), Demand::Throttle(_)) | (Demand::Rpm(_), Demand::Rpm(_)) => {
                run.shaped.is_below(run.demand)
            }
            // A governor makes a throttle of an rpm. Otherwise what is commanded now is of the other kind, and not in force.
            _ => run.own_speed_control || matches!(run.shaped, Demand::Rpm(_)),
        };
        let shaped = run.stage != LossStage::None || run.limited || behind;
        let demand = if shaped { run.shaped } else { run.demand };
        // What has not gone out yet is for its source to say again: after a reset a demand rises, and does not jump.
        Order::Run(run.sent.filter(|sent| sent.is_below(demand)).unwrap_or(demand))
    }

    /// Nothing was in force, and the ECU has reported what its engine does.
    pub(super) fn found(&mut self, now: Instant, found: Found, sign: Sign) {
        let throttle = match sign {
            Sign::State { throttle, .. } | Sign::Faulted { throttle, .. } => throttle,
            _ => None,
        };
        let reported =
            self.link.status().report.throttle.filter(|throttle| throttle.age(now) <= THROTTLE_MAX_AGE);
        let throttle = throttle.or(reported.map(|throttle| throttle.value));
        match (found, throttle) {
            (Found::Nothing, _) => {}
            // It comes round within a second; an ECU that never says it is brought to idle.
            (Found::Running, None) if now < self.started + THROTTLE_MAX_AGE => {}
            (Found::NotRunning, _) => self.standby(now, Origin::Node),
            // It is nobody's, so the stages of loss begin.
            (Found::Running | Found::Burning, throttle) => {
                let confirmed = found == Found::Running;
                let silent_since = match &self.mode {
                    Mode::Listen(finding) => self.lost_since(now, finding),
                    _ => now,
                };
                let throttle = self.lost_throttle(now, silent_since, throttle.unwrap_or(Throttle::IDLE));
                let demand = Demand::Throttle(throttle);
                // The start that a reset has cut short goes on as one, until its ECU says running. So does one that nobody
                // knows of.
                let starting = match (&self.mode, sign) {
                    (Mode::Listen(Finding { started: Some(since), .. }), Sign::State { stage, .. }) => {
                        (stage != Stage::Running).then_some((stage, *since))
                    }
                    (_, Sign::State { stage: Stage::Starting, .. }) => {
                        Some((Stage::Starting, Duration::from_ticks(0)))
                    }
                    _ => None,
                };
                let beginning = Beginning::Found { confirmed, starting, silent_since };
                self.begin(now, demand, Origin::Node, beginning);
                if let Mode::Run(run) = &mut self.mode {
                    run.life.answer();
                }
                self.express(now);
                self.event(Event::Resumed(demand));
            }
        }
    }

    /// Since when nobody has wanted the engine that was found to run; now, if somebody does.
    fn lost_since(&self, now: Instant, finding: &Finding) -> Instant {
        if matches!(self.sources.active(now), Some((_, Intent::Run(_)))) {
            return now;
        }
        // Whose demand was in force may have fallen silent since; or whoever spoke.
        let spoke = || self.sources.all_silent_from(now).flatten();
        let known = self.sources.silent_from(finding.ruler).or_else(spoke);
        // Silence of before a reset counts until somebody speaks, beyond the age limit of whoever it was.
        let beyond = finding.lost_for.as_ticks().saturating_sub(self.config.ages.longest().as_ticks());
        let kept = now.checked_sub(Duration::from_ticks(beyond)).unwrap_or(Instant::MIN);
        let lost = known.unwrap_or(kept).min(now);
        // Where an order was given up, the stages of loss go on; after a start of the node nobody has been waited for yet.
        if finding.silent_since < finding.since { finding.silent_since.min(lost) } else { lost }
    }

    /// Where the stages of loss would have taken this throttle by now, had the ECU been heard.
    fn lost_throttle(&self, now: Instant, silent_since: Instant, reported: Throttle) -> Throttle {
        let loss = &self.config.loss;
        let falling = now.saturating_duration_since(silent_since + loss.hold);
        let fallen = falling.as_millis().saturating_mul(loss.ramp.into()) / 1000;
        let tenths = u64::from(reported.tenths()).saturating_sub(fallen);
        let throttle = u16::try_from(tenths).ok().and_then(|tenths| Throttle::from_tenths(tenths).ok());
        let safe = loss.throttle.min(reported);
        if self.resets >= RESETS_MAX { safe } else { throttle.unwrap_or(reported).max(safe) }
    }
}
