//! Limits: what an engine may not do, found in its telemetry.
//!
//! A limit counts as passed when two values in a row are beyond it. AMT frames carry no checksum, and one odd frame
//! must raise nothing. It is told once, and again only after a value was within it.

use super::config::{Action, Limits};
use crate::telemetry::{Phase, Report, Timed};
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

/// What was watched.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[cfg_attr(target_os = "none", derive(defmt::Format))]
pub enum Watched {
    /// Shaft speed above its limit, in rpm.
    OverSpeed,
    /// Exhaust temperature above its limit, in 0.1 °C.
    OverTemperature,
    /// Shaft speed below its limit while running, in rpm.
    LowRpm,
    /// Exhaust temperature rises too fast during a start, in °C a second.
    HotStart,
    /// Shaft speed lost within 2 s without a lower demand, in percent.
    FlameOut,
    /// Supply voltage below its limit, in mV.
    SupplyLow,
    /// Shaft speed changed faster than any turbine can, in rpm a second.
    Implausible,
    /// The ECU reports a fault; the value is its number.
    EcuFault,
    /// The start took too long, in ms.
    StartTimeout,
}

/// A limit that was passed.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[cfg_attr(target_os = "none", derive(defmt::Format))]
pub struct Passed {
    /// Which.
    pub what: Watched,
    /// The value, in the unit named at [`Watched`].
    pub value: i32,
    /// The limit, in the same unit.
    pub limit: i32,
    /// When.
    pub at: Instant,
}

/// One limit's memory.
#[derive(Clone, Copy, Debug, Default)]
struct Twice {
    beyond: u8,
}

impl Twice {
    /// True once, when the second value in a row is beyond.
    fn see(&mut self, beyond: bool) -> bool {
        self.beyond = if beyond { self.beyond.saturating_add(1).min(3) } else { 0 };
        self.beyond == 2
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
pub(super) struct Watch {
    limits: Limits,
    over_speed: Twice,
    over_temperature: Twice,
    low_rpm: Twice,
    hot_start: Twice,
    flame_out: Twice,
    supply_low: Twice,
    implausible: Twice,
    fault: Option<u8>,
    /// The same as in the last report, and when that came.
    fault_before: Option<u8>,
    fault_seen: Option<Instant>,
    rpm_seen: Option<Instant>,
    egt_seen: Option<Instant>,
    supply_seen: Option<Instant>,
    /// The last shaft speed that a turbine can have.
    plausible: Option<Timed<Rpm>>,
    /// The last values, and of the last two the one that makes less of a loss of speed or a rise of temperature: a
    /// single odd frame stays out of the history.
    rpm_last: Option<Rpm>,
    rpm_kept: Option<Rpm>,
    egt_last: Option<Celsius>,
    egt_kept: Option<Celsius>,
    history: Deque<Sample, 12>,
    found: Deque<(Passed, Action), 9>,
}

impl Watch {
    pub const fn new(limits: Limits) -> Self {
        const NEVER: Twice = Twice { beyond: 0 };
        Self {
            limits,
            over_speed: NEVER,
            over_temperature: NEVER,
            low_rpm: NEVER,
            hot_start: NEVER,
            flame_out: NEVER,
            supply_low: NEVER,
            implausible: NEVER,
            fault: None,
            fault_before: None,
            fault_seen: None,
            rpm_seen: None,
            egt_seen: None,
            supply_seen: None,
            plausible: None,
            rpm_last: None,
            rpm_kept: None,
            egt_last: None,
            egt_kept: None,
            history: Deque::new(),
            found: Deque::new(),
        }
    }

    /// What was found since the last call, first found first.
    pub fn found(&mut self) -> Option<(Passed, Action)> {
        self.found.pop_front()
    }

    /// Looks at what the ECU has said. `lowered`: when the demand was last lowered, or the engine not to run.
    pub fn see(&mut self, now: Instant, report: &Report, lowered: Instant) {
        let phase = report.phase.map(|phase| phase.value);
        if let Some(rpm) = report.rpm.filter(|rpm| self.rpm_seen != Some(rpm.at)) {
            self.rpm_seen = Some(rpm.at);
            self.see_rpm(now, report, rpm, phase, lowered);
            self.rpm_kept = Some(self.rpm_last.map_or(rpm.value, |last| last.min(rpm.value)));
            self.rpm_last = Some(rpm.value);
        }
        if let Some(egt) = report.egt.filter(|egt| self.egt_seen != Some(egt.at)) {
            self.egt_seen = Some(egt.at);
            self.see_egt(now, egt, phase);
            self.egt_kept = Some(self.egt_last.map_or(egt.value, |last| last.max(egt.value)));
            self.egt_last = Some(egt.value);
        }
        if let Some(supply) = report.supply.filter(|supply| self.supply_seen != Some(supply.at)) {
            self.supply_seen = Some(supply.at);
            if let (Some(limit), Some(voltage)) = (self.limits.supply_low.at, supply.value.voltage)
                && self.supply_low.see(voltage < limit)
            {
                self.tell(now, Watched::SupplyLow, voltage.get(), limit.get(), self.limits.supply_low.action);
            }
        }
        if let Some(faults) = report.faults.filter(|faults| self.fault_seen != Some(faults.at)) {
            self.fault_seen = Some(faults.at);
            let fault = (!faults.value.is_empty()).then(|| faults.value.number());
            let agreed = core::mem::replace(&mut self.fault_before, fault) == fault;
            if agreed
                && core::mem::replace(&mut self.fault, fault) != fault
                && let Some(number) = fault
            {
                self.tell(now, Watched::EcuFault, u32::from(number), 0, self.limits.ecu_fault);
            }
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
            let before = self.plausible.unwrap_or(rpm);
            // Frames that were read late come close together.
            let passed = rpm.at.saturating_duration_since(before.at).max(CHANGE_OVER).as_micros();
            let change = u64::from(value.abs_diff(before.value.get())) * 1_000_000 / passed;
            let change = u32::try_from(change).unwrap_or(u32::MAX);
            if self.implausible.see(change > limit) {
                self.tell(now, Watched::Implausible, change, limit, self.limits.implausible.action);
            }
            if change <= limit || self.implausible.beyond > 1 {
                self.plausible = Some(rpm);
            }
        }

        // Where no limit is set, the engine's own figures serve.
        let told_max = report.max_rpm.map(|max| max.value.get() / 100 * 105);
        if let Some(limit) = self.limits.over_speed.at.map(Rpm::get).or(told_max)
            && self.over_speed.see(value > limit)
        {
            self.tell(now, Watched::OverSpeed, value, limit, self.limits.over_speed.action);
        }
        let told_idle = report.idle_rpm.map(|idle| idle.value.get() / 100 * 80);
        if let Some(limit) = self.limits.low_rpm.at.map(Rpm::get).or(told_idle)
            && self.low_rpm.see(phase == Some(Phase::Running) && value < limit)
        {
            self.tell(now, Watched::LowRpm, value, limit, self.limits.low_rpm.action);
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
            if self.flame_out.see(beyond) {
                self.tell(now, Watched::FlameOut, lost, u32::from(limit), self.limits.flame_out.action);
            }
        }
    }

    fn see_egt(&mut self, now: Instant, egt: Timed<Celsius>, phase: Option<Phase>) {
        let value = egt.value.tenths();
        if let Some(limit) = self.limits.over_temperature.at
            && self.over_temperature.see(egt.value > limit)
        {
            self.push(
                now,
                Watched::OverTemperature,
                value.into(),
                limit.tenths().into(),
                self.limits.over_temperature.action,
            );
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
            if self.hot_start.see(beyond) {
                let rise = i32::try_from(rise).unwrap_or(i32::MAX);
                self.push(now, Watched::HotStart, rise, limit.into(), self.limits.hot_start.action);
            }
        }
    }

    fn sample(&mut self, now: Instant) {
        if self.history.back().is_some_and(|last| now < last.at + SAMPLE) {
            return;
        }
        if self.history.is_full() {
            self.history.pop_front();
        }
        let sample = Sample { at: now, rpm: self.rpm_kept, egt: self.egt_kept };
        let _ = self.history.push_back(sample);
    }

    fn tell(&mut self, now: Instant, what: Watched, value: u32, limit: u32, action: Action) {
        let value = i32::try_from(value).unwrap_or(i32::MAX);
        self.push(now, what, value, i32::try_from(limit).unwrap_or(i32::MAX), action);
    }

    fn push(&mut self, now: Instant, what: Watched, value: i32, limit: i32, action: Action) {
        // There is room for each limit once, and whoever watches takes them out after every look.
        let _ = self.found.push_back((Passed { what, value, limit, at: now }, action));
    }
}
