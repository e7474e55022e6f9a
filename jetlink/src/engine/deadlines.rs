//! Whether the engine of a run is known to live, and the times at which something times out.

use super::data::{Engine, Mode};
use super::life::{Finding, Life};
use super::retained::SILENCE_STEP;
use super::run::{Arbitration, RUN_OUT, Run};
use crate::link::Link;
use embassy_time::{Duration, Instant};

impl Engine {
    /// Whether the ECU reports a running engine and nothing puts that in doubt, or reports faults only while the exhaust is hot.
    pub(super) fn lives(&self) -> bool {
        let Mode::Run(Run { life, .. }) = &self.mode else { return false };
        life.lives(self.exhaust.burning())
    }

    /// The next of all these times.
    pub(super) fn deadline(&self) -> Option<Instant> {
        let now = self.at;
        let gap = self.link.gap_at();
        let wait = self.start_wait.map(|wait| wait.until);
        let pump = self.pump_ends();
        let sources = self.sources.deadline(now);
        let of_mode = match &self.mode {
            Mode::Listen(finding) => self.listen_ends(now, *finding),
            Mode::Run(run) => {
                let (living, doubted) = (self.lives(), run.life.in_doubt());
                let by = Arbitration { sources: &self.sources, config: &self.config, living, doubted };
                let take_over = run.waits().map(|wait| wait.latest);
                [run.loss_deadline(&by), take_over, run.next, self.life_deadline(&run.life, run.start_by)]
                    .into_iter()
                    .flatten()
                    .min()
            }
            Mode::Pwm { life, start_by } => self.life_deadline(life, *start_by),
            Mode::Stop(_) | Mode::Standby => None,
        };
        // Without any input, too, the record has how long a silence lasts.
        let counts = self.begun && matches!(self.mode, Mode::Listen(_) | Mode::Run(_));
        let record = now.checked_add(SILENCE_STEP).filter(|_| counts);
        // A past deadline has been handled. It is set again by the input that it waits for.
        [gap, wait, pump, sources, of_mode, record].into_iter().flatten().filter(|at| *at > now).min()
    }

    /// Timeout of the start, of the ECU's own restart, or of the wait for a confirmation.
    fn life_deadline(&self, life: &Life, start_by: Option<Instant>) -> Option<Instant> {
        let start = start_by.filter(|_| !life.reached());
        let restart = life.restarting().map(|since| since + self.start_time());
        [start, restart, self.doubt_ends(life)].into_iter().flatten().min()
    }

    /// Time without a confirmation of a life in doubt, and without a reply to its ECU: its begin, and its length before the
    /// last reset. Replies from before the order do not count: an engine that is found has not had one yet.
    pub(super) fn unconfirmed(&self, life: &Life) -> Option<(Instant, Duration)> {
        let (since, before) = (life.in_doubt()?, life.doubted_before());
        let began = if let Mode::Run(run) = &self.mode { run.began } else { Instant::MIN };
        let last_reply = self.link.last_reply().filter(|at| *at >= began);
        Some(last_reply.map_or((since, before), |at| (at, Duration::from_ticks(0))))
    }

    /// Time at which a life in doubt loses its order: its ECU has stopped the engine by then.
    pub(super) fn doubt_ends(&self, life: &Life) -> Option<Instant> {
        let (since, before) = self.unconfirmed(life)?;
        let left = self.link.reply_timeout()?.as_ticks().saturating_sub(before.as_ticks());
        since.checked_add(Duration::from_ticks(left))
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
        let counted = self.in_stages_of_loss(finding.carried).as_ticks();
        silent_from.checked_add(Duration::from_ticks(after.as_ticks().saturating_sub(counted)))
    }

    /// The part of a silence that belongs to the stages of loss: it began with the last command, they with the end of its source's timeout,
    /// of which only the longest is known.
    pub(super) fn in_stages_of_loss(&self, silence: Duration) -> Duration {
        Duration::from_ticks(silence.as_ticks().saturating_sub(self.config.timeouts.longest().as_ticks()))
    }
}
