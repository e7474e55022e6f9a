//! Limits: what an engine may not do, found in its telemetry.
//!
//! A limit counts as passed when two values in a row are beyond it. AMT frames carry no checksum, and one odd frame
//! must raise nothing. It is told once, and again only after a value was within it. What is done about it holds for as
//! long as it is passed.

use super::config::Limits;
use crate::limit::Action;
use crate::limit::{LimitKind, LimitViolation};
use crate::report::{Phase, Report, Timed};
use crate::units::{Celsius, Rpm};
use embassy_time::{Duration, Instant};
use heapless::Deque;

/// A loss of shaft speed is judged over this time.
const FLAME_OUT_OVER: Duration = Duration::from_secs(2);
/// For so long after the demand was lowered, a falling shaft speed is what was asked for.
const SPOOL_DOWN: Duration = Duration::from_secs(6);
/// A rise of temperature is judged over at least this time.
const RISE_OVER: Duration = Duration::from_millis(500);
/// A change of shaft speed is judged over at least this time.
const CHANGE_OVER: Duration = Duration::from_millis(20);
/// Between two samples that are kept.
const SAMPLE: Duration = Duration::from_millis(240);

/// One limit's memory.
#[derive(Clone, Copy, Debug)]
struct Consecutive {
    /// Values in a row that were beyond.
    beyond: u8,
    /// It is passed.
    passed: Option<(LimitViolation, Action)>,
}

impl Consecutive {
    const NEVER: Self = Self { beyond: 0, passed: None };

    /// A value beyond the limit, with what is to be told, or one within. Gives what is to be told, once: with the second
    /// value in a row.
    fn see(&mut self, beyond: Option<LimitViolation>, action: Action) -> Option<LimitViolation> {
        self.beyond = if beyond.is_some() { self.beyond.saturating_add(1).min(3) } else { 0 };
        match beyond {
            None => self.passed = None,
            Some(passed) if self.beyond == 2 => self.passed = Some((passed, action)),
            Some(_) => {}
        }
        beyond.filter(|_| self.beyond == 2)
    }
}

#[derive(Clone, Copy, Debug)]
struct Sample {
    at: Instant,
    rpm: Option<Rpm>,
    egt: Option<Celsius>,
}

/// Watches one engine.
#[derive(Clone, Debug)]
pub(super) struct LimitMonitor {
    limits: Limits,
    over_speed: Consecutive,
    over_temperature: Consecutive,
    low_rpm: Consecutive,
    hot_start: Consecutive,
    flame_out: Consecutive,
    supply_low: Consecutive,
    implausible: Consecutive,
    fault: Consecutive,
    /// The fault of the last report, and when that came.
    fault_before: Option<u8>,
    fault_seen: Option<Instant>,
    rpm_seen: Option<Instant>,
    egt_seen: Option<Instant>,
    supply_seen: Option<Instant>,
    /// The last shaft speed that a turbine can have, and the one before it while there is none: two have to agree first.
    plausible: Option<Timed<Rpm>>,
    first_rpm: Option<Timed<Rpm>>,
    /// The last values, and of the last two the one that makes less of a loss of speed or a rise of temperature: a
    /// single odd frame stays out of the history.
    rpm_last: Option<Rpm>,
    rpm_filtered: Option<Rpm>,
    egt_last: Option<Celsius>,
    egt_filtered: Option<Celsius>,
    history: Deque<Sample, 12>,
    found: Deque<LimitViolation, 9>,
}

impl LimitMonitor {
    pub const fn new(limits: Limits) -> Self {
        Self {
            limits,
            over_speed: Consecutive::NEVER,
            over_temperature: Consecutive::NEVER,
            low_rpm: Consecutive::NEVER,
            hot_start: Consecutive::NEVER,
            flame_out: Consecutive::NEVER,
            supply_low: Consecutive::NEVER,
            implausible: Consecutive::NEVER,
            fault: Consecutive::NEVER,
            fault_before: None,
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
            found: Deque::new(),
        }
    }

    /// New limits, for the values that come from now on.
    pub const fn configure(&mut self, limits: Limits) {
        self.limits = limits;
    }

    /// What was found since the last call, first found first.
    pub fn found(&mut self) -> Option<LimitViolation> {
        self.found.pop_front()
    }

    /// The hotter of the last two exhaust temperatures: one odd frame does not make a hot exhaust cool.
    pub const fn hottest(&self) -> Option<Celsius> {
        self.egt_filtered
    }

    /// The limit that is passed now and asks for the most, if one asks for anything.
    pub fn in_force(&self) -> Option<(LimitViolation, Action)> {
        [
            self.over_speed,
            self.over_temperature,
            self.low_rpm,
            self.hot_start,
            self.flame_out,
            self.supply_low,
            self.implausible,
            self.fault,
        ]
        .into_iter()
        .filter_map(|limit| limit.passed)
        .filter(|(_, action)| *action != Action::Report)
        .max_by_key(|(_, action)| *action)
    }

    /// Looks at what the ECU has said. `lowered`: when the demand was last lowered, or the engine not to run.
    pub fn see(&mut self, now: Instant, report: &Report, lowered: Instant) {
        let phase = report.phase.map(|phase| phase.value);
        if let Some(rpm) = report.rpm.filter(|rpm| self.rpm_seen != Some(rpm.at)) {
            self.rpm_seen = Some(rpm.at);
            self.see_rpm(now, report, rpm, phase, lowered);
            self.rpm_filtered = Some(self.rpm_last.map_or(rpm.value, |last| last.min(rpm.value)));
            self.rpm_last = Some(rpm.value);
        }
        if let Some(egt) = report.egt.filter(|egt| self.egt_seen != Some(egt.at)) {
            self.egt_seen = Some(egt.at);
            self.see_egt(now, egt, phase);
            self.egt_filtered = Some(self.egt_last.map_or(egt.value, |last| last.max(egt.value)));
            self.egt_last = Some(egt.value);
        }
        if let Some(supply) = report.supply.filter(|supply| self.supply_seen != Some(supply.at)) {
            self.supply_seen = Some(supply.at);
            if let (Some(limit), Some(voltage)) = (self.limits.supply_low.at, supply.value.voltage) {
                let passed = LimitViolation::new(LimitKind::SupplyLow, voltage.get(), limit.get(), now);
                let told =
                    self.supply_low.see((voltage < limit).then_some(passed), self.limits.supply_low.action);
                self.tell(told);
            }
        }
        if let Some(faults) = report.faults.filter(|faults| self.fault_seen != Some(faults.at)) {
            self.fault_seen = Some(faults.at);
            let fault = (!faults.value.is_empty()).then(|| faults.value.number());
            // Another fault is told anew, if two reports in a row say so.
            if core::mem::replace(&mut self.fault_before, fault) != fault {
                self.fault.beyond = 0;
            }
            let before = self.fault.passed.map(|(passed, _)| passed.value);
            let passed =
                fault.map(|number| LimitViolation::new(LimitKind::EcuFault, u32::from(number), 0, now));
            let told = self.fault.see(passed, self.limits.ecu_fault);
            self.tell(told.filter(|told| before != Some(told.value)));
        }
        self.sample(now);
    }

    fn see_rpm(
        &mut self,
        now: Instant,
        report: &Report,
        rpm: Timed<Rpm>,
        phase: Option<Phase>,
        lowered: Instant,
    ) {
        let value = rpm.value.get();
        if let Some(limit) = self.limits.implausible.at {
            self.see_change(now, rpm, limit);
        }

        // Where no limit is set, the engine's own figures serve.
        let reported_max = report.max_rpm.map(|max| max.value.get() / 100 * 105);
        if let Some(limit) = self.limits.over_speed.at.map(Rpm::get).or(reported_max) {
            let passed = LimitViolation::new(LimitKind::OverSpeed, value, limit, now);
            let told = self.over_speed.see((value > limit).then_some(passed), self.limits.over_speed.action);
            self.tell(told);
        }
        let reported_idle = report.idle_rpm.map(|idle| idle.value.get() / 100 * 80);
        if let Some(limit) = self.limits.low_rpm.at.map(Rpm::get).or(reported_idle) {
            let low = phase == Some(Phase::Running) && value < limit;
            let passed = LimitViolation::new(LimitKind::LowRpm, value, limit, now);
            let told = self.low_rpm.see(low.then_some(passed), self.limits.low_rpm.action);
            self.tell(told);
        }

        if let Some(limit) = self.limits.flame_out.at {
            let highest = self
                .history
                .iter()
                .filter(|sample| sample.at + FLAME_OUT_OVER >= now)
                .filter_map(|sample| sample.rpm)
                .max()
                .unwrap_or(rpm.value);
            let lost = highest.get().saturating_sub(value).saturating_mul(100) / highest.get().max(1);
            let asked_for = now < lowered + SPOOL_DOWN;
            let beyond = phase == Some(Phase::Running) && !asked_for && lost >= u32::from(limit);
            let passed = LimitViolation::new(LimitKind::FlameOut, lost, u32::from(limit), now);
            let told = self.flame_out.see(beyond.then_some(passed), self.limits.flame_out.action);
            self.tell(told);
        }
    }

    /// A change of shaft speed that no turbine can make, in rpm a second.
    fn see_change(&mut self, now: Instant, rpm: Timed<Rpm>, limit: u32) {
        let change = |before: Timed<Rpm>| {
            // Frames that were read late come close together.
            let passed = rpm.at.saturating_duration_since(before.at).max(CHANGE_OVER).as_micros();
            let change = u64::from(rpm.value.get().abs_diff(before.value.get())) * 1_000_000 / passed;
            u32::try_from(change).unwrap_or(u32::MAX)
        };
        let Some(before) = self.plausible else {
            let agree = self.first_rpm.replace(rpm).is_some_and(|first| change(first) <= limit);
            self.plausible = agree.then_some(rpm);
            return;
        };
        let change = change(before);
        let passed = LimitViolation::new(LimitKind::Implausible, change, limit, now);
        let told = self.implausible.see((change > limit).then_some(passed), self.limits.implausible.action);
        self.tell(told);
        if change <= limit || self.implausible.beyond > 1 {
            self.plausible = Some(rpm);
        }
    }

    fn see_egt(&mut self, now: Instant, egt: Timed<Celsius>, phase: Option<Phase>) {
        let value = egt.value.tenths();
        if let Some(limit) = self.limits.over_temperature.at {
            let passed = LimitViolation {
                what: LimitKind::OverTemperature,
                value: value.into(),
                limit: limit.tenths().into(),
                at: now,
            };
            let beyond = (egt.value > limit).then_some(passed);
            let told = self.over_temperature.see(beyond, self.limits.over_temperature.action);
            self.tell(told);
        }
        if let Some(limit) = self.limits.hot_start.at {
            let before = self
                .history
                .iter()
                .rev()
                .find(|sample| sample.at + RISE_OVER <= egt.at && sample.egt.is_some());
            let rise = before.map_or(0, |before| {
                let passed = egt.at.saturating_duration_since(before.at).as_millis().max(1) as i64;
                let tenths = i64::from(value) - i64::from(before.egt.map_or(value, Celsius::tenths));
                tenths * 100 / passed
            });
            let beyond = phase == Some(Phase::Starting) && rise > i64::from(limit);
            let value = i32::try_from(rise).unwrap_or(i32::MAX);
            let passed = LimitViolation { what: LimitKind::HotStart, value, limit: limit.into(), at: now };
            let told = self.hot_start.see(beyond.then_some(passed), self.limits.hot_start.action);
            self.tell(told);
        }
    }

    fn sample(&mut self, now: Instant) {
        if self.history.back().is_some_and(|last| now < last.at + SAMPLE) {
            return;
        }
        if self.history.is_full() {
            self.history.pop_front();
        }
        let sample = Sample { at: now, rpm: self.rpm_filtered, egt: self.egt_filtered };
        let _ = self.history.push_back(sample);
    }

    fn tell(&mut self, passed: Option<LimitViolation>) {
        if let Some(passed) = passed {
            // There is room for each limit once, and whoever watches takes them out after every look.
            let _ = self.found.push_back(passed);
        }
    }
}
