//! A value that moves to its target at a limited rate, exact in integers: nothing is lost between two updates.

use embassy_time::{Duration, Instant};

/// Parts of a unit that are kept between updates.
const PARTS: u64 = 1000;

/// A moving value, in the units of its caller.
#[derive(Clone, Copy, Debug)]
pub(super) struct Ramp {
    parts: u64,
    at: Instant,
}

/// How fast, in units a second. `None`: at once.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) struct Rates {
    pub up: Option<u32>,
    pub down: Option<u32>,
}

impl Rates {
    pub const AT_ONCE: Self = Self { up: None, down: None };
}

impl Ramp {
    pub const fn new(value: u32, at: Instant) -> Self {
        Self { parts: value as u64 * PARTS, at }
    }

    /// Whole units, rounded down on the way up and up on the way down by at most one.
    pub const fn value(&self) -> u32 {
        (self.parts / PARTS) as u32
    }

    /// Moves on to `now`. Gives when to come back, if it is still on its way: after `step` or at its end.
    pub fn follow(&mut self, now: Instant, target: u32, rates: Rates, step: Duration) -> Option<Instant> {
        let target = u64::from(target) * PARTS;
        let passed = now.saturating_duration_since(self.at).as_micros();
        self.at = now;
        let (rate, up) = if target >= self.parts { (rates.up, true) } else { (rates.down, false) };
        let way = target.abs_diff(self.parts);
        // Units a second are parts a millisecond.
        let moved = rate.map_or(way, |rate| (u64::from(rate) * passed / 1000).min(way));
        self.parts = if up { self.parts + moved } else { self.parts - moved };
        let left = way - moved;
        if left == 0 {
            return None;
        }
        let rate = u64::from(rate.unwrap_or(u32::MAX)).max(1);
        let end = Duration::from_micros((left * 1000).div_ceil(rate));
        Some(now + end.min(step))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const STEP: Duration = Duration::from_millis(20);

    fn ms(ms: u64) -> Instant {
        Instant::from_millis(ms)
    }

    #[test]
    fn it_arrives_exactly_when_the_rate_says() {
        let mut ramp = Ramp::new(800, ms(0));
        let rates = Rates { up: None, down: Some(500) };
        let mut now = ms(0);
        while let Some(next) = ramp.follow(now, 0, rates, STEP) {
            assert!(next > now && next <= now + STEP);
            now = next;
        }
        assert_eq!(now, ms(1600));
        assert_eq!(ramp.value(), 0);
    }

    #[test]
    fn slow_rates_lose_nothing_to_many_updates() {
        let mut ramp = Ramp::new(0, ms(0));
        let rates = Rates { up: Some(10), down: None };
        for at in 1..=10_000 {
            ramp.follow(ms(at), 1000, rates, STEP);
        }
        assert_eq!(ramp.value(), 100);
    }

    #[test]
    fn without_a_rate_it_jumps() {
        let mut ramp = Ramp::new(0, ms(0));
        assert_eq!(ramp.follow(ms(1), 700, Rates::AT_ONCE, STEP), None);
        assert_eq!(ramp.value(), 700);
    }
}
