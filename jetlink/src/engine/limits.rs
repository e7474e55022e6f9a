//! Monitors the limits of an engine in its telemetry.
//!
//! A limit is violated when two consecutive values exceed it: AMT frames carry no checksum, and one odd frame must raise
//! nothing. A violation is reported once, and again only after a value within the limit. Its action, as it is set at that time,
//! holds for as long as the limit is violated.

use super::config::Limits;
use crate::consecutive::{AGREEING, Consecutive};
use crate::limit::{Action, LimitKind, LimitViolation};
use crate::report::{Phase, Report, Timed};
use crate::units::{Celsius, Millivolts, Rpm};
use embassy_time::{Duration, Instant};
use heapless::Deque;

/// Time over which a loss of shaft speed is measured.
const FLAME_OUT_OVER: Duration = Duration::from_secs(2);
/// Grace period after a lower demand in which the shaft speed is expected to fall.
const SPOOL_DOWN: Duration = Duration::from_secs(6);
/// Shortest time over which a rise of temperature is measured.
const RISE_OVER: Duration = Duration::from_millis(500);
/// Shortest time over which a change of shaft speed is measured.
const CHANGE_OVER: Duration = Duration::from_millis(20);
/// Shortest time between two samples of the history.
const SAMPLE: Duration = Duration::from_millis(240);

/// State of one limit.
#[derive(Clone, Copy, Debug)]
struct LimitState {
    /// Consecutive values beyond the limit.
    beyond: Consecutive,
    violated: bool,
}

impl LimitState {
    const WITHIN: Self = Self { beyond: Consecutive::NONE, violated: false };

    /// Takes the violation by one value; `None`: it is within the limit, or there is no limit. `found` gets the violation once, at the
    /// second consecutive value. Not inlined: every limit calls it.
    #[inline(never)]
    fn observe(&mut self, violation: Option<LimitViolation>, found: &mut dyn FnMut(LimitViolation)) {
        let Some(violation) = violation else {
            *self = Self::WITHIN;
            return;
        };
        self.beyond.count(true);
        if self.beyond.is(AGREEING) {
            self.violated = true;
            found(violation);
        }
    }
}

#[derive(Clone, Copy, Debug)]
struct Sample {
    at: Instant,
    rpm: Option<Rpm>,
    egt: Option<Celsius>,
}

/// Monitors the limits of one engine.
#[derive(Clone, Debug)]
pub(super) struct LimitMonitor {
    over_speed: LimitState,
    over_temperature: LimitState,
    low_rpm: LimitState,
    hot_start: LimitState,
    flame_out: LimitState,
    supply_low: LimitState,
    implausible: LimitState,
    fault: LimitState,
    /// Fault of the last report, and its time.
    fault_before: Option<u8>,
    /// Fault of the last violation.
    fault_reported: i32,
    fault_seen: Option<Instant>,
    rpm_seen: Option<Instant>,
    egt_seen: Option<Instant>,
    supply_seen: Option<Instant>,
    /// Last plausible shaft speed, and the first candidate for one: two have to agree first.
    plausible: Option<Timed<Rpm>>,
    first_rpm: Option<Timed<Rpm>>,
    /// Last values, and of the last two the lower speed and the higher temperature: a single odd frame stays out of the
    /// history.
    rpm_last: Option<Rpm>,
    rpm_filtered: Option<Rpm>,
    egt_last: Option<Celsius>,
    egt_filtered: Option<Celsius>,
    history: Deque<Sample, 12>,
}

impl LimitMonitor {
    pub const fn new() -> Self {
        Self {
            over_speed: LimitState::WITHIN,
            over_temperature: LimitState::WITHIN,
            low_rpm: LimitState::WITHIN,
            hot_start: LimitState::WITHIN,
            flame_out: LimitState::WITHIN,
            supply_low: LimitState::WITHIN,
            implausible: LimitState::WITHIN,
            fault: LimitState::WITHIN,
            fault_before: None,
            fault_reported: 0,
            fault_seen: None,
            rpm_seen: None,
            egt_seen: None,
            supply_seen: None,
            plausible: None,
            first_rpm: None,
            rpm_last: None,
            rpm_filtered: None,
            egt_last: None,
            egt_filtered: None,
            history: Deque::new(),
        }
    }

    /// Discards the shaft speeds from before a gap in reception: over its length any speed is plausible, also an odd one.
    pub const fn gap(&mut self) {
        (self.plausible, self.first_rpm) = (None, None);
        self.implausible = LimitState::WITHIN;
    }

    /// The hotter of the last two exhaust temperatures, so that one odd frame does not make a hot exhaust cool.
    pub const fn hottest(&self) -> Option<Celsius> {
        self.egt_filtered
    }

    /// The violated limit with the strongest action, if one has an action beyond a report.
    pub fn in_force(&self, limits: &Limits) -> Option<(LimitKind, Action)> {
        [
            (&self.over_speed, LimitKind::OverSpeed, limits.over_speed.action),
            (&self.over_temperature, LimitKind::OverTemperature, limits.over_temperature.action),
            (&self.low_rpm, LimitKind::LowRpm, limits.low_rpm.action),
            (&self.hot_start, LimitKind::HotStart, limits.hot_start.action),
            (&self.flame_out, LimitKind::FlameOut, limits.flame_out.action),
            (&self.supply_low, LimitKind::SupplyLow, limits.supply_low.action),
            (&self.implausible, LimitKind::Implausible, limits.implausible.action),
            (&self.fault, LimitKind::EcuFault, limits.ecu_fault),
        ]
        .into_iter()
        .filter(|(limit, _, action)| limit.violated && *action != Action::Report)
        .map(|(_, kind, action)| (kind, action))
        .max_by_key(|(_, action)| *action)
    }

    /// Checks new values in the ECU's report, and of the supply. `lowered`: when the demand was last lowered; `now` without an
    /// order to run. `found` gets each violation that is confirmed.
    pub fn observe(
        &mut self,
        limits: &Limits,
        now: Instant,
        report: &Report,
        supply: Option<Timed<Millivolts>>,
        lowered: Instant,
        found: &mut dyn FnMut(LimitViolation),
    ) {
        let phase = report.phase.map(|phase| phase.value);
        if let Some(rpm) = report.rpm.filter(|rpm| self.rpm_seen != Some(rpm.at)) {
            self.rpm_seen = Some(rpm.at);
            self.observe_rpm(limits, now, report, rpm, (phase, lowered), found);
            self.rpm_filtered = Some(self.rpm_last.map_or(rpm.value, |last| last.min(rpm.value)));
            self.rpm_last = Some(rpm.value);
        }
        if let Some(egt) = report.egt.filter(|egt| self.egt_seen != Some(egt.at)) {
            self.egt_seen = Some(egt.at);
            self.observe_egt(limits, egt, phase, found);
            self.egt_filtered = Some(self.egt_last.map_or(egt.value, |last| last.max(egt.value)));
            self.egt_last = Some(egt.value);
        }
        if let Some(supply) = supply.filter(|supply| self.supply_seen != Some(supply.at)) {
            self.supply_seen = Some(supply.at);
            let voltage = supply.value;
            let limit = limits.supply_low.at.filter(|limit| voltage < *limit);
            let low =
                limit.map(|limit| LimitViolation::new(LimitKind::SupplyLow, voltage.get(), limit.get()));
            self.supply_low.observe(low, found);
        }
        if let Some(faults) = report.faults.filter(|faults| self.fault_seen != Some(faults.at)) {
            self.fault_seen = Some(faults.at);
            let fault = (!faults.value.is_empty()).then(|| faults.value.number());
            // A different fault is reported again, after two consecutive reports of it.
            if core::mem::replace(&mut self.fault_before, fault) != fault {
                self.fault.beyond.reset();
            }
            let before = self.fault.violated.then_some(self.fault_reported);
            let fault = fault.map(|number| LimitViolation::new(LimitKind::EcuFault, number.into(), 0));
            let reported = &mut self.fault_reported;
            self.fault.observe(fault, &mut |confirmed| {
                *reported = confirmed.value;
                if before != Some(confirmed.value) {
                    found(confirmed);
                }
            });
        }
        self.sample(now);
    }

    fn observe_rpm(
        &mut self,
        limits: &Limits,
        now: Instant,
        report: &Report,
        rpm: Timed<Rpm>,
        (phase, lowered): (Option<Phase>, Instant),
        found: &mut dyn FnMut(LimitViolation),
    ) {
        let value = rpm.value.get();
        if let Some(limit) = limits.implausible.at {
            self.check_change(rpm, limit, found);
        } else {
            self.implausible = LimitState::WITHIN;
        }

        // Without a configured limit the ECU's own figures apply. A maximum of 0 is not a limit.
        let reported_max = report.max_rpm.map(|max| max.value.get() / 100 * 105).filter(|max| *max > 0);
        let max = limits.over_speed.at.map(Rpm::get).or(reported_max).filter(|max| value > *max);
        let high = max.map(|max| LimitViolation::new(LimitKind::OverSpeed, value, max));
        self.over_speed.observe(high, found);
        let reported_idle = report.idle_rpm.map(|idle| idle.value.get() / 100 * 80);
        // `lowered` is `now` while no run is in force: after standby the ECU may still report a running engine.
        let runs = phase == Some(Phase::Running) && lowered < now;
        let min = limits.low_rpm.at.map(Rpm::get).or(reported_idle).filter(|min| runs && value < *min);
        let low = min.map(|min| LimitViolation::new(LimitKind::LowRpm, value, min));
        self.low_rpm.observe(low, found);

        let out = limits.flame_out.at.and_then(|limit| {
            let highest = self
                .history
                .iter()
                .filter(|sample| sample.at + FLAME_OUT_OVER >= now)
                .filter_map(|sample| sample.rpm)
                .max()
                .unwrap_or(rpm.value);
            let lost = highest.get().saturating_sub(value).saturating_mul(100) / highest.get().max(1);
            let commanded = now < lowered + SPOOL_DOWN;
            let beyond = phase == Some(Phase::Running) && !commanded && lost >= u32::from(limit);
            beyond.then(|| LimitViolation::new(LimitKind::FlameOut, lost, u32::from(limit)))
        });
        self.flame_out.observe(out, found);
    }

    /// Checks for a change of shaft speed, in rpm/s, that no turbine can make.
    fn check_change(&mut self, rpm: Timed<Rpm>, limit: u32, found: &mut dyn FnMut(LimitViolation)) {
        let change = |before: Timed<Rpm>| {
            // Frames that were read late have close timestamps.
            let elapsed = rpm.at.saturating_duration_since(before.at).max(CHANGE_OVER).as_micros();
            let change = u64::from(rpm.value.get().abs_diff(before.value.get())) * 1_000_000 / elapsed;
            u32::try_from(change).unwrap_or(u32::MAX)
        };
        let Some(before) = self.plausible else {
            let agree = self.first_rpm.replace(rpm).is_some_and(|first| change(first) <= limit);
            self.plausible = agree.then_some(rpm);
            return;
        };
        let change = change(before);
        let beyond = change > limit;
        let beyond = beyond.then(|| LimitViolation::new(LimitKind::Implausible, change, limit));
        self.implausible.observe(beyond, found);
        if change <= limit || self.implausible.beyond.reached(AGREEING) {
            self.plausible = Some(rpm);
        }
    }

    fn observe_egt(
        &mut self,
        limits: &Limits,
        egt: Timed<Celsius>,
        phase: Option<Phase>,
        found: &mut dyn FnMut(LimitViolation),
    ) {
        let value = egt.value.tenths();
        let violation = |kind, value, limit| LimitViolation { kind, value, limit };
        let max = limits.over_temperature.at.filter(|max| egt.value > *max);
        let hot = max.map(|max| violation(LimitKind::OverTemperature, value.into(), max.tenths().into()));
        self.over_temperature.observe(hot, found);
        let rises = limits.hot_start.at.and_then(|limit| {
            let before = self
                .history
                .iter()
                .rev()
                .find(|sample| sample.at + RISE_OVER <= egt.at && sample.egt.is_some());
            let rise = before.map_or(0, |before| {
                let elapsed = egt.at.saturating_duration_since(before.at).as_millis().max(1) as i64;
                let tenths = i64::from(value) - i64::from(before.egt.map_or(value, Celsius::tenths));
                tenths * 100 / elapsed
            });
            let beyond = phase == Some(Phase::Starting) && rise > i64::from(limit);
            let value = i32::try_from(rise).unwrap_or(i32::MAX);
            beyond.then(|| violation(LimitKind::HotStart, value, limit.into()))
        });
        self.hot_start.observe(rises, found);
    }

    fn sample(&mut self, now: Instant) {
        if self.history.back().is_some_and(|last| now < last.at + SAMPLE) {
            return;
        }
        if self.history.is_full() {
            self.history.pop_front();
        }
        // Among error sets no shaft speed comes, nor in a gap or in damaged frames: an old one must not count as lost later.
        let since = self.history.back().map(|last| last.at).max(now.checked_sub(SAMPLE));
        let rpm = self.rpm_filtered.filter(|_| self.rpm_seen > since);
        let sample = Sample { at: now, rpm, egt: self.egt_filtered };
        let _ = self.history.push_back(sample);
    }
}
