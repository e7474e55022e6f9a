//! A value that moves to its target at a limited rate, exact in integers: nothing is lost between two updates.

use embassy_time::{Duration, Instant};

/// Resolution between updates: parts of a unit.
const PARTS: u64 = 1000;
/// Interval between two updates of a value that moves.
const STEP: Duration = Duration::from_millis(20);

/// A moving value, in the units of its caller.
#[derive(Clone, Copy, Debug)]
pub(super) struct Ramp {
    parts: u64,
    at: Instant,
    target: u64,
    rates: Rates,
}

/// Rates, in units a second. `None`: at once.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) struct Rates {
    pub up: Option<u32>,
    pub down: Option<u32>,
}

impl Rates {
    pub const AT_ONCE: Self = Self { up: None, down: None };
}

impl Ramp {
    /// At rest.
    pub const fn new(value: u32, at: Instant) -> Self {
        let parts = value as u64 * PARTS;
        Self { parts, at, target: parts, rates: Rates::AT_ONCE }
    }

    /// Whole units, rounded down.
    pub const fn value(&self) -> u32 {
        (self.parts / PARTS) as u32
    }

    /// Moves towards the previous target until `now`, then towards `target`. Returns the time of the next update while the
    /// target is not reached: after 20 ms, or at its end.
    pub fn follow(&mut self, now: Instant, target: u32, rates: Rates) -> Option<Instant> {
        self.advance(now);
        self.target = u64::from(target) * PARTS;
        self.rates = rates;
        // Without a rate the target is reached at once.
        self.advance(now);
        let left = self.target.abs_diff(self.parts);
        let rate = self.rate().filter(|_| left > 0)?;
        // Units a second are parts a millisecond.
        let end = Duration::from_micros((left * 1000).div_ceil(u64::from(rate.max(1))));
        Some(now + end.min(STEP))
    }

    fn advance(&mut self, now: Instant) {
        let elapsed = now.saturating_duration_since(self.at).as_micros();
        self.at = self.at.max(now);
        let way = self.target.abs_diff(self.parts);
        let moved = self.rate().map_or(way, |rate| (u64::from(rate) * elapsed / 1000).min(way));
        self.parts = if self.target >= self.parts { self.parts + moved } else { self.parts - moved };
    }

    const fn rate(&self) -> Option<u32> {
        if self.target >= self.parts { self.rates.up } else { self.rates.down }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ms(ms: u64) -> Instant {
        Instant::from_millis(ms)
    }

    #[test]
    fn it_arrives_exactly_at_the_time_of_the_rate() {
        let mut ramp = Ramp::new(800, ms(0));
        let rates = Rates { up: None, down: Some(500) };
        let mut now = ms(0);
        while let Some(next) = ramp.follow(now, 0, rates) {
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
        for at in 0..=10_000 {
            ramp.follow(ms(at), 1000, rates);
        }
        assert_eq!(ramp.value(), 100);
    }

    #[test]
    fn time_at_rest_does_not_count() {
        let mut ramp = Ramp::new(800, ms(0));
        ramp.follow(ms(5000), 0, Rates { up: None, down: Some(500) });
        assert_eq!(ramp.value(), 800);
        ramp.follow(ms(5100), 0, Rates { up: None, down: Some(500) });
        assert_eq!(ramp.value(), 750);
    }

    #[test]
    fn without_a_rate_it_jumps() {
        let mut ramp = Ramp::new(0, ms(0));
        assert_eq!(ramp.follow(ms(1), 700, Rates::AT_ONCE), None);
        assert_eq!(ramp.value(), 700);
    }
}
