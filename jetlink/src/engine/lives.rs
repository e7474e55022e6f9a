//! The life of a run: what reports, gaps and silence make of it, and what its end does to the order.

use super::life::{Finding, Life};
use super::run::{RUN_OUT, Run};
use super::{Engine, Mode};
use crate::command::{Order, Origin};
use crate::event::{End, Event};
use crate::link::{Link, Sign};
use embassy_time::{Duration, Instant};

impl Engine {
    /// Judges what one frame says about the life of the engine, before its reply is handed out.
    pub(super) fn judge(&mut self, now: Instant, sign: Sign) {
        if sign == Sign::PowerUp {
            self.last_gap = Some(now);
        }
        self.observe_exhaust(now, sign);
        let exhaust = self.exhaust.burning();
        let answers = self.link.answers_frames();
        match &mut self.mode {
            Mode::Stop(_) | Mode::Standby => {}
            Mode::Run(Run { life, .. }) | Mode::Pwm { life, .. } => {
                let doubted = life.in_doubt().is_some();
                let end = life.observe(now, sign, exhaust);
                let doubts = life.in_doubt().is_some();
                match end {
                    Some(end) => self.life_over(now, end),
                    None => {
                        self.report_doubt(doubted, doubts);
                        if doubts {
                            // While in doubt, each set decides whether it is answered.
                            self.shape(now);
                        } else {
                            self.express(now);
                        }
                    }
                }
            }
            Mode::Listen(finding) => {
                let found = finding.observe(sign, exhaust, answers);
                self.found(now, found, sign);
            }
        }
    }

    pub(super) fn observe_exhaust(&mut self, now: Instant, sign: Sign) {
        let egt = match sign {
            Sign::State { .. } => {
                self.link.status().report.egt.filter(|egt| egt.at == now).map(|egt| egt.value)
            }
            Sign::Faulted { egt, .. } => egt,
            _ => return,
        };
        let lowered = match &self.mode {
            Mode::Run(run) => run.lowered.fall_expected(now).as_ticks() > 0,
            _ => false,
        };
        self.exhaust.observe(now, egt, lowered);
    }

    /// Ends the order, because the life that it belongs to is over.
    pub(super) fn life_over(&mut self, now: Instant, end: End) {
        let ran = match &self.mode {
            Mode::Run(Run { life, .. }) | Mode::Pwm { life, .. } => life.ran(),
            _ => false,
        };
        let failed = ran && !self.link.status().shutting_down;
        self.sources.forget_runs();
        self.standby(now, Origin::Node);
        self.failed = failed;
        self.event(Event::RunCancelled(end));
    }

    pub(super) fn report_doubt(&mut self, doubted: bool, doubts: bool) {
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

    /// Puts a run in doubt at once when three expected frames are missing.
    pub(super) fn find_gap(&mut self, now: Instant) {
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
                        if let Mode::Run(run) = &mut self.mode {
                            run.shaper.fall_back(now, run.sent);
                        }
                    }
                }
            }
            Mode::Listen(finding) => finding.gap(),
            Mode::Stop(_) | Mode::Standby => {}
        }
    }

    /// Cancels a run that nothing confirmed in time, but leaves the engine alone: if the ECU reports a running engine later,
    /// it resumes as one that was found running. A start ends.
    pub(super) fn give_up_order(&mut self, now: Instant) {
        let Mode::Run(run) = &self.mode else { return };
        let (reached, silent_since, active_source) =
            (run.life.reached(), run.silent_since(&self.config), run.active_source);
        if !reached {
            self.life_over(now, End::GapInStart);
            return;
        }
        if self.link.status().shutting_down {
            // A service command was stopping the engine: it must not run on should its link return.
            self.sources.forget_runs();
            self.standby(now, Origin::Node);
            self.event(Event::RunCancelled(End::Unconfirmed));
            return;
        }
        self.failed = true;
        // The stages of loss continue from where they were.
        let silent_since = silent_since.unwrap_or(now);
        self.mode =
            Mode::Listen(Finding::new(now, true).silent_since(silent_since).controlled_by(active_source));
        self.order(now, Order::Listen, Origin::Node);
        self.event(Event::RunCancelled(End::Unconfirmed));
    }

    /// Time at which standby is sent when no order is in force and no source commands. Otherwise a ZK ECU from version 5 would
    /// keep running (ZK-10).
    pub(super) fn listen_ends(&self, now: Instant, finding: Finding) -> Option<Instant> {
        let silent_from = match self.sources.all_silent_from(now)? {
            // A source was received since the order ended.
            Some(from) if from > finding.since => from,
            _ => finding.silent_since,
        };
        let after = self.config.loss.hold + self.config.loss.standby_after.unwrap_or(RUN_OUT);
        silent_from
            .checked_add(Duration::from_ticks(after.as_ticks().saturating_sub(finding.carried.as_ticks())))
    }

    /// Whether the ECU reports a running engine and nothing puts that in doubt, or reports faults only while the exhaust is hot.
    pub(super) fn lives(&self) -> bool {
        let Mode::Run(Run { life, .. }) = &self.mode else { return false };
        life.lives(self.exhaust.burning())
    }

    /// Timeout of the start, of the ECU's own restart, or of the wait for a confirmation.
    pub(super) fn life_deadline(&self, life: &Life, start_by: Option<Instant>) -> Option<Instant> {
        let start = start_by.filter(|_| !life.reached());
        let restart = life.restarting().map(|since| since + self.start_time());
        [start, restart, self.doubt_ends(life)].into_iter().flatten().min()
    }

    /// Time without a confirmation of a life in doubt, and without a reply to its ECU: its begin, and its length before the
    /// last reset.
    pub(super) fn unconfirmed(&self, life: &Life) -> Option<(Instant, Duration)> {
        let (since, before) = (life.in_doubt()?, life.doubted_before());
        Some(self.link.last_reply().map_or((since, before), |at| (at, Duration::from_ticks(0))))
    }

    /// Time at which a life in doubt loses its order: its ECU has stopped the engine by then.
    pub(super) fn doubt_ends(&self, life: &Life) -> Option<Instant> {
        let (since, before) = self.unconfirmed(life)?;
        let left = self.link.reply_timeout()?.as_ticks().saturating_sub(before.as_ticks());
        since.checked_add(Duration::from_ticks(left))
    }
}
