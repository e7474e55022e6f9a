//! Reports of an engine as messages: `HEARTBEAT`, `EFI_STATUS` and named values.
//!
//! `EFI_STATUS` has the fields of ArduPilot's own turbine driver. No field is ever NaN, and fields that a receiver casts to 8
//! bits are clamped: 0 means "not known" there.

use crate::dialect::{EFI_STATUS_DATA, HEARTBEAT_DATA};
use crate::ids::{AUTOPILOT_INVALID, MODE_CUSTOM, SystemStatus, TYPE_GENERIC};
use embassy_time::{Duration, Instant};
use jetlink::command::{Demand, Order};
use jetlink::engine::state::EngineState;
use jetlink::report::{Counters, LinkState};
use jetlink::telemetry::Telemetry;

/// Lowest byte of `custom_mode` of an engine.
pub const fn state_number(state: EngineState) -> u8 {
    state.number()
}

/// Bits of `custom_mode` of an engine, above its state.
pub mod flag {
    /// The engine is armed.
    pub const ARMED: u32 = 1 << 8;
    /// The switch of MAVLink is at run.
    pub const SWITCH_AT_RUN: u32 = 1 << 9;
    /// An emergency stop is latched.
    pub const STOP_LATCHED: u32 = 1 << 10;
    /// It is unclear whether the engine runs.
    pub const IN_DOUBT: u32 = 1 << 11;
    /// A limit holds the demand at the fail-safe throttle.
    pub const LIMITED: u32 = 1 << 12;
    /// The ECU does not obey.
    pub const NOT_OBEYED: u32 = 1 << 13;
    /// The engine ran, and stopped without a command.
    pub const FAILED: u32 = 1 << 14;
    /// First bit of the stage of loss, 0 to 3.
    pub const LOSS_SHIFT: u32 = 16;
}

/// The heartbeat of an engine.
pub(crate) fn heartbeat(telemetry: &Telemetry, at_run: bool) -> HEARTBEAT_DATA {
    let bit = |set: bool, flag: u32| if set { flag } else { 0 };
    let custom_mode = u32::from(state_number(telemetry.state))
        | bit(telemetry.armed, flag::ARMED)
        | bit(at_run, flag::SWITCH_AT_RUN)
        | bit(telemetry.stop_latched, flag::STOP_LATCHED)
        | bit(telemetry.in_doubt.is_some(), flag::IN_DOUBT)
        | bit(telemetry.limited, flag::LIMITED)
        | bit(!telemetry.obeyed, flag::NOT_OBEYED)
        | bit(telemetry.failed, flag::FAILED)
        | (telemetry.loss as u32) << flag::LOSS_SHIFT;
    let status = if telemetry.stop_latched {
        SystemStatus::FlightTermination
    } else if telemetry.failed || telemetry.state == EngineState::Fault || faulty(telemetry) {
        SystemStatus::Critical
    } else {
        match telemetry.state {
            EngineState::Offline | EngineState::NotKnown => SystemStatus::Uninit,
            EngineState::Stopped | EngineState::Standby | EngineState::Cooling | EngineState::Service => {
                SystemStatus::Standby
            }
            _ => SystemStatus::Active,
        }
    };
    heartbeat_of(custom_mode, status)
}

/// What the heartbeat of the node reports of its engines.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
pub(crate) struct Fleet {
    pub engines: u8,
    pub running: u8,
    /// Engines that need attention.
    pub attention: u8,
}

impl Fleet {
    pub fn count(&mut self, telemetry: &Telemetry) {
        self.engines = self.engines.saturating_add(1);
        self.running = self.running.saturating_add((telemetry.state == EngineState::Running).into());
        self.attention = self.attention.saturating_add(telemetry.needs_attention().into());
    }
}

/// The heartbeat of the node: how many engines it has, how many of them run, how many need attention, and whether the stored settings are
/// damaged.
pub(crate) const fn node_heartbeat(fleet: Fleet, damaged: bool) -> HEARTBEAT_DATA {
    let custom_mode = u32::from_le_bytes([fleet.engines, fleet.running, fleet.attention, damaged as u8]);
    let status = match (fleet.running, fleet.attention) {
        _ if damaged => SystemStatus::Critical,
        (_, 1..) => SystemStatus::Critical,
        (1.., _) => SystemStatus::Active,
        _ => SystemStatus::Standby,
    };
    heartbeat_of(custom_mode, status)
}

/// Sets every field: the default of the generated type is armed.
const fn heartbeat_of(custom_mode: u32, status: SystemStatus) -> HEARTBEAT_DATA {
    HEARTBEAT_DATA {
        custom_mode,
        mavtype: TYPE_GENERIC,
        autopilot: AUTOPILOT_INVALID,
        base_mode: MODE_CUSTOM,
        system_status: status as u8,
        mavlink_version: 3,
    }
}

fn faulty(telemetry: &Telemetry) -> bool {
    telemetry.current(telemetry.report.faults).is_some_and(|faults| !faults.is_empty())
}

/// Throttle that the engine is ordered to, in percent.
fn ordered_percent(telemetry: &Telemetry) -> f32 {
    let percent = match telemetry.ordered.order {
        Order::Run(demand) | Order::Doubt(demand) => match demand {
            Demand::Throttle(throttle) => f32::from(throttle.tenths()) / 10.0,
            Demand::Rpm(rpm) => share(rpm.get(), telemetry.report.max_rpm.map(|max| max.value.get())),
        },
        _ => 0.0,
    };
    percent.clamp(0.0, 100.0)
}

fn share(rpm: u32, max: Option<u32>) -> f32 {
    match max {
        Some(max) if max > 0 => (rpm as f32 * 100.0 / max as f32).clamp(0.0, 100.0),
        _ => 0.0,
    }
}

/// `EFI_STATUS` of an engine, by its place from 0.
pub(crate) fn efi_status(place: usize, telemetry: &Telemetry) -> EFI_STATUS_DATA {
    let report = &telemetry.report;
    let number = |value: Option<u32>| value.unwrap_or(0) as f32;
    let rpm = telemetry.current(report.rpm).map(|rpm| rpm.get());
    let egt = telemetry.current(report.egt).map_or(0.0, |egt| f32::from(egt.tenths()) / 10.0);
    let throttle = telemetry.current(report.throttle).map_or(0.0, |it| f32::from(it.tenths()) / 10.0);
    let volts = telemetry.current(telemetry.supply);
    // 0 is "not known" in this field, and 0.0001 is 0 V.
    let volts = volts.map_or(0.0, |volts| (volts.get() as f32 / 1000.0).max(0.0001));
    let healthy = telemetry.link == LinkState::Up && !telemetry.failed && !faulty(telemetry);
    EFI_STATUS_DATA {
        ecu_index: place as f32,
        rpm: number(rpm),
        fuel_consumed: number(telemetry.current(report.fuel_total).map(|fuel| fuel.get())),
        fuel_flow: number(telemetry.current(report.fuel_flow).map(|flow| flow.get())),
        engine_load: share(rpm.unwrap_or(0), report.max_rpm.map(|max| max.value.get())),
        throttle_position: throttle.clamp(0.0, 100.0),
        spark_dwell_time: 0.0,
        barometric_pressure: number(telemetry.current(report.pressure).map(|pressure| pressure.get()))
            / 1000.0,
        intake_manifold_pressure: 0.0,
        intake_manifold_temperature: 0.0,
        cylinder_head_temperature: egt,
        ignition_timing: 0.0,
        injection_time: 0.0,
        exhaust_gas_temperature: egt,
        throttle_out: ordered_percent(telemetry),
        pt_compensation: 0.0,
        health: u8::from(healthy),
        ignition_voltage: volts,
        fuel_pressure: 0.0,
    }
}

/// Shortest time over which link quality is measured, and the longest time without a frame of a link whose quality is not 0. The frames of an
/// AMT ECU at 2400 baud are 125 ms apart, while values may be sent more often.
const QUALITY_OVER: Duration = Duration::from_secs(1);

/// Numbers of frames at an instant.
#[derive(Clone, Copy, Debug)]
struct Frames {
    good: u32,
    bad: u32,
    at: Instant,
}

/// Share of good frames in the last second or more, in percent.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct LinkQuality {
    /// At the beginning of the measurement.
    from: Option<Frames>,
    /// When they were seen to change last.
    changed: Option<Frames>,
    percent: Option<f32>,
}

impl LinkQuality {
    pub fn percent(&mut self, now: Instant, counters: &Counters) -> Option<f32> {
        let bad =
            counters.crc_failures.wrapping_add(counters.truncated).wrapping_add(counters.damaged_frames);
        let frames = Frames { good: counters.frames, bad, at: now };
        let from = *self.from.get_or_insert(frames);
        let last = self.changed.get_or_insert(frames);
        if (last.good, last.bad) != (frames.good, frames.bad) {
            *last = frames;
        }
        let is_over = |since: Frames| now >= since.at + QUALITY_OVER;
        if is_over(*last) {
            (self.from, self.percent) = (Some(frames), Some(0.0));
        } else if is_over(from) {
            let good = frames.good.wrapping_sub(from.good);
            let all = good.saturating_add(frames.bad.wrapping_sub(from.bad));
            // Without a frame, the last one was less than a second ago: the measurement continues.
            if all > 0 {
                (self.from, self.percent) = (Some(frames), Some(good as f32 * 100.0 / all as f32));
            }
        }
        self.percent
    }
}

/// Names of the named values; the engine's number from 1 follows.
pub(crate) const PUMP_VOLTS: &str = "pumpv";
pub(crate) const REPLY_MARGIN: &str = "margin";
pub(crate) const THRUST: &str = "thrust";
pub(crate) const LINK_QUALITY: &str = "link";
pub(crate) const RPM: &str = "rpm";
pub(crate) const EGT: &str = "egt";
pub(crate) const FUEL_FLOW: &str = "flow";
pub(crate) const THROTTLE: &str = "thr";

/// The named values of an engine that are known. `with_main`: also those in `EFI_STATUS`, if that is not sent.
pub(crate) fn named_values(
    telemetry: &Telemetry,
    link_quality: Option<f32>,
    with_main: bool,
) -> impl Iterator<Item = (&'static str, f32)> {
    let report = &telemetry.report;
    let main = |value: Option<f32>| value.filter(|_| with_main);
    let volts = telemetry.current(report.pump).and_then(|pump| pump.voltage);
    [
        (RPM, main(telemetry.current(report.rpm).map(|rpm| rpm.get() as f32))),
        (EGT, main(telemetry.current(report.egt).map(|egt| f32::from(egt.tenths()) / 10.0))),
        (FUEL_FLOW, main(telemetry.current(report.fuel_flow).map(|flow| flow.get() as f32))),
        (THROTTLE, main(telemetry.current(report.throttle).map(|it| f32::from(it.tenths()) / 10.0))),
        (PUMP_VOLTS, volts.map(|volts| volts.get() as f32 / 1000.0)),
        (
            REPLY_MARGIN,
            telemetry.counters.worst_reply_margin.map(|margin| margin.as_micros() as f32 / 1000.0),
        ),
        (THRUST, telemetry.current(report.thrust).map(|thrust| thrust.get() as f32 / 1000.0)),
        (LINK_QUALITY, link_quality),
    ]
    .into_iter()
    .filter_map(|(name, value)| Some((name, value?)))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Shares in percent that a port shows whose values are sent at this interval, of a link with a frame every 125 ms as an AMT ECU has at
    /// 2400 baud. Each frame up to `until_ms` is good or bad as `is_good` has it.
    fn shown(every_ms: u64, until_ms: u64, is_good: fn(u64) -> bool) -> std::vec::Vec<(u64, f32)> {
        let mut quality = LinkQuality::default();
        let (mut counters, mut received) = (Counters::default(), 0);
        let mut shown = std::vec::Vec::new();
        for ms in (0..10_000).step_by(every_ms as usize) {
            while received * 125 <= ms.min(until_ms) {
                let count = if is_good(received) { &mut counters.frames } else { &mut counters.crc_failures };
                *count += 1;
                received += 1;
            }
            let now = Instant::from_millis(5000 + ms);
            shown.extend(quality.percent(now, &counters).map(|percent| (ms, percent)));
        }
        shown
    }

    #[test]
    fn link_quality_of_a_slow_line_does_not_depend_on_the_interval_of_its_values() {
        for every_ms in [50, 100, 1000] {
            let good = shown(every_ms, u64::MAX, |_| true);
            assert!(good.len() as u64 > 8000 / every_ms, "{}", good.len());
            assert!(good.iter().all(|(_, percent)| *percent == 100.0), "every {every_ms} ms: {good:?}");
            let half = shown(every_ms, u64::MAX, |frame| frame % 2 == 0);
            let fits = half.iter().all(|(_, percent)| (40.0..=60.0).contains(percent));
            assert!(fits, "every {every_ms} ms: {half:?}");
            let bad = shown(every_ms, u64::MAX, |_| false);
            assert!(bad.iter().all(|(_, percent)| *percent == 0.0), "every {every_ms} ms: {bad:?}");
        }
    }

    #[test]
    fn link_quality_is_0_a_second_after_the_last_frame() {
        for every_ms in [50, 100, 1000] {
            let silent = shown(every_ms, 5000, |_| true);
            let is_0 = |ms: u64| ms > 6000 + every_ms;
            assert!(silent.iter().filter(|(ms, _)| *ms < 6000).all(|(_, percent)| *percent == 100.0));
            let silent = silent.iter().filter(|(ms, _)| is_0(*ms));
            assert!(silent.clone().count() > 0 && silent.clone().all(|(_, percent)| *percent == 0.0));
        }
    }
}
