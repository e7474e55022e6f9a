//! An engine that is ordered to run: its active source, and the stages of loss without one.

use super::config::Supervision;
use super::life::Life;
use super::shaper::{Lowered, Plan, Shaper};
use super::sources::{Intent, Sources};
use crate::command::{Demand, Origin};
use crate::event::{Event, LossStage};
use crate::link::earlier;
use embassy_time::{Duration, Instant};
use heapless::Deque;

/// Time from the fail-safe stage to standby, 10 s, for an order without an engine that is known to run.
pub(super) const RUN_OUT: Duration = Duration::from_secs(10);
/// Time for two reports to confirm a life that one has put in doubt: a ZK ECU sends its state twice in 0.9 s at 20 Hz.
const CONFIRMS_WITHIN: Duration = Duration::from_secs(2);

/// An engine that is ordered to run.
#[derive(Clone, Debug)]
pub(super) struct Run {
    /// Time of the order.
    pub began: Instant,
    /// Life of the engine that this run belongs to.
    pub life: Life,
    /// Latest time to reach running.
    pub start_by: Option<Instant>,
    /// Source whose demand is in force.
    pub active_source: Origin,
    pub demand: Demands,
    /// Another source that waits to take over, and the end of its wait.
    pub taking_over: Option<TakeOver>,
    /// The stream of commands with which the active source was last in control. Where it still comes, the source was not away.
    pub stream: Option<Instant>,
    /// Begin of the fail-safe stage, while no source is fresh.
    pub fail_safe_at: Option<Instant>,
    pub stage: LossStage,
    pub carried: Carried,
    /// It continues after a reset, which is reported when its life is confirmed.
    pub resumed: bool,
    /// The ECU has its own speed control. The governor does not replace it while the version is unknown after a loss of the
    /// link.
    pub own_speed_control: bool,
    /// It resumed at the fail-safe stage, after consecutive resets without a source.
    pub resumed_low: bool,
    /// A limit was violated whose action is the fail-safe throttle.
    pub limited: bool,
    pub shaper: Shaper,
    /// Last lowering of the demand on the wire.
    pub lowered: Lowered,
    /// Next step of the shaped demand.
    pub next: Option<Instant>,
}

/// The demand on its way from the active source to the ECU.
#[derive(Clone, Copy, Debug)]
pub(super) struct Demands {
    /// In force, before it is shaped.
    pub commanded: Demand,
    /// Shaped.
    pub shaped: Demand,
    /// Handed to the transmitter.
    pub handed_out: Option<Demand>,
    /// Sent completely.
    pub sent: Demand,
    /// Sent when the ECU was last received: of a later one it is not known whether it reached the ECU.
    pub received: Demand,
}

impl Demands {
    /// The ECU has this demand, until the run sends its own: idle, or what was in force before a reset.
    pub const fn new(demand: Demand) -> Self {
        Self { commanded: demand, shaped: demand, handed_out: None, sent: demand, received: demand }
    }

    /// Whether a shaft speed is commanded.
    pub const fn is_rpm(&self) -> bool {
        matches!(self.commanded, Demand::Rpm(_))
    }
}

/// What a run carries over from before its order, or from before a reset of the node.
#[derive(Clone, Copy, Debug)]
pub(super) struct Carried {
    /// The source that started it, or that was in control before a reset, or before its order was given up. Whose standby ends a run depends
    /// on whose it is. The node: not known.
    pub source: Origin,
    /// Time since its start was ordered.
    pub started: Duration,
    /// Silence of the source in control, or the time since it was lost: a source that comes and goes is not in control. It is
    /// over when a source is.
    pub silent: Duration,
    /// Silence of all sources.
    pub all_silent: Duration,
}

/// A take-over that waits until its demand is close to the one in force.
#[derive(Clone, Copy, Debug)]
pub(super) struct TakeOver {
    pub origin: Origin,
    /// It waits no longer.
    pub latest: Instant,
    /// Since when its source has been in a gap; `None`: it waits now.
    gap: Option<Instant>,
}

/// Inputs of an arbitration.
#[derive(Clone, Copy, Debug)]
pub(super) struct Arbitration<'a> {
    pub sources: &'a Sources,
    pub config: &'a Supervision,
    /// The ECU reports a running engine, and nothing puts that in doubt.
    pub living: bool,
    /// Time since which something does.
    pub doubted: Option<Instant>,
}

impl Run {
    /// Determines the active source and the stage of loss. Returns the origin of a standby that ends the run.
    pub fn arbitrate(
        &mut self,
        now: Instant,
        by: Arbitration<'_>,
        events: &mut Deque<Event, 4>,
    ) -> Option<Origin> {
        let Arbitration { sources, config, .. } = by;
        // After consecutive resets without a command, a source holds its demand only once it is received.
        let holds = |(origin, _): &(Origin, Intent)| !self.resumed_low || sources.has_commanded(*origin);
        match sources.active(now).filter(holds) {
            // Standby of the source in control, or of a higher one, is obeyed at once.
            Some((origin, Intent::Standby))
                if origin == self.active_source
                    || origin.priority() >= self.whose(now, config).priority() =>
            {
                Some(origin)
            }
            Some((origin, Intent::Run(demand))) => {
                // It stayed in control or returned after a short gap, or before another source had taken over.
                let away = self.fail_safe_at.is_some() || self.waits().is_some();
                let stream = sources.stream(origin);
                let stayed = !sources.was_lost(origin) || stream == self.stream;
                if origin == self.active_source && (stayed || !away) {
                    self.stream = stream;
                    if away {
                        self.shaper.rise();
                    }
                    // A higher source that comes and goes continues to wait.
                    self.taking_over.take_if(|wait| wait.origin.priority() < origin.priority());
                    self.stop_waiting(now);
                    self.fail_safe_at = None;
                    self.resumed_low = false;
                    self.carried.silent = Duration::from_ticks(0);
                    self.demand.commanded = demand;
                    self.stage(LossStage::None, events);
                    return None;
                }
                let within = config.takeover.within;
                let latest = match self.taking_over {
                    // One deadline for all, and over their gaps: sources that alternate, or come and go, must not hold a lost
                    // demand forever.
                    Some(TakeOver { latest, gap, .. }) if gap.is_none_or(|since| now <= since + within) => {
                        latest
                    }
                    _ => now + within,
                };
                self.taking_over = Some(TakeOver { origin, latest, gap: None });
                // A source that waits to take over is in control, and its silence from before a reset is over.
                self.carried.silent = Duration::from_ticks(0);
                // Consecutive resets would restart the wait each time.
                if now >= latest || self.resumed_low || self.shaper.is_close(demand, &config.takeover) {
                    (self.taking_over, self.fail_safe_at) = (None, None);
                    self.resumed_low = false;
                    self.demand.commanded = demand;
                    self.active_source = origin;
                    self.stream = stream;
                    self.shaper.rise();
                    self.stage(LossStage::None, events);
                }
                None
            }
            // No source, or a lower one that streams standby: the stages of loss continue.
            lower => {
                self.stop_waiting(now);
                let fail_safe_at = self.lose(now, sources, config);
                // Without a configured standby it takes the silence of all sources.
                let silent = config.loss.standby_after.is_some() || sources.all_silent_from(now).is_some();
                if silent && self.standby_at(fail_safe_at, &by).is_some_and(|at| now >= at) {
                    self.stage(LossStage::Standby, events);
                    return Some(Origin::Node);
                }
                let stage = if now >= fail_safe_at { LossStage::FailSafe } else { LossStage::Hold };
                self.stage(stage, events);
                lower
                    .map(|(origin, _)| origin)
                    .filter(|_| now >= fail_safe_at + config.loss.lower_standby_after)
            }
        }
    }

    /// The source whose run it is. Where that is not known, any but the highest may be a lower one, also if one has taken over: the one whose
    /// it is may be received later.
    fn whose(&self, now: Instant, config: &Supervision) -> Origin {
        let is_known =
            self.carried.source != Origin::Node || now >= self.began + config.loss.lower_standby_after;
        let sources = [self.active_source, self.carried.source];
        let known = sources.into_iter().find(|source| is_known && *source != Origin::Node);
        known.unwrap_or(Origin::SOURCES[0])
    }

    /// The source in control: one that waits to take over, or the one whose demand is in force.
    pub fn in_control(&self) -> Origin {
        self.waits().map_or(self.active_source, |wait| wait.origin)
    }

    /// The source that waits to take over now.
    pub fn waits(&self) -> Option<TakeOver> {
        self.taking_over.filter(|wait| wait.gap.is_none())
    }

    fn stop_waiting(&mut self, now: Instant) {
        if let Some(wait) = &mut self.taking_over {
            wait.gap.get_or_insert(now);
        }
    }

    /// Silence of the source in control that is no loss yet. An engine that was found running without a source has lost it.
    pub fn timeout(&self, config: &Supervision) -> Duration {
        match self.active_source {
            Origin::Node => Duration::from_ticks(0),
            source => config.timeouts.of(source),
        }
    }

    /// Begin of the fail-safe stage. Silence from before a reset is included.
    fn lose(&mut self, now: Instant, sources: &Sources, config: &Supervision) -> Instant {
        let silent_from = sources.silent_from(self.active_source).unwrap_or(now).min(now);
        let before = self.carried.silent.as_ticks().saturating_sub(self.timeout(config).as_ticks());
        let hold = Duration::from_ticks(config.loss.hold.as_ticks().saturating_sub(before));
        *self.fail_safe_at.get_or_insert(silent_from + hold)
    }

    /// Time since which the source in control has been lost, if it is: the hold precedes the fail-safe stage.
    pub fn silent_since(&self, config: &Supervision) -> Option<Instant> {
        self.fail_safe_at.map(|at| at.checked_sub(config.loss.hold).unwrap_or(Instant::MIN))
    }

    /// Time until which a source that was received before a reset is not silent yet.
    fn received_until(&self, by: &Arbitration<'_>) -> Option<Instant> {
        if self.carried.all_silent.as_ticks() == 0 || by.sources.last_command().is_some() {
            return None;
        }
        let left = by.config.timeouts.longest().as_ticks().saturating_sub(self.carried.all_silent.as_ticks());
        self.began.checked_add(Duration::from_ticks(left))
    }

    /// Begin of the last stage of loss: as configured, otherwise 10 s after the fail-safe stage if no engine is known to run.
    /// Silence from before a reset is included.
    fn standby_at(&self, fail_safe_at: Instant, by: &Arbitration<'_>) -> Option<Instant> {
        let after = by.config.loss.standby_after.or((!by.living).then_some(RUN_OUT))?;
        let until_fail_safe = (self.timeout(by.config) + by.config.loss.hold).as_ticks();
        let before =
            self.carried.silent.as_ticks().saturating_sub(if self.resumed_low { 0 } else { until_fail_safe });
        let at = fail_safe_at.checked_add(Duration::from_ticks(after.as_ticks().saturating_sub(before)))?;
        if by.config.loss.standby_after.is_some() {
            return Some(at);
        }
        // One odd report, a gap or a reset may raise doubt long after the last stage was due, and must not end the run. A
        // loop of resets must, if no source is received in it.
        let could_run = self.life.reached() && !self.resumed_low;
        let confirmed_by =
            by.doubted.filter(|_| could_run).and_then(|since| since.checked_add(CONFIRMS_WITHIN));
        [Some(at), confirmed_by, self.received_until(by)].into_iter().flatten().max()
    }

    /// Start of the next stage of loss.
    pub fn loss_deadline(&self, by: &Arbitration<'_>) -> Option<Instant> {
        if self.waits().is_some() {
            // The stage does not change: the waiting source takes over or falls silent.
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
        if self.limited || (self.stage >= LossStage::FailSafe && self.waits().is_none()) {
            let in_control = self.stage == LossStage::None && self.waits().is_none();
            Plan::FailSafe { commanded: self.demand.commanded, in_control }
        } else if self.waits().is_some() || self.stage == LossStage::Hold {
            // Even if the demand was not reached yet: no source commands more now.
            Plan::Hold(self.demand.commanded)
        } else {
            Plan::To(self.demand.commanded)
        }
    }

    fn stage(&mut self, stage: LossStage, events: &mut Deque<Event, 4>) {
        if self.stage != stage {
            self.stage = stage;
            let _ = events.push_back(Event::SourceLoss(stage));
        }
    }
}
