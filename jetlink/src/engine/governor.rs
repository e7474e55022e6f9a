//! Speed control over the throttle, for ECUs without one: a PI controller in integers.
//!
//! Each new shaft speed sets a throttle. The output falls there at once, and rises there at its rate, also where speeds are missing. It is
//! limited in authority, and its integral is held while the output is at a limit. With telemetry older than its timeout the throttle goes
//! to idle.

use super::config::Governor as Config;
use super::ramp::{Ramp, Rates};
use crate::report::Timed;
use crate::units::{Rpm, Throttle};
use embassy_time::{Duration, Instant};

/// Resolution of the integral: parts of 0.1 %.
const PARTS: i64 = 1_000_000;
/// The same of the output: a slow rise is less than 0.1 % from speed to speed.
const OUTPUT_PARTS: u32 = 1000;
/// One part of the output, in those of the integral.
const OUTPUT_PART: i64 = PARTS / OUTPUT_PARTS as i64;

/// Rate of fall of a shaft, in rpm/s, above which fuel no longer accelerates it.
const FALLING: u32 = 5000;

/// Time over which the last but one speed also shows it. An AMT ECU reports its speed in steps of 500 or 700 rpm, and 500 rpm from one set to
/// the next are less than [`FALLING`].
const FALLING_OVER: Duration = Duration::from_millis(400);

/// Sets a throttle for a shaft speed.
#[derive(Clone, Copy, Debug)]
pub(super) struct Governor {
    /// In parts of 0.1 %.
    integral: i64,
    /// Throttle for the last shaft speed, in parts of 0.1 %.
    wanted: u32,
    /// Throttle that moves there, in the same parts: speeds that come seldom make no large steps.
    output: Ramp,
    /// The last speed, and the one before it.
    seen: Option<Timed<Rpm>>,
    before: Option<Timed<Rpm>>,
}

impl Governor {
    /// Begins at the throttle in force.
    pub const fn new(now: Instant, throttle: Throttle) -> Self {
        let tenths = throttle.tenths();
        Self {
            integral: tenths as i64 * PARTS,
            wanted: tenths as u32 * OUTPUT_PARTS,
            output: Ramp::new(tenths as u32 * OUTPUT_PARTS, now),
            seen: None,
            before: None,
        }
    }

    /// The throttle for a target, and the time of its next step, or at which the telemetry is too old.
    pub fn throttle(
        &mut self,
        now: Instant,
        config: &Config,
        target: Rpm,
        rpm: Option<Timed<Rpm>>,
    ) -> (Throttle, Instant) {
        let Some(rpm) = rpm.filter(|rpm| now < rpm.at + config.max_age) else {
            // Never hold a throttle without a speed.
            *self = Self::new(now, Throttle::IDLE);
            return (Throttle::IDLE, now + config.max_age);
        };
        if self.seen.map(|seen| seen.at) != Some(rpm.at) {
            // Not more than 0.5 s: a gap must not become one big step.
            let since = |before: Timed<Rpm>| {
                rpm.at.saturating_duration_since(before.at).min(Duration::from_millis(500))
            };
            let falls = |before: Timed<Rpm>| {
                let fall = before.value.get().saturating_sub(rpm.value.get());
                let elapsed = since(before).as_micros();
                elapsed > 0 && u64::from(fall) * 1_000_000 > u64::from(FALLING) * elapsed
            };
            let before = self.before.filter(|before| since(*before) < FALLING_OVER);
            let falls = self.seen.is_some_and(falls) || before.is_some_and(falls);
            let elapsed = self.seen.map_or(Duration::from_ticks(0), since);
            self.before = self.seen.replace(rpm);
            self.step(config, target, rpm.value, elapsed, falls);
        }
        let rates = Rates { up: Some(u32::from(config.slew) * OUTPUT_PARTS), down: None };
        let next = self.output.follow(now, self.wanted, rates);
        let tenths = u16::try_from(self.output.value() / OUTPUT_PARTS).unwrap_or(0);
        let old_at = rpm.at + config.max_age;
        let throttle = Throttle::from_tenths(tenths).unwrap_or(Throttle::IDLE);
        (throttle, next.map_or(old_at, |next| next.min(old_at)))
    }

    fn step(&mut self, config: &Config, target: Rpm, rpm: Rpm, elapsed: Duration, falls: bool) {
        let micros = elapsed.as_micros() as i64;
        let error = i64::from(target.get()) - i64::from(rpm.get());
        // Gains are for 1000 rpm, the integral's for a second: µs and parts cancel out.
        let proportional = error * i64::from(config.proportional) * PARTS / 1000;
        let step = error * i64::from(config.integral) * micros / 1000;
        let highest = i64::from(config.authority.tenths()) * PARTS;
        // A shaft that falls although the throttle was not lowered has no flame: more fuel would only flood it.
        let rise = if falls { 0 } else { i64::from(config.slew) * micros };
        // Not more than it rises until the next speed: without one it stays there.
        let limit = highest.min(i64::from(self.output.value()) * OUTPUT_PART + rise);
        // Anti-windup: up to a limit, and not further into it.
        let room = limit - self.integral - proportional;
        let step =
            if step > 0 { step.min(room.max(0)) } else { step.max(-(self.integral + proportional).max(0)) };
        self.integral = (self.integral + step).clamp(0, highest);
        let wanted = (self.integral + proportional).clamp(0, limit.max(0));
        self.wanted = u32::try_from(wanted / OUTPUT_PART).unwrap_or(0);
    }
}
