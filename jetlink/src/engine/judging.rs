//! What one frame shows about the life of the engine, and the engine that is found running.

use super::data::{Beginning, Engine, Mode, RESETS_TO_FAIL_SAFE};
use super::exhaust::{FALL_EXPECTED, Fall};
use super::life::{Finding, Found, Life};
use super::run::Run;
use super::sources::Intent;
use crate::command::{Demand, Origin};
use crate::event::Event;
use crate::link::{Link, Observation, Stage};
use crate::report::REPORT_MAX_AGE;
use crate::units::Throttle;
use embassy_time::{Duration, Instant};

impl Engine {
    /// Judges what one frame shows about the life of the engine, before its reply is handed out.
    pub(super) fn judge(&mut self, now: Instant, observation: Observation) {
        // A gap ends with the first frame after it.
        if observation == Observation::PowerUp || self.last_gap == Some(Instant::MAX) {
            self.last_gap = Some(now);
        }
        self.observe_exhaust(now, observation);
        let exhaust = self.exhaust.burning();
        let answers = self.link.answers_frames();
        match &mut self.mode {
            Mode::Stop(_) | Mode::Standby => {}
            Mode::Run(Run { life, .. }) | Mode::Pwm { life, .. } => {
                let doubted = life.in_doubt().is_some();
                let end = life.observe(now, observation, exhaust);
                let doubts = life.in_doubt().is_some();
                match end {
                    Some(end) => self.life_over(now, end),
                    None => {
                        self.report_doubt(doubted, doubts);
                        if doubts || doubted {
                            // While in doubt, each set decides whether it is answered. The one that ends the doubt is not answered with the
                            // throttle of a governor that had no speed.
                            self.shape(now);
                        } else {
                            self.express(now);
                        }
                    }
                }
            }
            Mode::Listen(finding) => {
                // Without replies for that long, the ECU has stopped its engine.
                finding.given_up |=
                    self.link.reply_timeout().is_some_and(|time| finding.unconfirmed_at(now) >= time);
                let found = finding.observe(observation, exhaust, answers);
                self.found(now, found, observation);
            }
        }
    }

    fn observe_exhaust(&mut self, now: Instant, observation: Observation) {
        let egt = match observation {
            Observation::State { .. } => {
                self.link.status().report.egt.filter(|egt| egt.at == now).map(|egt| egt.value)
            }
            Observation::Faulted { egt, .. } => egt,
            _ => return,
        };
        let lowered = match &self.mode {
            Mode::Run(run) => run.lowered.fall_expected(now).as_ticks() > 0,
            _ => false,
        };
        let fall = match observation {
            _ if !lowered => Fall::NotExpected,
            Observation::State { stage: Stage::Running, turning: Some(true), .. } => Fall::ExpectedOfRunning,
            _ => Fall::Expected,
        };
        self.exhaust.observe(now, egt, fall);
    }

    /// Acts on the result of a search for a running engine.
    fn found(&mut self, now: Instant, found: Found, observation: Observation) {
        let status = self.link.status();
        let throttle = status.report.settled_throttle(now);
        // Two reports come within a second. An engine whose ECU never reports a throttle goes to idle.
        let waits = status.report.throttle_before.is_none()
            && now < status.up_since.map_or(self.started, |up| up.max(self.started)) + REPORT_MAX_AGE;
        match (found, throttle) {
            (Found::Nothing, _) => {}
            // Two reports of the switch have to agree, too.
            (Found::Running, _) if status.report.switch.is_none() => {}
            // Its ECU reports that it obeys standby or a stop, and the shaft turns yet: nobody is known to want it to run.
            (Found::Running | Found::Burning, _)
                if status.report.switch.is_some_and(|switch| switch.value.ends_a_run()) => {}
            // Whoever commands standby meanwhile may not be the one whose run it is.
            (Found::Running, _) if waits => {
                if let Mode::Listen(finding) = &mut self.mode {
                    finding.ran = true;
                }
            }
            (Found::NotRunning, _) => self.standby(now, Origin::Node),
            // It has no source, so the stages of loss begin.
            (Found::Running | Found::Burning, throttle) => {
                let (lost_for, fall_expected) = match &self.mode {
                    Mode::Listen(finding) => (self.lost_for(now, finding), finding.fall_expected_at(now)),
                    _ => Default::default(),
                };
                // Its demand is lower than the one that its ECU had.
                let fall_expected =
                    if lost_for > self.config.loss.hold { FALL_EXPECTED } else { fall_expected };
                let throttle = self.lost_throttle(lost_for, throttle.unwrap_or(Throttle::IDLE));
                let demand = Demand::Throttle(throttle);
                // An interrupted start continues until its ECU reports running. So does a start that no record has.
                let (ran, started, after_faults) = match &self.mode {
                    Mode::Listen(finding) => (finding.flew(), finding.started, finding.after_faults),
                    _ => (false, None, false),
                };
                let life = match observation {
                    Observation::State { stage: Stage::Running, .. } => Life::found_running(),
                    Observation::State { stage, .. } if started.is_some() || stage == Stage::Starting => {
                        Life::found_starting(stage)
                    }
                    // In flight, if it ran before. Otherwise the ECU may have begun it just now.
                    Observation::State { .. } if ran => Life::found_running(),
                    Observation::State { .. } => Life::found_turning(now),
                    _ => Life::found_burning(now, after_faults),
                };
                let started_before = started.filter(|_| !life.reached()).unwrap_or(Duration::from_ticks(0));
                let beginning = Beginning::Found { life, started_before, lost_for, fall_expected };
                self.begin(now, demand, Origin::Node, beginning);
                self.update(now);
                if let Mode::Run(run) = &mut self.mode {
                    run.life.answer();
                }
                self.express(now);
                self.event(Event::Resumed(demand));
            }
        }
    }

    /// Time for which no source has commanded the running engine that was found; none, if one does.
    fn lost_for(&self, now: Instant, finding: &Finding) -> Duration {
        if matches!(self.sources.active(now), Some((_, Intent::Run(_)))) {
            return Duration::from_ticks(0);
        }
        // The source whose demand was in force may have fallen silent since, or all that were received.
        let commanded = || self.sources.all_silent_from(now).flatten();
        let known = self.sources.silent_from(finding.active_source).or_else(commanded);
        let lost_for = match known {
            // One that has only been present has been silent since the node began.
            Some(at) => now.saturating_duration_since(at.max(self.started)),
            // Silence before a reset is added until a source is received, beyond the longest source timeout.
            None => self.in_stages_of_loss(finding.lost_for + now.saturating_duration_since(finding.since)),
        };
        // After a cancelled order the stages of loss continue; after a start of the node they begin.
        match finding.silent_since < finding.since {
            true => lost_for.max(now.saturating_duration_since(finding.silent_since)),
            false => lost_for,
        }
    }

    /// The throttle to which the stages of loss would have lowered the reported one after such a time.
    fn lost_throttle(&self, lost_for: Duration, reported: Throttle) -> Throttle {
        let loss = &self.config.loss;
        let falling = Duration::from_ticks(lost_for.as_ticks().saturating_sub(loss.hold.as_ticks()));
        let fallen = falling.as_millis().saturating_mul(loss.ramp.into()) / 1000;
        let tenths = u64::from(reported.tenths()).saturating_sub(fallen);
        let throttle = u16::try_from(tenths).ok().and_then(|tenths| Throttle::from_tenths(tenths).ok());
        let safe = loss.throttle.min(reported);
        if self.resets >= RESETS_TO_FAIL_SAFE { safe } else { throttle.unwrap_or(reported).max(safe) }
    }
}
