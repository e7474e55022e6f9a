//! The life of a run: what a gap and the end of a doubt do to it, and what its end does to the order.

use super::data::{Engine, Mode};
use super::run::Run;
use crate::command::Origin;
use crate::event::{End, Event};
use crate::link::Link;
use embassy_time::{Duration, Instant};

impl Engine {
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
                        event = Event::Resumed(run.demand.shaped);
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
        self.last_gap = Some(Instant::MAX);
        self.exhaust.gap();
        self.limits.gap();
        match &mut self.mode {
            Mode::Run(Run { life, .. }) | Mode::Pwm { life, .. } => {
                let doubted = life.in_doubt().is_some();
                match life.gap(now) {
                    Some(end) => self.life_over(now, end),
                    None => {
                        self.report_doubt(doubted, true);
                        if let Mode::Run(run) = &mut self.mode {
                            // A reply is sent to an ECU that was just received.
                            if !self.link.answers_frames() {
                                run.demand.sent = run.demand.received;
                            }
                            run.shaper.fall_back(now, run.demand.sent);
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
        let (reached, silent_since) = (run.life.reached(), run.silent_since(&self.config));
        let began_here = run.carried.silent.as_ticks() == 0;
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
        // The stages of loss continue from where they were, as after a reset.
        let mut finding = Self::search(now, &self.record());
        finding.given_up = true;
        // Of a silence that began here the begin is known.
        if let Some(since) = silent_since.filter(|_| began_here) {
            (finding.carried, finding.lost_for) = (Duration::from_ticks(0), Duration::from_ticks(0));
            finding.silent_since = since;
        }
        self.listen(now, finding);
        self.event(Event::RunCancelled(End::Unconfirmed));
    }
}
