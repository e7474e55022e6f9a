//! The demand of a running engine: who asks for it, what becomes of it when nobody does, and how it moves.

use super::Run;
use super::config::{Supervision, Takeover};
use super::governor::Governor;
use super::ramp::{Ramp, Rates};
use super::sources::{Intent, Sources};
use crate::command::{Demand, Origin};
use crate::link::earlier;
use crate::telemetry::{Event, LossStage, Timed};
use crate::units::{Rpm, Throttle};
use embassy_time::{Duration, Instant};
use heapless::Deque;

/// The last stage of loss of an order to run without a living engine, after the fail-safe stage began.
pub(super) const RUN_OUT: Duration = Duration::from_secs(10);
/// In so long two reports confirm a life that one has put in doubt: the state of a ZK ECU comes round twice in 0.9 s at 20 Hz.
const CONFIRMS_WITHIN: Duration = Duration::from_secs(2);
/// Between two updates of a demand that moves.
const STEP: Duration = Duration::from_millis(20);
/// Stands for the maximum rpm of an engine that does not tell its own, when a rate in % is made one in rpm.
const NOMINAL_MAX_RPM: u32 = 100_000;

/// Where the demand shall go.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) enum Plan {
    /// No further to what is asked: another source is about to take over, or the one that asked is silent.
    Hold(Demand),
    /// To what the ruling source asks.
    To(Demand),
    /// To the fail-safe throttle, or to idle if an rpm was asked, by its ramp; and never above what is asked, if its source
    /// still rules.
    FailSafe { asked: Demand, ruled: bool },
}

/// What is known of the engine when its demand is shaped.
#[derive(Clone, Copy, Debug)]
pub(super) struct Shape {
    /// The ECU reports a running engine; until then the demand stays at idle.
    pub running: bool,
    /// Nothing puts that in doubt.
    pub living: bool,
    /// The source in control has spoken since the node started: its demand is its own, and not what was left of it in a record.
    pub spoken: bool,
    pub idle_rpm: Option<Rpm>,
    pub max_rpm: Option<Rpm>,
    pub rpm: Option<Timed<Rpm>>,
    /// That the ECU reports.
    pub throttle: Option<Throttle>,
    /// Thousandths.
    pub reduced_to: Option<u16>,
    /// The ECU has no speed control, so an rpm needs the governor.
    pub governed: bool,
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
        match sources.ruler(now) {
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

/// A demand of either kind on its way.
#[derive(Clone, Copy, Debug)]
enum Moving {
    /// In tenths of a percent.
    Throttle(Ramp),
    /// In revolutions a minute.
    Rpm(Ramp),
}

/// Moves the demand and, where the ECU has no speed control, makes it a throttle.
#[derive(Clone, Debug)]
pub(super) struct Shaper {
    moving: Moving,
    governor: Option<Governor>,
    /// The throttle that the governor has set; `None` before it has.
    governed: Option<Throttle>,
    /// It rises at its set rate until it is where it is commanded to: after a start, a take-over, a gap.
    rising: bool,
    /// It was reduced, because another engine failed.
    was_reduced: bool,
    at: Instant,
}

impl Shaper {
    /// At rest at a demand.
    pub fn new(now: Instant, demand: Demand) -> Self {
        Self {
            moving: Moving::new(now, demand),
            governor: None,
            governed: None,
            rising: true,
            was_reduced: false,
            at: now,
        }
    }

    /// It goes on from a lower demand: what has not gone out before a gap does not jump after it.
    pub fn fall_back(&mut self, now: Instant, sent: Demand) {
        if sent.is_below(self.moving.demand()) {
            self.moving = Moving::new(now, sent);
        }
    }

    /// From here the demand rises at its set rate, until it is where it is commanded to.
    pub const fn rise(&mut self) {
        self.rising = true;
    }

    /// When it last moved.
    pub const fn at(&self) -> Instant {
        self.at
    }

    /// Whether a demand is close enough to the one in force to take over without a bump.
    pub fn is_close(&self, demand: Demand, takeover: &Takeover) -> bool {
        match (self.moving.demand(), demand) {
            (Demand::Throttle(a), Demand::Throttle(b)) => {
                a.tenths().abs_diff(b.tenths()) <= takeover.throttle_band.tenths()
            }
            (Demand::Rpm(a), Demand::Rpm(b)) => a.get().abs_diff(b.get()) <= takeover.rpm_band.get(),
            _ => false,
        }
    }

    /// The demand for the ECU now, and when it moves on.
    pub fn demand(
        &mut self,
        now: Instant,
        plan: Plan,
        shape: &Shape,
        config: &Supervision,
    ) -> (Demand, Option<Instant>) {
        self.at = now;
        if core::mem::replace(&mut self.was_reduced, shape.reduced_to.is_some()) && !self.was_reduced {
            self.rising = true;
        }
        // What is held while its life is in doubt does not jump when it is let go.
        self.rising |= shape.running && !shape.living;
        // The reduction for an engine that failed is a fail-safe, and no slower than one.
        let down = match shape.reduced_to {
            Some(_) => config.slew.down.map(|down| down.max(config.loss.ramp)),
            None => config.slew.down,
        };
        let up = match config.slew.up {
            Some(up) if self.rising => Some(up.min(config.rise)),
            None if self.rising => Some(config.rise),
            up => up,
        };
        let slew = Rates { up: up.map(u32::from), down: down.map(u32::from) };
        let (target, rates) = match plan {
            // It waits for nobody else.
            Plan::Hold(asked)
                if shape.reduced_to.is_some()
                    && reduced(asked, shape.reduced_to).is_below(self.moving.demand()) =>
            {
                (reduced(asked, shape.reduced_to), slew)
            }
            Plan::Hold(_) => (self.moving.demand(), Rates::AT_ONCE),
            // Whether it lives is in doubt: it may go down, and not up. A throttle in place of an rpm cannot be said then; the
            // idle speed can.
            Plan::To(Demand::Throttle(_))
                if shape.running
                    && !shape.living
                    && matches!(self.moving, Moving::Rpm(_))
                    && !shape.governed =>
            {
                let Demand::Rpm(now_at) = self.moving.demand() else { return (self.moving.demand(), None) };
                (Demand::Rpm(shape.idle_rpm.map_or(now_at, |idle| idle.min(now_at))), slew)
            }
            Plan::To(demand)
                if shape.running
                    && !shape.living
                    && !reduced(demand, shape.reduced_to).is_below(self.moving.demand()) =>
            {
                (self.moving.demand(), Rates::AT_ONCE)
            }
            Plan::To(demand) => {
                let target = reduced(demand, shape.reduced_to);
                self.rising &= !shape.running || !shape.spoken || self.moving.demand() != target;
                (target, slew)
            }
            Plan::FailSafe { asked, ruled } => {
                let most = reduced(asked, shape.reduced_to);
                if ruled && most.is_below(self.moving.demand()) {
                    self.moving.follow(now, most, slew, shape);
                }
                let down = Rates { up: None, down: Some(u32::from(config.loss.ramp)) };
                (self.fail_safe(now, asked, shape, config), down)
            }
        };
        let (target, rates) =
            if shape.running { (target, rates) } else { (idle(target, shape), Rates::AT_ONCE) };
        let next = self.moving.follow(now, target, rates, shape);
        let demand = self.moving.demand();
        let (Demand::Rpm(rpm), true, Some(settings)) = (demand, shape.governed, config.governor) else {
            self.governor = None;
            return (demand, next);
        };
        if !shape.running {
            self.governor = None;
            return (Demand::Throttle(Throttle::IDLE), next);
        }
        if !shape.living {
            // Whether the engine lives is in doubt: it neither controls nor winds up, and holds nothing on old telemetry.
            self.governor = None;
            let old_at = shape.rpm.map(|rpm| rpm.at + settings.max_age).filter(|at| *at > now);
            if old_at.is_none() {
                self.governed = None;
                return (Demand::Throttle(Throttle::IDLE), next);
            }
            let held = self.governed.or(shape.throttle).unwrap_or(Throttle::IDLE);
            return (Demand::Throttle(held), earlier(next, old_at));
        }
        let governor = self
            .governor
            .get_or_insert_with(|| Governor::new(settings, shape.throttle.unwrap_or(Throttle::IDLE)));
        let (throttle, look_again) = governor.throttle(now, rpm, shape.rpm);
        self.governed = Some(throttle);
        (Demand::Throttle(throttle), earlier(next, Some(look_again).filter(|at| *at > now)))
    }

    /// Where the fail-safe takes the demand. It only ever lowers.
    fn fail_safe(&mut self, now: Instant, asked: Demand, shape: &Shape, config: &Supervision) -> Demand {
        let safe = match asked {
            Demand::Throttle(_) => config.loss.throttle,
            // As any rpm: how another throttle compares with it nothing says.
            Demand::Rpm(_) => Throttle::IDLE,
        };
        match (self.moving.demand(), shape.idle_rpm) {
            (Demand::Throttle(throttle), _) => Demand::Throttle(throttle.min(safe)),
            (Demand::Rpm(rpm), Some(idle)) if !shape.governed => Demand::Rpm(rpm.min(idle)),
            (Demand::Rpm(_), _) => {
                // From the governor's throttle on; an ECU's own is not known, and its idle rpm neither.
                let from = self.governed.filter(|_| shape.governed).unwrap_or(Throttle::IDLE);
                self.moving = Moving::new(now, Demand::Throttle(from));
                Demand::Throttle(from.min(safe))
            }
        }
    }
}

impl Moving {
    fn new(now: Instant, demand: Demand) -> Self {
        match demand {
            Demand::Throttle(throttle) => Self::Throttle(Ramp::new(throttle.tenths().into(), now)),
            Demand::Rpm(rpm) => Self::Rpm(Ramp::new(rpm.get(), now)),
        }
    }

    fn demand(&self) -> Demand {
        match self {
            Self::Throttle(ramp) => {
                let tenths = u16::try_from(ramp.value()).unwrap_or(u16::MAX);
                Demand::Throttle(Throttle::from_tenths(tenths).unwrap_or(Throttle::FULL))
            }
            Self::Rpm(ramp) => Demand::Rpm(Rpm::new(ramp.value())),
        }
    }

    fn follow(&mut self, now: Instant, target: Demand, rates: Rates, shape: &Shape) -> Option<Instant> {
        match (&mut *self, target) {
            (Self::Throttle(ramp), Demand::Throttle(throttle)) => {
                ramp.follow(now, throttle.tenths().into(), rates, STEP)
            }
            (Self::Rpm(ramp), Demand::Rpm(rpm)) => {
                let max = shape.max_rpm.map_or(NOMINAL_MAX_RPM, Rpm::get);
                // Tenths of a percent of the maximum.
                let share = |rate: Option<u32>| rate.map(|rate| rate.saturating_mul(max / 1000));
                ramp.follow(now, rpm.get(), Rates { up: share(rates.up), down: share(rates.down) }, STEP)
            }
            // The other kind of demand: nothing says how the two compare. With a slew it rises from what the ECU
            // reports, where it does; what is asked is the most all the same.
            (moving, target) => {
                let from = match (target, shape.throttle, shape.rpm) {
                    _ if rates.up.is_none() => target,
                    (Demand::Throttle(asked), now, _) => {
                        Demand::Throttle(asked.min(now.unwrap_or(Throttle::IDLE)))
                    }
                    (Demand::Rpm(asked), _, now) => {
                        let idle = shape.idle_rpm.unwrap_or(Rpm::new(0));
                        Demand::Rpm(asked.min(now.map_or(idle, |now| now.value)))
                    }
                };
                *moving = Self::new(now, from);
                if from == target { None } else { moving.follow(now, target, rates, shape) }
            }
        }
    }
}

/// A demand that fell by less, in thousandths of the whole, is noise of a stick.
const LOWERED_BY: u32 = 20;

/// Tells when a demand was lowered by more than a stick's noise.
#[derive(Clone, Copy, Debug)]
pub(super) struct Lowered {
    from: Demand,
    at: Instant,
    last: Option<Instant>,
}

impl Lowered {
    pub const fn new(now: Instant, demand: Demand) -> Self {
        Self { from: demand, at: now, last: None }
    }

    pub const fn at(&self) -> Instant {
        self.at
    }

    /// When the demand was last lowered in this run, if it was.
    pub const fn last(&self) -> Option<Instant> {
        self.last
    }

    pub fn see(&mut self, now: Instant, demand: Demand) {
        let (value, from, band) = match (demand, self.from) {
            (Demand::Throttle(demand), Demand::Throttle(from)) => {
                (demand.tenths().into(), from.tenths().into(), LOWERED_BY)
            }
            (Demand::Rpm(demand), Demand::Rpm(from)) => {
                (demand.get(), from.get(), NOMINAL_MAX_RPM / 1000 * LOWERED_BY)
            }
            // Between kinds that cannot be told, so it counts as less.
            _ => (0, u32::MAX, 0),
        };
        if value >= from {
            self.from = demand;
        } else if from - value > band {
            *self = Self { from: demand, at: now, last: Some(now) };
        }
    }
}

fn reduced(demand: Demand, to: Option<u16>) -> Demand {
    let Some(to) = to else { return demand };
    let share = |value: u32| (u64::from(value) * u64::from(to) / 1000) as u32;
    match demand {
        Demand::Throttle(throttle) => {
            let tenths = u16::try_from(share(throttle.tenths().into())).unwrap_or(0);
            Demand::Throttle(Throttle::from_tenths(tenths).unwrap_or(throttle).min(throttle))
        }
        Demand::Rpm(rpm) => Demand::Rpm(Rpm::new(share(rpm.get())).min(rpm)),
    }
}

fn idle(target: Demand, shape: &Shape) -> Demand {
    match target {
        Demand::Throttle(_) => Demand::Throttle(Throttle::IDLE),
        Demand::Rpm(rpm) => Demand::Rpm(shape.idle_rpm.map_or(Rpm::new(0), |idle| idle.min(rpm))),
    }
}
