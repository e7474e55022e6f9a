//! Speed control over the throttle, for ECUs without one: a PI controller in integers.
//!
//! Each new shaft speed sets a throttle. The output falls there at once, and rises there at its rate, also where speeds are missing. It is
//! limited in authority, and its integral is held while the output is at a limit. With telemetry older than its timeout the throttle goes
//! to idle.

use super::config::Governor as Config;
use crate::report::Timed;
use crate::units::{Rpm, Throttle};
use embassy_time::{Duration, Instant};

/// Interval between two updates of an output that rises.
const STEP: Duration = Duration::from_millis(20);

/// Resolution of the integral: parts of 0.1 %.
const PARTS: i64 = 1_000_000;

/// Rate of fall of a shaft, in rpm/s, above which fuel no longer accelerates it.
const FALLING: u32 = 5000;

/// Sets a throttle for a shaft speed.
#[derive(Clone, Copy, Debug)]
pub(super) struct Governor {
    config: Config,
    /// In parts of 0.1 %.
    integral: i64,
    /// In parts of 0.1 %: now, and where it moves to.
    output: i64,
    target: i64,
    at: Instant,
    seen: Option<Timed<Rpm>>,
}

impl Governor {
    /// Begins at the throttle in force.
    pub const fn new(now: Instant, config: Config, throttle: Throttle) -> Self {
        let parts = throttle.tenths() as i64 * PARTS;
        Self { config, integral: parts, output: parts, target: parts, at: now, seen: None }
    }

    /// The throttle for a target, and the time of its next step, or at which the telemetry is too old.
    pub fn throttle(&mut self, now: Instant, target: Rpm, rpm: Option<Timed<Rpm>>) -> (Throttle, Instant) {
        match rpm.filter(|rpm| now < rpm.at + self.config.max_age) {
            None => {
                // Never hold a throttle without a speed.
                (self.output, self.target, self.at) = (0, 0, now);
                self.integral = 0;
                self.seen = None;
                (Throttle::IDLE, now + self.config.max_age)
            }
            Some(rpm) => {
                self.advance(now);
                if self.seen.map(|seen| seen.at) != Some(rpm.at) {
                    // Not more than 0.5 s: a gap must not become one big step.
                    let elapsed = self
                        .seen
                        .map_or(Duration::from_ticks(0), |seen| rpm.at.saturating_duration_since(seen.at));
                    let elapsed = elapsed.min(Duration::from_millis(500));
                    let fall = self.seen.map_or(0, |seen| seen.value.get().saturating_sub(rpm.value.get()));
                    let falls = u64::from(fall) * 1_000_000 > u64::from(FALLING) * elapsed.as_micros();
                    self.seen = Some(rpm);
                    self.step(target, rpm.value, elapsed, falls && elapsed.as_ticks() > 0);
                    self.advance(now);
                }
                let tenths = u16::try_from(self.output / PARTS).unwrap_or(0);
                let throttle = Throttle::from_tenths(tenths).unwrap_or(Throttle::IDLE);
                let old_at = rpm.at + self.config.max_age;
                (throttle, if self.output < self.target { old_at.min(now + STEP) } else { old_at })
            }
        }
    }

    /// Moves the output up to now.
    fn advance(&mut self, now: Instant) {
        let elapsed = now.saturating_duration_since(self.at).as_micros();
        self.at = self.at.max(now);
        let rise = u64::from(self.config.slew).saturating_mul(elapsed);
        self.output = self.output.saturating_add(i64::try_from(rise).unwrap_or(i64::MAX)).min(self.target);
    }

    fn step(&mut self, target: Rpm, rpm: Rpm, elapsed: Duration, falls: bool) {
        let micros = elapsed.as_micros() as i64;
        let error = i64::from(target.get()) - i64::from(rpm.get());
        // Gains are for 1000 rpm, the integral's for a second: µs and parts cancel out.
        let proportional = error * i64::from(self.config.proportional) * PARTS / 1000;
        let step = error * i64::from(self.config.integral) * micros / 1000;
        let highest = i64::from(self.config.authority.tenths()) * PARTS;
        // A shaft that falls although the throttle was not lowered has no flame: more fuel would only flood it.
        let rise = if falls { 0 } else { i64::from(self.config.slew) * micros };
        let risen = self.output + rise;
        let wanted = self.integral + step + proportional;
        let limit = highest.min(risen);
        // Anti-windup: no further into a limit.
        if !(wanted > limit && step > 0 || wanted < 0 && step < 0) {
            self.integral = (self.integral + step).clamp(0, highest);
        }
        self.target = (self.integral + proportional).clamp(0, limit.max(0));
    }
}
