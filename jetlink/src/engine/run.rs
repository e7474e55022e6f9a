//! An engine that is ordered to run: whose demand is in force, and what becomes of it when nobody asks for one.

use super::config::Supervision;
use super::life::Life;
use super::shaper::{Lowered, Plan, Shaper};
use super::sources::{Intent, Sources};
use crate::command::{Demand, Origin};
use crate::event::{Event, LossStage};
use crate::link::earlier;
use embassy_time::{Duration, Instant};
use heapless::Deque;

/// The last stage of loss of an order to run without a living engine, after the fail-safe stage began.
pub(super) const RUN_OUT: Duration = Duration::from_secs(10);
/// In so long two reports confirm a life that one has put in doubt: the state of a ZK ECU comes round twice in 0.9 s at 20 Hz.
const CONFIRMS_WITHIN: Duration = Duration::from_secs(2);

/// An engine that is ordered to run.
#[derive(Clone, Debug)]
pub(super) struct Run {
    /// When it was ordered.
    pub began: Instant,
    /// How long its start had taken before a reset.
    pub started_before: Duration,
    /// The life of the engine that this run belongs to.
    pub life: Life,
    /// When it has to run by.
    pub start_by: Option<Instant>,
    /// The source in control: whose demand is in force.
    pub ruler: Origin,
    /// That demand, before it is shaped.
    pub demand: Demand,
    /// The demand as it was last shaped, as it was last handed out, and as it last went out whole.
    pub shaped: Demand,
    pub handed_out: Option<Demand>,
    pub sent: Option<Demand>,
    /// Another source waits to take over, until then at the latest.
    pub taking_over: Option<(Origin, Instant)>,
    /// No source is fresh: when the fail-safe stage begins, or has begun.
    pub fail_safe_at: Option<Instant>,
    pub stage: LossStage,
    /// Silence of the source in control from before the last reset.
    pub carried: Duration,
    /// The same of every source.
    pub all_carried: Duration,
    /// It goes on after a reset, which is reported when its life is confirmed.
    pub resumed: bool,
    /// The ECU has shown a speed control of its own in this run: while its version is not known again after a loss of the
    /// link, no governor takes its place.
    pub own_speed_control: bool,
    /// It was resumed at the fail-safe stage, because resets follow one another without a source.
    pub resumed_low: bool,
    /// A limit was passed whose action is the fail-safe throttle.
    pub limited: bool,
    pub shaper: Shaper,
    /// When the demand on the wire was last lowered.
    pub lowered: Lowered,
    /// When the shaped demand moves on.
    pub next: Option<Instant>,
}

/// What is known when the source in control of a running engine is found.
#[derive(Clone, Copy, Debug)]
pub(super) struct Arbitration<'a> {
    pub sources: &'a Sources,
    pub config: &'a Supervision,
    /// The ECU reports a running engine, and nothing puts that in doubt.
    pub living: bool,
    /// Since when something does.
    pub doubted: Option<Instant>,
}

impl Run {
    /// Finds who is in control now. Gives whose standby it is, if it is to be standby.
    pub fn rule(&mut self, now: Instant, by: Arbitration<'_>, told: &mut Deque<Event, 4>) -> Option<Origin> {
        let Arbitration { sources, config, .. } = by;
        // Silence from before the reset is over.
        if sources.has_wanted(self.ruler) {
            self.carried = Duration::from_ticks(0);
        }
        if sources.last_word().is_some() {
            self.all_carried = Duration::from_ticks(0);
        }
        match sources.active(now) {
            // Of the source in control, or of one above it, standby comes at once.
            // Of an engine that was found running nobody knows whose it is: any source but the highest may be the lower one.
            Some((origin, Intent::Standby))
                if origin == Origin::SOURCES[0]
                    || origin.priority() >= self.ruler.priority() && self.ruler != Origin::Node =>
            {
                Some(origin)
            }
            Some((origin, Intent::Run(demand))) => {
                // It was never away, or for a moment only. It was also away where another one was about to take over.
                let away = self.fail_safe_at.is_some() || self.taking_over.is_some();
                if origin == self.ruler && !(away && sources.was_lost(origin)) {
                    if away {
                        self.shaper.rise();
                    }
                    (self.taking_over, self.fail_safe_at) = (None, None);
                    self.resumed_low = false;
                    self.demand = demand;
                    self.stage(LossStage::None, told);
                    return None;
                }
                let latest = match self.taking_over {
                    // Not anew for each source: those that come and go in turn would hold a lost demand up for ever.
                    Some((_, latest)) => latest,
                    None => now + config.takeover.within,
                };
                self.taking_over = Some((origin, latest));
                // Resets that follow one another would begin the wait anew each time.
                if now >= latest || self.resumed_low || self.shaper.is_close(demand, &config.takeover) {
                    (self.taking_over, self.fail_safe_at) = (None, None);
                    self.resumed_low = false;
                    self.carried = Duration::from_ticks(0);
                    self.demand = demand;
                    self.ruler = origin;
                    self.shaper.rise();
                    self.stage(LossStage::None, told);
                }
                None
            }
            // Nobody, or a lower source that streams standby: the stages of loss go on.
            lower => {
                self.taking_over = None;
                let fail_safe_at = self.lose(now, sources, config);
                // Where it is not configured, it takes the silence of all sources.
                let silent = config.loss.standby_after.is_some() || sources.all_silent_from(now).is_some();
                if silent && self.standby_at(fail_safe_at, &by).is_some_and(|at| now >= at) {
                    self.stage(LossStage::Standby, told);
                    return Some(Origin::Node);
                }
                let stage = if now >= fail_safe_at { LossStage::FailSafe } else { LossStage::Hold };
                self.stage(stage, told);
                lower
                    .map(|(origin, _)| origin)
                    .filter(|_| now >= fail_safe_at + config.loss.lower_standby_after)
            }
        }
    }

    /// When the fail-safe stage begins. Silence from before a reset counts.
    fn lose(&mut self, now: Instant, sources: &Sources, config: &Supervision) -> Instant {
        let silent_from = sources.silent_from(self.ruler).unwrap_or(now).min(now);
        let before = self.carried.as_ticks().saturating_sub(config.ages.of(self.ruler).as_ticks());
        let hold = Duration::from_ticks(config.loss.hold.as_ticks().saturating_sub(before));
        *self.fail_safe_at.get_or_insert(silent_from + hold)
    }

    /// Since when the source in control has been lost, where it has: the hold came before the fail-safe stage.
    pub fn silent_since(&self, config: &Supervision) -> Option<Instant> {
        self.fail_safe_at.map(|at| at.checked_sub(config.loss.hold).unwrap_or(Instant::MIN))
    }

    /// When the last stage of loss begins: as configured, and where no engine is known to live, 10 s into the fail-safe
    /// stage. Silence from before a reset counts.
    fn standby_at(&self, fail_safe_at: Instant, by: &Arbitration<'_>) -> Option<Instant> {
        let after = by.config.loss.standby_after.or((!by.living).then_some(RUN_OUT))?;
        let until_fail_safe =
            by.config.ages.of(self.ruler).as_ticks().saturating_add(by.config.loss.hold.as_ticks());
        let before =
            self.all_carried.as_ticks().saturating_sub(if self.resumed_low { 0 } else { until_fail_safe });
        let at = fail_safe_at.checked_add(Duration::from_ticks(after.as_ticks().saturating_sub(before)))?;
        // One odd report, a gap or a reset raises doubt long after the stages have run out, and is no verdict. A loop of
        // resets is.
        match by.doubted.filter(|_| by.config.loss.standby_after.is_none() && !self.resumed_low) {
            Some(since) => Some(at.max(since.checked_add(CONFIRMS_WITHIN)?)),
            None => Some(at),
        }
    }

    /// When the next stage of loss begins.
    pub fn loss_deadline(&self, by: &Arbitration<'_>) -> Option<Instant> {
        if self.taking_over.is_some() {
            // The stages stay as they are: the source that waits takes over, or falls silent.
            return None;
        }
        let fail_safe_at = self.fail_safe_at?;
        match self.stage {
            LossStage::None | LossStage::Hold => Some(fail_safe_at),
            LossStage::FailSafe => {
                let lower = fail_safe_at + by.config.loss.lower_standby_after;
                let lower = Some(lower).filter(|at| *at > self.shaper.at());
                earlier(self.standby_at(fail_safe_at, by), lower)
            }
            LossStage::Standby => None,
        }
    }

    pub fn plan(&self) -> Plan {
        if self.limited || (self.stage >= LossStage::FailSafe && self.taking_over.is_none()) {
            let ruled = self.stage == LossStage::None && self.taking_over.is_none();
            Plan::FailSafe { asked: self.demand, ruled }
        } else if self.taking_over.is_some() || self.stage == LossStage::Hold {
            // Also where the demand has not come to pass yet: nobody asks for more now.
            Plan::Hold(self.demand)
        } else {
            Plan::To(self.demand)
        }
    }

    fn stage(&mut self, stage: LossStage, told: &mut Deque<Event, 4>) {
        if self.stage != stage {
            self.stage = stage;
            let _ = told.push_back(Event::SourceLoss(stage));
        }
    }
}
