//! Shapes the demand of a running engine: rates, reductions, governor.

use super::config::{Governor as GovernorSettings, Supervision, Takeover};
use super::exhaust::FALL_EXPECTED;
use super::governor::Governor;
use super::ramp::{Ramp, Rates};
use crate::command::Demand;
use crate::link::earlier;
use crate::report::Timed;
use crate::units::{Rpm, Throttle};
use core::mem::discriminant;
use embassy_time::{Duration, Instant};

/// Maximum rpm, for rates in %, of an engine whose ECU does not report its own.
const NOMINAL_MAX_RPM: u32 = 100_000;

/// Time for which a governor waits for a speed and a throttle after a doubt. The scale of AMT's speeds comes with the first alternate set, at
/// most the eleventh: 1.4 s at 2400 baud. ZK's throttle comes once in a round of reports.
const INCOMPLETE_MAX: Duration = Duration::from_secs(2);

/// Target of the demand.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) enum Plan {
    /// Hold before the commanded demand: another source is about to take over, or the active one is silent.
    Hold(Demand),
    /// The demand of the source in control.
    To(Demand),
    /// By its ramp to the fail-safe throttle, or to idle for an rpm demand; never above the commanded demand while its source
    /// is in control.
    FailSafe { commanded: Demand, in_control: bool },
}

/// State of the engine when its demand is shaped.
#[derive(Clone, Copy, Debug)]
pub(super) struct Shape {
    /// The ECU reports a running engine; until then the demand stays at idle.
    pub running: bool,
    /// Nothing puts that in doubt.
    pub living: bool,
    /// The last frame that was due was sent.
    pub transmits: bool,
    /// The active source was received since the node started: its demand is a command, not a retained value.
    pub received: bool,
    pub idle_rpm: Option<Rpm>,
    pub max_rpm: Option<Rpm>,
    pub rpm: Option<Timed<Rpm>>,
    /// As the ECU reports it.
    pub throttle: Option<Throttle>,
    /// The last demand that was sent completely.
    pub sent: Demand,
    /// The one that is being sent.
    pub in_transit: Option<Demand>,
    /// In per mille.
    pub reduced_to: Option<u16>,
    /// The ECU has no speed control, so an rpm needs the governor.
    pub governed: bool,
}

/// A demand of either kind on its way.
#[derive(Clone, Copy, Debug)]
enum Moving {
    /// In 0.1 %.
    Throttle(Ramp),
    /// In revolutions a minute.
    Rpm(Ramp),
}

/// Moves the demand and, for an ECU without speed control, turns an rpm into a throttle.
#[derive(Clone, Debug)]
pub(super) struct Shaper {
    moving: Moving,
    governor: Option<Governor>,
    /// Last throttle of the governor.
    governed: Option<Throttle>,
    /// The governor has not controlled since a doubt.
    doubted: bool,
    /// Since then the ECU has reported a throttle without a speed, or the other way round.
    incomplete_since: Option<Instant>,
    /// The throttle that the ECU has is not known yet: nothing can be sent that continues it.
    waits: bool,
    /// Limits the rise to the configured rate until the commanded demand is reached: after a start, a take-over, a gap.
    rising: bool,
    /// Share to which the demand was reduced because another engine failed.
    reduced_to: Option<u16>,
    /// The ECU's speeds, as last reported in this run: a lost link forgets them, and the fail-safe of an rpm needs them in doubt, the
    /// idle speed as its end and the maximum for its rate.
    idle_rpm: Option<Rpm>,
    max_rpm: Option<Rpm>,
    at: Instant,
}

impl Shaper {
    /// At rest at a demand.
    pub fn new(now: Instant, demand: Demand) -> Self {
        Self {
            moving: Moving::new(now, demand),
            governor: None,
            governed: None,
            doubted: false,
            incomplete_since: None,
            waits: false,
            rising: true,
            reduced_to: None,
            idle_rpm: None,
            max_rpm: None,
            at: now,
        }
    }

    /// Falls back to the lower demand that was sent before a gap, or the one of the other kind, so that the rest does not jump after
    /// it.
    pub fn fall_back(&mut self, now: Instant, sent: Demand) {
        let replaced = match (&self.moving, sent) {
            (Moving::Throttle(_), Demand::Rpm(_)) => true,
            // A governor sends a throttle for an rpm.
            (Moving::Rpm(_), Demand::Throttle(_)) => self.governed.is_none(),
            _ => sent.is_below(self.moving.demand()),
        };
        if replaced {
            self.moving = Moving::new(now, sent);
        }
    }

    /// Restarts from the substitute demand that was sent because the ECU cannot take the commanded one: what it can take later must
    /// not jump, and without a source does not rise.
    pub fn replace(&mut self, now: Instant, sent: Demand) {
        self.moving = Moving::new(now, sent);
        self.rising = true;
    }

    /// Limits the rise to the configured rate until the commanded demand is reached.
    pub const fn rise(&mut self) {
        self.rising = true;
    }

    /// Whether a governor waits for the throttle that the ECU has, so that no demand is known.
    pub const fn waits(&self) -> bool {
        self.waits
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

    /// The demand for the ECU now, and the time of its next step.
    pub fn demand(
        &mut self,
        now: Instant,
        plan: Plan,
        shape: &Shape,
        config: &Supervision,
    ) -> (Demand, Option<Instant>) {
        self.at = now;
        self.idle_rpm = shape.idle_rpm.or(self.idle_rpm);
        self.max_rpm = shape.max_rpm.or(self.max_rpm);
        let shape = &Shape { idle_rpm: self.idle_rpm, ..*shape };
        let before = core::mem::replace(&mut self.reduced_to, shape.reduced_to);
        if before.is_some_and(|before| shape.reduced_to.is_none_or(|now| now > before)) {
            self.rising = true;
        }
        // A demand held in doubt must not jump when the life is confirmed, nor one when the transmitter works again.
        self.rising |= shape.running && !(shape.living && shape.transmits);
        let (target, rates) = self.target(now, plan, shape, config);
        let (target, rates) =
            if shape.running { (target, rates) } else { (idle(target, shape), Rates::AT_ONCE) };
        let within = self.moving.within_maximum(target, shape);
        // A demand that was held must not jump when the maximum is known.
        self.rising |= within != target;
        let full = self.max_rpm.map_or(NOMINAL_MAX_RPM, Rpm::get);
        let next = self.moving.follow(now, within, rates, shape, full);
        let demand = self.moving.demand();
        let (Demand::Rpm(rpm), true, Some(settings)) = (demand, shape.governed, config.governor) else {
            self.governor = None;
            self.doubted &= !shape.living;
            self.waits = false;
            return (demand, next);
        };
        let (throttle, look_again) = self.govern(now, rpm, shape, &settings);
        (Demand::Throttle(throttle), earlier(next, look_again))
    }

    /// What the demand moves to, and the rates of that.
    fn target(&mut self, now: Instant, plan: Plan, shape: &Shape, config: &Supervision) -> (Demand, Rates) {
        // The reduction for a failed engine is at least as fast as a fail-safe.
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
        match plan {
            // The reduction for a failed engine does not wait for a take-over.
            Plan::Hold(commanded)
                if shape.reduced_to.is_some()
                    && reduced(commanded, shape.reduced_to).is_below(self.moving.demand()) =>
            {
                (reduced(commanded, shape.reduced_to), slew)
            }
            Plan::Hold(_) => (self.moving.demand(), Rates::AT_ONCE),
            // In doubt a demand may fall but not rise. A throttle cannot replace an rpm then; the idle rpm can.
            Plan::To(Demand::Throttle(_))
                if shape.running
                    && !shape.living
                    && matches!(self.moving, Moving::Rpm(_))
                    && !shape.governed =>
            {
                match (self.moving.demand(), shape.idle_rpm) {
                    (Demand::Rpm(now_at), Some(idle)) => (Demand::Rpm(idle.min(now_at)), slew),
                    (now_at, _) => (now_at, slew),
                }
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
                // The first of its kind has to be sent: until then the ECU has another. A governor sends throttles for an rpm.
                let first = !shape.governed && discriminant(&target) != discriminant(&shape.sent);
                let moves = first || self.moving.demand() != target;
                self.rising &= !shape.running || !shape.received || !shape.transmits || moves;
                (target, slew)
            }
            Plan::FailSafe { commanded, in_control } => {
                let safe = self.fail_safe(now, commanded, shape, config);
                let most = reduced(commanded, shape.reduced_to);
                let ramp = u32::from(config.loss.ramp);
                if (in_control || shape.reduced_to.is_some()) && most.is_below(self.moving.demand()) {
                    // A lower demand of the source in control is obeyed, and so is a reduction without one: above the fail-safe by
                    // the faster of the two rates.
                    let above = safe.is_below(self.moving.demand());
                    let down = slew.down.map(|down| if above { down.max(ramp) } else { down });
                    (most, Rates { up: None, down })
                } else {
                    (safe, Rates { up: None, down: Some(ramp) })
                }
            }
        }
    }

    /// The throttle that brings the engine to this speed, and when to look at it again.
    fn govern(
        &mut self,
        now: Instant,
        rpm: Rpm,
        shape: &Shape,
        settings: &GovernorSettings,
    ) -> (Throttle, Option<Instant>) {
        self.waits = false;
        if !shape.running {
            self.governor = None;
            return (Throttle::IDLE, None);
        }
        let unknown = shape.rpm.is_none() || self.governed.is_none() && shape.throttle.is_none();
        if !shape.living || self.doubted && unknown {
            // In doubt the governor neither controls nor winds up, and holds no throttle on old telemetry.
            self.governor = None;
            self.doubted = true;
            let old_at = self.telemetry_is_old_at(now, shape, settings).filter(|at| *at > now);
            if old_at.is_none() {
                self.governed = None;
            } else if shape.rpm.is_none()
                && let Some(reported) = shape.throttle
            {
                // Two sets have to agree on more.
                self.governed = Some(self.governed.map_or(reported, |held| held.min(reported)));
            }
            let held = self.governed.or(shape.throttle).filter(|_| old_at.is_some());
            self.waits = shape.living && held.is_none() && old_at.is_some();
            return (held.unwrap_or(Throttle::IDLE), old_at);
        }
        self.incomplete_since = None;
        // The throttle in force is the one that was sent, or a lower one that is being sent. After a doubt, and after an rpm, it is the
        // one that the ECU reports.
        let from = match (shape.sent, shape.in_transit) {
            (Demand::Throttle(sent), next) if !core::mem::take(&mut self.doubted) => match next {
                Some(Demand::Throttle(next)) => sent.min(next),
                _ => sent,
            },
            _ => shape.throttle.unwrap_or(Throttle::IDLE),
        };
        let governor = self.governor.get_or_insert_with(|| Governor::new(now, from));
        let (throttle, look_again) = governor.throttle(now, settings, rpm, shape.rpm);
        self.governed = Some(throttle);
        (throttle, Some(look_again).filter(|at| *at > now))
    }

    /// When the telemetry on which a governor holds its throttle is too old.
    fn telemetry_is_old_at(
        &mut self,
        now: Instant,
        shape: &Shape,
        settings: &GovernorSettings,
    ) -> Option<Instant> {
        match shape.rpm {
            // Between the reports of a living engine.
            Some(rpm) if !shape.living || self.governed.or(shape.throttle).is_some() => {
                Some(rpm.at + settings.max_age)
            }
            _ if shape.living || shape.throttle.is_some() => {
                Some(*self.incomplete_since.get_or_insert(now) + INCOMPLETE_MAX)
            }
            _ => None,
        }
    }

    /// Target of the fail-safe. It only ever lowers the demand.
    fn fail_safe(&mut self, now: Instant, commanded: Demand, shape: &Shape, config: &Supervision) -> Demand {
        let safe = match commanded {
            Demand::Throttle(_) => config.loss.throttle,
            // An rpm does not compare with a throttle other than idle.
            Demand::Rpm(_) => Throttle::IDLE,
        };
        match (self.moving.demand(), shape.idle_rpm) {
            (Demand::Throttle(throttle), _) => Demand::Throttle(throttle.min(safe)),
            (Demand::Rpm(rpm), Some(idle)) if !shape.governed => Demand::Rpm(rpm.min(idle)),
            (Demand::Rpm(_), _) => {
                // Begin at the governor's throttle. Without a governor neither throttle nor idle rpm is known.
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

    #[inline(never)]
    fn demand(&self) -> Demand {
        match self {
            Self::Throttle(ramp) => {
                let tenths = u16::try_from(ramp.value()).unwrap_or(u16::MAX);
                Demand::Throttle(Throttle::from_tenths(tenths).unwrap_or(Throttle::FULL))
            }
            Self::Rpm(ramp) => Demand::Rpm(Rpm::new(ramp.value())),
        }
    }

    /// The maximum of an ECU with its own speed control. While it has not reported it, or not again after its link was lost, an
    /// rpm does not rise: it could not be clamped.
    fn within_maximum(&self, target: Demand, shape: &Shape) -> Demand {
        match target {
            Demand::Rpm(rpm) if !shape.governed => {
                let highest = match (shape.max_rpm, self) {
                    (Some(max), _) => max,
                    (None, Self::Rpm(ramp)) => Rpm::new(ramp.value()),
                    (None, Self::Throttle(_)) => {
                        shape.rpm.map(|rpm| rpm.value).or(shape.idle_rpm).unwrap_or(Rpm::new(0))
                    }
                };
                Demand::Rpm(rpm.min(highest))
            }
            target => target,
        }
    }

    /// Moves towards a demand. `full`: 100 % of an rpm, for its rates.
    fn follow(
        &mut self,
        now: Instant,
        target: Demand,
        rates: Rates,
        shape: &Shape,
        full: u32,
    ) -> Option<Instant> {
        match (&mut *self, target) {
            (Self::Throttle(ramp), Demand::Throttle(throttle)) => {
                ramp.follow(now, throttle.tenths().into(), rates)
            }
            (Self::Rpm(ramp), Demand::Rpm(rpm)) => {
                let share = |rate: Option<u32>| rate.map(|rate| rate.saturating_mul(full / 1000));
                ramp.follow(now, rpm.get(), Rates { up: share(rates.up), down: share(rates.down) })
            }
            // The two kinds of demand do not compare. With a slew the new one rises from what the ECU has, and never begins
            // above the commanded one: the demand that was sent if that is of this kind, otherwise the ECU's reported value.
            (moving, target) => {
                let from = match (target, shape.sent) {
                    _ if rates.up.is_none() => target,
                    (Demand::Throttle(commanded), Demand::Throttle(sent)) => {
                        Demand::Throttle(commanded.min(sent))
                    }
                    (Demand::Rpm(commanded), Demand::Rpm(sent)) => Demand::Rpm(commanded.min(sent)),
                    (Demand::Throttle(commanded), Demand::Rpm(_)) => {
                        Demand::Throttle(commanded.min(shape.throttle.unwrap_or(Throttle::IDLE)))
                    }
                    (Demand::Rpm(commanded), Demand::Throttle(_)) => {
                        let idle = shape.idle_rpm.unwrap_or(Rpm::new(0));
                        Demand::Rpm(commanded.min(shape.rpm.map_or(idle, |now| now.value)))
                    }
                };
                *moving = Self::new(now, from);
                if from == target { None } else { moving.follow(now, target, rates, shape, full) }
            }
        }
    }
}

/// Longest time for which a lower demand that an ECU does not follow explains a fall. Most cuts are shorter; an ECU that never follows
/// must not hide a flame-out.
const FOLLOWS_WITHIN: Duration = Duration::from_secs(15);

/// Noise of a stick, 2 %, in per mille of the full range: smaller falls do not count.
const LOWERED_BY: u32 = 20;

/// Detects a demand lowered by more than the noise of a stick.
#[derive(Clone, Copy, Debug)]
pub(super) struct Lowered {
    /// The highest that the ECU may have been sent last.
    from: Demand,
    at: Instant,
    /// The ECU was last known not to have followed it then.
    open_at: Instant,
    falls_until: Option<Instant>,
}

impl Lowered {
    /// A demand that was lowered before it: a fall of the exhaust is expected for that long.
    pub fn new(now: Instant, demand: Demand, fall_expected: Duration) -> Self {
        Self { from: demand, at: now, open_at: now, falls_until: now.checked_add(fall_expected) }
    }

    /// The same, where it may not have gone out yet: until it does, the ECU may have any higher one.
    pub fn unsent(now: Instant, demand: Demand, fall_expected: Duration) -> Self {
        let highest = match demand {
            Demand::Throttle(_) => Demand::Throttle(Throttle::FULL),
            Demand::Rpm(_) => Demand::Rpm(Rpm::new(u32::MAX)),
        };
        Self::new(now, highest, fall_expected)
    }

    /// When the demand was lowered, or was last known not to have reached the ECU.
    pub const fn open_at(&self) -> Instant {
        self.open_at
    }

    /// The ECU reports more than it was ordered: its shaft and its exhaust have yet to fall.
    pub fn not_followed(&mut self, now: Instant) {
        if now < self.at + FOLLOWS_WITHIN {
            self.open_at = now;
            self.falls_until = now.checked_add(FALL_EXPECTED);
        }
    }

    /// Time for which a fall of the exhaust is expected yet.
    pub fn fall_expected(&self, now: Instant) -> Duration {
        self.falls_until.map_or(Duration::from_ticks(0), |until| until.saturating_duration_since(now))
    }

    /// `goes_out`: it goes to the ECU. In doubt it may not: a demand that is lowered then is a lowering until it does, and from then on.
    /// `sent`: the last one that the ECU was sent. One that was never sent is lowered by nothing.
    pub fn observe(&mut self, now: Instant, demand: Demand, goes_out: bool, sent: Demand) {
        if self.from.is_below(sent) {
            self.from = sent;
        }
        let (value, from, band) = match (demand, self.from) {
            (Demand::Throttle(demand), Demand::Throttle(from)) => {
                (demand.tenths().into(), from.tenths().into(), LOWERED_BY)
            }
            (Demand::Rpm(demand), Demand::Rpm(from)) => {
                (demand.get(), from.get(), NOMINAL_MAX_RPM / 1000 * LOWERED_BY)
            }
            // Two kinds do not compare, so a change counts as a lowering.
            _ => (0, u32::MAX, 0),
        };
        if from.saturating_sub(value) > band {
            *self = Self::new(now, if goes_out { demand } else { self.from }, FALL_EXPECTED);
        }
    }
}

#[inline(never)]
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
