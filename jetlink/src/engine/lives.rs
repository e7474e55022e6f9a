//! The life of a run: what a gap and the end of a doubt do to it, and what its end does to the order.

use super::data::{Engine, Mode};
use super::life::Finding;
use super::run::Run;
use crate::command::Origin;
use crate::event::{End, Event};
use crate::link::Link;
use embassy_time::Instant;

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
        let (reached, after_faults) = (run.life.reached(), run.life.after_faults());
        let (silent_since, active_source) = (run.silent_since(&self.config), run.active_source);
        // A silence that began before a reset is longer than this node has run.
        let carried = (run.carried.silent.as_ticks() > 0 && self.sources.last_command().is_none())
            .then(|| (run.carried.all_silent + now.saturating_duration_since(run.began), self.silent(run)));
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
        let finding = match carried {
            Some((all_silent, silent)) => {
                Finding::given_up(now, now, active_source).carrying(all_silent, silent)
            }
            None => Finding::given_up(now, silent_since.unwrap_or(now), active_source),
        };
        self.listen(now, finding.after_faults(after_faults));
        self.event(Event::RunCancelled(End::Unconfirmed));
    }
}
