//! Limits notes that may come in any number, and counts the rest.

use super::quantity::seconds;
use embassy_time::{Duration, Instant};

/// Number that passes in [`SPAN`].
const MOST: u32 = 6;
/// See [`MOST`].
const SPAN: Duration = Duration::from_secs(10);

/// Of one engine.
#[derive(Debug)]
pub struct Limiter {
    end: Instant,
    shown: u32,
    hidden: u32,
    /// When the first one was held back.
    since: Instant,
}

impl Limiter {
    /// Nothing has come.
    pub const fn new() -> Self {
        Self { end: Instant::MIN, shown: 0, hidden: 0, since: Instant::MIN }
    }

    /// Whether one more is shown. [`Limiter::over`] comes first.
    pub fn lets_through(&mut self, now: Instant) -> bool {
        if now >= self.end {
            (self.end, self.shown) = (now + SPAN, 0);
        }
        if self.shown < MOST {
            self.shown += 1;
            return true;
        }
        if self.hidden == 0 {
            self.since = now;
        }
        self.hidden += 1;
        false
    }

    /// The line for those that were held back, when their time is over.
    pub fn over(&mut self, now: Instant) -> Option<String> {
        if now >= self.end { self.rest() } else { None }
    }

    /// The same, at any time.
    pub fn rest(&mut self) -> Option<String> {
        let hidden = core::mem::take(&mut self.hidden);
        let events = if hidden == 1 { "event" } else { "events" };
        (hidden > 0).then(|| {
            format!("({hidden} {events} not shown since {:.1} s)", seconds(self.since - Instant::MIN))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(tenths: u64) -> Instant {
        Instant::MIN + Duration::from_millis(100 * tenths)
    }

    #[test]
    fn six_in_ten_seconds_and_the_rest_is_counted() {
        let mut limiter = Limiter::new();
        let through = (0..8).filter(|&tenths| limiter.lets_through(at(20 + tenths))).count();
        assert_eq!((through, limiter.over(at(119))), (6, None));
        assert_eq!(limiter.over(at(120)).as_deref(), Some("(2 events not shown since 2.6 s)"));
        assert_eq!(limiter.over(at(121)), None);
        assert!(limiter.lets_through(at(121)));
    }

    #[test]
    fn the_rest_is_reported_at_the_end() {
        let mut limiter = Limiter::new();
        assert_eq!(limiter.rest(), None);
        for _ in 0..7 {
            limiter.lets_through(at(5));
        }
        assert_eq!(limiter.rest().as_deref(), Some("(1 event not shown since 0.5 s)"));
        assert_eq!(limiter.rest(), None);
    }
}
